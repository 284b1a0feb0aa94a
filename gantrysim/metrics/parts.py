"""Parts of the error normal to a path, and their values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import Column, by_blocks
from gantrysim.base.quantity import PARTS, SIZES, Quantity, contents
from gantrysim.metrics.analysis import ErrorSize, ErrorSpread

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
        corner: what changing legs of the path adds, None where that is nothing; see `gantrysim.metrics.links`.
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
