"""The error budget: which link of the chain caused which part of the nozzle's error normal to the requested path.

With e(q) the error of a point q, its offset from its foot c on the requested path, normal to the path there, the links
of the chain stand one behind the other at every tick:

    e(nozzle) = e(commanded)                         generation: the controller's program
              + e(encoder) - e(commanded)            tracking: the servo
              + e(motor) - e(encoder)                measurement: the encoder's counts
              + e(nozzle) - e(motor)                 structure: everything behind the motor

each as the rigid machine would put the nozzle there. The parts add up exactly, sample by sample. Every e is taken to
its own foot, so that a lag along the path is no error normal to it: to first order a part is the displacement of its
link along the normal n, as for tracking

    e(encoder) - e(commanded) = (encoder - commanded).n + r,

and the remainder r is of second order, kappa l^2 / 2 with the lag l and the path's curvature kappa, and smaller by an
order where the normal of the error itself turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats, dot
from gantrysim.controllers.paths.path import Projection
from gantrysim.machine.machine import Machine
from gantrysim.metrics.analysis import Analysis, ErrorSize
from gantrysim.metrics.spacing import one_way
from gantrysim.run import Run

LINKS = ("generation", "tracking", "measurement", "structure")

_PERCENTILE = 95.0
_REST = 0.01  # of a turn
_NO_ERROR = 1e-9  # rms of what is rounding only [mm]


@dataclass(frozen=True)
class Part:
    """A part of the error normal to the requested path, at the ticks of an analysis.

    Attributes:
        lateral: along the path's left normal, (m,) [mm].
        vertical: along the path's binormal, tangent x left normal, which is up on a level path, (m,) [mm].
    """

    lateral: Floats
    vertical: Floats

    @property
    def size(self) -> Floats:
        """Magnitude, (m,) [mm]."""
        return np.hypot(self.lateral, self.vertical)

    def __sub__(self, other: Part) -> Part:
        return Part(self.lateral - other.lateral, self.vertical - other.vertical)


@dataclass(frozen=True)
class PartValues:
    """AnalysisValues of a part of the error.

    Attributes:
        rms: root mean square of its magnitude [mm].
        p95: magnitude that 95 % of the ticks do not exceed [mm].
        max: largest magnitude [mm].
        share: of the contour error's mean square, <part.contour> / <contour.contour>: the shares of all links add up to
            1, that of a link which makes good for others is negative, and all are 0 where there is no error.
        s: arc length on the requested path where it is largest [mm].
        time: at which it is [s].
        point: of the requested path there, (x, y, z) [mm].
    """

    rms: float
    p95: float
    max: float
    share: float
    s: float
    time: float
    point: tuple[float, float, float]


@dataclass(frozen=True)
class TurnValues:
    """AnalysisValues of one turn.

    Attributes:
        turn: 1 for the first.
        s: arc length on the requested path at its first and last tick [mm].
        parts: rms and largest magnitude by link, and of the whole under "contour" [mm].
    """

    turn: int
    s: tuple[float, float]
    parts: dict[str, ErrorSize]


@dataclass(frozen=True)
class BudgetValues:
    """The figures of a budget.

    Attributes:
        parts: by link, in the order of the chain.
        contour: of the whole error normal to the path, the sum of the parts.
        lag: along the path, commanded to nozzle; positive where the nozzle is behind [mm].
        turns: by turn, for a path of more than one.
    """

    parts: dict[str, PartValues]
    contour: PartValues
    lag: ErrorSize
    turns: tuple[TurnValues, ...]


class Budget:
    """The error budget of a run, tick by tick, while the dispenser is on.

    Args:
        of: the run, or its analysis where there is one.

    Attributes:
        analysis: of the run.
    """

    def __init__(self, of: Run | Analysis) -> None:
        self.analysis = of if isinstance(of, Analysis) else Analysis(of)

    @cached_property
    def contour(self) -> Part:
        """The nozzle's error normal to the path."""
        return _normal(self.analysis.nozzle)

    @cached_property
    def parts(self) -> dict[str, Part]:
        """The part of every link, by its name in `LINKS`, which add up to `contour`."""
        chain = (self.analysis.commanded, self.analysis.encoder, self.analysis.motor)
        errors = [*(_normal(foot) for foot in chain), self.contour]
        links = [errors[0], *(after - before for before, after in pairwise(errors))]
        return dict(zip(LINKS, links, strict=True))

    @cached_property
    def lag(self) -> Floats:
        """How far the nozzle is behind the command along the path, (m,) [mm]."""
        return self.analysis.commanded.s - self.analysis.nozzle.s

    @cached_property
    def turn(self) -> NDArray[np.intp]:
        """Turn of the path's tangent that the nozzle is in, 0 for the first, (m,); -1 where it is in none.

        Of a path that turns now left, now right turns are counted on the stretch that turns furthest one way. What is
        left of it after its whole turns, a hundredth of one, belongs to the last.
        """
        foot = np.maximum.accumulate(self.analysis.nozzle.s)
        turned, (first, last) = one_way(self.analysis.run.requested.heading(foot), foot)
        turn = np.full(foot.size, -1)
        if turned.size:
            whole = np.ceil(turned[-1] / (2 * np.pi) - _REST)
            turn[first:last] = np.clip(np.floor(turned / (2 * np.pi)), 0, max(whole - 1, 0))
        return turn

    @cached_property
    def values(self) -> BudgetValues:
        """The figures of the budget."""
        return BudgetValues(
            parts={name: self.values_of(part) for name, part in self.parts.items()},
            contour=self.values_of(self.contour),
            lag=ErrorSize.of(self.lag),
            turns=self._turns(),
        )

    def tracking_by_axis(self, machine: Machine) -> dict[str, Part]:
        """Return what each axis' following error makes of the tracking part, to first order.

        It is the way the nozzle of a rigid machine makes along the path's normals where this axis alone is moved from
        its commanded to its encoder's position. Their sum is the tracking part but for a remainder of second order.

        Args:
            machine: that ran.
        """
        run, on, foot = self.analysis.run, self.analysis.ticks, self.analysis.commanded
        normal = run.requested.normal(foot.s)
        binormal = np.cross(run.requested.tangent(foot.s), normal)
        parts = {}
        for a, name in enumerate(run.axes):
            position = run.commanded[on]
            position[:, a] = run.encoder[on, a]
            shift = machine.tip(position) - run.commanded_tip[on]
            parts[name] = Part(dot(shift, normal), dot(shift, binormal))
        return parts

    def values_of(self, part: Part) -> PartValues:
        """Return the figures of a part of the error.

        Args:
            part: one of `parts`, or of a link's own.
        """
        size, whole = part.size, self.contour
        product = part.lateral * whole.lateral + part.vertical * whole.vertical
        mean, none = float(np.mean(whole.size**2)), _NO_ERROR**2
        k = int(size.argmax())
        s = self.analysis.nozzle.s[k]
        x, y, z = self.analysis.run.requested.position(s)[0].tolist()
        return PartValues(
            rms=float(np.sqrt(np.mean(size**2))),
            p95=float(np.percentile(size, _PERCENTILE)),
            max=float(size[k]),
            share=float(np.mean(product)) / mean if mean > none else 0.0,
            s=float(s),
            time=float(self.analysis.run.time[self.analysis.ticks[k]]),
            point=(x, y, z),
        )

    def _turns(self) -> tuple[TurnValues, ...]:
        if self.turn.max() < 1:
            return ()
        sizes = {name: part.size for name, part in {**self.parts, "contour": self.contour}.items()}
        figures = []
        for turn in range(self.turn.max() + 1):
            here = np.flatnonzero(self.turn == turn)
            s = self.analysis.nozzle.s[here]
            parts = {name: ErrorSize.of(size[here]) for name, size in sizes.items()}
            figures.append(TurnValues(turn + 1, (float(s.min()), float(s.max())), parts))
        return tuple(figures)


def _normal(foot: Projection) -> Part:
    return Part(foot.lateral, foot.vertical)
