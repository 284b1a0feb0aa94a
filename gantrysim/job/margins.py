"""Stability of a job's servo: what bounds it, notes on it and its machine, and refusal of an unstable loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from gantrysim.base.errors import InputError
from gantrysim.base.user_code import is_code
from gantrysim.job.settings import ServoSettings
from gantrysim.machine.checks import notes, weights
from gantrysim.machine.machine import Machine
from gantrysim.servo.derivation import LoopTask
from gantrysim.servo.laws import PD
from gantrysim.servo.notch import without_notches
from gantrysim.servo.request import LOOP_GAINS, SHAPING
from gantrysim.servo.servo import Servo
from gantrysim.servo.servo_design import gains
from gantrysim.servo.stability.margins import Margins

LOW_MARGIN = 1.5  # gain margin below which a run has a note
_FREQUENCY_STEP = 0.5**0.5  # from one frequency tried to the next
_TRIED_FREQUENCIES = 8  # frequencies, down to a sixteenth


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


def machine_notes(machine: Machine, margins: tuple[Margins, ...] | None, servo: Servo) -> tuple[str, ...]:
    """Return notes on the machine at rest, on gain margins below 1.5, and on weights that nothing balances."""
    low = (
        f"servo: {name} is {margin}: a gain margin below {LOW_MARGIN:g} leaves little to other loads and machines"
        for name, margin in zip(machine.axis_names, margins or (), strict=False)
        if margin.least_gain < LOW_MARGIN
    )
    return (*notes(machine), *low, *_weight_notes(machine, servo))


def _weight_notes(machine: Machine, servo: Servo) -> Iterator[str]:
    """Yield a note for each axis with a weight that nothing balances: a position loop without ki sinks by m g / kp."""
    for name, torque in weights(machine).items():
        a = machine.axis_names.index(name)
        axis = machine.axes[a]
        gains = servo.gains[a]
        drive = servo.drives[a]
        stiffness = gains.kp  # torque per error
        integrates = gains.ki > 0
        if servo.modes[a] == "velocity":
            stiffness *= drive.velocity_gain
            integrates |= drive.velocity_time > 0
        sinks = "the integral term takes it, after the start"
        if servo.modes[a] == "stepper":
            sinks = "the motor's field holds it"
        elif not integrates and stiffness > 0:
            sunk = 1e3 * abs(torque) / stiffness
            unit = "µm" if axis.unit == "mm" else "mdeg"
            sinks = f"without an integral term the axis stays {sunk:.4g} {unit} off its command, weight / kp"
        yield (
            f"machine {machine.name}: {name} holds a weight, {abs(torque):.3g} N·m at its motor: {sinks}; a "
            'counterbalance is gravcomp="1" on the bodies that it carries'
        )


def check_stability(
    machine: Machine,
    servo: Servo,
    margins: tuple[Margins, ...] | None,
    settings: ServoSettings,
    margins_at: Callable[[float], tuple[Margins, ...] | None],
) -> None:
    """Raise InputError for a servo that is unstable on its machine.

    Derived loops are stable, except with a user-defined law, so the error names the given values that shape the loops,
    or else a lower frequency with which the law is stable.

    Args:
        machine: the machine.
        servo: the servo.
        margins: margins of each axis, None if they are unknown.
        settings: settings of the servo.
        margins_at: function from another frequency [Hz] to the margins with it.
    """
    named = zip(machine.axis_names, margins or (), strict=False)
    unstable = [f"{name} is {margin}" for name, margin in named if not margin.stable]
    if not unstable:
        return
    names = (*SHAPING, "frequency", "velocity_bandwidth")
    given = [name for name in names if getattr(settings, name) is not None]
    softer = None
    if set(given) <= {"frequency"} and _has_own_law(settings):
        softer = next((tried for tried in _lower_frequencies(machine, servo) if _keeps_margin(margins_at(tried))), None)
    if softer is not None:
        advice = f"set servo.frequency = {softer:g}, with which every gain margin is at least {LOW_MARGIN:g}"
    elif given:
        advice = f"change {', '.join(given)}, or leave out what is given to have it derived"
    else:
        advice = "change the law, or give lower gains"
    raise InputError(
        f"servo on machine {machine.name}: {'; '.join(unstable)}: {advice}, or set simulation.allow_unstable = "
        "true to run it anyway"
    )


def _has_own_law(settings: ServoSettings) -> bool:
    names = [settings.law] if isinstance(settings.law, str) else settings.law
    return any(is_code(name) for name in names)


def _lower_frequencies(machine: Machine, servo: Servo) -> Iterator[float]:
    """Yield frequencies below the natural frequency of a servo in torque mode, kp = J w^2, to two digits [Hz]."""
    frequency = math.sqrt(servo.gains[0].kp / machine.axes[0].inertia) / (2 * math.pi)
    for _ in range(_TRIED_FREQUENCIES):
        frequency *= _FREQUENCY_STEP
        yield float(f"{frequency:.2g}")


def _keeps_margin(margins: tuple[Margins, ...] | None) -> bool:
    return margins is not None and all(margin.stable and margin.least_gain >= LOW_MARGIN for margin in margins)
