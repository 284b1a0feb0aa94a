"""The bead along the nozzle's trace: its cross-section from conservation.

With the glue's flow Q and the nozzle's speed v the section is A = Q / v; here it is the volume laid between two
places of the trace over the way between them, which is the same where the nozzle moves, and holds where it rests.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.bead.section import Section
from gantrysim.errors import InputError, at_least, finite, whole
from gantrysim.metrics.analysis import Analysis
from gantrysim.run import Run

_DISTANCE = 0.25  # of the stations [mm]
_STATIONS = (2, 400_000)
_LEAST = 1e-6  # [mm], of gap and cell
_LEAST_ANGLE = 1.0  # [deg], below which glue is a film without a shape
_STEADY, _MOSTLY = 0.1, 0.5  # of the median speed, and of the ticks up to a fault, for it to be that of the path
_SHORTEST = 1e-6  # [mm], of a trace that is no more than a dot
_LEAST_GAP = 0.05  # of the nominal one, for a nozzle that dips into the work


@dataclass(frozen=True)
class BeadSettings:
    """How the glue lies, and the grid on which it is looked at.

    Attributes:
        gap: height of the nozzle above the surface where it is on the requested path; None for the machine's [mm].
        contact_angle: of a drop on the surface, from 1 to 90 [deg].
        squashed: whether a bead that would stand higher than the nozzle stays squashed to the nozzle's height; else it
            relaxes to a sessile one behind it.
        cell: of the height map [mm].
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    gap: float | None = None
    contact_angle: float = 60.0
    squashed: bool = True
    cell: float = 0.25

    def __post_init__(self) -> None:
        if self.gap is not None:
            at_least("gap", self.gap, _LEAST, "mm")
        if not _LEAST_ANGLE <= finite("contact_angle", self.contact_angle, "deg") <= 90:
            raise InputError(
                f"contact_angle = {self.contact_angle:g} deg: must be at least {_LEAST_ANGLE:g} and at most 90 deg"
            )
        at_least("cell", self.cell, _LEAST, "mm")


class BeadTrace:
    """The bead of a run at stations evenly spaced along the nozzle's trace in the work frame.

    More than usual, as at a stop or in a slow corner, spreads along the trace as far as it is wide; volume is
    conserved: sum of area * ds, the first and the last station for half a length, is the volume laid. Of the trace
    alone there is no place before its start and after its end: what is laid at rest there spreads to one side, into a
    pear, not into a disc.

    Args:
        run: the run.
        settings: how the glue lies.
        analysis: of the run, where there is one.
        stations: their number; by default one every quarter of a millimetre.

    Attributes:
        run: the run.
        settings: how the glue lies.
        gap: the nozzle's height above the surface where it is on the requested path [mm].
        length: of the nozzle's trace along the surface up to each tick, (n,) [mm].
        place: of the stations along the trace, (r,) [mm].
    """

    def __init__(
        self,
        run: Run,
        settings: BeadSettings | None = None,
        analysis: Analysis | None = None,
        stations: int | None = None,
    ) -> None:
        self.run = run
        self.settings = BeadSettings() if settings is None else settings
        self.gap = run.gap if self.settings.gap is None else self.settings.gap
        self._analysis = analysis
        steps = surface_steps(run.nozzle)
        self.length: Floats = np.concatenate([[0.0], np.cumsum(steps)])
        total = max(float(self.length[-1]), _SHORTEST)
        count = (
            int(np.clip(np.ceil(total / _DISTANCE) + 1, *_STATIONS))
            if stations is None
            else whole("stations", stations, 2)
        )
        self.place: Floats = np.linspace(0.0, total, count)

    @cached_property
    def analysis(self) -> Analysis:
        """The run's traces held against its requested path."""
        return Analysis(self.run) if self._analysis is None else self._analysis

    @property
    def ds(self) -> float:
        """Distance of the stations [mm]."""
        return float(self.place[1])

    @cached_property
    def _ascending(self) -> Floats:
        """`length`, strictly ascending where the nozzle rests, as np.interp wants it."""
        return self.length + np.arange(self.length.size) * 1e-12

    def along(self, values: Floats) -> Floats:
        """Return values at the ticks, (n,), at the stations, (r,)."""
        return np.interp(self.place, self._ascending, values)

    @cached_property
    def point(self) -> Floats:
        """Stations on the nozzle's trace, in the work frame, (r, 3) [mm]."""
        return np.stack([self.along(self.run.nozzle[:, i]) for i in range(3)], axis=1)

    @cached_property
    def heading(self) -> Floats:
        """Angle of the trace in plan view, not wrapped, (r,) [rad]."""
        along = np.gradient(self.point[:, :2], axis=0)
        moving = np.flatnonzero(np.abs(along).max(axis=1) > 1e-9 * self.ds)
        if not moving.size:
            return np.zeros(self.place.size)
        # up and down it keeps the direction it had
        last = moving[np.maximum(np.searchsorted(moving, np.arange(self.place.size), "right") - 1, 0)]
        return np.unwrap(np.arctan2(along[last, 1], along[last, 0]))

    @cached_property
    def volume(self) -> Floats:
        """Volume laid up to each tick, (n,) [mm³]."""
        return np.concatenate([[0.0], np.cumsum(self.run.flow[:-1]) * self.run.period])

    @cached_property
    def nominal(self) -> float:
        """Section asked for, the median over the ticks of the flow asked for over the commanded speed [mm²].

        Of a fixed flow that is the flow over the median speed. 0 where it is not known: where glue is asked for at rest
        alone, or none, or where a fault ends the run before the speed of a fixed flow is steady.
        """
        asked, speed = self.run.flow_demand[:-1], self.commanded_steps / self.run.period
        moving = (asked > 0) & (speed > 0)
        if not moving.any():
            return 0.0
        sections = asked[moving] / speed[moving]
        section = float(np.median(sections))
        steady = np.abs(sections - section) <= _STEADY * section
        return section if self.run.fault is None or np.mean(steady) >= _MOSTLY else 0.0

    @cached_property
    def commanded_steps(self) -> Floats:
        """Length of the commanded path from each tick to the next, (n - 1,) [mm]."""
        return np.linalg.norm(np.diff(self.run.commanded_tip, axis=0), axis=1)

    @cached_property
    def nozzle_height(self) -> Floats:
        """Height of the nozzle above the surface, the gap and its vertical error to the requested path, (r,) [mm].

        Where the path climbs the surface climbs with it. Beyond where the dispenser is on the error is that at the end.
        """
        run = self.run
        if not run.dispense.any():
            return np.full(self.place.size, self.gap)
        error = self.analysis.nozzle.offset[:, 2]
        ticks = np.arange(len(run.time), dtype=np.float64)
        height = self.gap + np.interp(ticks, self.analysis.ticks, error)
        return np.maximum(self.along(height), _LEAST_GAP * self.gap)

    @cached_property
    def surface(self) -> Floats:
        """Height of the surface below the nozzle at each tick, in the work frame, (n,) [mm].

        It is the gap below the requested path; beyond where the dispenser is on it is that at the end.
        """
        run = self.run
        if not run.dispense.any():
            return run.nozzle[:, 2] - self.gap
        on = self.analysis.ticks
        requested = run.nozzle[on, 2] - self.analysis.nozzle.offset[:, 2]
        return np.interp(np.arange(len(run.time)), on, requested) - self.gap

    @cached_property
    def area(self) -> Floats:
        """Cross-section A, (r,) [mm²]."""
        ds = self.ds
        edges = np.concatenate([[-ds], self.place]) + 0.5 * ds
        laid = np.diff(np.interp(edges, self._ascending, self.volume))
        laid[[0, -1]] *= 2  # the first and the last station stand for half a length
        return self._spread(np.maximum(laid / ds, 0.0))

    def _spread(self, area: Floats) -> Floats:
        """Tolerances what a section holds above the nominal one along the trace, as far as it is wide.

        In turn over one, two, four ... widths of the nominal section that which is wider than so much.
        """
        held = self.nominal if self.nominal > 0 else float(area.max())
        if held <= 0:
            return area
        width = float(self._sections(np.array([held]), np.array([self.gap])).width[0])
        slope = held / width
        while (excess := np.maximum(area - held, 0.0)).any() and width < 2 * self.place[-1]:
            area = np.minimum(area, held) + _averaged(excess, int(np.ceil(0.5 * width / self.ds)))
            width, held = 2 * width, 2 * width * slope
        return area

    def _sections(self, area: Floats, gap: Floats) -> Section:
        gap = gap if self.settings.squashed else np.full_like(gap, np.inf)
        return Section(area, gap, self.settings.contact_angle)

    @cached_property
    def section(self) -> Section:
        """The shapes of the sections at the stations."""
        return self._sections(self.area, self.nozzle_height)

    @property
    def width(self) -> Floats:
        """Width of the bead, (r,) [mm]."""
        return self.section.width

    @property
    def height(self) -> Floats:
        """Largest height of the bead, (r,) [mm]."""
        return self.section.height

    @cached_property
    def nominal_section(self) -> Section:
        """The nominal section's shape, under a nozzle at its nominal height."""
        return self._sections(np.array([self.nominal]), np.array([self.gap]))

    @cached_property
    def stretches(self) -> NDArray[np.intp]:
        """Ticks at which the program's dispensing begins, and the first at which it is off again, (k, 2)."""
        edges = np.diff(np.concatenate([[0], self.run.dispense.astype(np.int8), [0]]))
        return np.stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)], axis=1)


def surface_steps(trace: Floats) -> Floats:
    """Length from each point of a trace to the next along the surface, (n - 1,) [mm].

    Where the nozzle rises or falls by more than it goes ahead it leaves the surface, or comes to it: of that only the
    way in plan view counts, so that glue which flows meanwhile lies on the spot.
    """
    step = np.diff(trace, axis=0)
    ahead = np.hypot(step[:, 0], step[:, 1])
    return np.where(np.abs(step[:, 2]) > ahead, ahead, np.hypot(ahead, step[:, 2]))


def _averaged(values: Floats, reach: int) -> Floats:
    """Moving average over `reach` to both sides, twice, mirrored at the ends, which keeps the sum."""
    for _ in range(2):
        cumulated = np.concatenate([[0.0], np.cumsum(np.pad(values, reach, mode="reflect"))])
        values = (cumulated[2 * reach + 1 :] - cumulated[: -2 * reach - 1]) / (2 * reach + 1)
    return np.maximum(values, 0.0)
