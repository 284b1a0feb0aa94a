"""The feet of a trace on a path, as entries of a table of points along it, in the order of the motion; compiled."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import seen
from gantrysim.base.jit import inner_jit, plain_inner_jit, plain_jit
from gantrysim.paths.minima import ZERO, Minima, Table, find_minima, first_near_entry, nearest_entry, square_distance
from gantrysim.paths.sequences import (
    BEAM,
    CANDIDATES,
    Buffers,
    Ends,
    Sequences,
    Trace,
    begun,
    extended,
)

# A foot advances by at most _REACH more than four times the point's step, and goes back by at most _BACK more than it
# [mm].
_REACH = 10.0
_BACK = 1.0
_AROUND = 12  # entries about the first foot that are searched for a nearer one
_WEIGHT = 0.02  # of the distance from the path, per mm of the trace, against the difference in progress [1/mm]
# Between two points with others left out between them the path may go with the trace, or leave that motion out: any
# progress from the distance of the two to the length of the trace between them is likely, and that length the likelier.
_LEFT_OUT = 0.1  # weight of the remaining length against a progress beyond either
_ROUNDING = 1e-9  # of lengths [mm]


@plain_inner_jit
def _range(values, count):
    """Return the least and the largest of the first `count` values."""
    least = values[0]
    largest = values[0]
    for i in range(1, count):
        value = values[i]
        if value < least:
            least = value
        if value > largest:
            largest = value
    return least, largest


@plain_inner_jit
def _least(values, count):
    """Return the index of the least of the first `count` values."""
    least = 0
    for i in range(1, count):
        if values[i] < values[least]:
            least = i
    return least


@plain_jit
def _start(table, point, begin):
    """Return the index of the entry at the first foot of a trace that begins at a point; arguments as in `along`."""
    points = table.points
    if begin < 0:
        first = first_near_entry(table, point)
        reach = 2
    else:
        first = min(begin, len(points) - 1)
        reach = int((2 * np.sqrt(square_distance(points[first], point)) + _BACK) / table.spacing)
    first = nearest_entry(points, point, first - reach, first + reach)
    return nearest_entry(points, point, first - _AROUND, first + _AROUND)


@plain_inner_jit
def _misfit(advance, step, length):
    """Return by how much a foot's progress differs from the trace's [mm].

    Args:
        advance: progress of the foot along the path [mm].
        step: distance of the two points [mm].
        length: of the trace between them where points are left out, else 0 [mm].
    """
    if length <= step + _ROUNDING:
        return abs(advance - step)
    beyond = max(step - advance, 0.0) + max(advance - length, 0.0)
    return _LEFT_OUT * abs(advance - length) + (1.0 - _LEFT_OUT) * beyond


@plain_inner_jit
def _extend(table, trace, sequences, buffers):
    """Extend the best sequences of feet from the first point of a trace to all others.

    Args:
        table: points along the path.
        trace: the trace.
        sequences: of its points, the first row given, the others written.
        buffers: with the ends of the sequences, which are updated.
    """
    points = table.points
    spacing = table.spacing
    last_entry = len(points) - 1
    ends = buffers.ends
    extended_cost = buffers.cost
    extended_place = buffers.place
    minima = buffers.minima
    count = ZERO
    lowest = 0.0
    for k in range(1, len(trace.points)):
        point = trace.points[k]
        step = np.sqrt(square_distance(point, trace.points[k - 1]))
        length = max(trace.travel[k], step)
        before = sequences.candidates[k - 1]
        first, last = _range(sequences.entry[k - 1], before)
        low = max(first - int((_BACK + length) / spacing), 0)
        for ahead in (_BACK, _REACH):  # far ahead only where no foot nearby advances as the trace does
            high = min(last + int((ahead + 4 * length) / spacing) + 1, last_entry)
            count = ZERO
            for c in range(find_minima(points, point, low, high, minima)):
                best = 0
                least = np.inf
                for j in range(before):
                    advance = (minima.place[c] - ends.place[j]) * spacing
                    cost = ends.cost[j] + _misfit(advance, step, trace.travel[k])
                    if cost < least:
                        best = j
                        least = cost
                least += _WEIGHT * minima.distance[c] * length
                # where all slots are taken, the costliest sequence gives way
                slot = count
                if count < BEAM:
                    count += 1
                else:
                    slot = 0
                    for j in range(1, BEAM):
                        if extended_cost[j] > extended_cost[slot]:
                            slot = j
                    if extended_cost[slot] <= least:
                        continue
                extended_cost[slot] = least
                extended_place[slot] = minima.place[c]
                sequences.entry[k, slot] = minima.entry[c]
                sequences.origin[k, slot] = best
            lowest = extended_cost[_least(extended_cost, count)]
            if lowest <= 0.5 * length:
                break
        alive = 0
        for c in range(count):  # those far behind the best do not come back
            if extended_cost[c] <= lowest + 2 * _REACH:
                ends.cost[alive] = extended_cost[c] - lowest
                ends.place[alive] = extended_place[c]
                sequences.entry[k, alive] = sequences.entry[k, c]
                sequences.origin[k, alive] = sequences.origin[k, c]
                alive += 1
        sequences.candidates[k] = alive


@plain_inner_jit
def _trace_back(sequences, slot, entries):
    """Write the sequence that ends at a candidate of the last point of `entries`."""
    for k in range(len(entries) - 1, -1, -1):
        entries[k] = sequences.entry[k, slot]
        slot = sequences.origin[k, slot]


def along(points, trace, travel, spacing, begin):
    """Return the index of the entry at the foot of every point of a trace, in the order of the motion, (n,).

    Candidates are the points of the path that are nearer than their neighbours. Among all sequences of candidates s_k
    within reach of one another the one with the least

        sum of |s_k - s_(k-1) - l_k| + w d_k l_k,    l_k = |p_k - p_(k-1)|,

    is chosen (Viterbi's algorithm), d being the distance from the path. So the foot advances along the path as the
    trace does, where the path retraces itself or nearly does, and is the nearest where it may be either of two.

    Args:
        points: of a table along the path, (m, 3) [mm].
        trace: points, (n, 3) [mm].
        travel: length of the trace from the point before where others between them are left out, 0 elsewhere, (n,)
            [mm]. It stands for l_k there, see `_misfit`.
        spacing: of the table [mm].
        begin: index at which the trace begins; -1 to search the whole table.
    """
    table = Table(points, spacing)
    sequences, buffers = begun(_start(table, trace[0], begin))
    entries = np.empty(len(trace), np.int64)
    _next_block(table, Trace(trace, travel), extended(sequences, len(trace) - 1), buffers, entries, True)
    return entries


@inner_jit
def along_compiled(points, trace, travel, spacing, begin):
    """Return what `along` does, for compiled callers."""
    n = len(trace)
    # empty: to clear them takes a tenth of the time of a short trace
    sequences = Sequences(np.empty((n, BEAM), np.int32), np.empty((n, BEAM), np.int8), np.empty(n, np.int64))
    ends = Ends(np.zeros(BEAM), np.zeros(BEAM))
    numbers = np.empty((3, CANDIDATES))
    minima = Minima(np.empty(CANDIDATES, np.int64), numbers[0], numbers[1], numbers[2])
    buffers = Buffers(ends, np.empty(BEAM), np.empty(BEAM), minima, np.empty(BEAM, np.int32))
    table = Table(points, spacing)
    first = _start(table, trace[0], begin)
    sequences.entry[0, 0] = first
    sequences.candidates[0] = 1
    ends.place[0] = first
    _extend(table, Trace(trace, travel), sequences, buffers)
    entries = np.empty(n, np.int64)
    _trace_back(sequences, _least(ends.cost, sequences.candidates[n - 1]), entries)
    return entries


@plain_jit
def _next_block(table, block, sequences, buffers, entries, is_last):
    """Extend sequences by a block of a trace, and write what all of them have in common.

    Arrays are made by the caller: numba would compile that too.

    Args:
        table: points along the path.
        block: of the trace, after the last point of the block before, k + 1 points.
        sequences: of the points that are not decided and of the block, (u + k,), of which those of the block, from its
            second point on, are written.
        buffers: with the ends of the sequences, which are updated.
        entries: of the same points, (u + k,), written as far as they are decided.
        is_last: whether the block is the last.

    Returns:
        The number of decided points less one.
    """
    first = len(entries) - len(block.points)
    new = Sequences(sequences.entry[first:], sequences.origin[first:], sequences.candidates[first:])
    _extend(table, block, new, buffers)
    k = len(entries) - 1
    count = sequences.candidates[k]
    slots = buffers.slots
    for c in range(count):
        slots[c] = c
    if is_last:
        best = _least(buffers.ends.cost, count)
        slots[0] = best
        count = 1
    while True:
        least, largest = _range(slots, count)
        if k == 0 or least == largest:
            break
        for c in range(count):
            slots[c] = sequences.origin[k, slots[c]]
        k -= 1
    if least == largest:
        _trace_back(sequences, slots[0], entries[: k + 1])
    return k


def along_blocks(points, blocks, count, spacing, begin):
    """Return what `along` does, (n,), for a trace that is given block by block.

    Args:
        points: as in `along`.
        blocks: iterator of the trace's points in their order, (k, 3) each, and their `travel`, (k,) each [mm].
        count: number of points, n.
        spacing: as in `along`.
        begin: as in `along`.
    """
    trace, travel = next(blocks)
    if len(trace) == count:
        return along(points, trace, travel, spacing, begin)
    table = Table(points, spacing)
    entries = np.empty(count, np.int64)
    decided = 0
    received = 0
    undecided, buffers = begun(_start(table, trace[0], begin))
    while received < count:
        received = decided + len(undecided.candidates) + len(trace) - 1
        sequences = extended(undecided, len(trace) - 1)
        block = Trace(trace, travel)
        k = _next_block(table, block, sequences, buffers, entries[decided:received], received == count)
        undecided = Sequences(sequences.entry[k:], sequences.origin[k:], sequences.candidates[k:])
        decided += k
        if received < count:
            last = trace[-1:]
            trace, travel = next(blocks)
            trace = seen(np.concatenate([last, trace]))
            travel = np.concatenate([[0.0], travel])
    return entries
