"""Faults of a log that an alignment cannot mend: axes swapped or mirrored, a scale or a clock that is wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.compare.alignment import DOUBTFUL_RESIDUAL, LARGEST_CLOCK, Alignment, aligned_trace
from gantrysim.compare.compare_quantities import DIFFERENCE
from gantrysim.compare.equal_times import AS_WELL, ROTATION, turned_points
from gantrysim.compare.measured import Trace
from gantrysim.record.run import Run

_MUCH_BETTER = 0.2  # residual with other axes, of that without, from which these are the ones
_MOST_SAMPLES = 0.5  # share of a trace within the run, from which other axes are believed
_EXPLAINED_RESIDUAL = 0.5  # residual with scale and clock, of that without, below which these are named
_NAMED = 0.25  # effect of a scale or clock, of the residual, from which it is named
_SAMPLES = 500  # of a trace with which other axes are tried
_TOO_WIDE = 2.0  # span of a trace, of the run's, from which its unit must be another
_SCALE_ROUNDS = 2  # in which a scale of hundredths is found
_WRONG_SCALE = 0.02  # beyond it a scale is no error of a machine but another unit

Axes = tuple[int, int]


def aligned_as_named(trace: Trace, run: Run, what: tuple[str, ...]) -> Alignment:
    """Return the alignment of a trace whose axes are those of the run.

    Where a trace lies far from the run, it is also tried with x and y swapped and mirrored.

    Raises:
        InputError: the trace is far wider than the run, fits with other axes, or cannot be aligned.
    """
    _check_span(trace, run)
    failure: InputError | None = None
    residual = math.inf
    try:
        alignment = aligned_trace(trace, run, what)
        residual = alignment.residual
    except InputError as error:
        failure = error
    if residual > DOUBTFUL_RESIDUAL * _spread(trace, run):
        _check_axes(trace, run, what, residual)
    if failure is not None:
        raise failure
    return alignment


def _check_span(trace: Trace, run: Run) -> None:
    """Raise InputError where a trace reaches further than the run, as it may cover a part of it only."""
    link = trace.links[0]
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    assert measured is not None
    names = tuple("xyz") if link == "nozzle" else run.axes
    units = ("mm",) * len(names) if link == "nozzle" else run.units
    known = ~np.isnan(measured).any(axis=0)
    spans = np.where(known, np.ptp(measured, axis=0), 0.0)
    run_spans = np.ptp(getattr(run, link), axis=0)
    widest = int(spans.argmax())
    if spans[widest] > _TOO_WIDE * run_spans[known].max() > 0:
        unit = units[widest]
        raise InputError(
            f"{link}: {names[widest]} of the trace spans {spans[widest]:.4g} {unit}, of the run "
            f"{run_spans[widest]:.4g} {unit}: the trace must span at most {_TOO_WIDE:g} times what the run does; "
            f"a column in another unit? Name it, as x=x[um]"
        )


def _spread(trace: Trace, run: Run) -> float:
    """Return the rms of the run's positions about their mean, of what the trace measures first."""
    positions = getattr(run, trace.links[0])
    return float(np.sqrt(np.mean((positions - positions.mean(axis=0)) ** 2)))


def _check_axes(trace: Trace, run: Run, what: tuple[str, ...], residual: float) -> None:
    """Raise InputError where a trace fits the run with its first two axes swapped or mirrored."""
    names = tuple("xy") if trace.links[0] == "nozzle" else run.axes[:2]
    if len(names) < 2 or (trace.links[0] != "nozzle" and len(set(run.units[:2])) > 1):
        return
    fits = []
    few = _thinned_trace(trace)
    for swapped, signs in _hypotheses():
        try:
            alignment = aligned_trace(_with_axes(few, swapped, signs), run, what)
        except InputError:  # it does not overlap the run this way either
            continue
        inside = (alignment.instants >= run.time[0]) & (alignment.instants <= run.time[-1])
        # a few samples at rest fit any way
        if np.mean(inside) >= _MOST_SAMPLES:
            fits.append((alignment.residual, abs(alignment.rotation), _words(names, swapped, signs)))
    best = min((fitted for fitted, _, _ in fits), default=math.inf)
    if best < _MUCH_BETTER * min(residual, _spread(trace, run)):
        # the nozzle's frame may be turned too, and x mirrored is y mirrored in a frame turned by half a turn
        _, _, words = min((fit for fit in fits if fit[0] <= AS_WELL * best), key=lambda fit: fit[1])
        without = "cannot be aligned" if math.isinf(residual) else f"lies {DIFFERENCE.text(residual)} rms off"
        raise InputError(
            f"{trace.links[0]}: the trace {without}, but {DIFFERENCE.text(best)} with {words}: give --columns the "
            "other way round, or with a factor of -1"
        )


def _thinned_trace(trace: Trace) -> Trace:
    """Return a trace with as many samples as tell one hypothesis from another, of what it measures first."""
    every = max(len(trace.time) // _SAMPLES, 1)
    link = trace.links[0]
    if link == "nozzle":
        assert trace.nozzle is not None
        return Trace(trace.time[::every], {}, trace.nozzle[::every])
    return Trace(trace.time[::every], {link: trace.axes[link][::every]}, None)


def _hypotheses() -> Iterator[tuple[bool, Axes]]:
    for swapped, first, second in product((False, True), (1, -1), (1, -1)):
        if swapped or (first, second) != (1, 1):
            yield swapped, (first, second)


def _with_axes(trace: Trace, swapped: bool, signs: Axes) -> Trace:
    """Return a trace with its first two axes swapped, then each multiplied by its sign."""

    def other(positions: Floats) -> Floats:
        order = [1, 0] if swapped else [0, 1]
        changed = positions.copy()
        changed[:, :2] = positions[:, order] * np.array(signs)
        return changed

    nozzle = None if trace.nozzle is None else other(trace.nozzle)
    return replace(trace, axes={link: other(positions) for link, positions in trace.axes.items()}, nozzle=nozzle)


def _words(names: tuple[str, ...], swapped: bool, signs: Axes) -> str:
    texts = [f"{names[0]} and {names[1]} swapped"] if swapped else []
    mirrored = [name for name, sign in zip(names, signs, strict=True) if sign < 0]
    texts += [f"{' and '.join(mirrored)} mirrored"] if mirrored else []
    return ", ".join(texts)


class ScaleAndClock(NamedTuple):
    """Scales of the axes and a clock that explain most of what is left after an alignment; only those that are named.

    Attributes:
        scales: of the trace's axes less 1, by their columns.
        clock: rate of the trace's clock less 1; 0 where none is named.
        residual: rms of what is left [mm or deg].
    """

    scales: Mapping[int, float]
    clock: float
    residual: float

    @property
    def is_any(self) -> bool:
        """Whether a scale or a clock is named."""
        return bool(self.scales or self.clock)


def scale_and_clock(trace: Trace, run: Run, alignment: Alignment) -> ScaleAndClock:
    """Return the scale of an axis and the clock that would explain most of what is left after the alignment.

    With m the measured positions of the link that aligns and s the simulated ones at their instants t', the least
    squares of

        m - s(t') - offset = k (s(t') - mean) + c s'(t') (t' - mean) + b s'(t') + a + d z x s(t')

    give the scale 1 + k of each axis, and a clock that runs fast by -c; d stands where the alignment sought a turn,
    which takes up a part of a scale. They are named where they take away half of the residual or more. At equal places
    the clock is judged by these, see `gantrysim.compare.alignment`, and only what lies across the path counts here.
    """
    measured = trace.nozzle if alignment.by == "nozzle" else trace.axes[alignment.by]
    assert measured is not None
    offset = alignment.offsets["nozzle" if alignment.by == "nozzle" else "axes"]
    simulated = getattr(run, alignment.by)
    columns = np.flatnonzero(~np.isnan(measured).any(axis=0) & (np.ptp(simulated, axis=0) > 0))
    time = alignment.instants
    inside = (time >= run.time[0]) & (time <= run.time[-1])
    spline = CubicSpline(run.time, simulated, axis=0)
    s = turned_points(spline(time[inside]), np.radians(alignment.rotation))[:, columns]
    rate = turned_points(spline(time[inside], 1), np.radians(alignment.rotation))[:, columns]
    residual = (measured[inside] - offset)[:, columns] - s
    since = (time[inside] - time[inside].mean())[:, None]
    units = np.eye(columns.size)
    slopes = [(s - s.mean(axis=0)) * unit for unit in units]
    if alignment.criterion == "time":
        slopes += [rate * since, rate]
    slopes += [np.broadcast_to(unit, s.shape) for unit in units]
    if ROTATION in alignment.estimates:
        slopes.append(turned_points(spline(time[inside]), np.radians(alignment.rotation + 90.0))[:, columns])
    if alignment.criterion == "path":
        tangent = rate / np.maximum(np.linalg.norm(rate, axis=1), 1e-12)[:, None]
        residual, *slopes = (part - tangent * np.sum(tangent * part, axis=1)[:, None] for part in (residual, *slopes))
    matrix = np.stack([slope.ravel() for slope in slopes], axis=1)
    fitted = np.linalg.lstsq(matrix, residual.ravel(), rcond=None)[0]
    before = float(np.sqrt(np.mean(residual**2)))
    after = float(np.sqrt(np.mean((residual.ravel() - matrix @ fitted) ** 2)))
    if not after < _EXPLAINED_RESIDUAL * before:
        return ScaleAndClock({}, 0.0, before)
    is_named = np.sqrt(np.mean((matrix * fitted) ** 2, axis=0)) >= _NAMED * before
    scales = {column: float(fitted[k]) for k, column in enumerate(columns.tolist()) if is_named[k]}
    clock = columns.size
    rate_named = alignment.criterion == "time" and is_named[clock]
    return ScaleAndClock(scales, -float(fitted[clock]) if rate_named else 0.0, before)


def aligned_beside_faults(trace: Trace, run: Run, what: tuple[str, ...]) -> Alignment:
    """Return the alignment of a trace whose offsets, turn and shift hold nothing of a wrong scale or clock.

    An alignment takes up what it can of a scale or a clock. So where these are named they are taken out of the trace,
    about its middle, and it is aligned again; the trace that is compared keeps them.

    Raises:
        InputError: as `aligned_as_named`, or a scale so far from 1 that the unit of a column must be another.
    """
    alignment = aligned_as_named(trace, run, what)
    for _ in range(_SCALE_ROUNDS):
        faults = scale_and_clock(trace, run, alignment)
        if not faults.is_any:
            break
        _check_scales(faults, alignment, run)
        anew = aligned_trace(_without(faults, trace, alignment, run), run, what)
        if anew.criterion == "time":
            anew = replace(anew, instants=trace.time - anew.shift)
        alignment = replace(anew, residual=scale_and_clock(trace, run, anew).residual)
    return alignment


def _without(faults: ScaleAndClock, trace: Trace, alignment: Alignment, run: Run) -> Trace:
    """Return a trace without the faults that are named, about the middle of what the run covers."""
    inside = (alignment.instants >= run.time[0]) & (alignment.instants <= run.time[-1])

    def without_rate(values: Floats, rate: float) -> Floats:
        middle = values[inside].mean()
        return np.asarray(middle + (values - middle) / (1 + rate))

    measured = trace.nozzle if alignment.by == "nozzle" else trace.axes[alignment.by]
    assert measured is not None
    corrected = measured.copy()
    for column, scale in faults.scales.items():
        corrected[:, column] = without_rate(measured[:, column], scale)
    time = without_rate(trace.time, faults.clock) if faults.clock else trace.time
    if alignment.by == "nozzle":
        return replace(trace, time=time, nozzle=corrected)
    return replace(trace, time=time, axes={**trace.axes, alignment.by: corrected})


def fault_notes(trace: Trace, run: Run, alignment: Alignment) -> list[str]:
    """Return notes on a scale of an axis and on a clock that explain most of what is left after an alignment.

    Raises:
        InputError: a scale so far from 1 that the unit of a column must be another.
    """
    faults = scale_and_clock(trace, run, alignment)
    _check_scales(faults, alignment, run)
    names = _axis_names(alignment, run)
    notes = [
        f"{names[column]} of the trace is {1 + scale:.6f} times that of the run; that is most of the difference, and "
        "an offset is that at the path's middle"
        for column, scale in faults.scales.items()
    ]
    if abs(faults.clock) > LARGEST_CLOCK:
        notes.append(
            f"the trace takes {1 + faults.clock:.4g} times as long as the run, more than by a wrong clock: their "
            "speeds differ, which --align path leaves out; that is most of the difference"
        )
    elif faults.clock:
        way = "fast" if faults.clock > 0 else "slow"
        ppm = 1e6 * abs(faults.clock)
        notes.append(f"the trace's clock runs {way} by {ppm:.0f} ppm against the run's; that is most of the difference")
    return notes


def _check_scales(faults: ScaleAndClock, alignment: Alignment, run: Run) -> None:
    names = _axis_names(alignment, run)
    for column, scale in faults.scales.items():
        if abs(scale) > _WRONG_SCALE:
            raise InputError(
                f"{names[column]}: the trace is {1 + scale:.5g} times the run: a column in another unit, or with a "
                "wrong factor?"
            )


def _axis_names(alignment: Alignment, run: Run) -> tuple[str, ...]:
    return tuple("xyz") if alignment.by == "nozzle" else run.axes
