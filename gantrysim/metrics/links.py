"""Links of the error budget: how far each moves the nozzle off the requested path.

The offset of a point from its foot, as components in the path's frame, changes nowhere faster than the point moves, on
smooth paths but for their curvature and at corners by `gantrysim.paths.corners`. So the difference of the
offsets of two neighbouring points of the chain is never larger than the displacement between them.

That holds where both feet are the nearest on a stretch of the path that joins them. A trace is followed in the order of
the motion, though, and where a path nearly retraces itself the feet of two points may lie on legs that no such stretch
joins: on the way there and on the way back. Then both points are measured from one leg, that of the later link, and
what is missing to the offset from the other leg is the corner's, not the link's.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, at_rows, lengths
from gantrysim.base.columns import blocks, table_by_blocks
from gantrysim.metrics.parts import Part, difference
from gantrysim.paths.corners import Components
from gantrysim.paths.path import Path, Projection

_NOTHING = 1e-13  # remainder that is rounding [mm]
_ROUNDING = 1e-9  # by which a difference of offsets may exceed a displacement [mm]


class Trace(NamedTuple):
    """Trace of one point of the chain while glue flows, such as the nozzle of a rigid machine at commanded positions.

    Attributes:
        foot: projection of the points onto the requested path, with m rows.
        points: in the work frame, at all ticks of the run, (n, 3) [mm].
        ticks: the ticks that count, (m,).
    """

    foot: Projection
    points: Floats
    ticks: NDArray[np.intp]

    def at(self, block: slice) -> Floats:
        """Return the points at some of the ticks that count."""
        return at_rows(self.points, self.ticks[block])


def links(path: Path, chain: list[Trace]) -> tuple[list[Part], Part | None]:
    """Return the part of the error that each link of a chain adds, and the part of the corners.

    Args:
        path: the requested path.
        chain: traces of the commanded position, of each that follows it, and of the nozzle.

    Returns:
        The offset of the first trace and the part of each link between two; and the part of corners at which the path
        nearly retraces itself, None where it is 0. All add up to the offset of the last trace.
    """
    if not path.corners.size:
        errors = [offset_of(trace.foot) for trace in chain]
        return [errors[0], *(difference(after, before) for before, after in pairwise(errors))], None
    rows = len(chain[0].foot.s)
    nozzle = chain[-1].foot
    begin = table_by_blocks((_carried(path, chain[0].foot, nozzle, block) for block in blocks(rows)), rows)
    parts = [begin]
    for before, after in pairwise(chain):
        link = (_link(path, before, after, nozzle, block) for block in blocks(rows))
        parts.append(table_by_blocks(link, rows))
    corner = table_by_blocks((_remainder(nozzle, parts, block) for block in blocks(rows)), rows)
    return parts, corner if corner.size.any() else None


def offset_of(foot: Projection) -> Part:
    """Return the offset of points from their feet."""
    columns = vars(foot)  # not the attributes: a long run's columns stay in the file that holds them
    return Part(columns["lateral"], columns["vertical"], columns["beyond"])


def _carried(path: Path, foot: Projection, target: Projection, block: slice) -> Part:
    """Return the offsets from some feet in the frame of the legs of other feet."""
    offset = Components(foot.lateral[block], foot.vertical[block], foot.beyond[block])
    carried = path.legs.carry(offset, foot.s[block], target.s[block])
    return Part(carried.lateral, carried.vertical, carried.beyond)


def _link(path: Path, before: Trace, after: Trace, nozzle: Projection, block: slice) -> Part:
    """Return the part of one link at some ticks, in the frame of the legs of the nozzle's feet."""
    part = _carried(path, after.foot, nozzle, block) - _carried(path, before.foot, nozzle, block)
    s_before = before.foot.s[block]
    s_after = after.foot.s[block]
    displacement = lengths(after.at(block) - before.at(block))
    too_large = part.size > displacement + _ROUNDING  # the two feet lie on legs that nearly retrace each other
    rows = np.flatnonzero(too_large & path.legs.between(s_before, s_after))
    if not rows.size:
        return part
    leg = path.legs.leg(s_after[rows])
    there = path.project_on_leg(after.at(block)[rows], leg)
    here = path.project_on_leg(before.at(block)[rows], leg)
    moved = Components(there.lateral - here.lateral, there.vertical - here.vertical, there.beyond - here.beyond)
    moved = path.legs.carry(moved, s_after[rows], nozzle.s[block][rows])
    part.lateral[rows] = moved.lateral
    part.vertical[rows] = moved.vertical
    part.beyond[rows] = moved.beyond
    return part


def _remainder(nozzle: Projection, parts: list[Part], block: slice) -> Part:
    """Return the nozzle's offset less some parts, exactly 0 where that is rounding."""
    remainder = offset_of(nozzle).at(block)
    for part in parts:
        remainder = remainder - part.at(block)
    rounding = remainder.size < _NOTHING
    for component in (remainder.lateral, remainder.vertical, remainder.beyond):
        component[rounding] = 0.0
    return remainder
