"""What a run uses of its tolerances along the path: shares of the limits by stretch of the program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.controllers.speeds import Stretches
from gantrysim.glue.bead import Bead
from gantrysim.job.tolerance import Tolerance
from gantrysim.metrics.analysis import Analysis
from gantrysim.results.glue import BeadWidth

LARGEST, LEVEL, WIDTH, ENDS = range(4)
# powers of the speed with which these errors grow: the following error of a curve of the radius R is v² / (R k²); a
# valve that is late by t switches v t late, and a flow that lags by t marks v t of the bead
EXPONENTS = np.array([2.0, 2.0, 1.0, 1.0])
HALVES = 2

# share of a stretch's time below its level: the limit of 95 % is one of the whole path, and the reversal of an axis
# takes more than 5 % of the time of a short stretch
_LEVEL_SHARE = 80.0


@dataclass(frozen=True)
class LocalUsage:
    """Shares of the limits that a run uses by place.

    Attributes:
        shares: largest contour error, level of the contour error, width of the bead, starts and stops, in the halves of
            each stretch, 0 where nothing is judged, (4, m, 2).
        reached: fastest commanded speed in each stretch, 0 where no glue is laid, (m,) [mm/s].
    """

    shares: Floats
    reached: Floats

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Whether glue is laid in a stretch, (m,)."""
        return self.reached > 0


def local_usage(analysis: Analysis, bead: Bead, tolerance: Tolerance, stretches: Stretches) -> LocalUsage:
    """Return what a complete run uses of its tolerances by place."""
    count = stretches.ends.size
    shares = np.zeros((len(EXPONENTS), count * HALVES))
    contour = np.abs(analysis.nozzle.distance)
    half = _halves(stretches, analysis.nozzle.s)
    np.maximum.at(shares[LARGEST], half, contour / tolerance.path_max)
    shares[LEVEL] = np.repeat(_levels(contour, half // HALVES, count), HALVES) / tolerance.path_p95
    if bead.nominal > 0 and bead.total_volume > 0:
        width = BeadWidth(bead, tolerance)
        ticks = np.searchsorted(bead.length, bead.place[width.judged]).clip(0, bead.length.size - 1)
        error = np.abs(width.error[width.judged])
        np.maximum.at(shares[WIDTH], _halves(stretches, _feet(analysis, ticks)), error / tolerance.bead_width)
        opening, closing = bead.stretches.T
        stopped = closing[closing < len(bead.run.time)]
        missing = np.abs(bead.missing_at_starts) / tolerance.start_length
        excess = np.abs(bead.excess_at_stops) / tolerance.stop_length
        np.maximum.at(shares[ENDS], _halves(stretches, _feet(analysis, opening)), missing)
        np.maximum.at(shares[ENDS], _halves(stretches, _feet(analysis, stopped - 1)), excess)
    return LocalUsage(shares.reshape(len(EXPONENTS), count, HALVES), _reached_speeds(analysis, stretches))


def _halves(stretches: Stretches, s: Floats) -> NDArray[np.intp]:
    """Index of the half of a stretch at arc lengths of the requested path, (n,)."""
    index = stretches.at(s)
    middle = stretches.ends[index] - 0.5 * stretches.lengths[index]
    return HALVES * index + (s > middle)


def _levels(error: Floats, index: NDArray[np.intp], count: int) -> Floats:
    """Level of an error in each stretch, (count,)."""
    levels = np.zeros(count)
    order = np.argsort(index, kind="stable")
    begins = np.searchsorted(index[order], np.arange(count + 1))
    for k in range(count):
        here = error[order[begins[k] : begins[k + 1]]]
        if here.size:
            levels[k] = np.percentile(here, _LEVEL_SHARE)
    return levels


def _feet(analysis: Analysis, ticks: NDArray[np.intp]) -> Floats:
    """Arc lengths of the requested path of the nozzle at ticks, (n,) [mm]."""
    return analysis.nozzle.s[np.searchsorted(analysis.ticks, ticks).clip(0, analysis.ticks.size - 1)]


def _reached_speeds(analysis: Analysis, stretches: Stretches) -> Floats:
    speeds = np.zeros(stretches.ends.size)
    progress = analysis.progress
    following = np.diff(analysis.ticks) == 1
    steps = np.diff(progress)[following] / analysis.run.period
    np.maximum.at(speeds, stretches.at(progress[:-1][following]), steps)
    return speeds
