"""The alignment of a measured trace with a simulated run, in time and place.

With m(t) a measured position, s(t) the simulated one of the same link and R a turn about z, the least sum of squares of

    m(t) - R s(t - shift) - offset

gives shift, offset and turn; it starts from the places where the velocities differ least, and the
best of them is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import correlate, correlation_lags, find_peaks

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, unknown
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

_LONGEST = 100.0  # of a trace, in lengths of the run
_SMOOTH = 15  # samples of a mean over which velocities are compared
_STANDSTILL = 1e-6  # covered sum of squares, of the largest, below which the run stands still
_MOST_PLACES = 8  # places that are tried
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
    covered = np.array([_covered_motion(speed, lags, trace_speed.shape[1]) for speed in run_speed])
    difference = energy + np.sum(covered - 2 * likeness, axis=0)
    if difference.min() > _POOR * energy:
        moving = covered > _STANDSTILL * covered.max()
        difference = energy - np.sum(np.maximum(likeness, 0.0) ** 2 * moving / np.where(moving, covered, 1.0), axis=0)
    peaks, _ = find_peaks(-difference)
    minima = np.union1d(peaks, [np.argmin(difference)])
    near = minima[difference[minima] <= difference.min() + _NEARLY * energy]
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
    smooth = partial(np.convolve, np.full(_SMOOTH, 1 / _SMOOTH), mode="same")
    steps = np.array([smooth(np.diff(column)) for column in columns])
    return (steps[:1] + 1j * steps[1:2]) if turning else steps


def _covered_motion(speed: Floats, lags: Floats, count: int) -> Floats:
    """Return the sum of squares of an axis' steps that a trace of some samples covers, for each lag."""
    total = np.concatenate([[0.0], np.cumsum(np.abs(speed) ** 2)])
    first = np.clip(-lags, 0, speed.size)
    after = np.clip(count - lags, 0, speed.size)
    return total[after] - total[first]


ALIGNED = ("time", "offset", "rotation")
_STEPS = 50
_SETTLED = 1e-9  # change of the shift that ends the search, in servo periods
_AS_WELL = 1.1  # residual, of the best one, up to which another place fits as well
_NOTHING = 1e-5  # residual that is rounding [mm or deg]
_APART = 15  # servo periods by which the shifts of two places differ
_AS_LONG = 0.9  # overlap with the run, of the first place's, below which a place is none


@dataclass(frozen=True)
class Alignment:
    """How a trace lies against the simulation.

    Attributes:
        by: link that gives it: commanded, encoder or nozzle.
        shift: the trace's time less the run's [s].
        offsets: the trace's position less the run's, by frame: "axes" (axes,) and "nozzle" (3,) [mm or deg].
        rotation: turn of the nozzle's frame about z, counter-clockwise positive [deg].
        residual: rms of what is left of the link [mm or deg].
        others: shifts with which the trace fits as well, as on a circle of several turns [s].
    """

    by: str
    shift: float
    offsets: Mapping[str, Floats]
    rotation: float
    residual: float
    others: tuple[float, ...] = ()


class _Fit(NamedTuple):
    """A trace laid on a run: time shift [s], offset (axes,), turn [rad], rms of the residual, samples that overlap."""

    shift: float
    offset: Floats
    turn: float
    residual: float
    overlap: int


def aligned_trace(trace: Trace, run: Run, what: tuple[str, ...] = ("time", "offset")) -> Alignment:
    """Return the alignment of a trace with a simulated run.

    The first of command, encoder and nozzle that is measured gives the shift. Axes have one offset, of that link; the
    nozzle has its own.

    Args:
        trace: measured.
        run: simulated.
        what: is fitted, of `ALIGNED`; the rest is taken to be zero.
    """
    for quantity in what:
        if quantity not in ALIGNED:
            raise unknown("alignment", quantity, ALIGNED)
    by = trace.links[0]
    placed = "offset" in what
    turning = "rotation" in what and trace.nozzle is not None
    fit, others = _best(trace, run, by, None if "time" in what else 0.0, placed, turning)
    turn = fit.turn
    offsets = {}
    if by != "nozzle":
        offsets["axes"] = fit.offset
        if trace.nozzle is not None:
            of_nozzle, _ = _best(trace, run, "nozzle", fit.shift, placed, turning)
            offsets["nozzle"] = of_nozzle.offset
            turn = of_nozzle.turn
    else:
        offsets["nozzle"] = fit.offset
    return Alignment(by, fit.shift, offsets, float(np.degrees(turn)), fit.residual, others)


def _best(
    trace: Trace, run: Run, link: str, shift: float | None, placed: bool, turning: bool
) -> tuple[_Fit, tuple[float, ...]]:
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
    as_good = [fit.shift for fit in whole if fit.residual <= max(_AS_WELL * best.residual, _NOTHING)]
    return best, tuple(sorted(_apart(as_good, best.shift, _APART * run.period)))


def _apart(shifts: list[float], from_shift: float, least: float) -> list[float]:
    """Return the shifts that differ from one, and from each other, by more than a least difference."""
    distinct = [from_shift]
    for shift in shifts:
        if min(abs(shift - other) for other in distinct) > least:
            distinct.append(shift)
    return distinct[1:]


def _fitted_link(trace: Trace, run: Run, link: str, start: Place, free: tuple[bool, bool, bool]) -> _Fit:
    """Return the fit of one link by Gauss and Newton from a place; free are shift, offset and turn."""
    shifting, placed, turning = free
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    assert measured is not None
    known = ~np.isnan(measured).any(axis=0)
    spline = CubicSpline(run.time, getattr(run, link)[:, known], axis=0)
    m = measured[:, known]
    columns = np.flatnonzero(known)
    tau, turn = start
    offset = np.zeros(m.shape[1])
    for _ in range(_STEPS):
        shifted = trace.time - tau
        inside = (shifted >= run.time[0]) & (shifted <= run.time[-1])
        overlap = int(np.count_nonzero(inside))
        if overlap < LEAST_SAMPLES:
            raise InputError(
                f"the trace covers {overlap} of its samples with the run, from {run.time[0]:g} to "
                f"{run.time[-1]:g} s: must be at least {LEAST_SAMPLES}"
            )
        s = spline(shifted[inside])
        rate = spline(shifted[inside], 1)
        residual = m[inside] - turned_points(s, turn) - offset
        slopes = []
        if shifting:
            slopes.append(-turned_points(rate, turn))
        if turning:
            slopes.append(turned_points(s, turn + np.pi / 2) * (columns < 2))
        if placed:
            slopes += [np.broadcast_to(unit, residual.shape) for unit in np.eye(residual.shape[1])]
        if not slopes:
            break
        step = np.linalg.lstsq(np.stack([slope.ravel() for slope in slopes], axis=1), residual.ravel(), rcond=None)[0]
        steps = list(step)
        change = steps.pop(0) if shifting else 0.0
        tau += change
        if turning:
            turn += steps.pop(0)
        offset = offset + (np.array(steps) if placed else 0.0)
        if abs(change) <= _SETTLED * run.period and np.abs(step).max() <= _SETTLED:
            break
    whole = np.zeros(measured.shape[1])
    whole[known] = offset
    return _Fit(float(tau), whole, float(turn), float(np.sqrt(np.mean(residual**2))), overlap)


def turned_points(points: Floats, turn: float) -> Floats:
    """Return points turned about z, (n, 2 or more)."""
    if turn == 0.0:
        return points
    x, y, *others = points.T
    cos = np.cos(turn)
    sin = np.sin(turn)
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, *others])
