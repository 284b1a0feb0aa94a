"""Spreading of surplus glue along the trace."""

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats


def spread(area: Floats, steady: float, width: float, ds: float, *, longest: float) -> Floats:
    """Spread the surplus of a section over a steady one along the trace, as far as it is wide, (r,) [mm²].

    What is wider than one, two, four ... steady widths spreads over as much, one after the other: the height of a bead
    is bounded by the nozzle, so that its section grows with its width.

    Args:
        area: section at the stations, (r,) [mm²].
        steady: section above which glue spreads [mm²].
        width: of the steady section [mm].
        ds: distance of the stations [mm].
        longest: width from which nothing spreads further [mm].
    """
    limit = steady
    slope = steady / width
    while (excess := np.maximum(area - limit, 0.0)).any() and width < longest:
        area = np.minimum(area, limit) + _averaged(excess, int(np.ceil(0.5 * width / ds)))
        width *= 2
        limit = width * slope
    return area


def _averaged(values: Floats, reach: int) -> Floats:
    """Moving average over `reach` to both sides, twice; mirrored at the ends, which conserves the sum."""
    for _ in range(2):
        sums = np.concatenate([[0.0], np.cumsum(np.pad(values, reach, mode="reflect"))])
        values = (sums[2 * reach + 1 :] - sums[: -2 * reach - 1]) / (2 * reach + 1)
    return np.maximum(values, 0.0)
