"""The section of a run's report that shows its servo: gains, margins of the loops, ripple of the torque."""

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
    """Return the section of the servo of a job, on the machine that ran."""
    servo = job.built_servo
    found = margins_of(machine, servo, job.simulation.physics_step)
    ripple = torque_ripple(run)
    columns: list[str | Column] = [
        "axis",
        Column("gain margin", ".2f"),
        Column("down to", ".2f"),
        Column("phase margin [deg]", ".1f"),
        Column("delay margin [ms]", ".2f"),
        Column("peak of |S|", ".2f"),
        Column("crossover [Hz]", ".1f"),
        Column("torque ripple [N·m]", ".2g"),
        Column("of the peak torque [%]", ".2f"),
    ]
    rows = [
        [
            axis.name,
            *(_row(found[a]) if found else [None] * 6),
            float(ripple[a]),
            100 * float(ripple[a]) / axis.peak_torque,
        ]
        for a, axis in enumerate(machine.axes)
    ]
    margins = Table(
        columns,
        rows,
        "How far the loop of each moving axis is from instability at home, without Coulomb friction, and how restless "
        "its torque demand is while the dispenser is on",
    )
    return Section("Servo", _words(machine, found), table=[_gains(machine, servo), margins])


def _gains(machine: Machine, servo: Servo) -> Table:
    rows = [
        [axis.name, axis.unit, *(getattr(servo, gain.name)[a] for gain in GAINS)] for a, axis in enumerate(machine.axes)
    ]
    columns = [Column(f"{gain.name} [{gain.unit}]") for gain in GAINS]
    return Table(["axis", "u", *columns], rows, "Gains")


def _row(margins: Margins) -> list[float | None]:
    numbers = (
        margins.gain,
        margins.gain_lower,
        margins.phase,
        1e3 * margins.delay,
        margins.sensitivity,
        margins.crossover,
    )
    return [value if math.isfinite(value) else None for value in numbers]


def _words(machine: Machine, found: tuple[Margins, ...] | None) -> list[str]:
    if found is None:
        return ["The machine has an actuator with a delay of its own, so the margins of its loops are not known."]
    unstable = [axis.name for axis, margins in zip(machine.axes, found, strict=True) if not margins.stable]
    if unstable:
        loops = f"loops of {' and '.join(unstable)} are" if len(unstable) > 1 else f"loop of {unstable[0]} is"
        return [f"Coulomb friction apart, the {loops} not stable."]
    least = min(range(len(found)), key=lambda a: found[a].gain)
    return [
        f"The gains of {machine.axes[least].name} are the nearest to instability: times {found[least].gain:.2f} they "
        "reach it."
    ]
