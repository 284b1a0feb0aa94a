"""The part of a path that is nearest to each point of a trace, near the progress of the command; compiled.

A motion controller knows at every tick which point of the requested path its command stands for: the progress p_k. The
command, and what follows it, lie about c(p_k). So the feet of all of them are the nearest points of one stretch of the
path, from p_k - w_k to p_k + w_k, with

    r_k = max(d_k, r_(k-1) - (p_k - p_(k-1)) / 2),    w_k = 4 r_k,

where d_k is the distance of the furthest of them from c(p_k). On a line w_k = d_k would do; where two legs meet at an
inner angle phi, the nearest point of the other leg is at most 2 d_k / sin(phi / 2) away along the path, so that w_k
holds it down to 60 degrees, and a sharper corner nearly so. Behind a corner the distance from a follower on the leg
before shrinks, but not its lag: what it was before the corner counts until the command has left the corner behind.

As all points of a tick have the same stretch, the distance from it changes by no more than the points are apart.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import plain_inner_jit, plain_jit

_FADING = 0.5  # of the reach, per millimetre of progress
_WIDTH = 4.0  # half-width of the stretch, in units of the reach
_LEAST = 1e-6  # half-width of the stretch [mm]
_ON_PATH = 1e-3  # distance of a command that lies on the path: the sagitta of chords, and rounding [mm]


class Table(NamedTuple):
    """Points along a path, with all of its corners; between two of them the path is smooth, and nearly a chord.

    Attributes:
        s: arc lengths, ascending, (m,) [mm].
        points: (m, 3), by columns [mm].
        is_corner: whether the tangent jumps there, (m,).
        widest: largest distance between two neighbours along the path [mm].
    """

    s: Floats
    points: Floats
    is_corner: NDArray[np.bool_]
    widest: float


@plain_inner_jit
def to_chord(points, i, x, y, z, between=(0.0, 1.0)):
    """Return the squared distance of a point from the chord of entry i to the next, and the share of its foot.

    Args:
        points: along the path, (m, 3) [mm].
        i: entry.
        x: of the point [mm].
        y: of the point [mm].
        z: of the point [mm].
        between: shares of the chord from and up to which it counts.
    """
    u = points[i + 1, 0] - points[i, 0]
    v = points[i + 1, 1] - points[i, 1]
    w = points[i + 1, 2] - points[i, 2]
    a = x - points[i, 0]
    b = y - points[i, 1]
    c = z - points[i, 2]
    square = u * u + v * v + w * w
    low, high = between
    share = min(max((a * u + b * v + c * w) / square, low), high) if square > 0.0 else low
    a -= share * u
    b -= share * v
    c -= share * w
    return a * a + b * b + c * c, share


@plain_inner_jit
def chord_at(s, place):
    """Return the index of the chord at an arc length, the later of two that meet there."""
    low = 0
    high = len(s) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if s[middle] <= place:
            low = middle
        else:
            high = middle
    return low


@plain_inner_jit
def widened(reach, distance, advance):
    """Return the reach r at a tick, from that at the tick before, the distance d and the progress between them."""
    return max(distance, reach - _FADING * advance)


@plain_inner_jit
def stretch(s, progress, reach):
    """Return begin and end of the stretch of the path in which the feet of a tick lie."""
    half = _WIDTH * reach + _LEAST
    return max(progress - half, s[0]), min(progress + half, s[-1])


@plain_inner_jit
def _share_at(s, i, place):
    """Return the share of the chord of entry i at an arc length, from 0 to 1."""
    return min(max((place - s[i]) / (s[i + 1] - s[i]), 0.0), 1.0)


@plain_inner_jit
def _coarsely_nearest(points, x, y, z):
    """Return a chord that is near to a point, out of some over the whole path."""
    count = len(points) - 1
    best = 0
    least = np.inf
    for i in range(0, count, int(np.sqrt(count)) + 1):
        square = to_chord(points, i, x, y, z)[0]
        if square < least:
            least = square
            best = i
    return best


@plain_inner_jit
def nearest_chord(table, x, y, z, progress, reach):
    """Return the chord nearest to a point within the stretch about a progress, the nearer of two to it, and its foot.

    The search goes outwards from the progress. Chords are left out that are too near to one at a large distance to
    be nearer than the best: the distance changes by at most the way along the path.
    """
    s, points, _, widest = table
    low, high = stretch(s, progress, reach)
    start = _coarsely_nearest(points, x, y, z) if reach == np.inf else chord_at(s, progress)
    best = start
    least, foot = to_chord(points, start, x, y, z, (_share_at(s, start, low), _share_at(s, start, high)))
    for ahead in (True, False):
        i = start + 1 if ahead else start - 1
        while 0 <= i < len(s) - 1 and s[i] < high and s[i + 1] > low:
            begin = _share_at(s, i, low) if s[i] < low else 0.0
            end = _share_at(s, i, high) if s[i + 1] > high else 1.0
            square, share = to_chord(points, i, x, y, z, (begin, end))
            if square < least:
                least = square
                best = i
                foot = share
            skipped = 1
            # before the root, which most chords near the foot do not need
            if square > least + widest * widest:
                beyond = (np.sqrt(square) - np.sqrt(least)) / widest
                if not beyond < len(s):
                    break
                skipped += int(beyond)
            i += skipped if ahead else -skipped
    return best, foot


@plain_jit
def find_reaches(distance, progress, reach):
    """Write the reach r of every tick, (n,) [mm].

    Args:
        distance: of the furthest point from the path at the progress, d, (n,) [mm].
        progress: of the command, ascending, (n,) [mm].
        reach: to be written; its first element is that of the tick before the first.
    """
    at_tick = reach[0]
    before = progress[0]
    for k in range(len(progress)):
        at_tick = widened(at_tick, distance[k], progress[k] - before)
        before = progress[k]
        reach[k] = at_tick


@plain_jit
def find_feet(table, trace, progress, reach, parts):
    """Write a smooth part of the path on which the foot of every point lies, and a guess of the foot.

    Args:
        table: along the path.
        trace: points, (n, 3) [mm].
        progress: of the command, (n,) [mm].
        reach: as of `find_reaches`, (n,) [mm]; inf for the whole path.
        parts: begin and end of the part, and the guess, to be written, (3, n) [mm].
    """
    s, _, is_corner, _ = table
    last = len(s) - 1
    for k in range(len(trace)):
        x = trace[k, 0]
        y = trace[k, 1]
        z = trace[k, 2]
        i, share = nearest_chord(table, x, y, z, progress[k], reach[k])
        begin, end = stretch(s, progress[k], reach[k])
        parts[2, k] = s[i] + share * (s[i + 1] - s[i])
        # the foot on the curve may lie behind the end of its chord, but not behind a corner
        parts[0, k] = max(s[i] if i == 0 or is_corner[i] else s[i - 1], begin)
        parts[1, k] = min(s[i + 1] if i + 1 == last or is_corner[i + 1] else s[i + 2], end)


@plain_jit
def find_progress_on_path(table, trace, progress):
    """Write the progress of a command that lies on the path, in the order of the motion, and return how many have one.

    Each point has the first place of the path, from that of the point before on, that is within rounding of it.

    Args:
        table: along the path.
        trace: points, (n, 3) [mm].
        progress: to be written, (n,) [mm].
    """
    s, points, _, widest = table
    i = 0
    reached = 0.0
    for k in range(len(trace)):
        x = trace[k, 0]
        y = trace[k, 1]
        z = trace[k, 2]
        first = i
        while True:
            square, share = to_chord(points, i, x, y, z)
            distance = np.sqrt(square)
            place = s[i] + share * (s[i + 1] - s[i])
            if distance <= _ON_PATH and (i > first or place >= reached - _ON_PATH):
                break
            i += 1 + max(int((distance - _ON_PATH) / widest), 0)
            if i > len(s) - 2:
                return k
        reached = max(reached, place)
        progress[k] = reached
    return len(trace)


@plain_jit
def find_assignment(points, trace, cost, is_ahead, entries):
    """Write the entries of points along a path that stand for a trace: never falling, with the least sum of squares.

    A dynamic program over all entries and all points of the trace: exact, and as slow as their product.

    Args:
        points: along the path, (m, 3) [mm].
        trace: points in the order of the motion, (n, 3) [mm].
        cost: for the work, zeros, (m,).
        is_ahead: for the work, (n, m).
        entries: to be written, (n,).
    """
    count = len(points)
    for k in range(len(trace)):
        for j in range(count):
            # at no cost the entry may advance from one point of the trace to the next
            is_ahead[k, j] = j > 0 and cost[j - 1] < cost[j]
            if is_ahead[k, j]:
                cost[j] = cost[j - 1]
        for j in range(count):
            a = trace[k, 0] - points[j, 0]
            b = trace[k, 1] - points[j, 1]
            c = trace[k, 2] - points[j, 2]
            cost[j] += a * a + b * b + c * c
    j = 0
    for i in range(1, count):
        if cost[i] < cost[j]:
            j = i
    for k in range(len(trace) - 1, -1, -1):
        entries[k] = j
        while is_ahead[k, j]:
            j -= 1
