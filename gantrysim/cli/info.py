"""The tables of `gantrysim info`: an overview, machines and jobs, settings, gains and margins, keys of a job."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from dataclasses import fields
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table

from gantrysim.base.errors import InputError, meant_names, nearest, short_text
from gantrysim.cli.machine import describe
from gantrysim.cli.terminal import say, show
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.glue.dispenser.syringe import Syringe
from gantrysim.job.key_list import Key, controller_keys, sections
from gantrysim.job.loading import builtin_jobs, job_text, read_job
from gantrysim.job.programs import PROGRAMS, described_fields
from gantrysim.job.settings import INTEGRAL_TIME, ServoSettings
from gantrysim.machine.design.library import counts_of, encoder_names, motor_names, motor_of
from gantrysim.machine.machine import Machine, builtin_models
from gantrysim.servo.request import DERIVED_VALUES
from gantrysim.servo.servo import Servo
from gantrysim.servo.stability.margins import Plant

_KG_CM2 = 1e4  # in a kg·m²


def _table(title: str, texts: Iterable[str], numbers: Iterable[str] = (), caption: str | None = None) -> Table:
    """Return a table without rows: columns of text, the last of them wrapped, then columns of numbers."""
    table = Table(title=title, title_justify="left", caption=caption, caption_justify="left")
    *names, last = texts
    for name in names:
        table.add_column(name, no_wrap=True)
    table.add_column(last)
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def machines_table() -> Table:
    """Return the built-in machines, a row per axis."""
    table = _table(
        "built-in machines",
        ("machine", "axis"),
        ("travel", "speed", "acceleration", "encoder"),
        "acceleration: from rest, with the peak torque against inertia and Coulomb friction",
    )
    for name in builtin_models():
        for a, axis in enumerate(Machine(name).axes):
            acceleration = (axis.peak_torque - axis.coulomb) / axis.inertia
            table.add_row(
                "" if a else name,
                axis.name,
                f"{axis.travel[0]:g} to {axis.travel[1]:g} {axis.unit}",
                f"{axis.speed_limit:g} {axis.unit}/s",
                f"{acceleration:.3g} {axis.unit}/s²",
                f"{1e3 * axis.resolution:.3g} {'µm' if axis.unit == 'mm' else 'mdeg'}",
            )
        table.add_section()
    return table


def jobs_table() -> Table:
    """Return the built-in jobs, described by the comments of their files."""
    table = _table("built-in jobs", ("job", "machine", "controller", "description"))
    for name in builtin_jobs():
        # not the job itself, which may need packages that are not installed
        content = read_job(name).content
        comment = [line.removeprefix("#").strip() for line in job_text(name).splitlines() if line.startswith("#")]
        table.add_row(name, content["machine"], content["program"]["controller"], escape(" ".join(comment)))
    return table


def _default_text(value: str | float | None) -> str:
    if value is None:
        return "derived"
    return value if isinstance(value, str) else f"{value:g}"


def settings_table() -> Table:
    """Return the servo settings with their defaults."""
    table = _table("servo settings, as in --set servo.damping=0.7", ("setting", "default", "description"))
    for name, field in ServoSettings.model_fields.items():
        table.add_row(name, _default_text(field.default), escape(field.description or ""))
    table.caption = "derived: from the axes, unless given as one number or a list of one per axis"
    return table


def glue_table() -> Table:
    """Return the settings of dispenser, needle, syringe and bead with their defaults."""
    table = _table(
        "dispenser and bead settings, as in --set dispenser.dead_time=0.01", ("setting", "default", "description")
    )
    kinds = (
        ("dispenser", Dispenser),
        ("dispenser.needle", Needle),
        ("dispenser.syringe", Syringe),
        ("bead", BeadSettings),
    )
    for prefix, kind in kinds:
        descriptions = described_fields(kind)
        for field in fields(kind):
            default = field.default
            text = f"{default:g}" if isinstance(default, float) else str(default).lower()
            table.add_row(f"{prefix}.{field.name}", text, escape(descriptions.get(field.name, "")))
        table.add_section()
    return table


def gains_table(period: float = ServoSettings().period) -> Table:
    """Return the default gains of each machine at a servo period [s]."""
    servos = {name: Servo.derive(Machine(name).axes, period, integral_time=INTEGRAL_TIME) for name in builtin_models()}
    # the machine's own, or the same for all
    hidden = ("resolution", "torque_limit", "notch_width", "notch_depth")
    shown = [
        g
        for g in DERIVED_VALUES
        if g.name not in hidden and any(any(servo.per_axis(g.name)) for servo in servos.values())
    ]
    units = ", ".join(f"{g.name} {g.unit}" for g in shown)
    table = _table(
        f"default gains at a servo period of {1e3 * period:g} ms and an integral time of {INTEGRAL_TIME:g} s",
        ("machine", "axis"),
        (
            "Hz",
            *(g.name.replace("notch_frequency", "notch_Hz").replace("_", "\n") for g in shown),
        ),
        f"Hz: natural frequency; {units}; u: mm or deg",
    )
    for name, servo in servos.items():
        axes = Machine(name).axes
        for a, axis in enumerate(axes):
            frequency = math.sqrt(servo.gains[a].kp / axis.inertia) / (2 * math.pi)
            values = [servo.per_axis(parameter.name)[a] for parameter in shown]
            gains = [f"{value:.3g}" if value else "–" for value in values]
            table.add_row("" if a else name, axis.name, f"{frequency:.1f}", *gains)
        table.add_section()
    return table


def margins_table(period: float = ServoSettings().period) -> Table:
    """Return the stability margins of each machine with the default gains at a servo period [s]."""
    table = _table(
        f"stability margins with these gains at a servo period of {1e3 * period:g} ms",
        ("machine", "axis"),
        ("gain", "phase\n\\[deg]", "delay\n\\[ms]", "peak\nof |S|", "crossover\n\\[Hz]"),
        "at home, without Coulomb friction; gain: factor on all gains of the axis",
    )
    for name in builtin_models():
        machine = Machine(name)
        servo = Servo.derive(machine.axes, period, integral_time=INTEGRAL_TIME)
        all_margins = Plant.of(machine, period).margins(servo)
        for a, (axis, margins) in enumerate(zip(machine.axes, all_margins, strict=True)):
            table.add_row(
                "" if a else name,
                axis.name,
                f"{margins.gain:.2f}",
                f"{margins.phase:.0f}",
                f"{1e3 * margins.delay:.2f}",
                f"{margins.sensitivity:.2f}",
                f"{margins.crossover:.1f}",
            )
        table.add_section()
    return table


def motors_table() -> Table:
    """Return the motors that a machine's table may name."""
    table = _table(
        "motors of the library",
        ("motor", "kind"),
        ("bus\n\\[V]", "torque\n\\[N·m]", "peak\n\\[A]", "rotor\n\\[kg·cm²]"),
        caption="torque: continuous; a machine's table names them, or has the values of a data sheet",
    )
    for name in motor_names():
        motor = motor_of(name)
        values = (motor.voltage, motor.continuous, motor.current, _KG_CM2 * motor.rotor_inertia)
        table.add_row(name, motor.kind, *(f"{value:.3g}" for value in values))
    return table


def encoders_table() -> Table:
    """Return the encoders that a machine's table may name."""
    table = _table("encoders of the library", ("encoder",), ("counts per revolution",))
    for name in encoder_names():
        table.add_row(name, f"{counts_of(name):,.0f}")
    return table


def keys_table(title: str, keys: Iterable[Key]) -> Table:
    """Return keys of a job with defaults and meanings."""
    table = Table(title=escape(title), title_justify="left")
    table.add_column("key", no_wrap=True)
    table.add_column("default")
    table.add_column("meaning")
    for key in keys:
        table.add_row(escape(key.name), escape(key.default), escape(key.meaning))
    return table


class Kind(NamedTuple):
    """Tables that `gantrysim info` prints by one name.

    Attributes:
        tables: makes them.
        content: what they hold, in a line.
    """

    tables: Callable[[], Iterable[Table]]
    content: str


KINDS = {
    "machines": Kind(lambda: [machines_table()], "axes with travel, speed, acceleration, encoder"),
    "jobs": Kind(lambda: [jobs_table()], "what each job does"),
    "servo": Kind(lambda: [settings_table()], "servo settings with their defaults"),
    "glue": Kind(lambda: [glue_table()], "settings of dispenser, needle, syringe, bead"),
    "gains": Kind(lambda: [gains_table(), margins_table()], "default gains, with their stability margins"),
    "motors": Kind(lambda: [motors_table(), encoders_table()], "motors and encoders for a machine's table"),
    "keys": Kind(
        lambda: [keys_table(title.replace("`", ""), keys) for title, keys in sections().items()],
        "all keys of a job",
    ),
}


def overview_table() -> Table:
    """Return the names that `gantrysim info` takes, on one screen of 24 lines of 80 characters."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column()
    for k, name in enumerate(builtin_models()):
        table.add_row("" if k else "machines", f"{name}: axes {', '.join(axis.name for axis in Machine(name).axes)}")
    table.add_row("jobs", ", ".join(builtin_jobs()))
    table.add_row("controllers", ", ".join(PROGRAMS))
    table.add_row("", "")
    table.add_row("gantrysim info", "")
    for name, kind in KINDS.items():
        table.add_row(f"  {name}", kind.content)
    table.add_row("  NAME", "one machine, job, controller, or key, as in servo.damping")
    return table


# What `gantrysim info NAME` prints: one machine, job, controller or key, or all of a kind.


def show_name(name: str) -> None:
    """Print what a name stands for: a machine, job or controller, a key in full or its last part, or one of `KINDS`.

    Raises:
        InputError: none of these.
    """
    tables = sections()
    if name in builtin_models():
        describe(Machine(name), None)
    elif name in builtin_jobs():
        say(job_text(name).rstrip())
    elif name in PROGRAMS:
        say((inspect.getdoc(PROGRAMS[name]) or "").split("\n\n")[0], wrap=True)
        show(keys_table(f'keys of [program] with controller = "{name}"', controller_keys(name)))
    elif name in KINDS:
        for table in KINDS[name].tables():
            show(table)
    elif named := _named_keys(name, tables):
        for title, keys in named.items():
            show(keys_table(title.replace("`", ""), keys))
    else:
        raise _unknown_name(name, tables)


def _named_keys(name: str, tables: dict[str, list[Key]]) -> dict[str, list[Key]]:
    """Return the keys of a name in full, or else those that end with it, by their tables."""
    in_full = {title: [key for key in keys if key.name == name] for title, keys in tables.items()}
    ending = {title: [key for key in keys if key.name.endswith(f".{name}")] for title, keys in tables.items()}
    named = in_full if any(in_full.values()) else ending
    return {title: keys for title, keys in named.items() if keys}


def _unknown_name(name: str, tables: dict[str, list[Key]]) -> InputError:
    keys = [key.name for table in tables.values() for key in table]
    question = meant_names(nearest(name, {*builtin_models(), *builtin_jobs(), *PROGRAMS, *KINDS, *keys}))
    return InputError(
        f"unknown name {short_text(name)}: {f'{question} ' if question else ''}"
        "gantrysim info lists machines and jobs, gantrysim info keys all keys"
    )
