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
    low = square[:-1]
    high = square[1:]
    peak = np.minimum(np.maximum(speed**2, np.maximum(low, high)), 0.5 * (low + high) + acceleration * lengths)
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    rise, fall = (np.clip((peak - end) / (2 * acceleration), 0.0, lengths) for end in (low, high))
    s = np.empty((lengths.size, 3))
    v = np.empty((lengths.size, 3))
    s[:, 0] = ends[:-1]
    s[:, 1] = np.minimum(ends[:-1] + rise, ends[1:])
    s[:, 2] = np.clip(ends[1:] - fall, s[:, 1], ends[1:])
    v[:, 0] = np.sqrt(low)
    v[:, 1] = np.sqrt(peak)
    v[:, 2] = v[:, 1]
    nodes = np.append(s.ravel(), ends[-1])
    speeds = np.append(v.ravel(), 0.0)
    distinct = np.append(True, np.diff(nodes) > 0)  # of nodes at one place the first, where their speeds agree
    return Limited(nodes[distinct], speeds[distinct])


@jit
def _swept(lengths: Floats, acceleration: Floats, top: Floats) -> Floats:
    """Squares of the highest speeds at the joints that can be braked from and reached, (n + 1,)."""
    x = top.copy()
    for k in range(lengths.size - 1, -1, -1):
        x[k] = min(x[k], x[k + 1] + 2.0 * acceleration[k] * lengths[k])
    for k in range(lengths.size):
        x[k + 1] = min(x[k + 1], x[k] + 2.0 * acceleration[k] * lengths[k])
    return x
