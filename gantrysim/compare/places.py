"""Places where a measured trace may lie along a run: where their velocities differ least.

With a(t) the trace's velocity and b(t) the run's, over the trace and zero outside the run,

    D(shift) = sum |a(t) - b(t - shift)|^2 = sum |a|^2 + sum |b|^2 - 2 sum a b

where the second sum is over the part of the run that the trace then covers. A correlation, the last term alone, would
lay a trace that covers a part of the run on its fastest stretch. An offset of the positions is not in it. Where the
least D is most of the trace's own sum, as with positions in another unit, each axis of b is scaled too: with the best
factors,

    D(shift) = sum |a|^2 - (sum a b)^2 / sum |b|^2    by axis, without the second term where sum a b < 0
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate, correlation_lags, find_peaks

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.record.run import Run

_LONGEST = 100.0  # of a trace, in lengths of the run
_SMOOTH = 15  # samples of a mean over which velocities are compared
_STANDSTILL = 1e-6  # covered sum of squares, of the largest, below which the run stands still
_MOST = 8  # places that are tried
_POOR = 0.5  # least difference, of the trace's sum of squares, from which the run is scaled
_NEARLY = 0.1  # of the trace's sum of squares, by which the difference at a place may exceed the least one


class Place(NamedTuple):
    """Time of a trace less that of the run [s], and its turn about z [rad]."""

    shift: float
    turn: float


def places(time: Floats, measured: Floats, run: Run, simulated: Floats, turning: bool) -> list[Place]:
    """Return where a trace may lie, to about a servo period, the least difference first.

    Args:
        time: of the trace's samples, (n,) [s].
        measured: its positions, (n, k) [mm or deg].
        run: simulated.
        simulated: its positions, (m, k) [mm or deg].
        turning: compare x and y as complex numbers, whose magnitude a turn does not change.

    Raises:
        InputError: a trace that is too short, or much longer than the run.
    """
    length = time[-1] - time[0]
    least = 2 * _SMOOTH * run.period
    most = _LONGEST * (run.time[-1] - run.time[0])
    if not least <= length <= most:
        raise InputError(
            f"the trace lasts {length:.4g} s: must last {least:.4g} to {most:.4g} s beside a run of "
            f"{run.time[-1]:.4g} s; is its time in another unit?"
        )
    even = np.arange(time[0], time[-1], run.period)
    trace_speed = _velocities([np.interp(even, time, column) for column in measured.T], turning)
    run_speed = _velocities(list(simulated.T), turning)
    lags = correlation_lags(trace_speed.shape[1], run_speed.shape[1])
    products = np.array([correlate(a, b, method="fft") for a, b in zip(trace_speed, run_speed, strict=True)])
    likeness = np.abs(products) if turning else products
    energy = float(np.sum(np.abs(trace_speed) ** 2))
    covered = np.array([_covered(speed, lags, trace_speed.shape[1]) for speed in run_speed])
    difference = energy + np.sum(covered - 2 * likeness, axis=0)
    if difference.min() > _POOR * energy:
        moving = covered > _STANDSTILL * covered.max()
        difference = energy - np.sum(np.maximum(likeness, 0.0) ** 2 * moving / np.where(moving, covered, 1.0), axis=0)
    peaks, _ = find_peaks(-difference)
    minima = np.union1d(peaks, [np.argmin(difference)])
    near = minima[difference[minima] <= difference.min() + _NEARLY * energy]
    best = near[np.argsort(difference[near], kind="stable")][:_MOST]
    return [
        Place(
            float(even[0] - run.time[0] + lags[k] * run.period),
            float(np.angle(products[0, k])) if turning else 0.0,
        )
        for k in best.tolist()
    ]


def _velocities(columns: list[Floats], turning: bool) -> NDArray[Any]:
    """Return the smoothed steps of positions, a row per axis, or one of complex numbers."""
    smooth = partial(np.convolve, np.full(_SMOOTH, 1 / _SMOOTH), mode="same")
    steps = np.array([smooth(np.diff(column)) for column in columns])
    return (steps[:1] + 1j * steps[1:2]) if turning else steps


def _covered(speed: Floats, lags: Floats, count: int) -> Floats:
    """Return the sum of squares of an axis' steps that a trace of some samples covers, for each lag."""
    total = np.concatenate([[0.0], np.cumsum(np.abs(speed) ** 2)])
    first = np.clip(-lags, 0, speed.size)
    after = np.clip(count - lags, 0, speed.size)
    return total[after] - total[first]
