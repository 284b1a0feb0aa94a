"""Colour scales of a bead: by its share of the tolerance, its width or its contour error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, unknown
from gantrysim.glue.bead.sweep import Sweep
from gantrysim.glue.bead.trace import BeadSettings, BeadTrace
from gantrysim.record.run import Run
from gantrysim.results.glue import BeadWidth

PLAIN = "plain"
VERDICT = "verdict"
COLOURS = (PLAIN, VERDICT, "width", "error")

_SHADES = 256
# span of a scale, in percentiles of the values: a peak at a corner or a blob at a stop must not dominate it
_ERROR_PERCENTILE = 99.5
_WIDTH_PERCENTILES = (5.0, 95.0)
_LEAST_ERROR = 1.0  # smallest span of an error scale [µm]
_LEAST_WIDTH = 0.02  # smallest span of a width scale to either side, relative to the nominal width
_LABEL_ERROR = 0.005  # rounding of labels, relative to the span
_UM = 1e3
# colours of the verdict by share of the tolerance: blue to green within, yellow near it, red beyond; blind to red and
# green one still sees blue, yellow and dark
_VERDICT_COLOURS = (
    (0.0, "#2a5fa5"),
    (0.8, "#6fc7b4"),
    (0.8, "#f2c14e"),
    (1.0, "#f2c14e"),
    (1.0, "#e0512f"),
    (2.0, "#7a0018"),
)
_VERDICT_END = 2.0  # of the scale, in tolerances


@dataclass(frozen=True, eq=False)
class Scale:
    """A colour scale.

    Attributes:
        title: name of the quantity.
        unit: of the quantity.
        low, high: values at the first and the last colour.
        below, above: whether there are values beyond these; they have the first or the last colour.
        table: colours from low to high, (256, 3), 0 to 255.
        limit: value that is marked on the scale, None for none.
    """

    title: str
    unit: str
    low: float
    high: float
    below: bool
    above: bool
    table: NDArray[np.uint8]
    limit: float | None = None

    @property
    def short_title(self) -> str:
        """Last word of the title."""
        return self.title.split()[-1]

    def share(self, values: Floats) -> Floats:
        """Return where values lie between low and high, 0 to 1."""
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)

    def labels(self) -> tuple[str, str, str]:
        """Return the lowest, middle and highest value as text, with the digits that half a percent of the span needs.

        A sign before the first or the last marks values beyond it.
        """
        values = (self.low, 0.5 * (self.low + self.high), self.high)
        rounding = _LABEL_ERROR * (self.high - self.low)
        for digits in itertools.count():
            texts = [f"{value:.{digits}f}" for value in values]
            if all(abs(float(text) - value) <= rounding for text, value in zip(texts, values, strict=True)):
                break
        low, middle, high = texts
        if self.below:
            low = f"≤ {low}"
        if self.above:
            high = f"≥ {high}"
        return low, middle, high


def scale_for(
    colour: str, runs: Sequence[Run], beads: Sequence[BeadSettings | BeadTrace | None] | None = None
) -> Scale | None:
    """Return one colour scale for the beads of several runs, or None for plain beads.

    A scale of the verdict ends at twice the tolerance, and marks the tolerance. An error scale begins at 0 and ends at
    the 99.5th percentile. A width scale is centred on the first run's nominal width, where that is known, and spans the
    5th to the 95th percentile, so that a blob at a stop does not dominate it.

    Args:
        colour: one of `COLOURS`.
        runs: the runs to be coloured.
        beads: bead settings of each run, or the beads themselves.

    Raises:
        InputError: no such colour, or a verdict on a run without a job.
    """
    if colour not in COLOURS:
        raise unknown("colour", colour, COLOURS)
    if colour == PLAIN:
        return None
    if beads is None:
        beads = [None] * len(runs)
    sweeps = [Sweep(run, bead) for run, bead in zip(runs, beads, strict=True)]
    values = np.concatenate([_values(colour, sweep) for sweep in sweeps])
    if colour == VERDICT:
        span = (0.0, _VERDICT_END)
        return replace(_scale("error in tolerances", "", span, values, _verdict_table()), limit=1.0)
    if colour == "error":
        largest = float(np.percentile(values, _ERROR_PERCENTILE))
        high = _rounded_up(max(largest, _LEAST_ERROR))
        # without viridis' darkest shades
        return _scale("contour error", "µm", (0.0, high), values, _table("viridis", 0.22, 1.0))
    nominal = float(sweeps[0].bead_trace.nominal_section.width[0]) or float(np.median(values)) or 1.0  # or no glue
    reach = float(np.abs(np.percentile(values, _WIDTH_PERCENTILES) - nominal).max())
    reach = min(_rounded_up(max(reach, _LEAST_WIDTH * nominal)), nominal)
    return _scale("bead width", "mm", (nominal - reach, nominal + reach), values, _table("coolwarm", 0.0, 1.0))


def _scale(title: str, unit: str, span: tuple[float, float], values: Floats, table: NDArray[np.uint8]) -> Scale:
    """Return a scale over a span, which marks values beyond it."""
    low, high = span
    return Scale(title, unit, low, high, bool(values.min() < low), bool(values.max() > high), table)


def values_along(colour: str, bead_trace: BeadTrace) -> Floats:
    """Return what colours a bead at its stations, (r,): for "width" [mm], "error" [µm], "verdict" in tolerances."""
    if colour == "width":
        return bead_trace.width
    if colour == VERDICT:
        return usage_along(bead_trace)
    return errors_along(bead_trace)


def errors_along(bead_trace: BeadTrace) -> Floats:
    """Return the contour error at the stations of a bead, (r,) [µm]; while the dispenser is off, the nearest one."""
    run = bead_trace.run
    if not run.dispense.any():
        return np.zeros(bead_trace.place.size)
    ticks = np.arange(len(run.time), dtype=np.float64)
    analysis = bead_trace.analysis
    return bead_trace.along(_UM * np.interp(ticks, analysis.ticks, analysis.nozzle.distance))


def usage_along(bead_trace: BeadTrace) -> Floats:
    """Return the share of its tolerance that the worse of contour error and width uses at the stations, (r,).

    Away from starts and stops, as in the verdict, where alone the width is judged.

    Raises:
        InputError: the run has no job, which has the tolerance.
    """
    run = bead_trace.run
    if run.job is None:
        raise InputError("colour verdict: the run has no job, which gives the tolerances: use error or width")
    width = float(bead_trace.nominal_section.width[0]) if bead_trace.nominal > 0 else math.nan
    tolerance = run.job.limits(run.face, width)
    usage = errors_along(bead_trace) / (_UM * tolerance.path_max)
    if bead_trace.nominal <= 0 or not run.dispense.any():
        return usage
    bead_width = BeadWidth(bead_trace, tolerance)
    return np.maximum(usage, np.where(bead_width.judged, np.abs(bead_width.error) / tolerance.bead_width, 0.0))


def default_colour(runs: Sequence[Run]) -> str:
    """Return the colour by the verdict, or by the error where a run has no job."""
    return VERDICT if all(run.job is not None for run in runs) else "error"


def _values(colour: str, sweep: Sweep) -> Floats:
    """Return the coloured quantity of a whole bead at each place of its rings, (k,)."""
    mesh = sweep.mesh(len(sweep.bead_trace.run.time) - 1)
    # rings of an end and unused ones share a place
    _, first = np.unique(mesh.place, return_index=True)
    if colour == "width":
        return mesh.width[first]
    return np.interp(mesh.place[first], sweep.bead_trace.place, values_along(colour, sweep.bead_trace))


def _rounded_up(value: float) -> float:
    """Return a value rounded up to two digits."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(math.ceil(value / digit - 1e-9) * digit)


def _table(name: str, first: float, last: float) -> NDArray[np.uint8]:
    # slow to import, and needed for coloured beads alone
    from matplotlib import colormaps

    shades: NDArray[np.float64] = colormaps[name](np.linspace(first, last, _SHADES))
    return np.round(255 * shades[:, :3]).astype(np.uint8)


def _verdict_table() -> NDArray[np.uint8]:
    """Return the shades of the verdict, with steps at the warning and at the tolerance."""
    shades = np.linspace(0.0, _VERDICT_END, _SHADES)
    stops = [stop for stop, _ in _VERDICT_COLOURS]
    colours = np.array([ImageColor.getrgb(colour) for _, colour in _VERDICT_COLOURS], float)
    # np.interp takes the first of two equal stops from below, so that a step stays a step
    table = np.stack([np.interp(shades, stops, channel) for channel in colours.T], axis=1)
    return np.round(table).astype(np.uint8)
