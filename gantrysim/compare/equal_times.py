"""The alignment of a measured trace with a simulated run at equal times.

With m(t) a measured position, s(t) the simulated one of the same link and R a turn about z, the least sum of squares of

    m(t) - R s(t - shift) - offset

gives shift, offset and turn; it starts from the places where the velocities differ least, and the best of them is
taken. Offsets and turns that the data do not distinguish from zero are zero.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import correlate, correlation_lags, find_peaks

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.compare.estimates import Estimate, clustered_intervals
from gantrysim.compare.measured import LEAST_SAMPLES, Trace
from gantrysim.record.run import Run

# Places where a measured trace may lie along a run: where their velocities differ least.
#
# With a(t) the trace's velocity and b(t) the run's, over the trace and zero outside the run,
#
#     D(shift) = sum |a(t) - b(t - shift)|^2 = sum |a|^2 + sum |b|^2 - 2 sum a b
#
# where the second sum is over the part of the run that the trace then covers. A correlation, the last term alone, would
# lay a trace that covers a part of the run on its fastest stretch. An offset of the positions is not in it. Where the
# least D is most of the trace's own sum, as with positions in another unit, each axis of b is scaled too: with the best
# factors,
#
#     D(shift) = sum |a|^2 - (sum a b)^2 / sum |b|^2    by axis, without the second term where sum a b < 0

_TRACE_LENGTH = 100.0  # of a trace, in lengths of the run
_MEAN_SAMPLES = 15  # samples of a mean over which velocities are compared
_STANDSTILL = 1e-6  # covered sum of squares, of the largest, below which the run stands still
_MOST_PLACES = 8  # places that are tried
_POOR_FIT = 0.5  # least difference, of the trace's sum of squares, from which the run is scaled
_NEARLY_LEAST = 0.1  # of the trace's sum of squares, by which the difference at a place may exceed the least one


class Place(NamedTuple):
    """Time of a trace less that of the run [s], and its turn about z [rad]."""

    shift: float
    turn: float


def check_duration(time: Floats, run: Run) -> None:
    """Raise InputError for a trace that is too short, or much longer than the run."""
    length = time[-1] - time[0]
    least = 2 * _MEAN_SAMPLES * run.period
    most = _TRACE_LENGTH * (run.time[-1] - run.time[0])
    if not least <= length <= most:
        raise InputError(
            f"the trace lasts {length:.4g} s: must last {least:.4g} to {most:.4g} s beside a run of "
            f"{run.time[-1]:.4g} s; is its time in another unit?"
        )


def places(time: Floats, measured: Floats, run: Run, simulated: Floats, turning: bool) -> list[Place]:
    """Return where a trace may lie, to about a servo period, the least difference first.

    Args:
        time: of the trace's samples, (n,) [s].
        measured: its positions, (n, k) [mm or deg].
        run: simulated.
        simulated: its positions, (m, k) [mm or deg].
        turning: compare x and y as complex numbers, whose magnitude a turn does not change.
    """
    even = np.arange(time[0], time[-1], run.period)
    trace_speed = _velocities([np.interp(even, time, column) for column in measured.T], turning)
    run_speed = _velocities(list(simulated.T), turning)
    lags = correlation_lags(trace_speed.shape[1], run_speed.shape[1])
    products = np.array([correlate(a, b, method="fft") for a, b in zip(trace_speed, run_speed, strict=True)])
    likeness = np.abs(products) if turning else products
    energy = float(np.sum(np.abs(trace_speed) ** 2))
    covered = np.array([_covered_motion(speed, lags, trace_speed.shape[1]) for speed in run_speed])
    difference = energy + np.sum(covered - 2 * likeness, axis=0)
    if difference.min() > _POOR_FIT * energy:
        moving = covered > _STANDSTILL * covered.max()
        difference = energy - np.sum(np.maximum(likeness, 0.0) ** 2 * moving / np.where(moving, covered, 1.0), axis=0)
    peaks, _ = find_peaks(-difference)
    minima = np.union1d(peaks, [np.argmin(difference)])
    near = minima[difference[minima] <= difference.min() + _NEARLY_LEAST * energy]
    best = near[np.argsort(difference[near], kind="stable")][:_MOST_PLACES]
    return [
        Place(
            float(even[0] - run.time[0] + lags[k] * run.period),
            float(np.angle(products[0, k])) if turning else 0.0,
        )
        for k in best.tolist()
    ]


def _velocities(columns: list[Floats], turning: bool) -> NDArray[Any]:
    """Return the smoothed steps of positions, a row per axis, or one of complex numbers."""
    smooth = partial(np.convolve, np.full(_MEAN_SAMPLES, 1 / _MEAN_SAMPLES), mode="same")
    steps = np.array([smooth(np.diff(column)) for column in columns])
    return (steps[:1] + 1j * steps[1:2]) if turning else steps


def _covered_motion(speed: Floats, lags: Floats, count: int) -> Floats:
    """Return the sum of squares of an axis' steps that a trace of some samples covers, for each lag."""
    total = np.concatenate([[0.0], np.cumsum(np.abs(speed) ** 2)])
    first = np.clip(-lags, 0, speed.size)
    after = np.clip(count - lags, 0, speed.size)
    return total[after] - total[first]


_SEARCH_STEPS = 50
_SETTLED_SHIFT = 1e-9  # change of the shift that ends the search, in servo periods
AS_WELL = 1.1  # residual, of the best one, up to which another place fits as well
NOTHING = 1e-5  # residual that is rounding [mm or deg]
DISTINCT_SHIFTS = 15  # servo periods by which the shifts of two places differ
_AS_LONG = 0.9  # overlap with the run, of the first place's, below which a place is none
# difference of encoder and motor up to which the motor is the encoder without its counts [mm or deg]
_ENCODER_COUNTS = 0.005
TIME = "time"  # names of estimates
ROTATION = "rotation"


def link_positions(trace: Trace, run: Run, link: str) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Return measured and simulated positions of a link and the columns that are measured, (n, k), (m, k), (k,)."""
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    if measured is None:
        raise InputError(f"{link} is not measured")
    columns = np.flatnonzero(~np.isnan(measured).any(axis=0))
    simulated = np.asarray(getattr(run, link))
    if link == "encoder" and np.abs(simulated - run.motor).max() <= _ENCODER_COUNTS:
        simulated = np.asarray(run.motor)
    return measured[:, columns], simulated[:, columns], columns


def estimate_name(run: Run, link: str, column: int) -> str:
    """Return the name of the estimate of an offset, as "nozzle x" or "axes y"."""
    return f"nozzle {'xyz'[column]}" if link == "nozzle" else f"axes {run.axes[column]}"


class TimedFit(NamedTuple):
    """A trace laid on a run: time shift [s], offset (axes,), turn [rad], rms of the residual, samples that overlap."""

    shift: float
    offset: Floats
    turn: float
    residual: float
    overlap: int
    estimates: dict[str, Estimate]


def best_fit(
    trace: Trace, run: Run, link: str, shift: float | None, placed: bool, turning: bool
) -> tuple[TimedFit, tuple[float, ...]]:
    """Return the fit of one link with the least residual, and the shifts of others as good; a given shift is kept."""
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    if measured is None:
        raise InputError(f"{link} is not measured")
    known = ~np.isnan(measured).any(axis=0)
    turning = turning and link == "nozzle"
    free = shift is None
    starts = [Place(float(shift or 0.0), 0.0)]
    if free:
        starts = places(trace.time, measured[:, known], run, getattr(run, link)[:, known], turning)
    fits = [_fitted_link(trace, run, link, start, (free, placed, turning)) for start in starts]
    whole = [fit for fit in fits if fit.overlap >= _AS_LONG * fits[0].overlap]
    best = min(whole, key=lambda fit: fit.residual)
    as_good = [fit.shift for fit in whole if fit.residual <= max(AS_WELL * best.residual, NOTHING)]
    return best, tuple(sorted(apart_shifts(as_good, best.shift, DISTINCT_SHIFTS * run.period)))


def apart_shifts(shifts: list[float], from_shift: float, least: float) -> list[float]:
    """Return the shifts that differ from one, and from each other, by more than a least difference."""
    distinct = [from_shift]
    for shift in shifts:
        if min(abs(shift - other) for other in distinct) > least:
            distinct.append(shift)
    return distinct[1:]


def _fitted_link(trace: Trace, run: Run, link: str, start: Place, free: tuple[bool, bool, bool]) -> TimedFit:
    """Return the fit of one link from a place; free are shift, offset and turn.

    Offsets and a turn that the data do not distinguish from zero are zero.
    """
    shifting, placed, turning = free
    measured, simulated, columns = link_positions(trace, run, link)
    fit = _TimeFit(trace.time, measured, CubicSpline(run.time, simulated, axis=0), columns, run)
    fit.shift, fit.turn = start
    names = [TIME] * shifting + [ROTATION] * turning
    names += [estimate_name(run, link, int(column)) for column in columns] if placed else []
    estimates: dict[str, Estimate] = {}
    while True:
        fit.refine(names)
        judged = fit.estimates(names)
        estimates |= judged
        unknown_values = [name for name in names if name != TIME and not judged[name].distinguished]
        if not unknown_values:
            break
        names.remove(min(unknown_values, key=lambda name: abs(judged[name].value) / max(judged[name].interval, 1e-300)))
        fit.offset[:] = 0.0
        fit.turn = fit.turn if ROTATION in names else 0.0
    whole = np.zeros(3 if link == "nozzle" else len(run.axes))
    whole[columns] = fit.offset
    return TimedFit(fit.shift, whole, fit.turn, fit.residual, fit.overlap, estimates)


class _TimeFit:
    """The fit of one link at equal times by Gauss and Newton.

    Args:
        time: of the trace, (n,) [s].
        measured: positions, (n, k).
        spline: of the run's.
        columns: of the link that are measured, (k,).
        run: simulated.
    """

    def __init__(
        self, time: Floats, measured: Floats, spline: CubicSpline, columns: NDArray[np.intp], run: Run
    ) -> None:
        self.time = time
        self.measured = measured
        self.spline = spline
        self.columns = columns
        self.run = run
        self.shift = 0.0
        self.turn = 0.0
        self.offset = np.zeros(measured.shape[1])
        self.overlap = 0

    def equations(self, names: list[str]) -> tuple[Floats, Floats]:
        """Return residuals of the samples within the run, (m, k), and their slopes by the values named, (m, k, p)."""
        run = self.run
        shifted = self.time - self.shift
        inside = (shifted >= run.time[0]) & (shifted <= run.time[-1])
        self.overlap = int(np.count_nonzero(inside))
        if self.overlap < LEAST_SAMPLES:
            raise InputError(
                f"the trace covers {self.overlap} of its samples with the run, from {run.time[0]:g} to "
                f"{run.time[-1]:g} s: must be at least {LEAST_SAMPLES}"
            )
        s = self.spline(shifted[inside])
        residual = self.measured[inside] - turned_points(s, self.turn) - self.offset
        slopes = []
        for name in names:
            if name == TIME:
                slopes.append(-turned_points(self.spline(shifted[inside], 1), self.turn))
            elif name == ROTATION:
                slopes.append(turned_points(s, self.turn + np.pi / 2) * (self.columns < 2))
            else:
                slopes.append(np.broadcast_to(np.eye(residual.shape[1])[self._place(name)], residual.shape))
        return residual, np.stack(slopes, axis=2) if slopes else np.zeros((*residual.shape, 0))

    def _place(self, name: str) -> int:
        """Return the number of an offset among the columns that are measured."""
        frame, axis = name.split(" ", 1)
        column = "xyz".index(axis) if frame == "nozzle" else self.run.axes.index(axis)
        return int(np.flatnonzero(self.columns == column)[0])

    def refine(self, names: list[str]) -> None:
        """Fit the values named."""
        for _ in range(_SEARCH_STEPS):
            residual, slopes = self.equations(names)
            if not names:
                return
            flat = slopes.reshape(-1, len(names))
            step = np.linalg.lstsq(flat, residual.ravel(), rcond=None)[0]
            change = 0.0
            for name, value in zip(names, step.tolist(), strict=True):
                if name == TIME:
                    change = value
                    self.shift += value
                elif name == ROTATION:
                    self.turn += value
                else:
                    self.offset[self._place(name)] += value
            if abs(change) <= _SETTLED_SHIFT * self.run.period and np.abs(step).max() <= _SETTLED_SHIFT:
                return

    def estimates(self, names: list[str]) -> dict[str, Estimate]:
        """Return the values named with their intervals."""
        residual, slopes = self.equations(names)
        intervals = clustered_intervals(residual, slopes).tolist()
        estimates = {}
        for name, interval in zip(names, intervals, strict=True):
            if name == ROTATION:
                estimates[name] = Estimate(float(np.degrees(self.turn)), float(np.degrees(interval)))
            else:
                value = self.shift if name == TIME else float(self.offset[self._place(name)])
                estimates[name] = Estimate(value, interval)
        return estimates

    @property
    def residual(self) -> float:
        """rms of what is left [mm or deg]."""
        return float(np.sqrt(np.mean(self.equations([])[0] ** 2)))


def turned_points(points: Floats, turn: float) -> Floats:
    """Return points turned about z, (n, 2 or more)."""
    if turn == 0.0:
        return points
    x, y, *others = points.T
    cos = np.cos(turn)
    sin = np.sin(turn)
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, *others])
