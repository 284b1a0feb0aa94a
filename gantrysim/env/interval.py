"""Measurements between two decisions of an agent, from the servo's log; compiled."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import log_of, pointer, row_at
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.paths.nearest import Table, chord_near, nearest_chord, remembered_lag, stretch, to_chord

# what is measured between two decisions, see `IntervalValues`: of the path, and of each axis
PATH_VALUES = np.dtype(
    [
        ("contour_rms", np.float64),
        ("contour_max", np.float64),
        ("lateral", np.float64),
        ("speed", np.float64),
        ("heading", np.float64),
        ("curvature", np.float64),
    ]
)
AXIS_VALUES = np.dtype(
    [
        ("following_rms", np.float64),
        ("following_max", np.float64),
        ("following_mean", np.float64),
        ("torque", np.float64),
        ("ripple", np.float64),
    ]
)

# how far an episode is measured
PROGRESS = np.dtype(
    [
        ("tick", np.int64),  # the first that is not
        ("foot", np.int64),  # index of the chord nearest to the nozzle at the last tick with the dispenser on
        ("lag", np.float64),  # of the nozzle, as remembered behind corners, see `gantrysim.paths.nearest` [mm],
        ("place", np.float64),  # and the progress there [mm]
        # of the episode
        ("laid", np.float64),  # ticks with the dispenser on
        ("square", np.float64),  # sum of their squared contour errors [mm²]
        ("largest", np.float64),  # of their contour errors [mm]
    ]
)
NOT_MEASURED = -1  # tick of the progress after an interval that is still to be measured

# what is measured at a place, with the addresses of its arrays
MEASURED_SPAN = np.dtype(
    [
        ("dispense", np.int64),  # whether the dispenser is on, (n,)
        ("progress", np.int64),  # arc length for which each setpoint stands, (n,) [mm]
        ("count", np.int64),  # number of setpoints, n
        ("points", np.int64),  # along the requested path, (m, 3), by columns [mm]
        ("s", np.int64),  # arc lengths of the points, (m,) [mm]
        ("entries", np.int64),  # m
        ("widest", np.float64),  # largest distance between neighbouring points [mm]
        ("peak", np.int64),  # peak torque of the drives, (axes,) [N·m]
        ("path_values", np.int64),  # one of `PATH_VALUES`, to be written
        ("axis_values", np.int64),  # (axes,) of `AXIS_VALUES`, to be written
        ("before", PROGRESS),  # the interval, unchanged, as MuJoCo's steps may be taken back and made again
        ("after", PROGRESS),  # it, to be written
    ]
)

_MEASURED_SPAN = numba.from_dtype(MEASURED_SPAN)
_PATH_VALUES = numba.from_dtype(PATH_VALUES)
_AXIS_VALUES = numba.from_dtype(AXIS_VALUES)
_OCTET = types.uint8
_FLOAT = types.float64

# points of the path to either side of a foot, over which heading and curvature are taken: 0.3 to 0.8 mm on the drawn
# spirals of all tasks, 0.4 mm on a straight path
_CHORD = 8


class _Laid(NamedTuple):
    """The nozzle while it dispenses.

    Attributes:
        tips: its places, (k, 3) [mm].
        progress: that of the command at the same ticks, (k,) [mm].
    """

    tips: Floats
    progress: Floats


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


@cache
def measuring_stage() -> int:
    """Return the address of a C function that measures an interval; its argument is the address of its `MEASURED_SPAN`.

    Errors of the axes are those of all ticks since `before`, contour errors of those with the dispenser on. The
    distance to the path is that to the chords between its points, whose sagitta is spacing^2 curvature / 8; its feet
    are found as those of the analysis are, near the progress of the command.

    As the observer of a servo's row, see `gantrysim.machine.row`, it measures on the thread that has stepped.
    """

    def stage(address, argument):
        measure_interval(row_at(address), numba.carray(pointer(argument, _MEASURED_SPAN), (1,))[0])

    return compiled_stage(stage)


@cache
def _observer(stage: int) -> Any:
    return ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)(stage)


def measure(row: int, argument: int, stage: int | None = None) -> None:
    """Measure an interval now, on this thread.

    Args:
        row: address of the servo's row, whose log is read.
        argument: of the stage: by default the address of the `MEASURED_SPAN`.
        stage: address of a C function such as `measuring_stage`, the default.
    """
    _observer(measuring_stage() if stage is None else stage)(row, argument)


@jit
def measure_interval(row, span):
    """Measure the ticks of a servo's row since `before`, and write values and progress after them."""
    axes = row.axes
    first = span.before.tick
    last = row.tick
    log = log_of(row)
    position = numba.carray(pointer(row.setpoints, _FLOAT), (span.count, axes))
    dispense = numba.carray(pointer(span.dispense, _OCTET), (span.count,))
    points = numba.carray(pointer(span.points, _FLOAT), (3, span.entries)).T
    s = numba.carray(pointer(span.s, _FLOAT), (span.entries,))
    progress = numba.carray(pointer(span.progress, _FLOAT), (span.count,))
    peak = numba.carray(pointer(span.peak, _FLOAT), (axes,))
    path_values = numba.carray(pointer(span.path_values, _PATH_VALUES), (1,))[0]
    axis_values = numba.carray(pointer(span.axis_values, _AXIS_VALUES), (axes,))
    setpoints = _Setpoints(position, dispense, progress)
    laid, path_values.speed = _measure_axes(log, (first, last), setpoints, row.period, peak, axis_values)
    # no corner needs to be known for the distance from chords
    path = Table(s, points, np.empty(0, np.bool_), span.widest)
    _measure_path(path, laid, span, path_values)
    span.after.tick = last


@jit
def _measure_axes(log, ticks, setpoints, period, peak, values):
    """Measure following errors and torques of the axes; return the nozzle while it dispenses, and its speed.

    Args:
        log: the servo's.
        ticks: the first, and the one after the last.
        setpoints: of all ticks.
        period: servo period [s].
        peak: peak torque of the drives, (axes,) [N·m].
        values: (axes,) of `AXIS_VALUES`, to be written.
    """
    first, last = ticks
    position, dispense, progress = setpoints
    tips = np.empty((last - first, 3))
    stands_for = np.empty(last - first)
    laid = 0
    count = 0
    pairs = 0
    way = 0.0
    for value in values:
        value.following_rms = 0.0
        value.following_max = 0.0
        value.following_mean = 0.0
        value.torque = 0.0
        value.ripple = 0.0
    for k in range(first, last):
        setpoint = log.tick[k].setpoint
        tip = log.tick[k].nozzle
        if not (np.isfinite(tip[0]) and np.isfinite(tip[1]) and np.isfinite(tip[2])):
            continue
        count += 1
        # at a switch of the dispenser torques differ for other reasons than ripple
        dispensing = k > 0 and dispense[setpoint] != 0 and dispense[log.tick[k - 1].setpoint] != 0
        pairs += dispensing
        for a in range(len(values)):
            value = values[a]
            error = position[setpoint, a] - log.axis[k, a].encoder
            demand = log.axis[k, a].demand
            value.following_rms += error * error
            value.following_max = max(value.following_max, abs(error))
            value.following_mean += error
            value.torque = max(value.torque, abs(demand))
            if dispensing:
                change = demand - log.axis[k - 1, a].demand
                value.ripple += change * change
        way += _distance(tip, log.tick[k - 1].nozzle) if k > 0 else 0.0
        if dispense[setpoint] != 0:
            for i in range(3):
                tips[laid, i] = tip[i]
            stands_for[laid] = progress[setpoint]
            laid += 1
    for a in range(len(values)):
        value = values[a]
        value.following_rms = np.sqrt(value.following_rms / max(count, 1))
        value.following_mean /= max(count, 1)
        value.torque /= peak[a]
        value.ripple = np.sqrt(0.5 * value.ripple / max(pairs, 1)) / peak[a]
    return _Laid(tips[:laid], stands_for[:laid]), way / (max(count, 1) * period)


@jit
def _measure_path(path, laid, span, values):
    """Measure the contour errors of the nozzle's places while it dispenses.

    Args:
        path: points along the requested path.
        laid: the nozzle while it dispenses.
        span: with the state before, and that after it to be written.
        values: of `PATH_VALUES`, to be written.
    """
    points = path.points
    s = path.s
    tips = laid.tips
    count = len(tips)
    foot = span.before.foot
    here = foot
    lag = span.before.lag
    place = span.before.place
    square = 0.0
    largest = 0.0
    sideways = 0.0
    for k in range(count):
        x = tips[k, 0]
        y = tips[k, 1]
        z = tips[k, 2]
        stands_for = laid.progress[k]
        here = chord_near(s, stands_for, here)
        share = (stands_for - s[here]) / (s[here + 1] - s[here])
        away = 0.0
        for i in range(3):
            away += (tips[k, i] - points[here, i] - share * (points[here + 1, i] - points[here, i])) ** 2
        away = np.sqrt(away)
        lag = remembered_lag(lag, away, stands_for - place)
        place = stands_for
        between = stretch(path, here, place, away, lag)
        foot, along = nearest_chord(path, (x, y, z), (here, here), between, (place, place), 0.0)
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
    span.after.laid = span.before.laid + count
    span.after.square = span.before.square + square
    span.after.largest = max(span.before.largest, largest)
    middle = min(max(foot, _CHORD), len(points) - 1 - _CHORD)
    x_before = points[middle, 0] - points[middle - _CHORD, 0]
    y_before = points[middle, 1] - points[middle - _CHORD, 1]
    x_after = points[middle + _CHORD, 0] - points[middle, 0]
    y_after = points[middle + _CHORD, 1] - points[middle, 1]
    turned = np.arctan2(x_before * y_after - y_before * x_after, x_before * x_after + y_before * y_after)
    values.contour_rms = np.sqrt(square / max(count, 1))
    values.contour_max = largest
    values.lateral = sideways / max(count, 1)
    values.heading = np.arctan2(y_before + y_after, x_before + x_after)
    values.curvature = turned / (0.5 * (s[middle + _CHORD] - s[middle - _CHORD]))
