"""Whether a bead leaves a level plane, which decides how pictures show it."""

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import extent
from gantrysim.record.run import Run

LEVEL = 1.0  # climb up to which a bead is flat; it holds the sag of a table and the errors of a needle's height [mm]


def climb(heights: Floats) -> float:
    """Return the extent of heights of the nozzle with glue, (n,) [mm], 0 for none."""
    return float(np.ptp(heights)) if heights.size else 0.0


def leaves_plane(run: Run) -> bool:
    """Return whether the nozzle climbs by more than `LEVEL` in the work frame while it dispenses."""
    return extent(lambda block: run.nozzle[block, 2][run.dispense[block]], len(run.time)) > LEVEL
