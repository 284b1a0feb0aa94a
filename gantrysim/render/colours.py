"""Colour scales of a bead, for its width or its contour error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import unknown
from gantrysim.bead.sweep import Sweep
from gantrysim.bead.trace import BeadSettings, BeadTrace
from gantrysim.record.run import Run

COLOURS = ("plain", "width", "error")

_SHADES = 256
# span of a scale, in percentiles of the values: a peak at a corner or a blob at a stop must not dominate it
_ERROR_PERCENTILE = 99.5
_WIDTH_PERCENTILES = (5.0, 95.0)
_LEAST_ERROR = 1.0  # smallest span of an error scale [µm]
_LEAST_WIDTH = 0.02  # smallest span of a width scale to either side, relative to the nominal width
_LABEL_ERROR = 0.005  # rounding of labels, relative to the span
_UM = 1e3


@dataclass(frozen=True, eq=False)
class Scale:
    """A colour scale.

    Attributes:
        title: name of the quantity.
        unit: of the quantity.
        low, high: values at the first and the last colour.
        below, above: whether there are values beyond these; they have the first or the last colour.
        table: colours from low to high, (256, 3), 0 to 255.
    """

    title: str
    unit: str
    low: float
    high: float
    below: bool
    above: bool
    table: NDArray[np.uint8]

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

    An error scale begins at 0 and ends at the 99.5th percentile. A width scale is centred on the first run's nominal
    width, where that is known, and spans the 5th to the 95th percentile, so that a blob at a stop does not dominate it.

    Args:
        colour: one of `COLOURS`.
        runs: the runs to be coloured.
        beads: bead settings of each run, or the beads themselves.

    Raises:
        InputError: no such colour.
    """
    if colour not in COLOURS:
        raise unknown("colour", colour, COLOURS)
    if colour == "plain":
        return None
    if beads is None:
        beads = [None] * len(runs)
    sweeps = [Sweep(run, bead) for run, bead in zip(runs, beads, strict=True)]
    values = np.concatenate([_values(colour, sweep) for sweep in sweeps])
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


def errors_along(bead_trace: BeadTrace) -> Floats:
    """Return the contour error at the stations of a bead, (r,) [µm]; while the dispenser is off, the nearest one."""
    run = bead_trace.run
    if not run.dispense.any():
        return np.zeros(bead_trace.place.size)
    ticks = np.arange(len(run.time), dtype=np.float64)
    analysis = bead_trace.analysis
    return bead_trace.along(_UM * np.interp(ticks, analysis.ticks, analysis.nozzle.distance))


def _values(colour: str, sweep: Sweep) -> Floats:
    """Return the coloured quantity of a whole bead at each place of its rings, (k,)."""
    mesh = sweep.mesh(len(sweep.bead_trace.run.time) - 1)
    _, first = np.unique(mesh.place, return_index=True)  # rings of an end and unused ones share a place
    if colour == "width":
        return mesh.width[first]
    return np.interp(mesh.place[first], sweep.bead_trace.place, errors_along(sweep.bead_trace))


def _rounded_up(value: float) -> float:
    """Return a value rounded up to two digits."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(math.ceil(value / digit - 1e-9) * digit)


def _table(name: str, first: float, last: float) -> NDArray[np.uint8]:
    from matplotlib import colormaps  # slow to import, and needed for coloured beads alone

    shades: NDArray[np.float64] = colormaps[name](np.linspace(first, last, _SHADES))
    return np.round(255 * shades[:, :3]).astype(np.uint8)
