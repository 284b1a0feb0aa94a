"""Measurements between two decisions of an agent, from the servo's log; compiled."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numba
import numpy as np

from gantrysim.controllers.paths.nearest import along
from gantrysim.jit import cached, inner_jit
from gantrysim.native.pointers import floats, logs_at, octets

# a row of measurements: those of the path, then those of one axis after the other
SHARED = ("ticks", "dispensing", "pairs", "contour_square", "contour_max", "lateral", "way", "heading", "turning")
PER_AXIS = ("square", "largest", "sum", "demand", "ripple")

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
def measure(spans, places, rows):
    """Measure the ticks of some places from `first` to before `last`, and write the foot of the last.

    Errors of the axes are sums over all these ticks, contour errors over those with the dispenser on. The distance to
    the path is that to the chords between its points, whose sagitta is spacing^2 curvature / 8; its feet are found as
    those of the analysis are, from the last foot on.

    Args:
        spans: of all places, whose arrays the caller keeps alive, (places,) of `SPAN`; a foot of -1 is for a dispenser
            that was never on.
        places: indices of those to be measured, (m,).
        rows: measurements of all places, to be written: `SHARED`, then `PER_AXIS` for one axis after the other. The
            ripple is a sum of squared changes over pairs of ticks with the dispenser on; `heading` [rad] and `turning`
            [1/mm] are the path's at the last foot.
    """
    axes = (rows.shape[1] - _HEAD) // _EACH
    for place in places:
        span = spans[place]
        tick, axis = logs_at(span.log, span.axis_log, span.last, axes)
        position = numba.carray(floats(span.setpoints), (span.count, axes))
        dispense = numba.carray(octets(span.dispense), (span.count,))
        points = numba.carray(floats(span.points), (span.entries, 3))
        first, last, spacing = span.first, span.last, span.spacing
        span.foot = _measure(tick, axis, first, last, position, dispense, points, spacing, span.foot, rows[place])


@inner_jit
def _measure(log, axes, first, last, position, dispense, points, spacing, foot, row):
    n = position.shape[1]
    tips, laid = np.empty((last - first, 3)), 0
    row[:] = 0.0
    for k in range(first, last):
        at = log[k].setpoint
        tip = log[k].nozzle
        if not np.isfinite(tip).all():
            continue
        row[0] += 1
        both = k > 0 and dispense[at] != 0 and dispense[log[k - 1].setpoint] != 0
        row[2] += both
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
        row[6] += _distance(tip, log[k - 1].nozzle) if k > 0 else 0.0
        if dispense[at] != 0:
            tips[laid] = tip
            laid += 1
    feet = along(points, tips[:laid], spacing, max(foot, 0)) if laid else np.zeros(0, np.int64)
    for k in range(laid):
        foot = feet[k]
        distance, left = np.inf, 0.0
        for i in range(max(foot - 1, 0), min(foot + 1, len(points) - 1)):
            to, side = _to_chord(points, i, tips[k])
            if to < distance:
                distance, left = to, side
        row[1] += 1
        row[3] += distance * distance
        row[4] = max(row[4], distance)
        row[5] += left
    middle = min(max(foot, _CHORD), len(points) - 1 - _CHORD)
    x, y = points[middle] - points[middle - _CHORD], points[middle + _CHORD] - points[middle]
    row[7] = np.arctan2(x[1] + y[1], x[0] + y[0])
    between = np.arctan2(x[0] * y[1] - x[1] * y[0], x[0] * y[0] + x[1] * y[1])
    row[8] = between / (_CHORD * spacing)
    return foot
