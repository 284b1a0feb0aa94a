"""Measurements between two decisions of an agent, from the servo's log; compiled."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np

from gantrysim.controllers.paths.nearest import along
from gantrysim.jit import inner_jit, jit

# a row of measurements: those of the path, then those of one axis after the other
SHARED = ("ticks", "dispensing", "pairs", "contour_square", "contour_max", "lateral", "way", "heading", "turning")
PER_AXIS = ("square", "largest", "sum", "demand", "ripple")

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


@jit
def measure(log, first, last, position, dispense, points, spacing, foot, row):
    """Measure the ticks from `first` to before `last` and return the foot of the last.

    Errors of the axes are sums over all these ticks, contour errors over those with the dispenser on. The distance to
    the path is that to the chords between its points, whose sagitta is spacing^2 curvature / 8; its feet are found as
    those of the analysis are, from the last foot on.

    Args:
        log: the servo's, see `gantrysim.native.row.Log`.
        first: the first tick.
        last: the tick after the last.
        position: the setpoints for all axes, (n, axes).
        dispense: whether the dispenser is on, (n,).
        points: along the requested path, (m, 3) [mm].
        spacing: distance between the points [mm].
        foot: index of the point nearest to the nozzle at the last tick, -1 before the dispenser was ever on.
        row: measurements, to be written: `SHARED`, then `PER_AXIS` for one axis after the other. The ripple is a sum of
            squared changes over pairs of ticks with the dispenser on; `heading` [rad] and `turning` [1/mm] are the
            path's at the last foot.
    """
    n = position.shape[1]
    tips, laid = np.empty((last - first, 3)), 0
    row[:] = 0.0
    for k in range(first, last):
        at = log.tick[k].setpoint
        tip = log.tick[k].nozzle
        if not np.isfinite(tip).all():
            continue
        row[0] += 1
        both = k > 0 and dispense[at] and dispense[log.tick[k - 1].setpoint]
        row[2] += both
        for a in range(n):
            column = row[_HEAD + _EACH * a : _HEAD + _EACH * (a + 1)]
            error = position[at, a] - log.axis[k, a].encoder
            demand = log.axis[k, a].demand
            column[0] += error * error
            column[1] = max(column[1], abs(error))
            column[2] += error
            column[3] = max(column[3], abs(demand))
            if both:
                change = demand - log.axis[k - 1, a].demand
                column[4] += change * change
        row[6] += _distance(tip, log.tick[k - 1].nozzle) if k > 0 else 0.0
        if dispense[at]:
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
