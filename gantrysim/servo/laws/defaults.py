"""Parameters of the laws that follow from an axis and the natural frequency of its loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from gantrysim.servo.laws.friction import Friction
from gantrysim.servo.laws.parameters import CONTOUR, FRICTION, LEARNING, OBSERVER, PREVIEW
from gantrysim.servo.laws.user import LawName

OBSERVER_SHARE = 0.5  # of the natural frequency, the observer's cut-off
CONTOUR_GAIN = 1.0
PREVIEW_SHARE = 0.25  # of the servo's frequency, the cut-off of the preview
LEARNING_SHARE = 2.0  # times the natural frequency, the cut-off of the learning


class Moved(Protocol):
    """What the laws' models need to know of an axis."""

    @property
    def inertia(self) -> float:
        """Motor torque per acceleration of the axis [N·m·s²/u]."""

    @property
    def viscous(self) -> float:
        """Motor torque per speed of the axis [N·m·s/u]."""

    @property
    def friction(self) -> Friction:
        """Friction at the motor."""


def law_values(law: Sequence[LawName], axis: Moved, frequency: float, lag: float, period: float) -> dict[str, float]:
    """Return the parameters of an axis' laws, see `LAW_PARAMETERS`; those of input shaping are not among them.

    Args:
        law: names.
        axis: the axis.
        frequency: natural frequency of the loop [Hz].
        lag: time constant of the torque [s].
        period: servo period [s].
    """
    values: dict[str, float] = {}
    if FRICTION in law:
        values |= dict(
            zip(
                ("friction_torque", "friction_static", "friction_speed", "friction_stiffness"),
                axis.friction,
                strict=True,
            )
        )
    if OBSERVER in law:
        values |= {
            "observer_bandwidth": OBSERVER_SHARE * frequency,
            "observer_inertia": axis.inertia,
            "observer_viscous": axis.viscous,
            "observer_lag": lag,
        }
    if CONTOUR in law:
        values["contour_gain"] = CONTOUR_GAIN
    if PREVIEW in law:
        values["preview_bandwidth"] = PREVIEW_SHARE / period
    if LEARNING in law:
        values["learning_bandwidth"] = min(LEARNING_SHARE * frequency, PREVIEW_SHARE / period)
    return values
