"""How far the nozzle is from its command, by the place on the requested path.

The largest distances come where an axis turns round or begins to move, which are nearly the same places whatever the
program's speed and steps are. So the path is divided into parts of equal length, and each has the largest distance in
it, or so near to it that the foot of the nozzle, which lags, may lie there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gantrysim.base.arrays import Floats, at_rows, dot
from gantrysim.base.columns import by_blocks
from gantrysim.metrics.budget import Budget

PARTS = 256  # of a path
_LEAST = 0.3  # of the rms: a part that one program passes without a deviation may have one with another
_SAME_LENGTH = 1e-9  # of paths, relative


@dataclass(frozen=True)
class Deviation:
    """Distance of the nozzle from its command while the dispenser is on, in parts of the requested path.

    Attributes:
        length: of the requested path [mm].
        largest: distance in each part, (PARTS,); inf where it is unknown [mm].
    """

    length: float
    largest: Floats

    @classmethod
    def unknown(cls) -> Deviation:
        """Return the deviation of a run that a fault ended, or that has not been made."""
        return cls(math.nan, np.full(PARTS, math.inf))

    @classmethod
    def of(cls, budget: Budget) -> Deviation:
        """Return the deviation in a complete run."""
        analysis = budget.analysis
        run = analysis.run
        ticks = analysis.ticks

        def squares(block: slice) -> Floats:
            rows = ticks[block]
            apart = at_rows(run.nozzle, rows) - at_rows(run.commanded_tip, rows)
            return dot(apart, apart)

        square = by_blocks(squares, ticks.size)
        length = float(run.requested.length)
        largest = np.zeros(PARTS)
        np.maximum.at(largest, part_of(analysis.nozzle.s, length), square)
        largest = np.sqrt(largest)
        # the nozzle's foot is about as far from that of its command as the two are apart, at most
        reach = min(1 + int(largest.max() / length * PARTS), PARTS) if length > 0 else PARTS
        around = sliding_window_view(np.pad(largest, reach), 2 * reach + 1).max(axis=1)
        return cls(length, np.maximum(around, _LEAST * math.sqrt(float(square.mean()))))

    def on(self, length: float) -> Deviation:
        """Return the deviation on a path of this length [mm]; on another path, the places are not the same."""
        if abs(self.length - length) <= _SAME_LENGTH * length:
            return self
        return Deviation(length, np.full(PARTS, self.largest.max()))


def part_of(s: Floats, length: float) -> np.ndarray:
    """Return the number of the part in which each arc length lies, on a path of a length [mm]."""
    if length <= 0:
        return np.zeros(len(s), np.intp)
    return np.clip((s * (PARTS / length)).astype(np.intp), 0, PARTS - 1)


def largest_of(deviations: Iterable[Deviation], length: float) -> Floats:
    """Return the largest of some deviations in each part of a path of a length, (PARTS,) [mm]."""
    return np.max([deviation.on(length).largest for deviation in deviations], axis=0)
