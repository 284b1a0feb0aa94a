"""Measurements between two decisions of an agent, from the servo's log; compiled."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import floats, logs_at, octets, row_at, typed_pointer
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.machine.row import Log
from gantrysim.paths.nearest import Table, chord_at, nearest_chord, remembered, stretch, to_chord

# a row of measurements, see `IntervalValues`: those of the path, then those of one axis after the other
SHARED = ("contour_rms", "contour_max", "lateral", "speed", "heading", "curvature")
PER_AXIS = ("following_rms", "following_max", "following_mean", "torque", "ripple")
TOTAL = 3  # of an episode: ticks with the dispenser on, sum of their squared contour errors, largest

# how far an episode is measured
PROGRESS = np.dtype(
    [
        ("tick", np.int64),  # the first that is not
        ("foot", np.int64),  # index of the chord nearest to the nozzle at the last tick with the dispenser on
        ("lag", np.float64),  # of the nozzle, as remembered behind corners, see `gantrysim.paths.nearest` [mm],
        ("place", np.float64),  # and the progress there [mm]
        ("total", np.float64, (TOTAL,)),
    ]
)
NOT_MEASURED = -1  # tick of the progress after an interval that is still to be measured

# what is measured at a place, with the addresses of its arrays
SPAN = np.dtype(
    [
        ("dispense", np.int64),  # whether the dispenser is on, (n,)
        ("progress", np.int64),  # arc length for which each setpoint stands, (n,) [mm]
        ("count", np.int64),  # number of setpoints, n
        ("points", np.int64),  # along the requested path, (m, 3), by columns [mm]
        ("s", np.int64),  # arc lengths of the points, (m,) [mm]
        ("entries", np.int64),  # m
        ("widest", np.float64),  # largest distance between neighbouring points [mm]
        ("peak", np.int64),  # peak torque of the drives, (axes,) [N·m]
        ("values", np.int64),  # measurements, to be written: `SHARED`, then `PER_AXIS` for one axis after the other
        ("before", PROGRESS),  # the interval, unchanged, as MuJoCo's steps may be taken back and made again
        ("after", PROGRESS),  # it, to be written
    ]
)

_PATH_COLUMNS = len(SHARED)
_AXIS_COLUMNS = len(PER_AXIS)

_CONTOUR_RMS = SHARED.index("contour_rms")
_CONTOUR_MAX = SHARED.index("contour_max")
_LATERAL = SHARED.index("lateral")
_SPEED = SHARED.index("speed")
_HEADING = SHARED.index("heading")
_CURVATURE = SHARED.index("curvature")

_CHORD = 8  # points of the path to either side of a foot, over which heading and curvature are taken


class _Setpoints(NamedTuple):
    """Positions of all axes, (n, axes), whether the dispenser is on, (n,), and the progress, (n,) [mm]."""

    position: Floats
    dispense: NDArray[np.uint8]
    progress: Floats


@jit
def _distance(a, b):
    x = a[0] - b[0]
    y = a[1] - b[1]
    z = a[2] - b[2]
    return np.sqrt(x * x + y * y + z * z)


@intrinsic
def _spans(context: Any, address: Any) -> Any:
    return typed_pointer(numba.from_dtype(SPAN))


@cache
def measuring_stage() -> int:
    """Return the address of a C function that measures an interval; its argument is the address of its `SPAN`.

    Errors of the axes are those of all ticks since `before`, contour errors of those with the dispenser on. The
    distance to the path is that to the chords between its points, whose sagitta is spacing^2 curvature / 8; its feet
    are found as those of the analysis are, near the progress of the command.

    As the observer of a servo's row, see `gantrysim.machine.row`, it measures on the thread that has stepped.
    """

    def stage(data, userdata, argument):
        _measure(row_at(userdata), numba.carray(_spans(argument), (1,))[0])

    return compiled_stage(stage)


@cache
def _measuring() -> Any:
    return ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)(measuring_stage())


def measure(userdata: int, span: int) -> None:
    """Measure an interval, see `measuring_stage`.

    Args:
        userdata: address of the servo's row, whose log is read.
        span: address of the `SPAN`.
    """
    _measuring()(0, userdata, span)


@jit
def _measure(row, span):
    """Measure the ticks of a servo's row since `before`, and write values and progress after them."""
    axes = row.axes
    first = span.before.tick
    last = row.tick
    log = Log(*logs_at(row.log, row.axis_log, last, axes))
    position = numba.carray(floats(row.setpoints), (span.count, axes))
    dispense = numba.carray(octets(span.dispense), (span.count,))
    points = numba.carray(floats(span.points), (3, span.entries)).T
    s = numba.carray(floats(span.s), (span.entries,))
    progress = numba.carray(floats(span.progress), (span.count,))
    peak = numba.carray(floats(span.peak), (axes,))
    values = numba.carray(floats(span.values), (_PATH_COLUMNS + _AXIS_COLUMNS * axes,))
    for column in range(len(values)):
        values[column] = 0.0
    for k in range(TOTAL):
        span.after.total[k] = span.before.total[k]
    setpoints = _Setpoints(position, dispense, progress)
    tips, speed = _measure_axes(log, (first, last), setpoints, row.period, peak, values)
    # no corner needs to be known for the distance from chords
    path = Table(s, points, np.empty(0, np.bool_), span.widest)
    _measure_path(path, tips, span, values)
    span.after.tick = last
    values[_SPEED] = speed


@jit
def _measure_axes(log, ticks, setpoints, period, peak, row):
    """Measure following errors and torques of the axes; return the nozzle while it dispenses, and its speed.

    The nozzle's places are followed by the progress of the command at the same ticks, (k, 4) [mm].

    Args:
        log: the servo's.
        ticks: the first, and the one after the last.
        setpoints: of all ticks.
        period: servo period [s].
        peak: peak torque of the drives, (axes,) [N·m].
        row: of measurements, zero so far; to be written.
    """
    first, last = ticks
    position, dispense, progress = setpoints
    n = position.shape[1]
    tips = np.empty((last - first, 4))
    laid = 0
    count = 0
    pairs = 0
    way = 0.0
    for k in range(first, last):
        setpoint = log.tick[k].setpoint
        tip = log.tick[k].nozzle
        if not (np.isfinite(tip[0]) and np.isfinite(tip[1]) and np.isfinite(tip[2])):
            continue
        count += 1
        # at a switch of the dispenser torques differ for other reasons than ripple
        dispensing = k > 0 and dispense[setpoint] != 0 and dispense[log.tick[k - 1].setpoint] != 0
        pairs += dispensing
        for a in range(n):
            column = _PATH_COLUMNS + _AXIS_COLUMNS * a
            error = position[setpoint, a] - log.axis[k, a].encoder
            demand = log.axis[k, a].demand
            row[column] += error * error
            row[column + 1] = max(row[column + 1], abs(error))
            row[column + 2] += error
            row[column + 3] = max(row[column + 3], abs(demand))
            if dispensing:
                change = demand - log.axis[k - 1, a].demand
                row[column + 4] += change * change
        way += _distance(tip, log.tick[k - 1].nozzle) if k > 0 else 0.0
        if dispense[setpoint] != 0:
            for i in range(3):
                tips[laid, i] = tip[i]
            tips[laid, 3] = progress[setpoint]
            laid += 1
    for a in range(n):
        column = _PATH_COLUMNS + _AXIS_COLUMNS * a
        row[column] = np.sqrt(row[column] / max(count, 1))
        row[column + 2] /= max(count, 1)
        row[column + 3] /= peak[a]
        row[column + 4] = np.sqrt(0.5 * row[column + 4] / max(pairs, 1)) / peak[a]
    return tips[:laid], way / (max(count, 1) * period)


@jit
def _measure_path(path, tips, span, row):
    """Measure the contour errors of the nozzle's places while it dispenses.

    Args:
        path: points along the requested path.
        tips: places of the nozzle, and the progress of the command, (k, 4) [mm].
        span: with the state before, and that after it to be written.
        row: of measurements, to be written.
    """
    points = path.points
    s = path.s
    laid = len(tips)
    foot = span.before.foot
    lag = span.before.lag
    place = span.before.place
    total = span.after.total
    square = 0.0
    largest = 0.0
    sideways = 0.0
    for k in range(laid):
        x = tips[k, 0]
        y = tips[k, 1]
        z = tips[k, 2]
        here = chord_at(s, tips[k, 3])
        share = (tips[k, 3] - s[here]) / (s[here + 1] - s[here])
        away = 0.0
        for i in range(3):
            away += (tips[k, i] - points[here, i] - share * (points[here + 1, i] - points[here, i])) ** 2
        away = np.sqrt(away)
        lag = remembered(lag, away, tips[k, 3] - place)
        place = tips[k, 3]
        foot, along = nearest_chord(path, x, y, z, place, stretch(path, place, away, lag))
        distance = to_chord(points, foot, x, y, z, (along, along))[0]
        u = points[foot + 1, 0] - points[foot, 0]
        v = points[foot + 1, 1] - points[foot, 1]
        level = np.sqrt(u * u + v * v)
        square += distance
        largest = max(largest, np.sqrt(distance))
        sideways += (u * (y - points[foot, 1]) - v * (x - points[foot, 0])) / level if level > 0.0 else 0.0
    span.after.foot = foot
    span.after.lag = lag
    span.after.place = place
    total[0] += laid
    total[1] += square
    total[2] = max(total[2], largest)
    middle = min(max(foot, _CHORD), len(points) - 1 - _CHORD)
    x_before = points[middle, 0] - points[middle - _CHORD, 0]
    y_before = points[middle, 1] - points[middle - _CHORD, 1]
    x_after = points[middle + _CHORD, 0] - points[middle, 0]
    y_after = points[middle + _CHORD, 1] - points[middle, 1]
    turned = np.arctan2(x_before * y_after - y_before * x_after, x_before * x_after + y_before * y_after)
    row[_CONTOUR_RMS] = np.sqrt(square / max(laid, 1))
    row[_CONTOUR_MAX] = largest
    row[_LATERAL] = sideways / max(laid, 1)
    row[_HEADING] = np.arctan2(y_before + y_after, x_before + x_after)
    row[_CURVATURE] = turned / (0.5 * (s[middle + _CHORD] - s[middle - _CHORD]))
