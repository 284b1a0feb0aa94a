"""The laws of the tick as a linear system, for the stability of their loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gantrysim.servo.gains import Gains
from gantrysim.servo.law import compensator
from gantrysim.servo.laws.cascade import as_pid
from gantrysim.servo.laws.observer import observing
from gantrysim.servo.laws.parameters import CASCADE
from gantrysim.servo.laws.user import LawName
from gantrysim.stability.compensator import Compensator


def linear_law(
    law: Sequence[LawName],
    gains: Gains,
    filter: tuple[float, float, float, float, float],
    values: Mapping[str, float],
    period: float,
    delay: float,
    feedback_delay: int,
) -> Compensator:
    """Return the laws of one axis as they answer to a position alone, with all demands at zero.

    P-PI and the disturbance observer are in it exactly. Cross-coupling is in it as it is where the path runs across
    the axis, where it multiplies the gains on the error most. Friction compensation and torques that are sent with
    the setpoints do not answer to a position.

    Args:
        law: names.
        gains: of the axis.
        filter: the notch.
        values: of the axis' other parameters, by name.
        period: servo period [s].
        delay: from sample to output [s].
        feedback_delay: from the encoder to the servo [servo periods].
    """
    contour_gain = values.get("contour_gain", 0.0)
    if CASCADE in law:  # its velocity loop knows no error of position, which cross-coupling could multiply
        pid = as_pid(gains)
        more = 1 + contour_gain
        across = pid._replace(kp=pid.kp + (more - 1) * gains.kp, ki=more * pid.ki)
        law_alone = compensator(across, period)
    else:
        law_alone = compensator(gains, period, contour_gain)
    return closed(law_alone.then(filter), values, period, delay, feedback_delay)


def closed(
    law: Compensator, values: Mapping[str, float], period: float, delay: float, feedback_delay: int
) -> Compensator:
    """Return a law with a disturbance observer, if there is one, and with the feedback's delay; see `linear_law`."""
    if values.get("observer_bandwidth"):
        inertia, viscous = values["observer_inertia"], values["observer_viscous"]
        lag = delay + feedback_delay * period + values["observer_lag"]
        law = observing(law, values["observer_bandwidth"], inertia, viscous, lag, period)
    return law.delayed(feedback_delay)
