"""The feet of a trace on a path, as entries of a table of points along it, in the order of the motion."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.base.jit import inner_jit, jit

# A foot advances by at most _REACH more than four times the point's step, and goes back by at most _BACK more than it
# [mm]; of all feet that a point may have, the best _KEPT are followed.
_REACH = 10.0
_BACK = 1.0
_KEPT = 8
_AROUND = 12  # entries about the first foot that are searched for a nearer one
_WEIGHT = 0.02  # of the distance from the path, per mm of the trace, against the difference in progress [1/mm]
# Between two points with others left out between them the path may go with the trace, or leave that motion out: any
# progress from the distance of the two to the length of the trace between them is likely, and that length the likelier.
_LEFT_OUT = 0.1  # weight of the rest of the length against a progress beyond either
_ROUNDING = 1e-9  # of lengths [mm]
_CANDIDATES = 1024  # minima about a point that are looked at


@inner_jit
def _square(a, b):
    """Squared distance of two points."""
    x = a[0] - b[0]
    y = a[1] - b[1]
    z = a[2] - b[2]
    return x * x + y * y + z * z


@inner_jit
def _nearest(table, point, low, high):
    """Index of the first entry nearest to a point, from low to high inclusive."""
    best = low
    least = np.inf
    for i in range(max(low, 0), min(high, len(table) - 1) + 1):
        square = _square(table[i], point)
        if square < least:
            best = i
            least = square
    return best


@inner_jit
def _first(table, point, spacing):
    """Index of the first entry as near to a point as the nearest, within the table's spacing."""
    nearest = table[_nearest(table, point, 0, len(table) - 1)]
    bound = np.sqrt(_square(nearest, point)) + spacing
    for i in range(len(table)):
        if _square(table[i], point) <= bound * bound:
            return i
    return 0


@inner_jit
def _vertex(before, square, after):
    """Place of the vertex of a parabola through three squared distances, in entries from the middle one, -1 to 1."""
    second = before - 2 * square + after
    return min(max(0.5 * (before - after) / second, -1.0), 1.0) if second > 0 else 0.0


@inner_jit
def _minima(table, point, low, high, found, place, distance):
    """Find the entries from low to high that are nearer to a point than their neighbours; return their number.

    Without any, it is the nearest; an end of the table needs one neighbour only.

    Args:
        table: points along the path, (m, 3) [mm].
        point: (3,) [mm].
        low: first entry.
        high: last entry.
        found: into whose first elements their indices are written, (c,).
        place: likewise where the distance is least about each, in entries, (c,).
        distance: likewise the distances, (c,) [mm].
    """
    count = 0
    best = low
    least = np.inf
    before = np.inf if low == 0 else _square(table[low - 1], point)
    square = _square(table[low], point)
    for i in range(low, high + 1):
        after = np.inf if i == len(table) - 1 else _square(table[i + 1], point)
        if square <= before and square < after and count < len(found):
            found[count], distance[count] = i, np.sqrt(square)
            place[count] = i + (_vertex(before, square, after) if 0 < i < len(table) - 1 else 0.0)
            count += 1
        if square < least:
            best = i
            least = square
        before = square
        square = after
    if count == 0:
        found[0], place[0], distance[0] = best, best, np.sqrt(least)
        return 1
    return count


@inner_jit
def _range(values, count):
    """Return the least and the largest of the first `count` values; quicker than the methods of a slice."""
    least = largest = values[0]
    for i in range(1, count):
        least = min(least, values[i])
        largest = max(largest, values[i])
    return least, largest


@inner_jit
def _start(table, point, spacing, begin):
    """Return the index of the entry at the first foot of a trace that begins at a point; arguments as in `along`."""
    last_entry = len(table) - 1
    if begin < 0:
        first = _first(table, point, spacing)
        reach = 2
    else:
        first = min(begin, last_entry)
        reach = int((2 * np.sqrt(_square(point, table[first])) + _BACK) / spacing)
    first = _nearest(table, point, first - reach, first + reach)
    return _nearest(table, point, first - _AROUND, first + _AROUND)


@inner_jit
def _misfit(advance, step, length):
    """Return by how much a foot's progress differs from that of the trace [mm].

    Args:
        advance: progress of the foot along the path [mm].
        step: distance of the two points [mm].
        length: of the trace between them where points are left out, else 0 [mm].
    """
    if length <= step + _ROUNDING:
        return abs(advance - step)
    beyond = max(step - advance, 0.0) + max(advance - length, 0.0)
    return _LEFT_OUT * abs(advance - length) + (1.0 - _LEFT_OUT) * beyond


@inner_jit
def _extend(table, trace, travel, spacing, index, origin, kept, cost, at):
    """Extend the best sequences of feet from the first point of a trace to all others.

    Args:
        table: points along the path, (m, 3) [mm].
        trace: points, (n, 3) [mm].
        travel: as in `along`, (n,) [mm].
        spacing: of the table [mm].
        index: candidates of every point, (n, _KEPT), the first row given, the others written.
        origin: which of the candidates of the point before each of them follows, (n, _KEPT), likewise.
        kept: number of candidates, (n,), likewise.
        cost: of the sequences that end at the candidates, (_KEPT,), updated.
        at: where their feet are, in entries, (_KEPT,), updated.
    """
    last_entry = len(table) - 1
    extended = np.zeros(_KEPT)
    reached = np.zeros(_KEPT)
    candidate = np.zeros(_CANDIDATES, np.int64)
    place = np.zeros(_CANDIDATES)
    distance = np.zeros(_CANDIDATES)
    count = 0
    lowest = 0.0
    for k in range(1, len(trace)):
        step = np.sqrt(_square(trace[k], trace[k - 1]))
        length = max(travel[k], step)
        before = kept[k - 1]
        first, last = _range(index[k - 1], before)
        low = max(first - int((_BACK + length) / spacing), 0)
        for ahead in (_BACK, _REACH):  # far ahead only where no foot nearby advances as the trace does
            high = min(last + int((ahead + 4 * length) / spacing) + 1, last_entry)
            count = 0
            for c in range(_minima(table, trace[k], low, high, candidate, place, distance)):
                best = 0
                least = np.inf
                for j in range(before):
                    total = cost[j] + _misfit((place[c] - at[j]) * spacing, step, travel[k])
                    if total < least:
                        best = j
                        least = total
                least += _WEIGHT * distance[c] * length
                slot = count if count < _KEPT else int(np.argmax(extended))
                if count < _KEPT:
                    count += 1
                elif extended[slot] <= least:
                    continue
                extended[slot], reached[slot] = least, place[c]
                index[k, slot], origin[k, slot] = candidate[c], best
            lowest = _range(extended, count)[0]
            if lowest <= 0.5 * length:
                break
        alive = 0
        for c in range(count):  # those far behind the best do not come back
            if extended[c] <= lowest + 2 * _REACH:
                cost[alive], at[alive] = extended[c] - lowest, reached[c]
                index[k, alive], origin[k, alive] = index[k, c], origin[k, c]
                alive += 1
        kept[k] = alive


@inner_jit
def _trace_back(index, origin, slot, found):
    """Write the sequence that ends at a candidate of the last point of `found`."""
    for k in range(len(found) - 1, -1, -1):
        found[k] = index[k, slot]
        slot = origin[k, slot]


@jit
def along(table, trace, travel, spacing, begin):
    """Return the index of the entry at the foot of every point of a trace, in the order of the motion, (n,).

    Candidates are the points of the path that are nearer than their neighbours. Among all sequences of candidates s_k
    within reach of one another the one with the least

        sum of |s_k - s_(k-1) - l_k| + w d_k l_k,    l_k = |p_k - p_(k-1)|,

    is chosen (Viterbi's algorithm), d being the distance from the path. So the foot advances along the path as the
    trace does, where the path retraces itself or nearly does, and is the nearest where it may be either of two.

    Args:
        table: points along the path, (m, 3) [mm].
        trace: points, (n, 3) [mm].
        travel: length of the trace from the point before where others between them are left out, 0 elsewhere, (n,)
            [mm]. It stands for l_k there, see `_misfit`.
        spacing: of the table [mm].
        begin: index at which the trace begins; -1 to search the whole table.
    """
    n = len(trace)
    index = np.zeros((n, _KEPT), np.int32)
    origin = np.zeros((n, _KEPT), np.int8)
    kept = np.ones(n, np.int64)
    cost = np.zeros(_KEPT)
    at = np.zeros(_KEPT)
    index[0, 0] = _start(table, trace[0], spacing, begin)
    at[0] = index[0, 0]
    _extend(table, trace, travel, spacing, index, origin, kept, cost, at)
    found = np.empty(n, np.int64)
    _trace_back(index, origin, int(np.argmin(cost[: kept[n - 1]])), found)
    return found


@jit
def _next_block(table, trace, travel, spacing, index, origin, kept, cost, at, found, last):
    """Extend sequences by a block of a trace, and write what all of them have in common.

    Args:
        table: as in `along`.
        trace: the block, after the last point of the one before, (k + 1, 3) [mm].
        travel: as in `along`, (k + 1,) [mm].
        spacing: as in `along`.
        index: of the points that are not decided, the last is the first of `trace`, (u, _KEPT).
        origin: likewise, see `_extend`.
        kept: likewise, (u,).
        cost: see `_extend`.
        at: see `_extend`.
        found: of the points not decided and of the block, (u + k,), written as far as it is decided.
        last: whether the block is the last.

    Returns:
        The number of decided points less one, and index, origin and kept from the last decided one on.
    """
    u = len(kept) - 1
    n = len(trace)
    indices = np.zeros((u + n, _KEPT), np.int32)
    origins = np.zeros((u + n, _KEPT), np.int8)
    counts = np.ones(u + n, np.int64)
    indices[: u + 1], origins[: u + 1], counts[: u + 1] = index, origin, kept
    _extend(table, trace, travel, spacing, indices[u:], origins[u:], counts[u:], cost, at)
    k = u + n - 1
    slots = np.arange(counts[k])
    if last:
        slots[:] = np.argmin(cost[: counts[k]])
    while k > 0 and slots.min() != slots.max():
        for c in range(len(slots)):
            slots[c] = origins[k, slots[c]]
        k -= 1
    if slots.min() == slots.max():
        _trace_back(indices, origins, slots[0], found[: k + 1])
    return k, indices[k:].copy(), origins[k:].copy(), counts[k:].copy()


def along_blocks(table, blocks, count, spacing, begin):
    """Return what `along` does, (n,), for a trace that is given block by block.

    Args:
        table: as in `along`.
        blocks: iterator of the trace's points in their order, (k, 3) each, and their `travel`, (k,) each [mm].
        count: number of points, n.
        spacing: as in `along`.
        begin: as in `along`.
    """
    trace, travel = next(blocks)
    if len(trace) == count:
        return along(table, trace, travel, spacing, begin)
    found = np.empty(count, np.int64)
    decided = 0
    seen = 0
    index = np.zeros((1, _KEPT), np.int32)
    origin = np.zeros((1, _KEPT), np.int8)
    kept = np.ones(1, np.int64)
    cost = np.zeros(_KEPT)
    at = np.zeros(_KEPT)
    index[0, 0] = at[0] = along(table, trace[:1], travel[:1], spacing, begin)[0]
    while seen < count:
        seen = decided + len(kept) + len(trace) - 1
        part = found[decided:seen]
        k, index, origin, kept = _next_block(
            table, trace, travel, spacing, index, origin, kept, cost, at, part, seen == count
        )
        decided += k
        if seen < count:
            last = trace[-1:]
            trace, travel = next(blocks)
            trace = np.concatenate([last, trace])
            travel = np.concatenate([[0.0], travel])
    return found


@jit
def longer_steps(steps):
    """Return the longer of the steps before and after each point of a trace, (n,) [mm].

    A point at rest has the last step before the rest, and the first after it.

    Args:
        steps: from each point to the next, (n - 1,) [mm].
    """
    found = np.zeros(len(steps) + 1)
    moved = 0.0
    for k in range(len(steps)):
        if steps[k] > 0.0:
            moved = steps[k]
        found[k + 1] = moved
    moved = 0.0
    for k in range(len(steps) - 1, -1, -1):
        if steps[k] > 0.0:
            moved = steps[k]
        found[k] = max(found[k], moved)
    return found


@jit
def vertices(table, points, nearest):
    """Return the vertex of a parabola through the squared distances to three entries, in entries, (n,).

    Args:
        table: points along the path, (m, 3) [mm].
        points: (n, 3) [mm].
        nearest: index of the entry nearest to each point, (n,).
    """
    found = np.empty(len(points))
    square = np.empty(3)
    for k in range(len(points)):
        middle = min(max(nearest[k], 1), len(table) - 2)
        for i in range(3):
            square[i] = _square(table[middle - 1 + i], points[k])
        found[k] = middle + _vertex(square[0], square[1], square[2])
    return found
