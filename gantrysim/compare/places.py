"""The place of a measured trace along a run: which instant of the run each sample belongs to, whatever the speed.

With m(t) a measured position, s(tau) the simulated one of the same link, R a turn about z and o an offset, each sample
belongs to the instant tau at which R s(tau) + o is nearest to it, in the order of the path. What is left lies across
the path, as along it only time passes. Offset and turn are those with the least sum of squares of that; where both
stand still, the whole distance counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from gantrysim.base.arrays import Floats, spans
from gantrysim.compare.estimates import RANK, Estimate, clustered_intervals, scales_of
from gantrysim.compare.vertices import (
    CHORDS,
    FEWEST_CHORDS,
    NOISES,
    SPARSE_SAMPLES,
    Vertices,
    noise_of,
    starts,
    vertices,
)

Rows = NDArray[np.bool_]

# The run as a curve, and the places of points along it.

_CHORD_POINTS = 8  # points of the curve to a chord
_WINDOW = 2.0  # chords around its expected place in which a point is looked for
_STRAY_WEIGHT = 0.05  # weight of a deviation from the expected place, of that of the distance
_NEWTON = 3


class Curve:
    """A run's positions by arc length.

    Args:
        time: of the positions, (n,) [s].
        points: the positions, (n, k).
        chord: of the vertices.
    """

    def __init__(self, time: Floats, points: Floats, chord: float) -> None:
        self.spline = CubicSpline(time, points, axis=0)
        self.rate = self.spline.derivative()
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        step = chord / _CHORD_POINTS
        # the first point in each step, and the last of all
        rows = np.union1d(np.unique(np.floor(length / step), return_index=True)[1], [len(points) - 1])
        self.row = rows.astype(np.float64)
        self.time = time[rows]
        self.points = points[rows]
        self.length = length[rows]
        self.step = np.diff(self.length)
        self.along = np.diff(self.points, axis=0)
        self.square = np.maximum(_sums_of_products(self.along, self.along), 1e-24)
        self.chord = chord
        self.fastest = float(np.linalg.norm(self.rate(time), axis=1).max())

    def nearest(self, points: Floats, expected: Floats) -> Floats:
        """Return arc lengths of the places nearest to points, (n, k), in a window around the expected ones, (n,)."""
        count = len(self.points) - 1
        middle = np.clip(np.searchsorted(self.length, expected) - 1, 0, count - 1)
        reach = int(_WINDOW * _CHORD_POINTS)
        best = np.full(len(points), np.inf)
        place = np.array(expected)
        for offset in range(-reach, reach + 1):
            length, cost = self._on_segments(points, np.clip(middle + offset, 0, count - 1), expected)
            closer = cost < best
            best = np.where(closer, cost, best)
            place = np.where(closer, length, place)
        return place

    def next_place(self, point: Floats, expected: float) -> float:
        """Return the arc length of the place nearest to one point, (k,), in the same window."""
        count = len(self.points) - 1
        middle = int(np.searchsorted(self.length, expected)) - 1
        reach = int(_WINDOW * _CHORD_POINTS)
        first = min(max(middle - reach, 0), count - 1)
        segments = slice(first, min(max(middle + reach, 0), count - 1) + 1)
        length, cost = self._on_segments(point, segments, np.array(expected))
        return float(length[np.argmin(cost)])

    def _on_segments(
        self, points: Floats, segment: NDArray[np.intp] | slice, expected: Floats
    ) -> tuple[Floats, Floats]:
        """Return arc lengths of the nearest points of segments, and their squared distances with what they stray."""
        along = self.along[segment]
        way = points - self.points[segment]
        share = np.minimum(np.maximum(_sums_of_products(way, along) / self.square[segment], 0.0), 1.0)
        across = way - share[:, None] * along
        distance = _sums_of_products(across, across)
        length = self.length[segment] + share * self.step[segment]
        return length, distance + _STRAY_WEIGHT * (length - expected) ** 2

    def instants(self, length: Floats) -> Floats:
        """Return the times at arc lengths, (n,) [s]."""
        return np.interp(length, self.length, self.time)

    def refined_instants(self, points: Floats, instants: Floats) -> Floats:
        """Return the times at which the run is nearest to points, from times that are about right."""
        for _ in range(_NEWTON):
            rate = self.rate(instants)
            square = np.sum(rate**2, axis=1)
            moving = square > (_STANDSTILL_SPEED * self.fastest) ** 2
            step = np.sum((points - self.spline(instants)) * rate, axis=1) / np.where(moving, square, 1.0)
            largest = self.chord / np.maximum(np.sqrt(square), 1e-12)
            instants = instants + np.where(moving, np.clip(step, -largest, largest), 0.0)
            instants = np.clip(instants, self.time[0], self.time[-1])
        return instants


def _sums_of_products(vectors: Floats, others: Floats) -> Floats:
    """Return the scalar products of vectors with others, both (n, k), as (n,): NumPy's own sums take longer."""
    products = vectors * others
    total = products[:, 0]
    for axis in range(1, products.shape[1]):
        total = total + products[:, axis]
    return total


def _tracked_places(curve: Curve, points: Floats, start: float, chord: float) -> Floats:
    """Return the arc lengths of the vertices of a trace, (n,), each from the one before it."""
    lengths = np.empty(len(points))
    expected = start
    for row, point in enumerate(points):
        place = curve.next_place(point, expected)
        lengths[row] = place
        expected = place + chord
    return lengths


# Offset and turn, judged at equal places.

_STANDSTILL_SPEED = 0.02  # of the highest speed, below which an axis stands still
_STANDSTILL_TIME = 0.02  # time for which it does [s]
_SEARCH_ROUNDS = 30
_LARGEST_STEP = 10.0  # of an offset, in lengths of the run, beyond which a trace has no place on it
_SETTLED_OFFSET = 1e-8  # change of an offset that ends the search [mm or deg]
_OUTSIDE_RESIDUALS = 5.0  # residuals beyond which a sample past an end of the run is no part of it
_SYSTEMATIC = 0.01  # of the residual, that no average takes away
_LEAST_EFFECT = 2e-5  # rms effect on positions, below which a value is not known [mm or deg]


@dataclass(frozen=True, eq=False)
class Placed:
    """A trace laid on a run at equal places.

    Attributes:
        instants: of the run for each sample, nan for samples that are no part of it, (n,) [s].
        offset: (k,) [mm or deg].
        turn: about z [rad].
        estimates: of what was fitted, zero or not: of the offsets by number of the axis, and of the turn as "turn".
        residual: rms of what is left across the path [mm or deg].
        still: whether a sample stands still, (n,).
    """

    instants: Floats
    offset: Floats
    turn: float
    estimates: dict[int | str, Estimate]
    residual: float
    still: Rows


class _Rest(NamedTuple):
    """A standstill: first and last row."""

    first: int
    last: int


def _rests(time: Floats, points: Floats, noise: float) -> list[_Rest]:
    """Return the standstills of a trace, each of at least 20 ms."""
    period = float(np.median(np.diff(time)))
    reach = max(1, math.ceil(_STANDSTILL_TIME / period))
    if len(points) <= 2 * reach:
        return []
    way = np.linalg.norm(points[reach:] - points[:-reach], axis=1)
    slow = way < max(_STANDSTILL_SPEED * float(way.max()), NOISES * noise)
    # a stretch of n slow ways lies over n + reach rows
    return [_Rest(int(first), int(after) - 1 + reach) for first, after in spans(slow)]


class _Paired(NamedTuple):
    """Rows of a trace at a standstill, and the instants of the run at the same one."""

    rows: slice
    instants: Floats


_Rests = tuple[list[_Rest], list[tuple[float, float, float]]]  # of a trace, and of a run: begin, end and place


class _Fit:
    """A trace on a curve, as its offset and turn are refined.

    Args:
        curve: the run.
        time: of the samples, (n,) [s].
        measured: positions, (n, k).
        free: whether each axis has an offset, (k,), and whether there is a turn.
        rests: standstills of trace and run.
    """

    def __init__(
        self,
        curve: Curve,
        time: Floats,
        measured: Floats,
        free: tuple[Rows, bool],
        rests: _Rests,
    ) -> None:
        self.curve = curve
        self.time = time
        self.measured = measured
        self.free_offsets, self.free_turn = free
        self.rests, self.rests_of_run = rests
        self.known: dict[int | str, Estimate] = {}
        self.lost = False
        self.offset = np.zeros(measured.shape[1])
        self.turn = 0.0
        self.length = np.zeros(len(time))
        self.instants = np.zeros(len(time))
        self.covered = np.ones(len(time), bool)
        self.still = np.zeros(len(time), bool)

    def back(self, points: Floats) -> Floats:
        """Return points of the trace's frame in that of the run."""
        return _turned_points(points - self.offset, -self.turn)

    def place(self, *, search: bool) -> None:
        """Find the instant of each sample, with offset and turn as they are."""
        points = self.back(self.measured)
        if search:
            self.length = self.curve.nearest(points, self.length)
            self.instants = self.curve.instants(self.length)
        self.instants = self.curve.refined_instants(points, self.instants)
        self.still[:] = False
        for rows, instants in self._paired_rests():
            self.instants[rows] = instants
            self.still[rows] = True
        inside = np.clip(self.instants, self.curve.time[0], self.curve.time[-1])
        away = np.linalg.norm(points - self.curve.spline(inside), axis=1)
        at_end = (self.length <= self.curve.length[0]) | (self.length >= self.curve.length[-1])
        past = at_end & ~self.still & (away > _OUTSIDE_RESIDUALS * max(float(np.median(away)), 1e-3 * self.curve.chord))
        self.covered = ~past & (self.instants == inside)

    def _paired_rests(self) -> list[_Paired]:
        pairs = []
        ends = np.array([standstill[2] for standstill in self.rests_of_run])
        if not ends.size:
            return []
        for standstill in self.rests:
            length = float(np.median(self.length[standstill.first : standstill.last + 1]))
            nearest = int(np.argmin(np.abs(ends - length)))
            if abs(ends[nearest] - length) > 2 * _WINDOW * self.curve.chord:
                continue
            begin, end, _ = self.rests_of_run[nearest]
            time = self.time[standstill.first : standstill.last + 1]
            if standstill.first == 0:
                instants = end - (time[-1] - time)
            elif standstill.last == len(self.time) - 1:
                instants = begin + (time - time[0])
            else:
                instants = begin + (end - begin) * (time - time[0]) / max(time[-1] - time[0], 1e-12)
            pairs.append(_Paired(slice(standstill.first, standstill.last + 1), instants))
        return pairs

    def equations(self) -> tuple[Floats, Floats, NDArray[np.intp]]:
        """Return residuals and slopes by offset and turn of the covered samples, (m, k), (m, k, p), and their rows."""
        rows = np.flatnonzero(self.covered)
        instants = self.instants[rows]
        s = self.curve.spline(instants)
        residual = self.measured[rows] - _turned_points(s, self.turn) - self.offset
        columns = [np.broadcast_to(unit, residual.shape) for unit in np.eye(residual.shape[1])[self.free_offsets]]
        if self.free_turn:
            turned = _turned_points(s, self.turn + math.pi / 2)
            turned[:, 2:] = 0.0
            columns.append(turned)
        slopes = np.stack(columns, axis=2) if columns else np.zeros((*residual.shape, 0))
        rate = _turned_points(self.curve.rate(instants), self.turn)
        speed = np.linalg.norm(rate, axis=1)
        moving = ~self.still[rows] & (speed > _STANDSTILL_SPEED * self.curve.fastest)
        tangent = np.where(moving, 1.0, 0.0)[:, None] * rate / np.maximum(speed, 1e-12)[:, None]
        residual = residual - tangent * np.sum(tangent * residual, axis=1)[:, None]
        slopes = slopes - tangent[:, :, None] * np.einsum("nk,nkp->np", tangent, slopes)[:, None, :]
        return residual, slopes, rows

    def refine(self) -> None:
        """Fit offset and turn, and the place of every sample with them."""
        for number in range(_SEARCH_ROUNDS):
            self.place(search=number < 4)
            residual, slopes, _ = self.equations()
            if not slopes.shape[2]:
                break
            flat = slopes.reshape(-1, slopes.shape[2])
            scale = scales_of(flat)
            step = np.linalg.lstsq(flat / scale, residual.ravel(), rcond=RANK)[0] / scale
            if not np.linalg.norm(step[: int(self.free_offsets.sum())]) < _LARGEST_STEP * self.curve.length[-1]:
                self.lost = True
                return
            steps = step.tolist()
            if self.free_turn:
                self.turn += steps.pop()
            self.offset[self.free_offsets] += steps
            if np.abs(step).max() <= _SETTLED_OFFSET and number >= 4:
                break
        self.place(search=False)

    @property
    def residual(self) -> float:
        """rms of what is left across the path [mm or deg]."""
        return float(np.sqrt(np.mean(self.equations()[0] ** 2)))

    def estimates(self) -> dict[int | str, Estimate]:
        """Return what is fitted with its interval.

        The errors that are left depend on their neighbours, so that whole blocks of rows count as independent, not
        rows (the sandwich of Liang and Zeger, Biometrika 73, 1986).
        """
        residual, slopes, _ = self.equations()
        names: list[int | str] = [int(k) for k in np.flatnonzero(self.free_offsets)]
        values = [float(self.offset[k]) for k in names if isinstance(k, int)]
        if self.free_turn:
            names.append("turn")
            values.append(self.turn)
        # errors of the model and of the instants, which no average takes away
        sizes = np.sqrt(np.mean(np.sum(slopes**2, axis=1), axis=0))
        floor = max(2 * _SYSTEMATIC * self.residual, _LEAST_EFFECT) / np.maximum(sizes, 1e-300)
        intervals = np.hypot(clustered_intervals(residual, slopes), floor).tolist()
        return {name: Estimate(*both) for name, *both in zip(names, values, intervals, strict=True)}


def _turned_points(points: Floats, turn: float) -> Floats:
    """Return points turned about z, (n, 2 or more)."""
    if turn == 0.0:
        return points.copy()
    cos = math.cos(turn)
    sin = math.sin(turn)
    turned = points.copy()
    turned[:, 0] = cos * points[:, 0] - sin * points[:, 1]
    turned[:, 1] = sin * points[:, 0] + cos * points[:, 1]
    return turned


_AS_LONG = 0.9  # of the samples of the first place, that are covered at another
MOST_ROWS = 4000  # from which offset and turn are fitted, about


def laid_on_run(
    time: Floats, measured: Floats, run: tuple[Floats, Floats], offsets: bool, turning: str = ""
) -> list[Placed]:
    """Return how a trace lies on a run at equal places, the best first; empty where its places cannot be known.

    They cannot where nothing moves, or the samples are too far apart to follow the path.

    Args:
        time: of the samples, (n,) [s].
        measured: positions, (n, k) [mm or deg].
        run: times, (m,), and positions of the same link, (m, k).
        offsets: whether each axis may have an offset.
        turning: "small" where the first two axes may be turned a little, "any" where by any angle.
    """
    run_time, positions = run
    way = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    noise = noise_of(measured)
    chord = max(way / CHORDS, NOISES * noise)
    steps = np.linalg.norm(np.diff(measured, axis=0), axis=1)
    extent = float(np.linalg.norm(np.ptp(positions, axis=0)))
    if (
        not way > 0
        or float(np.quantile(steps, 0.95)) > max(SPARSE_SAMPLES * extent, 2 * chord)
        or measured.shape[1] < 2
    ):
        return []
    curve = Curve(run_time, positions, chord)
    ours = vertices(measured, chord)
    theirs = vertices(positions, chord)
    if min(len(ours.row), len(theirs.row)) < FEWEST_CHORDS:
        return []
    rests_of_run = []
    for standstill in _rests(run_time, positions, 0.0):
        begin = float(run_time[standstill.first])
        rests_of_run.append((begin, float(run_time[standstill.last]), _length_at(curve, begin)))
    rows = np.arange(0, len(time), max(1, len(time) // MOST_ROWS))
    coarse = (time[rows], measured[rows])
    rests = (_rests(*coarse, noise), rests_of_run)
    results = []
    for lag, turn in starts(ours, theirs, turning == "any"):
        fit = _Fit(curve, *coarse, (np.full(measured.shape[1], offsets), bool(turning)), rests)
        _begin(fit, (ours, theirs), (lag, turn), rows)
        fit.refine()
        results.append(_with_known_values(fit))
    results = [fit for fit in results if not fit.lost]
    whole = [fit for fit in results if fit.covered.sum() >= _AS_LONG * results[0].covered.sum()]
    fine_rests = (_rests(time, measured, noise), rests_of_run)
    return [_placed_samples(fit, (time, measured), fine_rests) for fit in sorted(whole, key=lambda fit: fit.residual)]


def _length_at(curve: Curve, time: float) -> float:
    return float(np.interp(time, curve.time, curve.length))


def _begin(fit: _Fit, traces: tuple[Vertices, Vertices], start: tuple[int, float], rows: NDArray[np.intp]) -> None:
    """Lay the rows of a trace on the run where its first vertex is a given one of the run's, with a turn."""
    ours, theirs = traces
    lag, fit.turn = start
    first = max(0, -lag)
    after = min(len(ours.row), len(theirs.row) - lag)
    mine = ours.points[first:after]
    other = theirs.points[first + lag : after + lag]
    if fit.free_offsets.any():
        fit.offset = np.mean(mine - _turned_points(other, fit.turn), axis=0) * fit.free_offsets
    begin = float(np.interp(theirs.row[first + lag], fit.curve.row, fit.curve.length))
    lengths = _tracked_places(fit.curve, fit.back(mine), begin, fit.curve.chord)
    fit.length = np.interp(rows, ours.row[first:after], lengths)


def _with_known_values(fit: _Fit) -> _Fit:
    """Return a fit of which every offset and turn that the data do not distinguish from zero is zero."""
    while not fit.lost:
        estimates = fit.estimates()
        fit.known |= estimates
        unknown = [name for name, estimate in estimates.items() if not estimate.distinguished]
        if not unknown:
            return fit
        # the least certain first, as others may be known without it
        worst = min(unknown, key=lambda name: abs(estimates[name].value) / max(estimates[name].interval, 1e-300))
        if isinstance(worst, int):
            fit.free_offsets = fit.free_offsets & (np.arange(fit.free_offsets.size) != worst)
            fit.offset[worst] = 0.0
        else:
            fit.free_turn = False
            fit.turn = 0.0
        fit.refine()
    return fit


def _placed_samples(fit: _Fit, trace: tuple[Floats, Floats], rests: _Rests) -> Placed:
    """Return how all samples of a trace lie on the run, with the offset and turn of a fit."""
    whole = _Fit(fit.curve, *trace, (fit.free_offsets, fit.free_turn), rests)
    whole.offset = fit.offset
    whole.turn = fit.turn
    whole.length = np.interp(whole.time, fit.time, fit.length)
    whole.place(search=True)
    instants = np.where(whole.covered, _rising(whole.instants), np.nan)
    return Placed(instants, fit.offset, fit.turn, fit.known, whole.residual, whole.still)


def _rising(instants: Floats) -> Floats:
    """Return instants that never fall: between the highest so far and the lowest to come."""
    return 0.5 * (np.maximum.accumulate(instants) + np.minimum.accumulate(instants[::-1])[::-1])
