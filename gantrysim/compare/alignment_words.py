"""How a trace was aligned, in words: what its data distinguish from zero, each value with its 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from gantrysim.base.quantity import number_text
from gantrysim.compare.alignment import CLOCK, Alignment
from gantrysim.compare.compare_quantities import DIFFERENCE, ROTATION, SHIFT
from gantrysim.compare.equal_times import ROTATION as TURN
from gantrysim.compare.equal_times import TIME
from gantrysim.compare.estimates import Estimate
from gantrysim.metrics.analysis import THOUSANDTH
from gantrysim.record.run import Run

_WHERE = {"path": "at equal places of the path", "time": "at equal times"}
_SMALLEST = 1e-6  # interval that is written, in its unit
_LEAST_NOISE = 1e-5  # that is named [mm or deg]


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
    return f"± {max(factor * interval, _SMALLEST):.2g} {unit}"


def _words(name: str, estimate: Estimate, run: Run) -> str:
    if name == TURN:
        if not math.isfinite(estimate.interval):
            return "rotation, which the path does not show"
        return f"rotation {ROTATION.number(estimate.value)} {_plus_minus(estimate.interval, 'deg', 1.0)}"
    frame, axis = name.split(" ", 1)
    unit = THOUSANDTH["mm" if frame == "nozzle" else run.units[run.axes.index(axis)]]
    if not math.isfinite(estimate.interval):
        return f"{frame} offset {axis}, which the path does not show"
    offset = number_text(1e3 * estimate.value, "+.1f")
    return f"{frame} offset {axis} {offset} {_plus_minus(estimate.interval, unit, 1e3)}"


def estimate_rows(alignment: Alignment, run: Run) -> Iterator[list[Any]]:
    """Yield rows of a table: what is estimated, value, half the interval, unit, and whether it is distinguished."""
    for name, estimate in alignment.estimates.items():
        unit = {TIME: "s", TURN: "deg", CLOCK: "ppm"}.get(name)
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
        ROTATION.key: alignment.rotation,
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
