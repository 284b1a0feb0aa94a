"""Friction compensation: the torque of a friction model that the demand moves."""

from __future__ import annotations

import math
from typing import NamedTuple


class Friction(NamedTuple):
    """Friction of an axis at its motor.

    Attributes:
        coulomb: torque at speed [N·m].
        static: torque at which it breaks away [N·m].
        speed: Stribeck speed [u/s].
        stiffness: of the bristles, torque per travel after a reversal; 0 for a step [N·m/u].
    """

    coulomb: float
    static: float
    speed: float
    stiffness: float


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
        friction: in the order of `Friction`.
    """
    coulomb, static, speed, stiffness = friction
    level = coulomb
    if speed > 0.0:
        level += (static - coulomb) * math.exp(-((velocity / speed) ** 2))
    if travel == 0.0 or level <= 0.0:
        return last
    end = math.copysign(level, travel)
    if stiffness == 0.0:
        return end
    return end + (last - end) * math.exp(-stiffness * abs(travel) / level)
