"""The error budget: where on the chain the nozzle's error normal to the requested path lies.

With e(q) the offset of a point q from its foot on the requested path, in the path's frame there,

    e(nozzle) = e(commanded)                         generation
              + e(encoder) - e(commanded)            tracking
              + e(motor) - e(encoder)                measurement
              + e(geometric) - e(motor)              geometry
              + e(nozzle) - e(geometric)             structure

where encoder and motor positions are those of the nozzle of a rigid machine, and geometric ones those of a rigid
machine with errors of its geometry at the motors' positions; a run without these has no such link, and its structure
begins at the motor. The parts add up exactly at every tick.
Each is the difference of two traces and says where the error lies, not what caused it: structure is the motion of the
nozzle relative to the motor, and may be shaken by encoder counts that pass through the servo's kd. Causes are found by
switching them off, see `gantrysim.job.causes`.
Every point has its own foot, so that a lag along the path is no error normal to it: to first order a part is the
displacement of its link along the normal n, as for tracking

    e(encoder) - e(commanded) = (encoder - commanded).n + r

with a remainder r of second order, kappa l^2 / 2 for a lag l and a path of curvature kappa. The offset is normal to the
path, but where the foot is an end of the path or a corner: there it has a part along the tangent, too, so that the size
of e(nozzle) is the distance from the path everywhere.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats, dot
from gantrysim.columns import blocks, by_blocks, table_by_blocks
from gantrysim.controllers.paths.path import Projection
from gantrysim.display import table_html
from gantrysim.metrics.analysis import Analysis, ErrorSize
from gantrysim.metrics.parts import BudgetValues, Part, PartValues, TurnValues, difference
from gantrysim.metrics.spacing import one_way
from gantrysim.run import Run

# the links of the chain in their order; DESCRIPTIONS also has their sum, the contour error
LINKS = ("generation", "tracking", "measurement", "structure")
GEOMETRY = "geometry"  # between measurement and structure, on a machine with errors of its geometry
DESCRIPTIONS = {
    "generation": "requested path to commanded",
    "tracking": "commanded to encoder",
    "measurement": "encoder to motor",
    GEOMETRY: "motor to true axes",
    "structure": "motor to nozzle",
    "contour": "requested path to nozzle",
}

_PERCENTILE = 95.0
_REST = 0.01  # of a turn
_NO_ERROR = 1e-9  # largest rms of mere rounding [mm]
_UM = 1e3


def links_of(run: Run) -> tuple[str, ...]:
    """Return the links of a run's chain in their order: `LINKS`, and where it has errors of geometry that link."""
    return LINKS if run.geometric_tip is None else (*LINKS[:-1], GEOMETRY, LINKS[-1])


class RigidMachine(Protocol):
    """Kinematics of a machine."""

    def tip(self, position: ArrayLike) -> Floats:
        """Return the nozzle in the work frame, (n, 3) [mm], at axis positions, (n, axes) [mm or deg]."""
        ...


class Budget:
    """The error budget of a run while the dispenser is on; printed, it is a table of its links.

    Args:
        of: a run, or its analysis.

    Attributes:
        analysis: the analysis of the run.
    """

    def __init__(self, of: Run | Analysis) -> None:
        self.analysis = of if isinstance(of, Analysis) else Analysis(of)

    def __repr__(self) -> str:
        shares = ", ".join(f"{name} {100 * part.share:z.1f} %" for name, part in self.values.parts.items())
        return f"Budget(contour: {_UM * self.values.contour.rms:.1f} µm rms, {shares})"

    def _repr_html_(self) -> str:
        heads = ("link", "rms", "95 %", "max", "share", "span")
        rows = [
            [
                name,
                *(f"{_UM * size:.1f}" for size in (part.rms, part.p95, part.max)),
                f"{100 * part.share:z.1f} %",
                DESCRIPTIONS[name],
            ]
            for name, part in {**self.values.parts, "contour": self.values.contour}.items()
        ]
        return table_html("error normal to the requested path [µm]", heads, rows)

    def __str__(self) -> str:
        fault = "" if self.analysis.run.fault is None else ", until the fault"
        rows = [f"{'link':11} {'rms':>8} {'95 %':>8} {'max':>8} {'share':>9}"]
        for name, part in {**self.values.parts, "contour": self.values.contour}.items():
            sizes = " ".join(f"{_UM * size:8.1f}" for size in (part.rms, part.p95, part.max))
            rows.append(f"{name:11} {sizes} {100 * part.share:z7.1f} %  {DESCRIPTIONS[name]}")
        return "\n".join([f"error normal to the requested path [µm]{fault}", *rows])

    @cached_property
    def contour(self) -> Part:
        """The nozzle's error normal to the path."""
        return _normal(self.analysis.nozzle)

    @cached_property
    def parts(self) -> dict[str, Part]:
        """The part of every link of `links_of`; they add up to `contour`."""
        names = links_of(self.analysis.run)
        chain = [self.analysis.commanded, self.analysis.encoder, self.analysis.motor]
        if GEOMETRY in names:
            chain.append(self.analysis.geometric)
        errors = [*(_normal(foot) for foot in chain), self.contour]
        links = [errors[0], *(difference(after, before) for before, after in pairwise(errors))]
        return dict(zip(names, links, strict=True))

    @property
    def lag(self) -> Floats:
        """Lag of the nozzle behind the command along the path, (m,) [mm]."""
        return self.analysis.commanded.s - self.analysis.nozzle.s

    @property
    def turn(self) -> NDArray[np.intp]:
        """Turn of the path's tangent at each tick, 0 for the first, -1 outside of any, (m,).

        On a path that turns both ways, turns are counted on the stretch that turns furthest one way. A rest below a
        hundredth of a turn belongs to the last one.
        """
        turned, (first, last) = self._turned()
        turn = np.full(self.analysis.ticks.size, -1)
        if turned.size:
            turned /= 2 * np.pi  # in place: a long run has room for few arrays
            whole = np.ceil(turned[-1] - _REST)
            np.floor(turned, out=turned)
            turn[first:last] = np.clip(turned, 0, max(whole - 1, 0), out=turned)
        return turn

    def _turned(self) -> tuple[Floats, tuple[int, int]]:
        foot = np.maximum.accumulate(self.analysis.nozzle.s)
        path = self.analysis.run.requested
        return one_way(by_blocks(lambda block: path.heading(foot[block]), foot.size), foot)

    @cached_property
    def values(self) -> BudgetValues:
        """The values of the budget."""
        return BudgetValues(
            parts={name: self.values_of(part) for name, part in self.parts.items()},
            contour=self.values_of(self.contour),
            lag=ErrorSize.of(self.lag),
            turns=self._turns(),
        )

    def tracking_by_axis(self, machine: RigidMachine) -> dict[str, Part]:
        """Return each axis' contribution to the tracking part, to first order.

        It is the displacement of a rigid machine's nozzle along the path's normals as this axis alone moves from its
        commanded to its encoder position. The contributions add up to the tracking part, but for second order.

        Args:
            machine: the machine of the run.
        """
        run, on, foot = self.analysis.run, self.analysis.ticks, self.analysis.commanded

        @lru_cache(maxsize=1)
        def frame(first: int, last: int) -> tuple[Floats, Floats]:
            """The path's normal and binormal at the feet of some ticks."""
            s = foot.s[first:last]
            normal = run.requested.normal(s)
            return normal, np.cross(run.requested.tangent(s), normal)

        def part(a: int, block: slice) -> Part:
            normal, binormal = frame(block.start, block.stop)
            position = run.commanded[on[block]]
            position[:, a] = run.encoder[on[block], a]
            shift = machine.tip(position) - run.commanded_tip[on[block]]
            return Part(dot(shift, normal), dot(shift, binormal), np.zeros(len(shift)))

        return {
            name: table_by_blocks((part(a, block) for block in blocks(on.size)), on.size)
            for a, name in enumerate(run.axes)
        }

    def values_of(self, part: Part) -> PartValues:
        """Return the values of a part of the error."""
        size, mean = part.size, float(np.mean(self.contour.size**2))
        k = int(size.argmax())
        s = self.analysis.nozzle.s[k]
        x, y, z = self.analysis.run.requested.position(s)[0].tolist()
        return PartValues(
            rms=float(np.sqrt(np.mean(size**2))),
            p95=float(np.percentile(size, _PERCENTILE)),
            max=float(size[k]),
            share=float(np.mean(part.dot(self.contour))) / mean if mean > _NO_ERROR**2 else 0.0,
            s=float(s),
            time=float(self.analysis.run.time[self.analysis.ticks[k]]),
            point=(x, y, z),
        )

    def _turns(self) -> tuple[TurnValues, ...]:
        turns = self.turn
        count = int(turns.max()) + 1
        if count < 2:
            return ()
        inside = np.flatnonzero(turns >= 0)  # a stretch of ticks in the order of the turns
        edges = inside[0] + np.searchsorted(turns[inside], np.arange(count + 1))
        del turns, inside
        stretches = [slice(low, high) for low, high in pairwise(edges.tolist())]
        sizes: dict[str, list[ErrorSize]] = {}
        for name, part in {**self.parts, "contour": self.contour}.items():
            size = part.size
            sizes[name] = [ErrorSize.of(size[here]) for here in stretches]
        s = self.analysis.nozzle.s
        return tuple(
            TurnValues(
                turn + 1,
                (float(s[here].min()), float(s[here].max())),
                {name: every[turn] for name, every in sizes.items()},
            )
            for turn, here in enumerate(stretches)
        )


def _normal(foot: Projection) -> Part:
    return Part(*(vars(foot)[name] for name in ("lateral", "vertical", "beyond")))  # in a file where they are
