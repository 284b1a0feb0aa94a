"""The section of a run's report on its servo: gains, stability margins, torque ripple."""

from __future__ import annotations

from gantrysim.job.margins import LOW_MARGIN
from gantrysim.machine.machine import Machine
from gantrysim.metrics.error_quantities import TORQUE_RIPPLE
from gantrysim.report.document import Column, Section, Table
from gantrysim.results.quantities import TORQUE_RIPPLE_PERCENT
from gantrysim.results.run_results import AxisLoop, RunResults
from gantrysim.servo.gains import GAINS
from gantrysim.servo.laws import LAW_PARAMETERS
from gantrysim.servo.laws.selection import Laws, words
from gantrysim.servo.servo import Servo
from gantrysim.servo.servo_values import NOTCH
from gantrysim.servo.stability.margin_quantities import GAIN_MARGIN, MARGINS
from gantrysim.servo.stability.margins import NO_LOOP, Margins


def servo_section(results: RunResults) -> Section:
    """Return the section of the servo of a job on the machine of its run."""
    job = results.job
    machine = results.machine
    margins = job.margins
    reason = job.servo_reason
    law = job.built_servo.laws.names
    named = [] if law == Laws.names else [f"Law: {words(law)}."]
    return Section(
        "Servo",
        [_text(machine, margins), *named, f"{reason[0].upper()}{reason[1:]}."],
        table=[_gains(machine, job.built_servo), _margins(results.loops)],
    )


def _margins(loops: dict[str, AxisLoop]) -> Table:
    shown = [quantity for quantity in MARGINS if quantity is not GAIN_MARGIN]  # the smaller of two that are shown
    ripples = (TORQUE_RIPPLE, TORQUE_RIPPLE_PERCENT)
    columns: list[str | Column] = ["axis", *map(Column.of, shown), *map(Column.of, ripples)]
    rows = [
        [
            axis,
            *(quantity.scaled(quantity.get(loop.margins)) for quantity in shown),
            *(quantity.scaled(quantity.get(loop)) for quantity in ripples),
        ]
        for axis, loop in loops.items()
    ]
    return Table(
        columns,
        rows,
        "Stability margins at the home position, without Coulomb friction; with all it moves: for a factor on the "
        "gains of all axes that move each other; torque ripple while the dispenser is on",
    )


def _gains(machine: Machine, servo: Servo) -> Table:
    laws = (parameter for parameter in LAW_PARAMETERS if any(servo.per_axis(parameter.name)))
    shown = (*GAINS, *(NOTCH if any(servo.per_axis("notch_frequency")) else ()), *laws)
    # a row for each gain: with a column for each, the table would be wider than the page
    rows = [[gain.name, gain.unit, *servo.per_axis(gain.name)] for gain in shown]
    columns = [Column(f"{axis.name} [{axis.unit}]") for axis in machine.axes]
    return Table(["gain", "unit", *columns], rows, "Gains")


def _text(machine: Machine, margins: tuple[Margins, ...] | None) -> str:
    if margins is None:
        return (
            "Stability margins are unknown: an actuator of the machine has a delay of its own, or the servo a law of "
            "the user's that is not linear."
        )
    by_axis = dict(zip((axis.name for axis in machine.axes), margins, strict=True))
    unstable = [name for name, axis_margins in by_axis.items() if not axis_margins.stable]
    if unstable:
        return f"Unstable, Coulomb friction neglected: {', '.join(unstable)}."
    loops = {name: axis_margins for name, axis_margins in by_axis.items() if axis_margins != NO_LOOP}
    gains = {name: axis_margins.least_gain for name, axis_margins in loops.items()}
    if not gains:
        return "All axes are steppers in open loop: no loop, no margins."
    least = min(gains, key=gains.__getitem__)
    text = f"Axis {least} has the smallest {GAIN_MARGIN.label}: {GAIN_MARGIN.text(gains[least])}"
    if gains[least] < LOW_MARGIN:
        text += f", below {LOW_MARGIN:g}: with another load, or on another machine of this kind, it may be unstable"
    return f"{text}."
