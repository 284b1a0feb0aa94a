"""What the colour of a bead tells: its width, or its contour error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.bead.strand import BeadSettings, Strand
from gantrysim.controllers.path import Floats
from gantrysim.errors import unknown
from gantrysim.metrics import Analysis
from gantrysim.run import Run

__all__ = ["COLOURS", "Scale", "scale_for", "values_along"]

COLOURS = ("plain", "width", "error")

_SHADES = 256
_USUAL = {"width": (5.0, 95.0), "error": (0.0, 99.5)}  # percentiles of the values, that a scale holds
_LEAST_ERROR = 1.0  # [µm], that a scale spans
_LEAST_WIDTH = 0.02  # of the nominal width, that a scale spans to either side
_STATIONS = 1250
_LABELLED = 0.005  # of what a scale spans, to which its labels are exact
_UM = 1e3


@dataclass(frozen=True, eq=False)
class Scale:
    """What the colours stand for.

    Attributes:
        title: of the quantity.
        unit: of the quantity.
        low, high: its values at the first and the last colour.
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

    def share(self, values: Floats) -> Floats:
        """Return how far from low to high values are, 0 to 1."""
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)

    def labels(self) -> tuple[str, str, str]:
        """Return the lowest, middle and highest value as text, with as few digits as say each to half a percent.

        The percent is of what the scale spans. A sign before the first or the last says that there are values beyond.
        """
        values = (self.low, 0.5 * (self.low + self.high), self.high)
        near = _LABELLED * (self.high - self.low)
        digits = next(d for d in itertools.count() if all(abs(float(f"{v:.{d}f}") - v) <= near for v in values))
        low, middle, high = (f"{value:.{digits}f}" for value in values)
        return f"≤ {low}" if self.below else low, middle, f"≥ {high}" if self.above else high


def scale_for(colour: str, runs: Sequence[Run], bead: BeadSettings | None = None) -> Scale | None:
    """Return one scale for the beads of several runs.

    The error's begins at 0 and spans all but the rarest values; the width's has its middle at the first run's nominal
    width, where that is known, and spans what is usual, so that a blob at a stop does not take the colours from the
    rest.

    Args:
        colour: one of `COLOURS`.
        runs: to be coloured.
        bead: how the glue lies.

    Returns:
        None where the beads are plain.

    Raises:
        InputError: no such colour.
    """
    if colour not in COLOURS:
        raise unknown("colour", colour, COLOURS)
    if colour == "plain":
        return None
    strands = [Strand(run, bead, stations=_STATIONS) for run in runs]
    laid = [values_along(colour, strand)[strand.area > 0] for strand in strands]
    values = np.concatenate(laid) if any(part.size for part in laid) else np.zeros(1)
    usual = np.percentile(values, _USUAL[colour])
    if colour == "error":
        low, high = 0.0, _rounded_up(max(float(usual[1]), _LEAST_ERROR))
        title, unit, name, part = "contour error", "µm", "viridis", (0.22, 1.0)
    else:
        nominal = float(strands[0].nominal_section.width[0]) or float(np.median(values)) or 1.0  # without glue
        reach = min(_rounded_up(max(float(np.abs(usual - nominal).max()), _LEAST_WIDTH * nominal)), nominal)
        low, high = nominal - reach, nominal + reach
        title, unit, name, part = "width of the bead", "mm", "coolwarm", (0.0, 1.0)
    return Scale(title, unit, low, high, bool(values.min() < low), bool(values.max() > high), _table(name, *part))


def values_along(colour: str, strand: Strand) -> Floats:
    """Return what colours the bead at its stations, (r,): its width [mm], or the contour error there [µm].

    The contour error is known while the dispenser is on; beyond it is that at the end.
    """
    if colour == "width":
        return strand.width
    run = strand.run
    if not run.dispense.any():
        return np.zeros(strand.place.size)
    analysis: Analysis = strand.analysis
    ticks = np.arange(len(run.time), dtype=np.float64)
    return strand.along(_UM * np.interp(ticks, analysis.ticks, analysis.nozzle.distance))


def _rounded_up(value: float) -> float:
    """Return a value rounded up to two digits."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(math.ceil(value / digit - 1e-9) * digit)


def _table(name: str, first: float, last: float) -> NDArray[np.uint8]:
    from matplotlib import colormaps  # slow to import, and needed for coloured beads alone

    shades: NDArray[np.float64] = colormaps[name](np.linspace(first, last, _SHADES))
    return np.round(255 * shades[:, :3]).astype(np.uint8)
