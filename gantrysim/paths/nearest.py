"""The part of a path that is nearest to each point of a trace, near the progress of the command; compiled.

A motion controller knows at every tick which point of the requested path its command stands for: the progress p_k. The
command, and what follows it, lie about c(p_k). So the feet of all of them are the nearest points of one stretch of the
path: forwards as far as the path stays within a ball about c(p_k) of the radius d_k, and backwards within one of
d_k + l_k, but at least to p_(k-1), with

    l_k = max(lag_k, l_(k-1) - (p_k - p_(k-1)) / 2),

where d_k is the distance of the furthest of them from c(p_k), and lag_k that of the furthest follower from the command.
Where the path comes near itself, other legs are in the ball, but the path leaves it on its way to them. Behind a corner
the distance from a follower on the leg before shrinks, but not its way to the command: what it was before the corner
counts until the command has left the corner behind.

As all points of a tick have the same stretch, the distance from it changes by no more than the points are apart.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit

_FADING = 0.5  # of the lag, per millimetre of progress
_LEAST_RADIUS = 1e-6  # radius within which the path stays [mm]
_SAFE_DISTANCE = 0.5  # of the least radius of curvature
_FEW_CHORDS = 2  # chords from the place, up to which a search from there is as short
_NEAR_SQUARE = 0.26  # more than the square of half a chord, of the square of the widest
_SKIP_ROUNDING = 1e-9  # of the number of chords between two distances
_LEAST_SLOPE = 0.5  # of a guess: nearer to the centre of curvature the foot is sought from there
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


class Bends(NamedTuple):
    """How the path bends between the entries of its table.

    Attributes:
        curvature: vectors at the middles of the chords, (m - 1, 3) [1/mm].
        corners: arc lengths at which the tangent jumps, ascending, (k,) [mm].
        tightest: least radius of curvature between the corners [mm].
    """

    curvature: Floats
    corners: Floats
    tightest: float


@jit
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


@jit
def _square_to(points, i, x, y, z):
    """Return the squared distance of a point from entry i."""
    a = points[i, 0] - x
    b = points[i, 1] - y
    c = points[i, 2] - z
    return a * a + b * b + c * c


@jit
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


@jit
def chord_near(s, place, i):
    """Return what `chord_at` does, mostly after one step from a chord near it."""
    last = len(s) - 2
    if i < last and s[i + 1] <= place:
        i += 1
    is_here = (i == 0 or s[i] <= place) and (i == last or place < s[i + 1])
    return i if is_here else chord_at(s, place)


@jit
def remembered_lag(lag, distance, advance):
    """Return the lag l at a tick, from that at the tick before, the followers' distance, and the progress between."""
    return max(distance, lag - _FADING * advance)


@jit
def _share_at(s, i, place):
    """Return the share of the chord of entry i at an arc length, from 0 to 1."""
    return min(max((place - s[i]) / (s[i + 1] - s[i]), 0.0), 1.0)


@jit
def _left_at(table, i, step, centre, radius):
    """Return the arc length at which the path, from entry i on, forwards or backwards, leaves a ball or ends."""
    s, points, _, widest = table
    last = len(s) - 1 if step > 0 else 0
    x, y, z = centre
    while True:
        a = points[i, 0] - x
        b = points[i, 1] - y
        c = points[i, 2] - z
        square = a * a + b * b + c * c
        if square > radius * radius:
            break
        if i == last:
            return s[i]
        # the distance changes by at most the way along the path
        skipped = 1 + int((radius - np.sqrt(square)) / widest)
        i = min(i + skipped, last) if step > 0 else max(i - skipped, last)
    u = points[i - step, 0] - points[i, 0]
    v = points[i - step, 1] - points[i, 1]
    w = points[i - step, 2] - points[i, 2]
    length = u * u + v * v + w * w
    half = -(a * u + b * v + c * w)
    share = (half - np.sqrt(max(half * half - length * (square - radius * radius), 0.0))) / length
    return s[i] + min(max(share, 0.0), 1.0) * (s[i - step] - s[i])


@jit
def stretch(table, i, place, distance, lag):
    """Return begin and end of the stretch of a tick about a place of the path, on the chord i, from d and l."""
    s, points, _, _ = table
    share = _share_at(s, i, place)
    x = points[i, 0] + share * (points[i + 1, 0] - points[i, 0])
    y = points[i, 1] + share * (points[i + 1, 1] - points[i, 1])
    z = points[i, 2] + share * (points[i + 1, 2] - points[i, 2])
    begin = _left_at(table, i, -1, (x, y, z), distance + lag + _LEAST_RADIUS)
    return begin, _left_at(table, i + 1, 1, (x, y, z), distance + _LEAST_RADIUS)


@jit
def nearest_chord(table, point, chords, between, smooth, tightest):
    """Return the chord nearest to a point within a stretch, the nearer of two to a place on it, and its foot.

    The search goes outwards from the place. Chords are left out that are too near to one at a large distance to be
    nearer than the best: the distance changes by at most the way along the path.

    On a smooth part of the path the distance from the point only grows where the path leads away from it, as long as it
    is less than the radius of curvature: the search ends there.

    Args:
        table: along the path.
        point: its coordinates [mm].
        chords: at the place, and near the point.
        between: begin and end of the stretch [mm].
        smooth: corners before and behind the place, or the place itself where they are not known [mm].
        tightest: least radius of curvature between them, or 0 [mm].
    """
    s, points, _, widest = table
    x, y, z = point
    start, near = chords
    low, high = between
    best = start
    least, foot = to_chord(points, start, x, y, z, (_share_at(s, start, low), _share_at(s, start, high)))
    # no larger than the least square of a distance
    bound = least
    if abs(near - start) > _FEW_CHORDS and s[near] < high and s[near + 1] > low:
        square, share = to_chord(points, near, x, y, z, (_share_at(s, near, low), _share_at(s, near, high)))
        bound = min(bound, square)
        reach = max(_SAFE_DISTANCE * tightest - (high - low), 0.0)
        # there is one nearest point: it does not matter where the search begins
        if low >= smooth[0] and high <= smooth[1] and max(square, least) < reach * reach:
            start = best = near
            least = bound = square
            foot = share
    for ahead in (True, False):
        is_smooth = high <= smooth[1] if ahead else low >= smooth[0]
        i = start + 1 if ahead else start - 1
        while 0 <= i < len(s) - 1 and s[i] < high and s[i + 1] > low:
            first = _square_to(points, i, x, y, z)
            last = _square_to(points, i + 1, x, y, z)
            # the foot on a chord is within half of it from an end
            if min(first, last) < bound + _NEAR_SQUARE * widest * widest:
                begin = _share_at(s, i, low) if s[i] < low else 0.0
                end = _share_at(s, i, high) if s[i + 1] > high else 1.0
                square, share = to_chord(points, i, x, y, z, (begin, end))
                if square < least:
                    least = square
                    bound = min(bound, least)
                    best = i
                    foot = share
            square, before, remaining = (last, first, high - s[i + 1]) if ahead else (first, last, s[i] - low)
            reach = max(_SAFE_DISTANCE * tightest - remaining, 0.0)
            if is_smooth and before < square < reach * reach:
                break
            skipped = 1
            # before the root, which most chords near the foot do not need
            if square > bound + widest * widest:
                # nothing nearer is left out, by rounding neither
                beyond = (np.sqrt(square) - np.sqrt(bound)) / widest - _SKIP_ROUNDING
                if not beyond < len(s):
                    break
                skipped += int(beyond)
            i += skipped if ahead else -skipped
    return best, foot


@jit
def find_furthest(trace, places, command, squares):
    """Raise squares of distances to those of a trace: from places of the path, and from the command, (n, 2) [mm²].

    Args:
        trace: points, (n, 3) [mm].
        places: at the progress of the command, (n, 3) [mm].
        command: its points, (n, 3) [mm].
        squares: raised.
    """
    for k in range(len(trace)):
        x = trace[k, 0]
        y = trace[k, 1]
        z = trace[k, 2]
        squares[k, 0] = max(squares[k, 0], _square_to(places, k, x, y, z))
        squares[k, 1] = max(squares[k, 1], _square_to(command, k, x, y, z))


@jit
def find_stretches(table, progress, squares, stretches):
    """Write begin and end of the stretch of every tick.

    Args:
        table: along the path.
        progress: of the command, ascending, (n,) [mm].
        squares: of the distance of the furthest point from the path at the progress, and of the furthest follower from
            the command, (n, 2) [mm²].
        stretches: to be written, (2, n) [mm].
    """
    at_tick = 0.0
    before = progress[0]
    i = 0
    for k in range(len(progress)):
        at_tick = remembered_lag(at_tick, np.sqrt(squares[k, 1]), progress[k] - before)
        before = progress[k]
        i = chord_near(table[0], before, i)
        begin, end = stretch(table, i, before, np.sqrt(squares[k, 0]), at_tick)
        # the command may pass the tip of a rounded corner from one tick to the next, before its followers
        stretches[0, k] = min(begin, progress[max(k - 1, 0)]) if at_tick > 0.0 else begin
        stretches[1, k] = end


@jit
def find_starts(table, trace, places):
    """Write places of the path near which the nearest point of the whole path may lie, for the search to begin at.

    Args:
        table: along the path.
        trace: points, (n, 3) [mm].
        places: to be written, (n,) [mm].
    """
    s, points, _, _ = table
    count = len(s) - 1
    for k in range(len(trace)):
        least = np.inf
        for i in range(0, count, int(np.sqrt(count)) + 1):
            square = to_chord(points, i, trace[k, 0], trace[k, 1], trace[k, 2])[0]
            if square < least:
                least = square
                places[k] = s[i]


@jit
def find_feet(table, bends, trace, places, stretches, parts):
    """Write a smooth part of the path on which the foot of every point lies, and a guess of the foot.

    Args:
        table: along the path.
        bends: of the path between the table's entries.
        trace: points, (n, 3) [mm].
        places: of the path, at which the search begins, (n,) [mm].
        stretches: begin and end of the stretch that is searched, (2, n) [mm].
        parts: begin and end of the part, and the guess, to be written, (3, n) [mm].
    """
    s, points, is_corner, _ = table
    last = len(s) - 1
    corners = bends.corners
    start = 0
    corner = 0
    i = 0
    for k in range(len(trace)):
        begin = stretches[0, k]
        end = stretches[1, k]
        start = chord_near(s, places[k], start)
        while corner < len(corners) and corners[corner] <= s[start]:
            corner += 1
        while corner > 0 and corners[corner - 1] > s[start]:
            corner -= 1
        smooth = (
            corners[corner - 1] if corner > 0 else -np.inf,
            corners[corner] if corner < len(corners) else np.inf,
        )
        # the foot of a point is mostly near that of the point before
        point = (trace[k, 0], trace[k, 1], trace[k, 2])
        i, share = nearest_chord(table, point, (start, i), (begin, end), smooth, bends.tightest)
        # the path's tangent turns about the chord: the foot on the arc is where it is square to the way from there
        towards = 0.0
        for a in range(3):
            foot = points[i, a] + share * (points[i + 1, a] - points[i, a])
            towards += (foot - trace[k, a]) * bends.curvature[i, a]
        share -= towards * (share - 0.5) / max(1.0 + towards, _LEAST_SLOPE)
        parts[2, k] = s[i] + share * (s[i + 1] - s[i])
        # the foot on the curve may lie behind the end of its chord, but not behind a corner
        parts[0, k] = max(s[i] if i == 0 or is_corner[i] else s[i - 1], begin)
        parts[1, k] = min(s[i + 1] if i + 1 == last or is_corner[i + 1] else s[i + 2], end)


@jit
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


@jit
def find_assignment(points, trace, between, cost, is_ahead, entries):
    """Write the chords of a path that stand for a trace: never falling, with the least sum of squared distances.

    A dynamic program over all points of the trace and all chords that each may have: exact, and as slow as their
    number.

    Args:
        points: ends of the chords along the path, (m + 1, 3) [mm].
        trace: points in the order of the motion, (n, 3) [mm].
        between: first and last chord that each may have, neither of them falling, (2, n).
        cost: for the work, inf, (m,).
        is_ahead: for the work, (n, w), with w chords from the first of the point before to the last of each.
        entries: chords, to be written, (n,).
    """
    for j in range(between[0, 0], between[1, 0] + 1):
        cost[j] = 0.0
    for k in range(len(trace)):
        low = between[0, max(k - 1, 0)]
        for j in range(low, between[1, k] + 1):
            # at no cost the chord may advance from one point of the trace to the next
            is_ahead[k, j - low] = j > low and cost[j - 1] < cost[j]
            if is_ahead[k, j - low]:
                cost[j] = cost[j - 1]
        for j in range(between[0, k], between[1, k] + 1):
            cost[j] += to_chord(points, j, trace[k, 0], trace[k, 1], trace[k, 2])[0]
    j = between[0, -1]
    for i in range(j + 1, between[1, -1] + 1):
        if cost[i] < cost[j]:
            j = i
    for k in range(len(trace) - 1, -1, -1):
        entries[k] = j
        while is_ahead[k, j - between[0, max(k - 1, 0)]]:
            j -= 1
