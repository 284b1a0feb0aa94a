"""Measurements between two decisions of an agent, from the servo's log; compiled."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numba
import numpy as np

from gantrysim.base.jit import cached, inner_jit
from gantrysim.native.pointers import floats, logs_at, octets
from gantrysim.paths.nearest import along

# a row of measurements, see `IntervalValues`: those of the path, then those of one axis after the other
SHARED = ("contour_rms", "contour_max", "lateral", "speed", "heading", "curvature")
PER_AXIS = ("tracking_rms", "tracking_max", "tracking_mean", "torque", "ripple")
TOTAL = 3  # of an episode: ticks with the dispenser on, sum of their squared contour errors, largest

# what is measured at a place, with the addresses of its arrays
SPAN = np.dtype(
    [
        ("log", np.int64),  # of `LOG_TICK`, (ticks,)
        ("axis_log", np.int64),  # of `LOG_AXIS`, (ticks, axes)
        ("setpoints", np.int64),  # for all axes, (n, axes)
        ("dispense", np.int64),  # whether the dispenser is on, (n,)
        ("count", np.int64),  # n
        ("points", np.int64),  # along the requested path, (m, 3) [mm]
        ("entries", np.int64),  # m
        ("spacing", np.float64),  # distance between the points [mm]
        ("first", np.int64),  # tick
        ("last", np.int64),  # the tick after the last
        ("foot", np.int64),  # index of the point nearest to the nozzle at the last tick
    ]
)

_HEAD, _EACH = len(SHARED), len(PER_AXIS)

_CHORD = 8  # points of the path to either side of a foot, over which heading and curvature are taken


@inner_jit
def _distance(a, b):
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return np.sqrt(x * x + y * y + z * z)


@inner_jit
def _to_chord(points, i, tip):
    """Distance of a tip to the chord from point i to the next, and to the left of it in the XY plane."""
    a, b = points[i], points[i + 1]
    u, v, w = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    x, y, z = tip[0] - a[0], tip[1] - a[1], tip[2] - a[2]
    square = u * u + v * v + w * w
    share = min(max((x * u + y * v + z * w) / square, 0.0), 1.0) if square > 0 else 0.0
    x, y, z = x - share * u, y - share * v, z - share * w
    level = np.sqrt(u * u + v * v)
    left = (u * y - v * x) / level if level > 0 else 0.0
    return np.sqrt(x * x + y * y + z * z), left


@cached(numba.njit, error_model="numpy", nogil=True)
def measure(spans, places, period, peak, rows, totals):
    """Measure the ticks of some places from `first` to before `last`, and write the foot of the last.

    Errors of the axes are those of all these ticks, contour errors of those with the dispenser on. The distance to the
    path is that to the chords between its points, whose sagitta is spacing^2 curvature / 8; its feet are found as those
    of the analysis are, from the last foot on.

    Args:
        spans: of all places, whose arrays the caller keeps alive, (places,) of `SPAN`; a foot of -1 is for a dispenser
            that was never on.
        places: indices of those to be measured, (m,).
        period: servo period [s].
        peak: peak torque of the drives, (axes,) [N·m].
        rows: measurements of all places, to be written: `SHARED`, then `PER_AXIS` for one axis after the other.
        totals: of the episodes so far, (places, TOTAL), to be added to.
    """
    axes = (rows.shape[1] - _HEAD) // _EACH
    for place in places:
        span = spans[place]
        tick, axis = logs_at(span.log, span.axis_log, span.last, axes)
        position = numba.carray(floats(span.setpoints), (span.count, axes))
        dispense = numba.carray(octets(span.dispense), (span.count,))
        points = numba.carray(floats(span.points), (span.entries, 3))
        first, last, spacing = span.first, span.last, span.spacing
        row, total = rows[place], totals[place]
        span.foot = _measure(
            tick, axis, first, last, position, dispense, points, spacing, span.foot, period, peak, row, total
        )


@inner_jit
def _measure(log, axes, first, last, position, dispense, points, spacing, foot, period, peak, row, total):
    n = position.shape[1]
    tips, laid, ticks, pairs, way = np.empty((last - first, 3)), 0, 0, 0, 0.0
    row[:] = 0.0
    for k in range(first, last):
        at = log[k].setpoint
        tip = log[k].nozzle
        if not np.isfinite(tip).all():
            continue
        ticks += 1
        both = k > 0 and dispense[at] != 0 and dispense[log[k - 1].setpoint] != 0
        pairs += both
        for a in range(n):
            column = row[_HEAD + _EACH * a : _HEAD + _EACH * (a + 1)]
            error = position[at, a] - axes[k, a].encoder
            demand = axes[k, a].demand
            column[0] += error * error
            column[1] = max(column[1], abs(error))
            column[2] += error
            column[3] = max(column[3], abs(demand))
            if both:
                change = demand - axes[k - 1, a].demand
                column[4] += change * change
        way += _distance(tip, log[k - 1].nozzle) if k > 0 else 0.0
        if dispense[at] != 0:
            tips[laid] = tip
            laid += 1
    for a in range(n):
        column = row[_HEAD + _EACH * a : _HEAD + _EACH * (a + 1)]
        column[0] = np.sqrt(column[0] / max(ticks, 1))
        column[2] /= max(ticks, 1)
        column[3] /= peak[a]
        column[4] = np.sqrt(0.5 * column[4] / max(pairs, 1)) / peak[a]
    feet = along(points, tips[:laid], np.zeros(laid), spacing, max(foot, 0)) if laid else np.zeros(0, np.int64)
    square, largest, sideways = 0.0, 0.0, 0.0
    for k in range(laid):
        foot = feet[k]
        distance, left = np.inf, 0.0
        for i in range(max(foot - 1, 0), min(foot + 1, len(points) - 1)):
            to, side = _to_chord(points, i, tips[k])
            if to < distance:
                distance, left = to, side
        square += distance * distance
        largest = max(largest, distance)
        sideways += left
    total[0] += laid
    total[1] += square
    total[2] = max(total[2], largest)
    middle = min(max(foot, _CHORD), len(points) - 1 - _CHORD)
    x, y = points[middle] - points[middle - _CHORD], points[middle + _CHORD] - points[middle]
    heading = np.arctan2(x[1] + y[1], x[0] + y[0])
    between = np.arctan2(x[0] * y[1] - x[1] * y[0], x[0] * y[0] + x[1] * y[1])
    speed, curvature = way / (max(ticks, 1) * period), between / (_CHORD * spacing)
    # in the order of SHARED
    row[0], row[1], row[2] = np.sqrt(square / max(laid, 1)), largest, sideways / max(laid, 1)
    row[3], row[4], row[5] = speed, heading, curvature
    return foot
