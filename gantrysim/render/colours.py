"""What the colour of a bead tells: its width, or its contour error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.bead.sweep import Sweep
from gantrysim.bead.trace import BeadSettings, BeadTrace
from gantrysim.errors import unknown
from gantrysim.run import Run

COLOURS = ("plain", "width", "error")

_SHADES = 256
_USUAL = {"width": (5.0, 95.0), "error": (0.0, 99.5)}  # percentiles of the values, that a scale holds
_LEAST_ERROR = 1.0  # [µm], that a scale spans
_LEAST_WIDTH = 0.02  # of the nominal width, that a scale spans to either side
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


def scale_for(colour: str, runs: Sequence[Run], beads: Sequence[BeadSettings | None] | None = None) -> Scale | None:
    """Return one scale for the beads of several runs.

    The error's begins at 0 and spans all but the rarest values; the width's has its middle at the first run's nominal
    width, where that is known, and spans what is usual, so that a blob at a stop does not take the colours from the
    rest.

    Args:
        colour: one of `COLOURS`.
        runs: to be coloured.
        beads: how the glue of each lies.

    Returns:
        None where the beads are plain.

    Raises:
        InputError: no such colour.
    """
    if colour not in COLOURS:
        raise unknown("colour", colour, COLOURS)
    if colour == "plain":
        return None
    settings = [None] * len(runs) if beads is None else beads
    sweeps = [Sweep(run, bead) for run, bead in zip(runs, settings, strict=True)]
    values = np.concatenate([_values(colour, sweep) for sweep in sweeps])
    usual = np.percentile(values, _USUAL[colour])
    if colour == "error":
        low, high = 0.0, _rounded_up(max(float(usual[1]), _LEAST_ERROR))
        title, unit, name, part = "contour error", "µm", "viridis", (0.22, 1.0)
    else:
        nominal = (
            float(sweeps[0].bead_trace.nominal_section.width[0]) or float(np.median(values)) or 1.0
        )  # without glue
        reach = min(_rounded_up(max(float(np.abs(usual - nominal).max()), _LEAST_WIDTH * nominal)), nominal)
        low, high = nominal - reach, nominal + reach
        title, unit, name, part = "width of the bead", "mm", "coolwarm", (0.0, 1.0)
    return Scale(title, unit, low, high, bool(values.min() < low), bool(values.max() > high), _table(name, *part))


def errors_along(bead_trace: BeadTrace) -> Floats:
    """Return the contour error at the stations of a bead, (r,) [µm]; where the dispenser is off that about there."""
    run = bead_trace.run
    if not run.dispense.any():
        return np.zeros(bead_trace.place.size)
    ticks = np.arange(len(run.time), dtype=np.float64)
    return bead_trace.along(_UM * np.interp(ticks, bead_trace.analysis.ticks, bead_trace.analysis.nozzle.distance))


def _values(colour: str, sweep: Sweep) -> Floats:
    """Return what colours a whole bead at each place of its rings, (k,)."""
    mesh = sweep.mesh(len(sweep.bead_trace.run.time) - 1)
    _, first = np.unique(mesh.place, return_index=True)  # of the rings of an end, and of those that wait
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
