"""The law of the way over time that a group's properties give one command."""

from __future__ import annotations

from gantrysim.controllers.profile import Constant, Jerk, PointToPoint, Profile, Ramp, Shape, Sine
from gantrysim.controllers.softmc.group import Group


def along(group: Group, length: float, rotation: float) -> Profile:
    """Return the law along a path, slowed where the orientation axis could not follow.

    Over the length L [mm] the axis turns by dr [deg], so that v <= vrot L / |dr|, and the acceleration and the
    jerk likewise.
    """
    speed = min(group.velocity, group.vmax)
    down = group.acceleration if group.deceleration is None else group.deceleration
    share = length / abs(rotation) if rotation else None
    if share is None:
        return _law(group, length, speed, group.acceleration, down, group.jerk)
    vrot, arot, jrot = group.vrot * share, group.arot * share, _rotary_jerk(group) * share
    return _law(group, length, min(speed, vrot), min(group.acceleration, arot), min(down, arot), min(group.jerk, jrot))


def in_place(group: Group, rotation: float) -> Profile:
    """Return the law of the orientation axis alone [deg]."""
    return _law(group, abs(rotation), group.vrot, group.arot, group.arot, _rotary_jerk(group))


def _rotary_jerk(group: Group) -> float:
    """Jerk that builds up `arot` in the time in which the group's builds up its acceleration [deg/s³]."""
    return group.jerk * group.arot / group.acceleration


def _law(group: Group, length: float, speed: float, up: float, down: float, jerk: float) -> Profile:
    if group.profile == "constant":
        return Constant(length, speed)
    return PointToPoint(length, speed, up, down, _shape(group, jerk))


def _shape(group: Group, jerk: float) -> Shape:
    if group.profile == "sine":
        return Sine()
    if group.profile == "trapezoidal acceleration" or (group.profile == "smooth" and group.smooth < 0):
        return Jerk(jerk)
    return smoothed(group.smooth) if group.profile == "smooth" else Ramp()


def smoothed(n: int) -> Ramp:
    """Return the ramp of Smooth = n, 0 to 100, whose time is (1 + 2 n / 100) V / A.

    Up to 50 the acceleration rises to A ever more slowly; from there on it is a triangle, whose peak falls.
    """
    longer = 1 + 2 * n / 100
    return Ramp(1 - 1 / longer) if longer <= 2 else Ramp(0.5, 2 / longer)
