"""Notes on a program: cutter compensation without an offset, and where the motion stops although it need not."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gantrysim.controllers.fanuc.legs import PathLeg
from gantrysim.paths.chain import Chain


def notes_of(legs: Sequence[PathLeg], path: Chain, blend_time: float, acceleration: float) -> tuple[str, ...]:
    """Return the notes on the motions of a program.

    Args:
        legs: the motions.
        path: of all of them.
        blend_time: of the moving average [s].
        acceleration: of each axis [mm/s²].
    """
    moving = [leg for leg in legs if leg.piece is not None and not leg.rapid]
    idle = sum(leg.source.idle for leg in moving)
    halting = sum(leg.source.halting for leg in moving)
    zero_height = sum(leg.source.zero_height for leg in moving)
    notes = []
    if zero_height:
        notes.append(f"{zero_height} arcs with a third centre word of 0, as K0 in G17: without an effect on the path.")
    if idle:
        notes.append(
            f"{idle} motions in G41 or G42 have no D or an offset of 0: they follow the programmed path (offsets)."
        )
    if math.isinf(acceleration) and not blend_time:
        return tuple(notes)
    if halting:
        notes.append(
            f"{halting} motions in G64 stop at their end, as G05.1 Q1 or G08 P1, which the program uses, is off."
        )
    return (*notes, *(() if blend_time else _stops(legs, path, acceleration)))


def _stops(legs: Sequence[PathLeg], path: Chain, acceleration: float) -> tuple[str, ...]:
    """Return the note on corners at which motions stop, where they are too short to reach their feed or in G64."""
    lengths = np.diff(path.ends, prepend=0.0)
    pieces = iter(range(lengths.size))
    index = [next(pieces) if leg.piece is not None else -1 for leg in legs]  # of the path's pieces; -1 for a stop
    corners = set(np.searchsorted(path.ends, path.corners - 1e-9).tolist())
    halts = [
        (leg, float(lengths[k]))
        for leg, k, after, last in zip(legs, index, legs[1:], index[1:], strict=False)
        if k in corners and last >= 0 and not (leg.rapid or after.rapid or leg.spiral or after.spiral)
        if not leg.exact_stop
    ]
    # from rest to the feed and back takes the length v^2 / a
    short = [length for leg, length in halts if length < leg.feed**2 / acceleration]
    if short:
        return (
            f"{len(short)} stops at corners after motions too short to reach their feed, {np.median(short):.3g} mm "
            "long at the median; blend_time = 0.05 passes them without a stop.",
        )
    if any(leg.source.continuous for leg, _ in halts):
        return (f"{len(halts)} stops at corners in G64, as blend_time is 0; blend_time = 0.05 passes them.",)
    return ()
