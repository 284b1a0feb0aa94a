"""Stability of a job's servo: what bounds it, notes on small margins, and refusal of an unstable loop."""

from __future__ import annotations

import math

from gantrysim.base.errors import InputError
from gantrysim.job.settings import ServoSettings
from gantrysim.machine.machine import Machine
from gantrysim.servo.axis_loop import LoopTask
from gantrysim.servo.cascade import gains
from gantrysim.servo.laws import PD
from gantrysim.servo.notch import without_notches
from gantrysim.servo.servo import Servo
from gantrysim.servo.servo_values import LOOP_GAINS, SHAPING
from gantrysim.stability.margins import Margins

LOW_MARGIN = 1.5  # gain margin below which a run has a note


def servo_reason(settings: ServoSettings, machine: Machine, servo: Servo) -> str:
    """Return what bounds the natural frequency of a servo with these settings, and why it has notches, in words."""
    notched = not without_notches(settings.notch_frequency)
    # without notches the loops are derived so that they keep their margins without
    given = [
        name for name in LOOP_GAINS if getattr(settings, name) is not None and (notched or not name.startswith("notch"))
    ]
    if given:
        return f"{', '.join(given)} as given"
    lags = servo.lags._replace(drives=servo.loop_drives._replace(velocity=()))
    integral_time = math.inf if PD.name in servo.laws.names else settings.integral_time
    task = LoopTask(machine.axes, settings.period, lags, settings.damping, integral_time, servo.laws.names, notched)
    return gains(task, settings.frequency, settings.velocity_bandwidth)[1]


def margin_notes(machine: Machine, margins: tuple[Margins, ...] | None) -> tuple[str, ...]:
    """Return a note for each axis whose gain margin is below 1.5."""
    return tuple(
        f"servo: {name} is {margin}: a gain margin below {LOW_MARGIN:g} leaves little to other loads and machines"
        for name, margin in zip(machine.axis_names, margins or (), strict=False)
        if margin.least_gain < LOW_MARGIN
    )


def check_stability(machine: Machine, margins: tuple[Margins, ...] | None, settings: ServoSettings) -> None:
    """Raise InputError for a servo that is unstable on its machine.

    Args:
        machine: the machine.
        margins: of each axis.
        settings: of the servo; derived loops are stable, except with a user's own law, so the error names the given
            values that shape the loops.
    """
    named = zip(machine.axis_names, margins or (), strict=False)
    unstable = [f"{name} is {margin}" for name, margin in named if not margin.stable]
    if unstable:
        advice = "change the law, or give lower gains"
        names = (*SHAPING, "frequency", "velocity_bandwidth")
        given = [name for name in names if getattr(settings, name) is not None]
        if given:
            advice = f"change {', '.join(given)}, or leave out what is given to have it derived"
        raise InputError(
            f"servo on machine {machine.name}: {'; '.join(unstable)}: {advice}, or set simulation.allow_unstable = "
            "true to run it all the same"
        )
