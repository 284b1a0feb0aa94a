"""Lengths of the nozzle's trace, and sums along it."""

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import by_blocks
from gantrysim.record.run import Run


def cumulated(values: Floats) -> Floats:
    """Return the sums of the first values, of none to all of them, (n + 1,)."""
    sums = np.empty(len(values) + 1)
    sums[0] = 0.0
    np.cumsum(values, out=sums[1:])
    return sums


def surface_steps(run: Run) -> Floats:
    """Length of the nozzle's trace from each tick to the next along the surface, (n - 1,) [mm].

    A nozzle that moves steeper than 45 deg leaves the surface or approaches it: only its motion in plan view counts,
    so that glue which flows meanwhile lies on the spot.
    """

    def steps(block: slice) -> Floats:
        step = np.diff(run.nozzle[block.start : block.stop + 1], axis=0)  # a long run's is mapped anew
        ahead = np.hypot(step[:, 0], step[:, 1])
        return np.where(np.abs(step[:, 2]) > ahead, ahead, np.hypot(ahead, step[:, 2]))

    return by_blocks(steps, len(run.time) - 1)
