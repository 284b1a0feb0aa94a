"""What comes along: tables of the built-in machines, the jobs, the settings, and the servo's gains."""

from __future__ import annotations

import math
from dataclasses import fields

from rich.markup import escape
from rich.table import Table

from gantrysim.bead import BeadSettings
from gantrysim.controllers.programs import described
from gantrysim.controllers.servo import DERIVED, Servo
from gantrysim.job.job import Job, ServoSettings, builtin_jobs, job_text
from gantrysim.machine.axis import Axis
from gantrysim.machine.dispenser import Dispenser
from gantrysim.machine.machine import Machine, builtin_models
from gantrysim.machine.needle import Needle
from gantrysim.stability.margins import Plant


def machines_table() -> Table:
    """The built-in machines, an axis to a row."""
    table = Table(title="machines", title_justify="left")
    for name, justify in (
        ("machine", "left"),
        ("axis", "left"),
        ("travel", "right"),
        ("speed", "right"),
        ("acceleration", "right"),
        ("encoder", "right"),
    ):
        table.add_column(name, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    for name in builtin_models():
        for first, axis in enumerate(Machine(name).axes):
            table.add_row(
                "" if first else name,
                axis.name,
                f"{axis.travel[0]:g} to {axis.travel[1]:g} {axis.unit}",
                f"{axis.speed_limit:g} {axis.unit}/s",
                f"{_acceleration(axis):.3g} {axis.unit}/s²",
                f"{1e3 * axis.resolution:.3g} {'µm' if axis.unit == 'mm' else 'mdeg'}",
            )
        table.add_section()
    table.caption = "acceleration: of the peak torque against inertia and Coulomb friction, at rest"
    return table


def _acceleration(axis: Axis) -> float:
    return (axis.peak_torque - axis.coulomb) / axis.inertia


def jobs_table() -> Table:
    """The built-in jobs."""
    table = Table(title="jobs", title_justify="left")
    for name in ("job", "machine", "controller", "what"):
        table.add_column(name, no_wrap=name != "what")
    for name in builtin_jobs():
        job = Job.load(name)
        comment = [line.removeprefix("#").strip() for line in job_text(name).splitlines() if line.startswith("#")]
        table.add_row(name, job.machine, str(job.program["controller"]), escape(" ".join(comment)))
    return table


def settings_table() -> Table:
    """The servo's settings with their defaults."""
    table = Table(title="servo settings, as in --set servo.damping=0.7", title_justify="left")
    table.add_column("setting", no_wrap=True)
    table.add_column("default", no_wrap=True)
    table.add_column("what")
    for name, field in ServoSettings.model_fields.items():
        default = "derived" if field.default is None else f"{field.default:g}"
        table.add_row(name, default, escape(field.description or ""))
    table.caption = "derived: from the axes, unless given as one number or a list of one per axis"
    return table


def glue_table() -> Table:
    """The settings of dispenser, needle and bead with their defaults."""
    table = Table(title="settings of the glue, as in --set dispenser.dead_time=0.01", title_justify="left")
    table.add_column("setting", no_wrap=True)
    table.add_column("default", no_wrap=True)
    table.add_column("what")
    for prefix, kind in (("dispenser", Dispenser), ("dispenser.needle", Needle), ("bead", BeadSettings)):
        said = described(kind)
        for field in fields(kind):
            default = field.default
            text = "none" if default is None else f"{default:g}" if isinstance(default, float) else str(default).lower()
            table.add_row(f"{prefix}.{field.name}", text, escape(said.get(field.name, "")))
        table.add_section()
    return table


def gains_table(period: float = ServoSettings().period) -> Table:
    """The gains that follow for every machine at a servo period [s]."""
    table = Table(title=f"gains that follow at a period of {1e3 * period:g} ms", title_justify="left", pad_edge=False)
    table.add_column("machine", no_wrap=True)
    table.add_column("axis", no_wrap=True)
    servos = {name: Servo.derive(Machine(name).axes, period) for name in builtin_models()}
    shown = [g for g in DERIVED if g.name != "resolution" and any(any(getattr(s, g.name)) for s in servos.values())]
    for column in ("Hz", *(g.name.replace("_", "\n_") for g in shown)):
        table.add_column(column, justify="right", no_wrap=True)
    for name, servo in servos.items():
        axes = Machine(name).axes
        for a, axis in enumerate(axes):
            frequency = math.sqrt(servo.kp[a] / axis.inertia) / (2 * math.pi)
            gains = [f"{getattr(servo, g.name)[a]:.3g}" for g in shown]
            table.add_row("" if a else name, axis.name, f"{frequency:.1f}", *gains)
        table.add_section()
    units = ", ".join(f"{g.name} {g.unit}" for g in shown)
    table.caption = f"Hz: natural frequency; {units}; u is mm or deg"
    return table


def margins_table(period: float = ServoSettings().period) -> Table:
    """How far every machine is from instability with the gains that follow at a servo period [s]."""
    table = Table(title=f"stability margins with these gains at a period of {1e3 * period:g} ms", title_justify="left")
    for name in ("machine", "axis"):
        table.add_column(name, no_wrap=True)
    for name in ("gain", "phase\n\\[deg]", "delay\n\\[ms]", "peak\nof |S|", "crossover\n\\[Hz]"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in builtin_models():
        machine = Machine(name)
        found = Plant.of(machine, period).margins(Servo.derive(machine.axes, period))
        for a, (axis, margins) in enumerate(zip(machine.axes, found, strict=True)):
            numbers = (
                f"{margins.gain:.2f}",
                f"{margins.phase:.0f}",
                f"{1e3 * margins.delay:.2f}",
                f"{margins.sensitivity:.2f}",
                f"{margins.crossover:.1f}",
            )
            table.add_row("" if a else name, axis.name, *numbers)
        table.add_section()
    table.caption = "of the moving axis at home, without Coulomb friction; gain: factor on all gains of the axis"
    return table
