"""The ladder of servo laws: each one a file with its equation, its part of the tick and its linear model.

A new law is a file here, and its line in `LAWS` and its parameters in `GivenLaws` below.
"""

from __future__ import annotations

from collections import namedtuple
from typing import TypedDict

from gantrysim.servo.gains import PerAxis
from gantrysim.servo.laws.contour import CONTOUR
from gantrysim.servo.laws.friction import FRICTION
from gantrysim.servo.laws.law import BaseLaw, Law
from gantrysim.servo.laws.learning import LEARNING
from gantrysim.servo.laws.observer import OBSERVER
from gantrysim.servo.laws.p_pi import P_PI
from gantrysim.servo.laws.pd import PD
from gantrysim.servo.laws.pid import PID
from gantrysim.servo.laws.preview import PREVIEW
from gantrysim.servo.laws.zv import ZV
from gantrysim.servo.laws.zvd import ZVD

# Bases first; the others in the order in which they act
LAWS: tuple[Law, ...] = (PD, PID, P_PI, FRICTION, OBSERVER, CONTOUR, PREVIEW, LEARNING, ZV, ZVD)


class GivenLaws(TypedDict, total=False):
    """The parameters of all laws as keywords of `Servo.derive`, for editors and type checkers."""

    friction_torque: PerAxis
    friction_static: PerAxis
    friction_speed: PerAxis
    friction_stiffness: PerAxis
    observer_bandwidth: PerAxis
    observer_inertia: PerAxis
    observer_viscous: PerAxis
    observer_lag: PerAxis
    contour_gain: PerAxis
    preview_bandwidth: PerAxis
    learning_bandwidth: PerAxis
    shaper_frequency: PerAxis
    shaper_damping: PerAxis


BASES: dict[str, BaseLaw] = {law.name: law for law in LAWS if isinstance(law, BaseLaw)}
ADDITIONS: dict[str, Law] = {law.name: law for law in LAWS if not isinstance(law, BaseLaw)}

# input shaping has one set of parameters for its two laws
LAW_PARAMETERS = tuple(dict.fromkeys(parameter for law in LAWS for parameter in law.parameters))

# the parameters of all laws of one axis, by name; 0 where the law is not used
LawValues = namedtuple("LawValues", [p.name for p in LAW_PARAMETERS], defaults=[0.0] * len(LAW_PARAMETERS))  # type: ignore[misc]
