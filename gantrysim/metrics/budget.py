"""The error budget: where on the chain the nozzle's error normal to the requested path lies.

With e(q) the offset of a point q from its foot on the requested path, in the path's frame there,

    e(nozzle) = e(commanded)                         program
              + e(encoder) - e(commanded)            servo
              + e(motor) - e(encoder)                encoder
              + e(geometric) - e(motor)              geometry
              + e(nozzle) - e(geometric)             structure

where encoder and motor positions are those of the nozzle of a rigid machine, and geometric ones those of a rigid
machine with errors of its geometry at the motors' positions; a run without these has no such link, and its structure
begins at the motor. The parts add up exactly at every tick.
Each is the difference of two traces and says where the error lies, not what caused it: structure is the motion of the
nozzle relative to the motor, and may be shaken by encoder counts that pass through the servo's kd. Causes are found by
switching them off, see `gantrysim.job.causes`.
Every point has its own foot, so that a lag along the path is no error normal to it: to first order a part is the
displacement of its link along the normal n, as for servo

    e(encoder) - e(commanded) = (encoder - commanded).n + r

with a remainder r of second order, kappa l^2 / 2 for a lag l and a path of curvature kappa. The offset is normal to the
path, at corners too, about which the path's frame turns with it (`gantrysim.paths.corners`); where the foot is an end
of the path, or a corner at which the path nearly retraces itself, it has a part along the tangent. So the size of
e(nozzle) is the distance from the path everywhere. What changing legs at such a corner adds is a part of its own and
belongs to no link (`gantrysim.metrics.parts`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, at_rows, dot, lengths
from gantrysim.base.columns import blocks, by_blocks, table_by_blocks
from gantrysim.base.display import table_html
from gantrysim.base.extras import pandas_frame
from gantrysim.metrics.analysis import Analysis, ErrorSize, ErrorSpread
from gantrysim.metrics.parts import (
    CORNER,
    ERROR,
    PART_COLUMNS,
    BudgetValues,
    Part,
    PartValues,
    Trace,
    TurnValues,
    largest_link,
    links,
    offset_of,
)
from gantrysim.metrics.spacing import one_way
from gantrysim.record.run import Run

if TYPE_CHECKING:
    import pandas


# The servo part of the error by axis: whose following error moves the nozzle off the path.

_NO_MOTION = 1e-9  # shortest displacement that has a direction [mm]


class ForwardKinematics(Protocol):
    """Kinematics of a machine."""

    def tip(self, position: ArrayLike) -> Floats:
        """Return the nozzle in the work frame, (n, 3) [mm], at axis positions, (n, axes) [mm or deg]."""
        ...


def servo_by_axis(analysis: Analysis, servo: Part, machine: ForwardKinematics) -> dict[str, Part]:
    """Return each axis' contribution to the servo part, see `Budget.servo_by_axis`.

    Args:
        analysis: of the run.
        servo: part of the error between command and encoder.
        machine: the machine of the run.
    """
    run = analysis.run
    ticks = analysis.ticks

    @lru_cache(maxsize=1)  # a block's normals serve all axes
    def normals(first: int, last: int) -> tuple[Floats, Floats, Floats]:
        return _normals(analysis, servo, slice(first, last))

    def part(a: int, block: slice) -> Part:
        lateral, vertical, beyond = normals(block.start, block.stop)
        position = run.commanded[ticks[block]]
        position[:, a] = run.encoder[ticks[block], a]
        shift = machine.tip(position) - run.commanded_tip[ticks[block]]
        return Part(dot(shift, lateral), dot(shift, vertical), dot(shift, beyond))

    return {
        name: table_by_blocks((part(a, block) for block in blocks(ticks.size)), ticks.size)
        for a, name in enumerate(run.axes)
    }


def _normals(analysis: Analysis, servo: Part, block: slice) -> tuple[Floats, Floats, Floats]:
    """Return the directions along which a displacement counts as lateral, vertical and beyond, (n, 3) each."""
    run = analysis.run
    path = run.requested
    s = analysis.commanded.s[block]
    lateral = path.normal(s)
    vertical = np.cross(path.tangent(s), lateral)
    beyond = np.zeros_like(lateral)
    if not path.corners.size:
        return lateral, vertical, beyond
    # the frame turns between the feet of two points with a corner between them: no one normal fits both
    corner = path.legs.between(s, analysis.encoder.s[block])
    corner |= path.legs.between(s, analysis.nozzle.s[block])
    rows = np.flatnonzero(corner)
    corner_ticks = analysis.ticks[block][rows]
    displacement = run.encoder_tip[corner_ticks] - run.commanded_tip[corner_ticks]
    square = np.maximum(dot(displacement, displacement), _NO_MOTION**2)
    present = servo.at(block)
    for normal, component in ((lateral, present.lateral), (vertical, present.vertical), (beyond, present.beyond)):
        missing = component[rows] - dot(normal[rows], displacement)
        normal[rows] += (missing / square)[:, None] * displacement
    return lateral, vertical, beyond


# Checks of the errors of a run against distances alone, made in every run.
#
#     |point, path|   <=  |point before it in the chain, path| + l
#     |link|          <=  l + kappa l^2 / 2
#     |nozzle, path|  >=  distance to the nearest point of the whole path
#
# l is the distance of two neighbouring points of the chain from command to nozzle, kappa the curvature of the path at
# their feet. The first holds for feet that lie on one stretch of the path, and is broken by a foot that is lost; the
# budget itself then bounds the link, see `gantrysim.metrics.parts`, so that the second is broken by a wrong frame
# alone. Whatever the program and the machine, a run satisfies all three; one that does not has been measured wrongly,
# and neither its errors nor their causes are known.

_ROUNDING = 1e-6  # of distances and links [mm]
_SEARCHED_PLACES = 256  # at which the whole path is searched for a nearer point


def contradictions(analysis: Analysis, chain: list[Trace], links: dict[str, Part]) -> Iterator[str]:
    """Yield which of the three bounds a run breaks, each where it is broken most.

    Args:
        analysis: of the run.
        chain: the traces between which the links lie.
        links: the links between each trace and the next, by name.
    """
    run = analysis.run
    for block in blocks(analysis.ticks.size):
        for (before, after), (name, part) in zip(pairwise(chain), links.items(), strict=True):
            apart = lengths(after.at(block) - before.at(block))
            excess = np.abs(after.foot.distance[block] - before.foot.distance[block]) - apart
            what = f"the change of distance by the link {name}"
            yield from _worst(what, excess, "its two points are apart", analysis, block)
            excess = part.at(block).size - largest_link(before, after, block)
            yield from _worst(f"the link {name}", excess, "its two points are apart", analysis, block)
    distance = chain[-1].foot.distance
    rows = np.unique(np.append(np.linspace(0, distance.size - 1, _SEARCHED_PLACES).astype(np.intp), distance.argmax()))
    nearest = run.requested.project(at_rows(run.nozzle, analysis.ticks[rows])).distance
    excess = np.full(distance.size, -np.inf)
    excess[rows] = nearest - distance[rows]
    yield from _worst(
        "the distance of the nearest point of the path", excess, "the contour error", analysis, slice(0, distance.size)
    )


def _worst(what: str, excess: Floats, bound: str, analysis: Analysis, block: slice) -> Iterator[str]:
    k = int(excess.argmax())
    if excess[k] > _ROUNDING:
        time = float(analysis.run.time[analysis.ticks[block][k]])
        yield f"{what} is {1e3 * excess[k]:.3g} µm larger than {bound} at t = {time:.3f} s"


# the links of the chain in their order; DESCRIPTIONS also has their sum, the contour error
LINKS: tuple[str, ...] = ("program", "servo", "encoder", "structure")
GEOMETRY = "geometry"  # between encoder and structure, on a machine with errors of its geometry
DESCRIPTIONS: dict[str, str] = {
    "program": "requested path to commanded",
    "servo": "commanded to encoder",
    "encoder": "encoder to motor",
    GEOMETRY: "motor to true axes",
    "structure": "motor to nozzle",
    CORNER: "change of leg of the path",
    "contour": "requested path to nozzle",
}

_PERCENTILE = 95.0
_TURN_ROUNDING = 0.01  # of a turn
_NO_ERROR = 1e-9  # largest rms of mere rounding [mm]
_RMS, *_, _SHARE = PART_COLUMNS


def p95_of(size: Floats) -> float:
    """Return the size below which 95 % of the sizes lie."""
    return float(np.percentile(size, _PERCENTILE))


def links_of(run: Run) -> tuple[str, ...]:
    """Return the links of a run's chain in their order: `LINKS`, and where it has errors of geometry that link."""
    return LINKS if run.geometric_tip is None else (*LINKS[:-1], GEOMETRY, LINKS[-1])


class Stretch(NamedTuple):
    """Ticks in a row.

    Attributes:
        number: of the turn, from 1; 0 before the first turn, and one more than the last after it.
        name: "turn 1" and so on, "before" or "after".
        ticks: of the analysis.
    """

    number: int
    name: str
    ticks: slice


class Budget:
    """The error budget of a run while the dispenser is on; prints as a table of its links.

    Args:
        of: a run, or its analysis.

    Attributes:
        analysis: the analysis of the run.
    """

    def __init__(self, of: Run | Analysis) -> None:
        self.analysis = of if isinstance(of, Analysis) else Analysis(of)

    def __repr__(self) -> str:
        shares = ", ".join(f"{name} {_SHARE.text(part.share)}" for name, part in self.values.parts.items())
        return f"Budget(contour: {_RMS.text(self.values.contour.rms)} rms, {shares})"

    def _repr_html_(self) -> str:
        heads = ("link", *(column.head for column in PART_COLUMNS), "span")
        rows = [[name, *cells, DESCRIPTIONS[name]] for name, cells in self._cells()]
        return table_html("error normal to the requested path", heads, rows)

    def __str__(self) -> str:
        fault = "" if self.analysis.run.fault is None else ", until the fault"
        *sizes, share = (column.label for column in PART_COLUMNS)
        lines = [
            f"error normal to the requested path [{ERROR.unit}]{fault}",
            f"{'link':11} {' '.join(f'{size:>8}' for size in sizes)} {share:>9}",
        ]
        for name, (*sizes, share) in self._cells():
            numbers = " ".join(f"{size:>8}" for size in sizes)
            lines.append(f"{name:11} {numbers} {share:>7} {_SHARE.unit}  {DESCRIPTIONS[name]}")
        return "\n".join(lines)

    def _cells(self) -> Iterator[tuple[str, list[str]]]:
        for name, part in self.values.rows.items():
            yield name, [column.number(column.get(part)) for column in PART_COLUMNS]

    def to_frame(self) -> pandas.DataFrame:
        """Return a pandas DataFrame with a row per link, for corners if there are any, and for the contour error.

        Its columns are `PART_COLUMNS`: rms_um, p95_um, max_um and share_percent.

        Raises:
            InputError: pandas is not installed.
        """
        rows = self.values.rows
        columns = {column.key: [column.content(column.get(part)) for part in rows.values()] for column in PART_COLUMNS}
        return pandas_frame("Budget.to_frame", columns, index=list(rows))

    @cached_property
    def contour(self) -> Part:
        """The nozzle's error normal to the path."""
        return offset_of(self.analysis.nozzle)

    @cached_property
    def _contour_square(self) -> float:
        """Mean square of the contour error [mm²]."""
        return float(np.mean(self.contour.size**2))

    @cached_property
    def parts(self) -> dict[str, Part]:
        """Contribution of every link of `links_of`; together with `corner`, if any, they add up to `contour`."""
        return self._links[0]

    @property
    def corner(self) -> Part | None:
        """Contribution of changes of leg of the path, see `gantrysim.metrics.parts`; None if it is 0."""
        return self._links[1]

    @cached_property
    def _links(self) -> tuple[dict[str, Part], Part | None]:
        parts, corner = links(self.analysis.run.requested, self._chain)
        return dict(zip(links_of(self.analysis.run), parts, strict=True)), corner

    @cached_property
    def contradictions(self) -> tuple[str, ...]:
        """What contradicts the errors of this run; empty in a right one."""
        after_program = {name: part for name, part in self.parts.items() if name != "program"}
        return tuple(contradictions(self.analysis, self._chain, after_program))

    @cached_property
    def _chain(self) -> list[Trace]:
        analysis = self.analysis
        run = analysis.run
        chain = [
            Trace(analysis.commanded, run, "commanded_tip", analysis.ticks),
            Trace(analysis.encoder, run, "encoder_tip", analysis.ticks),
            Trace(analysis.motor, run, "motor_tip", analysis.ticks),
        ]
        if run.geometric_tip is not None:
            chain.append(Trace(analysis.geometric, run, "geometric_tip", analysis.ticks))
        chain.append(Trace(analysis.nozzle, run, "nozzle", analysis.ticks))
        return chain

    @property
    def lag(self) -> Floats:
        """Lag of the nozzle behind the command along the path, (m,) [mm].

        It is the difference between the arc lengths of their feet. If a corner lies between the feet, it is at most the
        distance between the two points, because inside a corner the foot jumps from one leg to the other.
        """
        run = self.analysis.run
        ticks = self.analysis.ticks
        commanded = self.analysis.commanded.s
        nozzle = self.analysis.nozzle.s
        path = run.requested
        if not path.corners.size:
            return commanded - nozzle

        def lag(block: slice) -> Floats:
            along = commanded[block] - nozzle[block]
            rows = np.flatnonzero(path.legs.between(commanded[block], nozzle[block]))
            apart = run.commanded_tip[ticks[block][rows]] - run.nozzle[ticks[block][rows]]
            distance = np.linalg.norm(apart, axis=1)
            along[rows] = np.clip(along[rows], -distance, distance)
            return along

        return by_blocks(lag, ticks.size)

    @property
    def turn(self) -> NDArray[np.intp]:
        """Number of the turn at each tick, 0 for the first, -1 outside any turn, (m,).

        A turn is a full rotation of the tangent. On a path that turns both ways, turns are counted on the stretch that
        turns furthest in one direction. A remainder below a hundredth of a turn belongs to the last turn.
        """
        turned, (first, last) = self._turns_one_way()
        turn = np.full(self.analysis.ticks.size, -1)
        if turned.size:
            # in place: a long run has room for few arrays
            turned /= 2 * np.pi
            whole = np.ceil(turned[-1] - _TURN_ROUNDING)
            np.floor(turned, out=turned)
            turn[first:last] = np.clip(turned, 0, max(whole - 1, 0), out=turned)
        return turn

    def _turns_one_way(self) -> tuple[Floats, tuple[int, int]]:
        return one_way(self.analysis.heading, np.maximum.accumulate(self.analysis.nozzle.s))

    @cached_property
    def contour_values(self) -> PartValues:
        """The values of the contour error."""
        return self.values_of(self.contour)

    @cached_property
    def part_values(self) -> dict[str, PartValues]:
        """Values of the contribution of every link."""
        return {name: self.values_of(part) for name, part in self.parts.items()}

    @cached_property
    def lag_values(self) -> ErrorSpread:
        """The values of the lag."""
        return ErrorSpread.of(self.lag)

    @cached_property
    def values(self) -> BudgetValues:
        """The values of the budget."""
        return BudgetValues(
            parts=self.part_values,
            corner=None if self.corner is None else self.values_of(self.corner),
            contour=self.contour_values,
            lag=self.lag_values,
            turns=self._turns(),
        )

    def servo_by_axis(self, machine: ForwardKinematics) -> dict[str, Part]:
        """Return each axis' contribution to the servo error, to first order.

        It is the displacement of a rigid machine's nozzle along the path's normals when this axis alone moves from its
        commanded to its encoder position. The contributions add up to the servo error, except for second-order terms.
        If a corner lies between the feet of command, encoder and nozzle, the normals are corrected by the smallest
        amount with which the contributions add up there as well (Broyden's formula for a secant).

        Args:
            machine: the machine of the run.
        """
        return servo_by_axis(self.analysis, self.parts["servo"], machine)

    def values_of(self, part: Part) -> PartValues:
        """Return the values of a contribution to the error."""
        size = part.size
        mean = self._contour_square
        k = int(size.argmax())
        s = self.analysis.nozzle.s[k]
        x, y, z = self.analysis.run.requested.position(s)[0].tolist()
        return PartValues(
            rms=float(np.sqrt(np.mean(size**2))),
            p95=p95_of(size),
            max=float(size[k]),
            share=float(np.mean(part.dot(self.contour))) / mean if mean > _NO_ERROR**2 else 0.0,
            s=float(s),
            time=float(self.analysis.run.time[self.analysis.ticks[k]]),
            point=(x, y, z),
        )

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """Turns of a spiral and the stretches before and after them, which cover all ticks; empty without turns.

        A path is a spiral if one of its turns lies beside another.
        """
        turns = self.turn
        count = int(turns.max()) + 1
        if count < 2 or not self.analysis.spacing.distance.size:
            return ()
        # a stretch of ticks in the order of the turns
        inside = np.flatnonzero(turns >= 0)
        edges = inside[0] + np.searchsorted(turns[inside], np.arange(count + 1))
        edges = np.concatenate([[0], edges, [turns.size]])
        names = ["before", *(f"turn {number}" for number in range(1, count + 1)), "after"]
        stretches = [
            Stretch(number, names[number], slice(low, high))
            for number, (low, high) in enumerate(pairwise(edges.tolist()))
        ]
        return tuple(stretch for stretch in stretches if stretch.ticks.start < stretch.ticks.stop)

    def _turns(self) -> tuple[TurnValues, ...]:
        sizes: dict[str, list[ErrorSize]] = {}
        for name, part in {**self.parts, "contour": self.contour}.items():
            size = part.size
            sizes[name] = [ErrorSize.of(size[stretch.ticks]) for stretch in self.stretches]
        s = self.analysis.nozzle.s
        turns = []
        for k, stretch in enumerate(self.stretches):
            along = s[stretch.ticks]
            parts = {name: by_stretch[k] for name, by_stretch in sizes.items()}
            turns.append(TurnValues(stretch.number, stretch.name, (float(along.min()), float(along.max())), parts))
        return tuple(turns)
