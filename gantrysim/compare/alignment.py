"""The alignment of a measured trace with a simulated run, at equal places of the path or at equal times, and its words.

At equal places a trace may have other speeds than the run, see `gantrysim.compare.places`; for equal times see
`gantrysim.compare.equal_times`. Offsets and turns that the data do not distinguish from zero are zero. The words name
what the data distinguish, each value with its 95 % interval.

With t the trace's time and tau that of the run at the same place, either t = shift + (1 + clock) tau, with equal speeds
and a clock that runs fast or slow, or the speeds differ: then dtau/dt at places where the run's speed is steady is the
ratio of the two.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.errors import InputError, unknown
from gantrysim.base.quantity import number_text
from gantrysim.compare.compare_quantities import DIFFERENCE, SHIFT
from gantrysim.compare.compare_quantities import ROTATION as ROTATION_ANGLE
from gantrysim.compare.equal_times import (
    AS_WELL,
    DISTINCT_SHIFTS,
    NOTHING,
    ROTATION,
    TIME,
    apart_shifts,
    best_fit,
    check_duration,
    estimate_name,
    link_positions,
)
from gantrysim.compare.estimates import Estimate, clustered_intervals
from gantrysim.compare.measured import Trace
from gantrysim.compare.places import Placed, Rows, laid_on_run
from gantrysim.compare.vertices import noise_of
from gantrysim.metrics.analysis import THOUSANDTH
from gantrysim.record.run import Run

ALIGNED = ("path", "time", "offset", "rotation")
DEFAULT = ("path", "offset", "rotation")
DOUBTFUL_RESIDUAL = 0.1  # residual, of the run's own spread, from which an alignment is doubted
CLOCK = "clock"
_SMALL_TURN = math.radians(1.0)  # up to which places on a path that is not turned are near

_MOVING_SPEED = 0.1  # of the highest speed, from which an instant is known by its place
_STEADY_ACCELERATION = 0.02  # of the largest acceleration along the path, below which a speed is steady
_RATIO_WINDOW = 0.05  # of a window in which its ratio is taken [s]
_FEWEST_WINDOWS = 4
LARGEST_CLOCK = 2e-3  # rate by which a log's clock may be wrong; beyond, it is another speed
_SAME_PLACE = 5.0  # residuals across the path by which places may differ at equal times
_LAG = 5e-3  # time by which a real axis may lag more or less than the simulated one [s]
_NEARLY_ALL = 0.999  # of the samples, that are no further
_MOVING_SAMPLES = 8  # samples in motion
_WHERE = {"path": "at equal places of the path", "time": "at equal times"}
_WRITTEN_INTERVAL = 1e-6  # interval that is written, in its unit
_LEAST_NOISE = 1e-5  # that is named [mm or deg]


@dataclass(frozen=True, eq=False)
class Alignment:
    """How a trace lies against the simulation.

    Attributes:
        by: link that gives it: commanded, encoder or nozzle.
        criterion: what is equal: "path" or "time".
        instants: of the run, for each sample of the trace; outside of the run or nan where it has none, (n,) [s].
        shift: the trace's time less the run's; where their speeds differ, its mean [s].
        offsets: the trace's position less the run's, by frame: "axes" (axes,) and "nozzle" (3,); zero where none is
            distinguished [mm or deg].
        rotation: turn of the nozzle's frame about z, counter-clockwise positive; zero likewise [deg].
        residual: rms of what is left of the link [mm or deg].
        estimates: of all that was fitted, by "time" [s], "clock", frame and axis as "nozzle x" [mm or deg], and
            "rotation" [deg].
        timing: of the trace against the run; None where it is not judged at equal places.
        noise: standard deviation of white noise in the link's positions [mm or deg].
        others: shifts with which the trace fits as well, as on a circle of several turns [s].
        notes: why it is not aligned as was asked.
    """

    by: str
    criterion: str
    instants: Floats
    shift: float
    offsets: Mapping[str, Floats]
    rotation: float
    residual: float
    estimates: Mapping[str, Estimate]
    timing: Timing | None = None
    noise: float = 0.0
    others: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


def aligned_trace(trace: Trace, run: Run, what: tuple[str, ...] = DEFAULT) -> Alignment:
    """Return the alignment of a trace with a simulated run.

    The first of command, encoder and nozzle that is measured gives the instants. Axes have one offset, of that link;
    the nozzle has its own.

    Args:
        trace: measured.
        run: simulated.
        what: "path" for equal places or "time" for a time shift, and what else is fitted, of `ALIGNED`; the rest is
            taken to be zero.

    Raises:
        InputError: an unknown alignment, both path and time, or a trace that does not fit the run.
    """
    for quantity in what:
        if quantity not in ALIGNED:
            raise unknown("alignment", quantity, ALIGNED)
    if "path" in what and "time" in what:
        raise InputError("alignment path and time: must be one of the two, as equal places or equal times")
    if "path" in what or "time" in what:
        check_duration(trace.time, run)
    if "path" not in what:
        return _aligned_in_time(trace, run, what)
    by_place = _aligned_by_place(trace, run, what)
    if by_place is not None:
        return by_place
    in_time = tuple("time" if quantity == "path" else quantity for quantity in what)
    note = "the trace is aligned in time: its samples do not show where on the path they are"
    return replace(_aligned_in_time(trace, run, in_time), notes=(note,))


def _aligned_by_place(trace: Trace, run: Run, what: tuple[str, ...]) -> Alignment | None:
    """Return the alignment at equal places; None where these are not known."""
    by = trace.links[0]
    measured, simulated, _ = link_positions(trace, run, by)
    laid = _laid_link(trace, run, by, what)
    if not laid:
        return None
    best = laid[0]
    timing = timing_of(_motion(trace, run, best), best.residual)
    if timing is None or best.residual > DOUBTFUL_RESIDUAL * min(_spread(measured), _spread(simulated)):
        return None
    same = timing.kind != "speed"
    offsets = {"nozzle" if by == "nozzle" else "axes": _whole_offset(trace, by, best)}
    estimates = {TIME: timing.shift, CLOCK: timing.clock} if same else {}
    estimates |= _named_estimates(trace, run, by, best)
    rotation = best.turn if by == "nozzle" else 0.0
    if by != "nozzle" and trace.nozzle is not None:
        of_nozzle = _laid_link(trace, run, "nozzle", what)
        if not of_nozzle:
            return None
        offsets["nozzle"] = _whole_offset(trace, "nozzle", of_nozzle[0])
        estimates |= _named_estimates(trace, run, "nozzle", of_nozzle[0])
        rotation = of_nozzle[0].turn
    as_good = [
        timing.shift.value + float(np.nanmedian(best.instants - other.instants))
        for other in laid[1:]
        if other.residual <= max(AS_WELL * best.residual, NOTHING)
    ]
    return Alignment(
        by=by,
        criterion="path",
        instants=timing.instants(trace.time) if same else best.instants,
        shift=timing.shift.value,
        offsets=offsets,
        rotation=float(np.degrees(rotation)),
        residual=best.residual,
        estimates=estimates,
        timing=timing,
        noise=noise_of(link_positions(trace, run, by)[0]),
        others=tuple(sorted(apart_shifts(as_good, timing.shift.value, DISTINCT_SHIFTS * run.period))),
    )


def _laid_link(trace: Trace, run: Run, link: str, what: tuple[str, ...]) -> list[Placed]:
    """Return where a link of a trace lies on the run, the best first; turned far only where it must be.

    A path that is turned by degrees is tried from its own turn too: places that were found on it as if it was not
    turned may bend offset and turn.
    """
    measured, simulated, _ = link_positions(trace, run, link)
    turning = link == "nozzle" and "rotation" in what
    laid = laid_on_run(trace.time, measured, (run.time, simulated), "offset" in what, "small" if turning else "")
    if not turning or (laid and _is_turned_little(laid[0].estimates["turn"])):
        return laid
    turned = laid_on_run(trace.time, measured, (run.time, simulated), "offset" in what, "any")
    is_better = turned and (not laid or AS_WELL * turned[0].residual < laid[0].residual)
    return turned if is_better else laid


def _is_turned_little(turn: Estimate) -> bool:
    return abs(turn.value) + turn.interval < _SMALL_TURN


def _spread(positions: Floats) -> float:
    """Return the rms of positions about their mean."""
    return float(np.sqrt(np.mean((positions - positions.mean(axis=0)) ** 2)))


def _motion(trace: Trace, run: Run, laid: Placed) -> Motion:
    rows = np.isfinite(laid.instants)
    instants = laid.instants[rows]
    # of the command, which does not shake
    spline = CubicSpline(run.time, run.commanded_tip, axis=0)
    rate = spline(instants, 1)
    speed = np.linalg.norm(rate, axis=1)
    acceleration = np.sum(rate * spline(instants, 2), axis=1) / np.maximum(speed, 1e-12)
    tick = np.clip(np.searchsorted(run.time, instants, side="right") - 1, 0, len(run.time) - 1)
    return Motion(trace.time[rows], instants, speed, acceleration, laid.still[rows], run.dispense[tick])


def _whole_offset(trace: Trace, link: str, laid: Placed) -> Floats:
    """Return the offset of all axes of a link, zero for those that are not measured."""
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    assert measured is not None
    whole = np.zeros(measured.shape[1])
    whole[~np.isnan(measured).any(axis=0)] = laid.offset
    return whole


def _named_estimates(trace: Trace, run: Run, link: str, laid: Placed) -> dict[str, Estimate]:
    """Return the estimates of a link by frame and axis, and of the rotation in degrees."""
    columns = link_positions(trace, run, link)[2]
    named = {}
    for key, estimate in laid.estimates.items():
        if isinstance(key, int):
            named[estimate_name(run, link, int(columns[key]))] = estimate
        else:
            named[ROTATION] = Estimate(float(np.degrees(estimate.value)), float(np.degrees(estimate.interval)))
    return named


def _aligned_in_time(trace: Trace, run: Run, what: tuple[str, ...]) -> Alignment:
    """Return the alignment at equal times."""
    by = trace.links[0]
    placed = "offset" in what
    turning = "rotation" in what and trace.nozzle is not None
    fit, others = best_fit(trace, run, by, None if "time" in what else 0.0, placed, turning)
    turn = fit.turn
    offsets = {}
    estimates = dict(fit.estimates)
    if by != "nozzle":
        offsets["axes"] = fit.offset
        if trace.nozzle is not None:
            of_nozzle, _ = best_fit(trace, run, "nozzle", fit.shift, placed, turning)
            offsets["nozzle"] = of_nozzle.offset
            turn = of_nozzle.turn
            estimates |= of_nozzle.estimates
    else:
        offsets["nozzle"] = fit.offset
    return Alignment(
        by=by,
        criterion="time",
        instants=trace.time - fit.shift,
        shift=fit.shift,
        offsets=offsets,
        rotation=float(np.degrees(turn)),
        residual=fit.residual,
        estimates=estimates,
        noise=noise_of(link_positions(trace, run, by)[0]),
        others=others,
    )


class Motion(NamedTuple):
    """The instants of a run at the samples of a trace, those that are part of it.

    Attributes:
        time: of the trace, (n,) [s].
        instants: of the run, (n,) [s].
        speed: of the run's command along its path there, (n,) [mm/s].
        acceleration: likewise, (n,) [mm/s²].
        still: whether the trace stands still, (n,).
        dispense: whether glue flows there, whose speed is the feed, (n,).
    """

    time: Floats
    instants: Floats
    speed: Floats
    acceleration: Floats
    still: Rows
    dispense: Rows


@dataclass(frozen=True)
class Timing:
    """The time of a trace against that of the run.

    Attributes:
        kind: "shift" where both pass the same places at the same times, "clock" where the trace's clock is faster or
            slower, or "speed" where the speeds differ.
        shift: time of the trace less that of the run: its mean, weighted by speed [s].
        clock: rate of the trace's clock less 1, where the speeds are the same.
        middle: instant of the run about which the clock is faster [s].
        speed: of the trace, over that of the run, where glue flows and the run's is steady; None where it never is.
        duration: time of the trace in motion, over that of the run for the same way.
    """

    kind: str
    shift: Estimate
    clock: Estimate
    middle: float
    speed: Estimate | None
    duration: float

    def instants(self, time: Floats) -> Floats:
        """Return the instants of the run at times of a trace with the same speeds, (n,) [s]."""
        if self.kind == "clock":
            return self.middle + (time - self.middle - self.shift.value) / (1 + self.clock.value)
        return time - self.shift.value


def timing_of(motion: Motion, across: float) -> Timing | None:
    """Return how the time of a trace goes; None where it hardly moves.

    Args:
        motion: the instants of the run at its samples.
        across: rms of what is left across the path [mm or deg].
    """
    moving = ~motion.still & (motion.speed > _MOVING_SPEED * motion.speed.max())
    if np.count_nonzero(moving) < _MOVING_SAMPLES:
        return None
    time, instants, speed = (values[moving] for values in (motion.time, motion.instants, motion.speed))
    middle = float(np.average(instants, weights=speed**2))
    # weighted by the speed, so that residuals are distances along the path
    slopes = np.stack([speed, speed * (instants - middle)], axis=1)[:, None, :]
    late = (time - instants) * speed
    shift, rate = np.linalg.lstsq(slopes[:, 0], late, rcond=None)[0].tolist()
    along = late - slopes[:, 0] @ [shift, rate]
    of_shift, of_rate = clustered_intervals(along[:, None], slopes).tolist()
    clock = Estimate(rate, of_rate)
    allowed = max(_SAME_PLACE * across, _LAG * float(np.median(speed)))
    kind = "speed"
    if abs(rate) <= LARGEST_CLOCK and float(np.quantile(np.abs(along), _NEARLY_ALL)) <= allowed:
        kind = "clock" if clock.distinguished and abs(rate) > _ROUNDING else "shift"
    steady = _steady_ratio(motion)
    way = float(np.ptp(instants))
    return Timing(kind, Estimate(shift, of_shift), clock, middle, steady, float(np.ptp(time)) / max(way, 1e-12))


_ROUNDING = 1e-9  # rate of a clock


def _steady_ratio(motion: Motion) -> Estimate | None:
    """Return the ratio of the speeds where that of the run is steady."""
    feed = ~motion.still & motion.dispense
    if not feed.any():
        return None
    is_steady = np.abs(motion.acceleration) <= _STEADY_ACCELERATION * float(np.abs(motion.acceleration).max())
    is_steady &= feed & (motion.speed > 0.5 * motion.speed[feed].max())
    ratios = []
    for first, after in spans(is_steady):
        # by windows: within one stretch of the run a trace may stop, as at a joint of two pieces
        windows = max(int((motion.instants[after - 1] - motion.instants[first]) / _RATIO_WINDOW), 1)
        for rows in np.array_split(np.arange(first, after), windows):
            time = motion.time[rows] - motion.time[rows].mean()
            instants = motion.instants[rows]
            if rows.size >= _MOVING_SAMPLES and np.ptp(instants) > 0:
                ratios.append(float(np.sum(time * instants) / np.sum(time**2)))
    if len(ratios) < _FEWEST_WINDOWS:
        return None
    ratio = float(np.median(ratios))
    # of a median of normal values, and their deviation from the median of its magnitudes
    deviation = 1.2533 * 1.4826 * float(np.median(np.abs(np.array(ratios) - ratio))) / len(ratios) ** 0.5
    return Estimate(ratio, 2 * deviation)


def alignment_words(alignment: Alignment, run: Run) -> str:
    """Return how a trace was aligned with a run, in some sentences."""
    sentences = [f"Aligned {_WHERE[alignment.criterion]}, by {alignment.by}: {_time_words(alignment)}."]
    names = [name for name in alignment.estimates if name not in (TIME, CLOCK)]
    claimed = [name for name in names if alignment.estimates[name].distinguished]
    if claimed:
        listed = "; ".join(_words(name, alignment.estimates[name], run) for name in claimed)
        sentences.append(f"Taken out: {listed}.")
    others = [name for name in names if name not in claimed]
    if others:
        listed = "; ".join(_words(name, alignment.estimates[name], run) for name in others)
        sentences.append(f"Not distinguished from zero, so not taken out: {listed}.")
    unit = _small_unit(alignment, run)
    remainder = f"rms left across the path: {DIFFERENCE.number(alignment.residual)} {unit}"
    if alignment.criterion == "time":
        remainder = f"residual {DIFFERENCE.number(alignment.residual)} {unit} rms"
    if alignment.noise > _LEAST_NOISE:
        remainder += f"; noise of the samples: {DIFFERENCE.number(alignment.noise)} {unit}"
    return " ".join([*sentences, f"{remainder[0].upper()}{remainder[1:]}."])


def _small_unit(alignment: Alignment, run: Run) -> str:
    units = ("mm",) if alignment.by == "nozzle" else run.units
    return " and ".join(dict.fromkeys(THOUSANDTH[unit] for unit in units))


def _time_words(alignment: Alignment) -> str:
    """Return how the trace's time goes with that of the run."""
    timing = alignment.timing
    shift = f"the trace's time is {SHIFT.text(alignment.shift)} against the run's"
    if timing is None:
        return shift
    if timing.kind == "shift":
        return f"{shift} ({_plus_minus(timing.shift.interval, 's', 1.0)}), at equal speeds"
    if timing.kind == "clock":
        rate = timing.clock
        way = "fast" if rate.value > 0 else "slow"
        ppm = f"{1e6 * abs(rate.value):.1f} {_plus_minus(rate.interval, 'ppm', 1e6)}"
        return f"{shift} at its middle, at equal speeds, and its clock runs {way} by {ppm}"
    text = f"the speeds differ, the trace takes {timing.duration:.4g} times as long for the same way"
    if timing.speed is not None:
        ratio = timing.speed
        text += f"; where glue flows at a steady speed, the trace has {ratio.value:.4f} ± {ratio.interval:.2g} of it"
    return text


def _plus_minus(interval: float, unit: str, factor: float) -> str:
    if not math.isfinite(interval):
        return "with no bound by the data"
    return f"± {number_text(max(factor * interval, _WRITTEN_INTERVAL), '.2g')} {unit}"


def _words(name: str, estimate: Estimate, run: Run) -> str:
    if name == ROTATION:
        if not math.isfinite(estimate.interval):
            return "rotation, which the path does not show"
        return f"rotation {ROTATION_ANGLE.number(estimate.value)} {_plus_minus(estimate.interval, 'deg', 1.0)}"
    frame, axis = name.split(" ", 1)
    unit = THOUSANDTH["mm" if frame == "nozzle" else run.units[run.axes.index(axis)]]
    if not math.isfinite(estimate.interval):
        return f"{frame} offset {axis}, which the path does not show"
    offset = number_text(1e3 * estimate.value, "+.1f")
    return f"{frame} offset {axis} {offset} {_plus_minus(estimate.interval, unit, 1e3)}"


def estimate_rows(alignment: Alignment, run: Run) -> Iterator[list[Any]]:
    """Yield rows of a table: what is estimated, value, half the interval, unit, and whether it is distinguished."""
    for name, estimate in alignment.estimates.items():
        unit = {TIME: "s", ROTATION: "deg", CLOCK: "ppm"}.get(name)
        factor = 1e6 if name == CLOCK else 1.0
        if unit is None:
            frame, axis = name.split(" ", 1)
            unit = "mm" if frame == "nozzle" else run.units[run.axes.index(axis)]
        interval = factor * estimate.interval if math.isfinite(estimate.interval) else None
        claim = "yes" if estimate.distinguished else "no"
        yield [name, factor * estimate.value, interval, unit, claim]


def alignment_content(alignment: Alignment) -> dict[str, Any]:
    """Return the alignment for JSON; offsets, residual and noise in mm or deg."""

    def pair(estimate: Estimate) -> dict[str, Any]:
        interval = estimate.interval if math.isfinite(estimate.interval) else None
        return {"value": estimate.value, "interval_95": interval, "distinguished": estimate.distinguished}

    timing = alignment.timing
    return {
        "by": alignment.by,
        "at": alignment.criterion,
        SHIFT.key: alignment.shift,
        ROTATION_ANGLE.key: alignment.rotation,
        "offsets": {name: values.tolist() for name, values in alignment.offsets.items()},
        "residual": alignment.residual,
        "noise": alignment.noise,
        "estimates": {name: pair(estimate) for name, estimate in alignment.estimates.items()},
        "timing": None
        if timing is None
        else {
            "kind": timing.kind,
            "speed_ratio": None if timing.speed is None else timing.speed.value,
            "speed_ratio_interval_95": None if timing.speed is None else timing.speed.interval,
            "duration_ratio": timing.duration,
        },
    }
