"""The laws of the tick as a linear system, for the stability of their loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gantrysim.servo.gains import Gains
from gantrysim.servo.laws import ADDITIONS, BASES, PID
from gantrysim.servo.laws.law import BaseLaw, Law, Timing
from gantrysim.servo.laws.user import LawName
from gantrysim.servo.notch import Coefficients
from gantrysim.servo.stability.compensator import Compensator


def linear_law(
    names: Sequence[LawName], gains: Gains, notch: Coefficients, values: Mapping[str, float], timing: Timing
) -> Compensator:
    """Return the laws of one axis as they answer to a position alone, with all demands at zero.

    Friction compensation and torques that are sent with the setpoints do not answer to a position.

    Args:
        names: of the laws, a base of the ladder first.
        gains: of the axis.
        notch: of the axis.
        values: parameters of the laws that answer to a position, by name.
        timing: of the servo.
    """
    error_gain = 1.0
    for law in added_laws(names):
        if law.answers_to_position:
            error_gain *= law.error_gain(values)
    base = base_response(names, gains, notch, timing.period, error_gain)
    return closed_around(base, names, values, timing)


def base_response(
    names: Sequence[LawName], gains: Gains, notch: Coefficients, period: float, error_gain: float = 1.0
) -> Compensator:
    """Return base law and notch of one axis, without the laws added to them and without the feedback's delay."""
    return base_law(names).compensator(gains, period, error_gain).then(notch)


def closed_around(
    base: Compensator, names: Sequence[LawName], values: Mapping[str, float], timing: Timing
) -> Compensator:
    """Return a base law with the laws added to it, and with the feedback's delay; see `linear_law`."""
    law = base
    for added in added_laws(names):
        if added.answers_to_position:
            law = added.closed_around(law, values, timing)
    return law.delayed(timing.feedback_delay)


def base_law(names: Sequence[LawName]) -> BaseLaw:
    """Return the base law; PID where it is a user's own, whose loop is designed as that of PID."""
    return BASES.get(str(names[0]), PID)


def added_laws(names: Sequence[LawName]) -> list[Law]:
    """Return the laws that are added to the base, in the order in which they act."""
    return [law for name, law in ADDITIONS.items() if name in names]
