"""Friction compensation: friction torque from a model driven by the commanded motion."""

from __future__ import annotations

import math
from typing import Any

from gantrysim.servo.gains import Parameter
from gantrysim.servo.laws.law import FEEDFORWARD, Law, LawDesign

# From here on exp(-x) is 0 in double precision. A library takes several times as long there, at most steps
# of a moving axis.
UNDERFLOW = 746.0


def friction_torque(last: float, velocity: float, travel: float, friction: tuple[float, ...]) -> float:
    """Return the torque of the friction at one tick [N·m].

        F = G s + (F' - G s) exp(-stiffness |dDPOS| / G),        s = sign(dDPOS)
        G = coulomb + (static - coulomb) exp(-(dDPOS/T / speed)^2)

    F' is the torque at the last tick. This is LuGre's friction without the damping of its bristles (Canudas de Wit,
    Olsson, Åström and Lischinsky, IEEE Transactions on Automatic Control 40, 1995), exact where the demand moves at a
    constant speed within a tick. At rest the bristles stay bent.

    Args:
        last: F' [N·m].
        velocity: dDPOS/T [u/s].
        travel: dDPOS [u].
        friction: Coulomb and static friction [N·m], Stribeck speed [u/s], stiffness [N·m/u].
    """
    coulomb, static, speed, stiffness = friction
    level = coulomb
    if speed > 0.0:
        square = (velocity / speed) ** 2
        if square < UNDERFLOW:
            level += (static - coulomb) * math.exp(-square)
    if travel == 0.0 or level <= 0.0:
        return last
    end = math.copysign(level, travel)
    if stiffness == 0.0:
        return end
    return end + (last - end) * math.exp(-stiffness * abs(travel) / level)


def tick(row: Any, laws: Any) -> None:
    """Add the friction torque of every axis to the feed-forward.

    It is no part of the linear model, so `row.compensation` tells a disturbance observer of it.
    """
    for axis in range(row.axes):
        law = laws[axis]
        velocity = row.demand_velocity[axis]
        if law.friction_torque > 0.0:
            friction = (law.friction_torque, law.friction_static, law.friction_speed, law.friction_stiffness)
            law.friction_now = friction_torque(law.friction_now, velocity, velocity * row.period, friction)
        row.compensation[axis] = law.friction_now
        row.feedforward[axis] += law.friction_now


class FrictionCompensation(Law):
    """The law as one of the ladder. It has no linear model: it acts on the command alone, not on the position."""

    name = "friction"
    meaning = "friction torque from a model driven by the commanded motion"
    parameters = (
        Parameter("friction_torque", "N·m", "Coulomb friction that the law friction compensates"),
        Parameter("friction_static", "N·m", "static friction that the law friction compensates"),
        Parameter(
            "friction_speed", "u/s", "Stribeck speed, at which friction has fallen from its static to its Coulomb value"
        ),
        Parameter(
            "friction_stiffness", "N·m/u", "stiffness of presliding: friction torque per travel after a reversal"
        ),
    )
    state = (("friction_now", float),)  # torque at the last tick [N·m]
    stages = ((FEEDFORWARD, tick),)

    def derived(self, design: LawDesign) -> dict[str, float]:
        friction = design.axis.friction
        return {
            "friction_torque": friction.coulomb,
            "friction_static": friction.static,
            "friction_speed": friction.speed,
            "friction_stiffness": friction.stiffness,
        }


FRICTION = FrictionCompensation()
