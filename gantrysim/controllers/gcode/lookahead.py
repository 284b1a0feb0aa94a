"""The speed along pieces: feeds, corners and the limits of the axes, looking ahead over the whole program.

Every piece is run at a constant acceleration, at its speed, and at a constant deceleration. On an arc of the radius r
the share beta = sqrt(3)/2 of the acceleration a is for v^2 / r and the rest, sqrt(1 - beta^2) a = a / 2, for the change
of the speed; together they are at most a in any direction.
"""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.paths.limits import Limited

# shares of the acceleration on an arc
INWARD = math.sqrt(0.75)
ALONG = 0.5


def turning_speed(radius: Floats, acceleration: Floats) -> Floats:
    """Return the largest speed on arcs [mm/s]."""
    return np.sqrt(INWARD * acceleration * radius)


def jump_speed(angle: Floats, acceleration: Floats, cycle: float) -> Floats:
    """Return the largest speed in corners, where the velocity jumps by at most a T in a cycle T [mm/s]."""
    with np.errstate(divide="ignore"):
        return acceleration * cycle / (2 * np.sin(0.5 * np.minimum(angle, math.pi)))


def junction_speed(angle: Floats, deviation: Floats, acceleration: Floats, reach: Floats) -> Floats:
    """Return the speed at which printers' firmware passes corners on the exact path [mm/s].

    It is that on an arc between the two lines: v^2 = a r, r = d cos(angle / 2) / (1 - cos(angle / 2)), where d is the
    distance of the arc from the corner, and r no larger than the arc that begins at the reach from the corner.
    """
    cosine = np.cos(0.5 * np.minimum(angle, math.pi))
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.minimum(deviation * cosine / (1 - cosine), reach / np.tan(0.5 * np.minimum(angle, math.pi)))
    return np.where(cosine < 1, np.sqrt(acceleration * radius), np.inf)


def planned(lengths: Floats, speed: Floats, acceleration: Floats, joint: Floats) -> Limited:
    """Return the fastest speed profile from rest to rest.

    Args:
        lengths: of the pieces, (n,) [mm].
        speed: largest speed on each, (n,) [mm/s].
        acceleration: largest on each, (n,) [mm/s²].
        joint: largest speed where pieces meet, (n - 1,) [mm/s].
    """
    top = np.zeros(lengths.size + 1)
    top[1:-1] = np.minimum(np.minimum(speed[:-1], speed[1:]), joint) ** 2
    square = _swept(lengths, acceleration, top)
    s, v = _nodes(lengths, speed, acceleration, square)
    return Limited(s, v)


@jit
def _swept(lengths: Floats, acceleration: Floats, top: Floats) -> Floats:
    """Squares of the highest speeds at the joints that can be braked from and reached, (n + 1,)."""
    x = top.copy()
    for k in range(lengths.size - 1, -1, -1):
        x[k] = min(x[k], x[k + 1] + 2.0 * acceleration[k] * lengths[k])
    for k in range(lengths.size):
        x[k + 1] = min(x[k + 1], x[k] + 2.0 * acceleration[k] * lengths[k])
    return x


@jit
def _nodes(lengths: Floats, speed: Floats, acceleration: Floats, square: Floats) -> tuple[Floats, Floats]:
    """Arc lengths where the acceleration changes, and the speeds there.

    Of nodes at one place the first is taken, as their speeds agree. Compiled, as whole arrays of all candidates take
    ten times the memory of the nodes.

    Args:
        lengths: of the pieces, (n,) [mm].
        speed: largest speed on each, (n,) [mm/s].
        acceleration: on each, (n,) [mm/s²].
        square: of the speeds where pieces meet, (n + 1,) [mm²/s²].
    """
    count = 0
    places = np.empty(0)
    speeds = np.empty(0)
    for is_counted in (False, True):
        if is_counted:
            places = np.empty(count)
            speeds = np.empty(count)
        count = 0
        begin = 0.0
        previous = -1.0
        for k in range(lengths.size):
            length = lengths[k]
            low = square[k]
            high = square[k + 1]
            reached = 0.5 * (low + high) + acceleration[k] * length
            peak = min(max(speed[k] ** 2, max(low, high)), reached)
            end = begin + length
            rise = min(max((peak - low) / (2.0 * acceleration[k]), 0.0), length)
            fall = min(max((peak - high) / (2.0 * acceleration[k]), 0.0), length)
            top = min(begin + rise, end)
            for place, value in ((begin, low), (top, peak), (min(max(end - fall, top), end), peak)):
                if place > previous:
                    if is_counted:
                        places[count] = place
                        speeds[count] = np.sqrt(value)
                    count += 1
                    previous = place
            begin = end
        if begin > previous:
            if is_counted:
                places[count] = begin
                speeds[count] = 0.0
            count += 1
    return places, speeds
