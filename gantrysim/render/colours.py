"""Colours of a bead: its share of the path's tolerance, its width, or whichever of these is judged worse."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, unknown
from gantrysim.base.quantity import UM
from gantrysim.glue.bead.trace import BeadSettings, BeadTrace
from gantrysim.job.tolerance import Tolerance
from gantrysim.record.run import Run
from gantrysim.results.colours import MAGNITUDE, SHARE, WIDTH, ColourScale
from gantrysim.results.glue import GLUE
from gantrysim.results.verdict import Verdict

PLAIN = "plain"
VERDICT = "verdict"
BY_WIDTH = "width"
BY_ERROR = "error"
COLOURS = (PLAIN, VERDICT, BY_WIDTH, BY_ERROR)

_ERROR_PERCENTILE = 99.5  # end of a scale of errors without a tolerance, which a peak at a corner must not stretch
_LEAST_ERROR = 1.0  # smallest span of such a scale [µm]
_LABEL_ERROR = 0.005  # rounding of labels, relative to the span


@dataclass(frozen=True, eq=False)
class Scale:
    """A colour scale.

    Attributes:
        title: name of the quantity.
        unit: of the quantity.
        low, high: values at the first and the last colour.
        below, above: whether there are values beyond these; they have the first or the last colour.
        colours: from low to high.
    """

    title: str
    unit: str
    low: float
    high: float
    below: bool
    above: bool
    colours: ColourScale

    @property
    def table(self) -> NDArray[np.uint8]:
        """Colours at even places from low to high, (256, 3), 0 to 255."""
        return self.colours.table()

    @property
    def short_title(self) -> str:
        """Last word of the title."""
        return self.title.split()[-1]

    def share(self, values: Floats) -> Floats:
        """Return the places of values on the scale, 0 at low to 1 at high."""
        colours = self.colours
        share = (values - self.low) / (self.high - self.low)
        return colours.places(colours.low + share * (colours.high - colours.low))

    @property
    def label_places(self) -> tuple[float, float, float]:
        """Places of the labels on the scale: its ends, and the tolerance, the nominal width or the middle."""
        return (0.0, float(self.colours.places(np.array(self.colours.middle))), 1.0)

    def labels(self) -> tuple[str, str, str]:
        """Return the values at `label_places` as text, with the digits that half a percent of the span needs.

        A sign before the first or the last marks values beyond it.
        """
        colours = self.colours
        span = self.high - self.low
        middle = self.low + span * (colours.middle - colours.low) / (colours.high - colours.low)
        values = (self.low, middle, self.high)
        for digits in itertools.count():
            texts = [f"{value:.{digits}f}" for value in values]
            away = (abs(float(text) - value) for text, value in zip(texts, values, strict=True))
            if all(distance <= _LABEL_ERROR * span for distance in away):
                break
        low, text, high = texts
        if self.below:
            low = f"≤ {low}"
        if self.above:
            high = f"≥ {high}"
        return low, text, high


def scale_for(
    colour: str,
    runs: Sequence[Run],
    beads: Sequence[BeadSettings | BeadTrace | None] | None = None,
    verdict: Verdict | None = None,
) -> Scale | None:
    """Return one colour scale for the beads of several runs, or None for plain beads.

    Its tolerance and nominal width are those of the first run. The contour error is coloured up to ten tolerances, the
    width up to three on either side of the nominal one. Without a job or a rig there is no tolerance: the scale ends
    at the 99.5th percentile.

    Args:
        colour: "width", "error" or "plain".
        runs: the runs to be coloured.
        beads: bead settings of each run, or the beads themselves.
        verdict: on the first run, which tells for which limit its path fails.

    Raises:
        InputError: no such colour.
    """
    if colour not in (PLAIN, BY_WIDTH, BY_ERROR):
        raise unknown("colour", colour, COLOURS)
    if colour == PLAIN:
        return None
    settings = beads or [None] * len(runs)
    traces = [BeadTrace.of(run, bead) for run, bead in zip(runs, settings, strict=True)]
    values = np.concatenate([values_along(colour, trace) for trace in traces])
    first = runs[0]
    nominal = float(traces[0].nominal_section.width[0]) or float(np.median(values)) or 1.0  # or no glue
    if colour == BY_WIDTH:
        share = Tolerance.bead_width if first.basis is None else first.basis.limits(first.face, nominal).bead_width
        reach = WIDTH.high * share / 100 * nominal
        return _scale("bead width", "mm", (nominal - reach, nominal + reach), values, WIDTH)
    if first.basis is not None:
        judged = None if verdict is None else verdict.path_limit
        largest = SHARE.high * UM * (judged or first.basis.limits(first.face).path_max)
        return _scale("contour error", "µm", (0.0, largest), values, SHARE)
    largest = float(np.percentile(values, _ERROR_PERCENTILE))
    return _scale("contour error", "µm", (0.0, _rounded_up(max(largest, _LEAST_ERROR))), values, MAGNITUDE)


def _scale(title: str, unit: str, span: tuple[float, float], values: Floats, colours: ColourScale) -> Scale:
    """Return a scale over a span, which marks values beyond it."""
    low, high = span
    return Scale(title, unit, low, high, bool(values.min() < low), bool(values.max() > high), colours)


def chosen_colour(colour: str | None, runs: Sequence[Run], verdicts: Sequence[Verdict | None] | None = None) -> str:
    """Return the colour of beads: "verdict", or none given, is the width or the error, whichever is judged worse.

    Stability and machine have no place on a bead.

    Args:
        colour: one of `COLOURS`, or None.
        runs: the runs to be coloured.
        verdicts: on the runs; the worst one decides. By default those of the runs.

    Raises:
        InputError: a verdict on a run without a job or a rig, which has the tolerances.
    """
    if colour not in (None, VERDICT):
        return colour
    if colour == VERDICT and any(run.basis is None for run in runs):
        raise InputError("colour verdict: the run has no job and no rig, which give the tolerances: use error or width")
    known = [run.known_verdict for run in runs] if verdicts is None else verdicts
    rows = [verdict[verdict.shown_row] for verdict in known if verdict is not None and verdict.rows]
    worst = max(rows, key=lambda row: row.severity, default=None)
    return BY_WIDTH if worst is not None and worst.name == GLUE else BY_ERROR


def values_along(colour: str, bead_trace: BeadTrace) -> Floats:
    """Return what colours a bead at its stations, (r,): its width [mm], or its contour error [µm]."""
    return bead_trace.width if colour == BY_WIDTH else errors_along(bead_trace)


def errors_along(bead_trace: BeadTrace) -> Floats:
    """Return the contour error at the stations of a bead, (r,) [µm]; while the dispenser is off, the nearest one."""
    run = bead_trace.run
    if not run.dispense.any():
        return np.zeros(bead_trace.place.size)
    foot = bead_trace.analysis.nozzle
    return bead_trace.along(bead_trace.at_all_ticks(lambda rows: UM * foot.distance[rows]))


def _rounded_up(value: float) -> float:
    """Return a value rounded up to two digits."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(math.ceil(value / digit - 1e-9) * digit)
