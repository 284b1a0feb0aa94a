"""Parts of the error normal to a path, by the links of the chain, and their values.

The offset of a point from its foot, as components in the path's frame, changes nowhere faster than the point moves, on
smooth paths but for their curvature and at corners by `gantrysim.paths.corners`. So the difference of the
offsets of two neighbouring points of the chain is never larger than the displacement between them.

That holds where the foot of a point between them moves on without a jump. Where it jumps from one leg to another that
lies on the other side of the points, as at a retrace, or to an end of the path, the link is the displacement itself, as
components in the frame at the foot of the later point, and what is missing to the offset of the nozzle is the change of
leg's, not the link's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, at_rows, dot, lengths
from gantrysim.base.columns import Column, blocks, by_blocks, table_by_blocks
from gantrysim.base.quantity import PARTS, SIZES, Quantity, contents
from gantrysim.metrics.analysis import ErrorSize, ErrorSpread
from gantrysim.paths.corners import Components
from gantrysim.paths.path import Path, Projection
from gantrysim.record.run import Run

CORNER = "corner"  # name of what belongs to no link

# columns of the error budget's table, of `PartValues`
ERROR = Quantity[Any](
    "",
    label="",
    unit="µm",
    form=".1f",
    meaning="Error normal to the requested path",
    path=(),
    factor=1e3,
    statistics=PARTS,
)
PART_COLUMNS: tuple[Quantity[PartValues], ...] = ERROR.numbers
PART_SIZES = PART_COLUMNS[:-1]  # without the share
ERROR_SIZES: tuple[Quantity[ErrorSize], ...] = replace(ERROR, statistics=SIZES).numbers  # of an `ErrorSize`
# where a part is largest
PART_PLACE = (
    Quantity["PartValues"](
        "s",
        label="at s",
        unit="mm",
        form=".1f",
        meaning="Arc length on the requested path at the largest magnitude",
        path=("s",),
    ),
    Quantity["PartValues"](
        "time", label="t", unit="s", form=".3f", meaning="Time of the largest magnitude", path=("time",)
    ),
)

_NOTHING = 1e-13  # remainder that is rounding [mm]
_ROUNDING = 1e-9  # by which a difference of offsets may exceed a displacement [mm]


@dataclass(frozen=True)
class Part:
    """A part of the error normal to the requested path, at the ticks of an analysis.

    Attributes:
        lateral: along the path's left normal, (m,) [mm].
        vertical: along the path's binormal, tangent x left normal; up on a level path, (m,) [mm].
        beyond: along the tangent, where the nearest point is an end of the path or a corner at which the path nearly
            retraces itself, (m,) [mm].
    """

    lateral: Column[Floats] = Column()
    vertical: Column[Floats] = Column()
    beyond: Column[Floats] = Column()

    @property
    def size(self) -> Floats:
        """Magnitude, (m,) [mm]."""
        return np.sqrt(self.dot(self))

    def at(self, rows: slice) -> Part:
        """Return the part at some of the ticks."""
        return Part(self.lateral[rows], self.vertical[rows], self.beyond[rows])

    def __sub__(self, other: Part) -> Part:
        return Part(self.lateral - other.lateral, self.vertical - other.vertical, self.beyond - other.beyond)

    def dot(self, other: Part) -> Floats:
        """Scalar product with another part, (m,) [mm²]."""

        def product(block: slice) -> Floats:
            a = self.at(block)
            b = other.at(block)
            return a.lateral * b.lateral + a.vertical * b.vertical + a.beyond * b.beyond

        return by_blocks(product, len(self.lateral))


@dataclass(frozen=True)
class PartValues:
    """Size of a part of the error, and where it is largest.

    Attributes:
        rms: root mean square of its magnitude [mm].
        p95: 95th percentile of its magnitude [mm].
        max: largest magnitude [mm].
        share: share of the contour error's mean square, <part.contour> / <contour.contour>. The links' shares add up to
            1; a negative one offsets others; without an error all are 0.
        s: arc length on the requested path at the largest magnitude [mm].
        time: time of the largest magnitude [s].
        point: point of the requested path there, (x, y, z) [mm].
    """

    rms: float
    p95: float
    max: float
    share: float
    s: float
    time: float
    point: tuple[float, float, float]

    def content(self) -> dict[str, Any]:
        """Return the values for JSON, by the keys of `PART_COLUMNS` and `PART_PLACE`."""
        place = {**contents(PART_PLACE, self), "point_mm": list(self.point)}
        return {**contents(PART_COLUMNS, self), "at_max": place}


@dataclass(frozen=True)
class TurnValues:
    """The errors within one turn of a spiral, or before its first or after its last.

    Attributes:
        turn: number of the turn, from 1; 0 before the first turn, and one more than the last after it.
        name: "turn 1" and so on, "before" or "after".
        s: arc length on the requested path at its first and last tick [mm].
        parts: size of every link's part, and of the whole as "contour" [mm].
    """

    turn: int
    name: str
    s: tuple[float, float]
    parts: dict[str, ErrorSize]


@dataclass(frozen=True)
class BudgetValues:
    """The values of a budget.

    Attributes:
        parts: the part of every link, in the order of the chain.
        corner: what changing legs of the path adds, None where that is nothing; see `gantrysim.metrics.parts`.
        contour: the whole error normal to the path, the sum of all these.
        lag: lag of the nozzle behind the command along the path [mm].
        turns: the errors within each turn of a spiral, and before and after them; empty for a path without turns.
    """

    parts: dict[str, PartValues]
    corner: PartValues | None
    contour: PartValues
    lag: ErrorSpread
    turns: tuple[TurnValues, ...]

    @property
    def rows(self) -> dict[str, PartValues]:
        """The rows of the budget's table: the parts by their links, the corners' where there is one, and the whole."""
        corner = {} if self.corner is None else {CORNER: self.corner}
        return {**self.parts, **corner, "contour": self.contour}


class Trace(NamedTuple):
    """Trace of one point of the chain while glue flows, such as the nozzle of a rigid machine at commanded positions.

    Attributes:
        foot: projection of the points onto the requested path, with m rows.
        run: the run.
        name: of the run's column with the points, in the work frame, (n, 3) [mm].
        ticks: the ticks that count, (m,).
    """

    foot: Projection
    run: Run
    name: str
    ticks: NDArray[np.intp]

    def at(self, block: slice) -> Floats:
        """Return the points at some of the ticks that count."""
        return at_rows(getattr(self.run, self.name), self.ticks[block])


def links(path: Path, chain: list[Trace]) -> tuple[list[Part], Part | None]:
    """Return the part of the error that each link of a chain adds, and the part of changes of leg.

    Args:
        path: the requested path.
        chain: traces of the commanded position, of each that follows it, and of the nozzle.

    Returns:
        The offset of the first trace and the part of each link between two; and the part of changes of leg, None where
        it is 0. All add up to the offset of the last trace.
    """
    rows = len(chain[0].foot.s)
    nozzle = chain[-1].foot
    begin = table_by_blocks((_carried_offsets(path, chain[0].foot, nozzle, block) for block in blocks(rows)), rows)
    parts = [begin]
    for before, after in pairwise(chain):
        link = (_link(path, before, after, nozzle, block) for block in blocks(rows))
        parts.append(table_by_blocks(link, rows))
    corner = table_by_blocks((_remainder(nozzle, parts, block) for block in blocks(rows)), rows)
    return parts, corner if corner.size.any() else None


def offset_of(foot: Projection) -> Part:
    """Return the offset of points from their feet."""
    # not the attributes: a long run's columns stay in the file that holds them
    columns = vars(foot)
    return Part(columns["lateral"], columns["vertical"], columns["beyond"])


def largest_link(before: Trace, after: Trace, block: slice) -> Floats:
    """Return how large the link between two traces can be: their distance, and its part by curvature, (n,) [mm]."""
    apart = lengths(after.at(block) - before.at(block))
    bend = np.maximum(*(np.abs(trace.foot.turning[block]) for trace in (before, after)))
    return apart + 0.5 * bend * apart**2


def _carried_offsets(path: Path, foot: Projection, target: Projection, block: slice) -> Part:
    """Return the offsets from some feet in the frame of the legs of other feet."""
    offset = Components(foot.lateral[block], foot.vertical[block], foot.beyond[block])
    if path.corners.size:
        offset = path.legs.carry(offset, foot.s[block], target.s[block])
    return Part(offset.lateral, offset.vertical, offset.beyond)


def _link(path: Path, before: Trace, after: Trace, nozzle: Projection, block: slice) -> Part:
    """Return the part of one link at some ticks, in the frame of the legs of the nozzle's feet."""
    part = _carried_offsets(path, after.foot, nozzle, block) - _carried_offsets(path, before.foot, nozzle, block)
    too_large = part.size > largest_link(before, after, block) + _ROUNDING
    rows = np.flatnonzero(too_large)
    if not rows.size:
        return part
    s = after.foot.s[block][rows]
    displacement = (after.at(block) - before.at(block))[rows]
    normal = path.normal(s)
    along = np.zeros(rows.size)
    moved = Components(dot(displacement, normal), dot(displacement, np.cross(path.tangent(s), normal)), along)
    if path.corners.size:
        moved = path.legs.carry(moved, s, nozzle.s[block][rows])
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
