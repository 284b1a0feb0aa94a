"""The section of a run's report on its servo: gains, stability margins, torque ripple."""

from __future__ import annotations

import math

from gantrysim.controllers.servo import GAINS, Servo
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import torque_ripple
from gantrysim.report.document import Column, Section, Table
from gantrysim.run import Run
from gantrysim.stability.margins import Margins, margins_of


def servo_section(job: Job, machine: Machine, run: Run) -> Section:
    """Return the section of the servo of a job on the machine of its run."""
    margins = margins_of(machine, job.built_servo, job.simulation.physics_step)
    return Section(
        "Servo", _text(machine, margins), table=[_gains(machine, job.built_servo), _margins(machine, margins, run)]
    )


def _margins(machine: Machine, margins: tuple[Margins, ...] | None, run: Run) -> Table:
    columns: list[str | Column] = [
        "axis",
        Column("gain margin", ".2f"),
        Column("lower gain margin", ".2f"),
        Column("phase margin [deg]", ".1f"),
        Column("delay margin [ms]", ".2f"),
        Column("peak of |S|", ".2f"),
        Column("crossover [Hz]", ".1f"),
        Column("torque ripple [N·m]", ".2g"),
        Column("of the peak torque [%]", ".2f"),
    ]
    rows: list[list[str | float | None]] = []
    for a, (axis, ripple) in enumerate(zip(machine.axes, torque_ripple(run).tolist(), strict=True)):
        numbers: list[float | None] = [None] * 6
        if margins is not None:
            m = margins[a]
            finite = (m.gain, m.gain_lower, m.phase, 1e3 * m.delay, m.sensitivity, m.crossover)
            numbers = [value if math.isfinite(value) else None for value in finite]
        rows.append([axis.name, *numbers, ripple, 100 * ripple / axis.peak_torque])
    return Table(
        columns, rows, "Stability margins at home, without Coulomb friction; torque ripple while the dispenser is on"
    )


def _gains(machine: Machine, servo: Servo) -> Table:
    rows = [
        [axis.name, axis.unit, *(getattr(servo, gain.name)[a] for gain in GAINS)] for a, axis in enumerate(machine.axes)
    ]
    columns = [Column(f"{gain.name} [{gain.unit}]") for gain in GAINS]
    return Table(["axis", "u", *columns], rows, "Gains")


def _text(machine: Machine, margins: tuple[Margins, ...] | None) -> str:
    if margins is None:
        return "Stability margins are unknown: an actuator of the machine has a delay of its own."
    by_axis = dict(zip((axis.name for axis in machine.axes), margins, strict=True))
    unstable = [name for name, axis_margins in by_axis.items() if not axis_margins.stable]
    if unstable:
        return f"Unstable, Coulomb friction neglected: {', '.join(unstable)}."
    least = min(by_axis, key=lambda name: by_axis[name].gain)
    return f"Axis {least} has the smallest gain margin: {by_axis[least].gain:.2f}."
