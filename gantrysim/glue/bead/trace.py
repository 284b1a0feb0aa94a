"""The bead along the nozzle's trace: its cross-section from conservation of volume.

With the glue's flow Q and the nozzle's speed v the section is A = Q / v. Here it is the volume laid between two points
of the trace over their distance, which is the same while the nozzle moves and also holds while it rests.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, compiled_view, spans
from gantrysim.base.columns import by_blocks, extent
from gantrysim.base.errors import check_type, whole_number
from gantrysim.base.jit import jit
from gantrysim.glue.bead.dots import Dot, dots_of, dotted_ticks
from gantrysim.glue.bead.section import BeadSettings, Section, spread
from gantrysim.glue.dispenser.command import Material
from gantrysim.metrics.analysis import Analysis
from gantrysim.record.run import Run, check_run

# Lengths of the nozzle's trace, and sums along it.


def cumulated_sums(values: Floats) -> Floats:
    """Return the sums of the first values, of none to all of them, (n + 1,)."""
    sums = np.empty(len(values) + 1)
    sums[0] = 0.0
    np.cumsum(values, out=sums[1:])
    return sums


def surface_steps(run: Run) -> Floats:
    """Length of the nozzle's trace from each tick to the next along the surface, (n - 1,) [mm].

    A nozzle that moves steeper than 45 deg leaves the surface or approaches it: only its motion in plan view counts,
    so that glue which flows meanwhile lies on the spot.
    """
    steps = np.empty(len(run.time) - 1)
    _find_surface_steps(compiled_view(run.nozzle), steps)
    return steps


@jit
def _find_surface_steps(nozzle: Floats, steps: Floats) -> None:
    """Write the steps of `surface_steps`."""
    for k in range(steps.size):
        ahead = math.hypot(nozzle[k + 1, 0] - nozzle[k, 0], nozzle[k + 1, 1] - nozzle[k, 1])
        up = nozzle[k + 1, 2] - nozzle[k, 2]
        steps[k] = ahead if abs(up) > ahead else math.hypot(ahead, up)


@jit
def _find_steps(points: Floats, steps: Floats) -> None:
    """Write the distances from each point to the next, (n - 1,) [mm]."""
    for k in range(steps.size):
        x = points[k + 1, 0] - points[k, 0]
        y = points[k + 1, 1] - points[k, 1]
        z = points[k + 1, 2] - points[k, 2]
        steps[k] = math.sqrt(x * x + y * y + z * z)


@jit
def _find_headings(point: Floats, least: float, direction: Floats, level: Floats) -> None:
    """Write the directions of a trace, by differences of its stations, the central ones between its ends.

    Args:
        point: the stations, (r, 3) [mm].
        least: motion in plan view from a station to the next, above which it has a direction there [mm].
        direction: unit vectors in plan view, (2, r), to be written; vertical motion keeps that before it.
        level: cosine of the angle of climb, (r,), to be written.
    """
    last = len(point) - 1
    cosine = 1.0
    sine = 0.0
    moves = False
    for k in range(last + 1):
        before = max(k - 1, 0)
        after = min(k + 1, last)
        share = 1.0 / (after - before)
        x = (point[after, 0] - point[before, 0]) * share
        y = (point[after, 1] - point[before, 1]) * share
        z = (point[after, 2] - point[before, 2]) * share
        ahead = math.hypot(x, y)
        length = math.hypot(ahead, z)
        level[k] = ahead / length if length > 0.0 else 1.0
        if ahead > least:
            cosine = x / ahead
            sine = y / ahead
            if not moves:
                direction[0, :k] = cosine
                direction[1, :k] = sine
                moves = True
        direction[0, k] = cosine
        direction[1, k] = sine


# Whether a bead leaves a level plane, which decides how pictures show it.

# climb up to which a bead is flat; it holds the sag of a table and the errors of a needle's height [mm]
LEVEL_CLIMB = 1.0


def climb(heights: Floats) -> float:
    """Return the extent of heights of the nozzle with glue, (n,) [mm], 0 for none."""
    return float(np.ptp(heights)) if heights.size else 0.0


def leaves_plane(run: Run) -> bool:
    """Return whether the nozzle climbs by more than `LEVEL_CLIMB` in the work frame while it dispenses."""
    return extent(lambda block: run.nozzle[block, 2][run.dispense[block]], len(run.time)) > LEVEL_CLIMB


_CELL = 0.25  # of the height map, where none is given [mm]
_CELLS_OF_A_BEAD = 0.25  # largest such cell, of the width of a bead
_DISTANCE = 0.25  # of the stations [mm]
_STATIONS = (2, 400_000)
# tolerance of a steady section, and share of the ticks before a fault that must keep it
_STEADY_SECTION = 0.1
_STEADY_SHARE = 0.5
_SAME_DEMAND = 1e-6  # of the largest flow demand, within which it is what E feeds
_SHORTEST_DOT = 1e-6  # length of the trace of a dot [mm]
_LEAST_GAP = 0.05  # of the nominal one, for a nozzle that dips into the work
_WET = 1e-3  # of the nominal section; below, a stretch of bead has ended


class BeadTrace:
    """The bead of a run at stations evenly spaced along the nozzle's trace in the work frame.

    A surplus, as at a stop or in a slow corner, spreads along the trace as far as it is wide. Volume is conserved: the
    sum of area * ds, with half a length for the first and the last station, is the volume laid. Glue laid at rest at an
    end of the trace spreads to one side only, into a pear instead of a disc. A stretch shorter than its two round ends
    is one round drop. Dots are no part of it: neither their stretches, nor their glue.

    Args:
        run: the run.
        settings: shape of the bead.
        analysis: the analysis of the run, if there is one already.
        stations: number of stations; by default one every quarter of a millimetre.

    Attributes:
        gap: height of the nozzle above the surface on the requested path [mm].
        length: length of the nozzle's trace along the surface up to each tick, (n,) [mm].
        place: place of the stations along the trace, (r,) [mm].
    """

    def __init__(
        self,
        run: Run,
        settings: BeadSettings | None = None,
        analysis: Analysis | None = None,
        stations: int | None = None,
    ) -> None:
        check_run(run)
        if settings is not None:
            check_type("settings", settings, BeadSettings, "BeadSettings", "a job has them as job.bead")
        self.run = run
        self.settings = BeadSettings() if settings is None else settings
        self.gap = run.gap if self.settings.gap is None else self.settings.gap
        self._analysis = analysis
        self.length: Floats = cumulated_sums(surface_steps(run))
        total = max(float(self.length[-1]), _SHORTEST_DOT)
        if stations is None:
            stations = int(np.clip(np.ceil(total / _DISTANCE) + 1, *_STATIONS))
        self.place: Floats = np.linspace(0.0, total, whole_number("stations", stations, 2))

    @staticmethod
    def of(run: Run, bead: BeadSettings | BeadTrace | None) -> BeadTrace:
        """Return the bead of a run, given as its settings, or as itself."""
        return bead if isinstance(bead, BeadTrace) and bead.run is run else BeadTrace(run, _settings_of(bead))

    @cached_property
    def analysis(self) -> Analysis:
        """The run's traces projected onto its requested path."""
        return Analysis(self.run) if self._analysis is None else self._analysis

    @property
    def ds(self) -> float:
        """Distance of the stations [mm]."""
        return float(self.place[1])

    @property
    def _ascending(self) -> Floats:
        """The length, strictly ascending as np.interp requires, (n,) [mm]."""
        # a nozzle at rest repeats its length: rounding-sized steps, in place, as a long run has room for few arrays
        length = np.arange(self.length.size, dtype=np.float64)
        length *= 1e-12
        length += self.length
        return length

    def along(self, values: Floats) -> Floats:
        """Interpolate values at the ticks, (n,), at the stations, (r,)."""
        return np.interp(self.place, self._ascending, values)

    @cached_property
    def point(self) -> Floats:
        """The stations in the work frame, (r, 3) [mm]."""
        return np.stack([self.along(self._nozzle(i)) for i in range(3)], axis=1)

    def _nozzle(self, i: int) -> Floats:
        """One coordinate of the nozzle, (n,) [mm]."""
        return by_blocks(lambda block: self.run.nozzle[block, i], len(self.length))

    @property
    def _vertical_error(self) -> Floats:
        """Vertical contour error at every tick, before and after dispensing that at the end, (n,) [mm]."""
        foot = self.analysis.nozzle
        return self.at_all_ticks(lambda rows: foot.offset[rows, 2])

    def at_all_ticks(self, values: Callable[[slice], Floats]) -> Floats:
        """Return values at all ticks, (n,), given those of some rows of the analysis; between these they are linear."""
        ticks = self.analysis.ticks

        def part(block: slice) -> Floats:
            first, after = np.searchsorted(ticks, [block.start, block.stop])
            # with the neighbours of the block
            near = slice(max(first - 1, 0), after + 1)
            return np.interp(np.arange(block.start, block.stop), ticks[near], values(near))

        return by_blocks(part, len(self.length))

    @property
    def direction(self) -> Floats:
        """Unit vector along the trace in plan view, x and y, (2, r)."""
        return self._headings[0]

    @property
    def level(self) -> Floats:
        """Cosine of the trace's angle of climb, (r,)."""
        return self._headings[1]

    @cached_property
    def _headings(self) -> tuple[Floats, Floats]:
        direction = np.empty((2, self.place.size))
        level = np.empty(self.place.size)
        _find_headings(compiled_view(self.point), 1e-9 * self.ds, direction, level)
        return direction, level

    @cached_property
    def heading(self) -> Floats:
        """Angle of the trace in plan view, not wrapped, (r,) [rad]."""
        x, y = self.direction
        return np.unwrap(np.arctan2(y, x))

    @cached_property
    def dots(self) -> tuple[Dot, ...]:
        """The dots of the run."""
        return dots_of(self.run, self.settings, self.gap)

    @property
    def has_glue(self) -> bool:
        """Whether any glue is laid, as a bead or in dots."""
        return bool(self.volume[-1] > 0) or any(dot.volume > 0 for dot in self.dots)

    @cached_property
    def _dotted(self) -> NDArray[np.bool_]:
        """Ticks whose glue is that of dots, (n,)."""
        return dotted_ticks(self.dots, len(self.run.time))

    def without_dots(self, values: Floats, block: slice) -> Floats:
        """Return flows at a block of ticks, 0 where they lay dots."""
        return np.where(self._dotted[block], 0.0, values) if self.dots else values

    @cached_property
    def volume(self) -> Floats:
        """Volume laid up to each tick, without dots, (n,) [mm³]."""
        last = len(self.run.time) - 1
        volume = cumulated_sums(self.without_dots(self.run.flow[:-1], slice(0, last)))
        volume *= self.run.period
        return volume

    @cached_property
    def most_flow(self) -> float:
        """Largest flow of the run [mm³/s]."""
        return float(self.run.flow.max())

    @cached_property
    def follows_material(self) -> bool:
        """Whether the program states the section of each line, by the material that it feeds by E."""
        run = self.run
        if run.extrusion is None:
            return False
        fed = Material(np.asarray(run.extrusion)).laid()
        demand = run.flow_demand
        total = float(fed.sum())
        if not (total > 0 and demand.any()):
            return False
        per_length = float(demand.sum()) / total
        return bool(np.abs(demand - per_length * fed).max() <= _SAME_DEMAND * demand.max())

    @cached_property
    def wanted(self) -> Floats:
        """Section that the program wants at the stations, (r,) [mm²].

        It is what it feeds by E for each length of path, where it does so, and else the nominal one everywhere.
        """
        if self.nominal <= 0 or not self.follows_material:
            return np.full(self.place.size, self.nominal)
        steps = self.commanded_steps
        moving = (steps > 0) & (self.run.flow_demand[:-1] > 0)
        if self.dots:
            moving &= ~self._dotted[:-1]
        volume = cumulated_sums(np.where(moving, self.run.flow_demand[:-1], 0.0))
        volume *= self.run.period
        path = cumulated_sums(np.where(moving, steps, 0.0))
        edges = np.concatenate([[-self.ds], self.place]) + 0.5 * self.ds
        laid = np.diff(np.interp(edges, self._ascending, volume))
        length = np.diff(np.interp(edges, self._ascending, path))
        some = np.flatnonzero(length > _SHORTEST_DOT)
        # beside the lines, the section of the nearest one
        middles = 0.5 * (some[1:] + some[:-1])
        nearest = some[np.searchsorted(middles, np.arange(self.place.size))]
        return np.asarray(laid[nearest] / length[nearest], np.float64)

    @cached_property
    def wanted_section(self) -> Section:
        """The wanted sections at the stations under a nozzle at its nominal height."""
        return self._sections(self.wanted, np.full(self.place.size, self.gap))

    @cached_property
    def widest(self) -> float:
        """Largest width that is wanted [mm]."""
        return float(self.wanted_section.width.max()) if self.follows_material else float(self.nominal_section.width[0])

    @cached_property
    def nominal(self) -> float:
        """Requested section, the median of flow demand over commanded speed [mm²].

        It is 0 where it is unknown: without flow in motion, or if a fault comes before the speed is steady.
        """
        demand = self.run.flow_demand[:-1]
        speed = self.commanded_steps
        speed /= self.run.period
        moving = (demand > 0) & (speed > 0)
        if self.dots:
            moving &= ~self._dotted[:-1]
        if not moving.any():
            return 0.0
        sections = demand[moving]
        sections /= speed[moving]
        del demand, speed
        # ramps and corners are few
        section = float(np.median(sections))
        steady = np.abs(sections - section) <= _STEADY_SECTION * section
        is_known = self.run.fault is None or self.follows_material or np.mean(steady) >= _STEADY_SHARE
        return section if is_known else 0.0

    @property
    def commanded_steps(self) -> Floats:
        """Length of the commanded path from each tick to the next, (n - 1,) [mm]."""
        steps = np.empty(len(self.run.time) - 1)
        _find_steps(compiled_view(self.run.commanded_tip), steps)
        return steps

    @cached_property
    def nozzle_height(self) -> Floats:
        """Height of the nozzle above the surface: the gap and the vertical contour error, (r,) [mm].

        The surface climbs with the path. Before and after dispensing the error is that at the end.
        """
        run = self.run
        if not run.dispense.any():
            return np.full(self.place.size, self.gap)
        return np.maximum(self.along(self.gap + self._vertical_error), _LEAST_GAP * self.gap)

    def surface(self) -> Floats:
        """Return the height of the surface below the nozzle at each tick, in the work frame, (n,) [mm].

        It is the gap below the requested path, and before and after dispensing that at the end.
        """
        run = self.run
        if not run.dispense.any():
            return run.nozzle[:, 2] - self.gap
        ticks = self.analysis.ticks
        foot = self.analysis.nozzle
        return self.at_all_ticks(lambda rows: run.nozzle[ticks[rows], 2] - foot.offset[rows, 2] - self.gap)

    @cached_property
    def area(self) -> Floats:
        """Cross-section A, (r,) [mm²]."""
        ds = self.ds
        edges = np.concatenate([[-ds], self.place]) + 0.5 * ds
        laid = np.diff(np.interp(edges, self._ascending, self.volume))
        # the shares of the first and the last station are half as long
        laid[[0, -1]] *= 2
        return self._spread(np.maximum(laid / ds, 0.0))

    def _spread(self, area: Floats) -> Floats:
        """Spread the surplus of a section over the wanted one along the trace."""
        steady = self.wanted if self.nominal > 0 else np.full(1, area.max())
        usual = self.nominal if self.nominal > 0 else float(steady[0])
        if usual <= 0:
            return area
        width = float(self._sections(np.array([usual]), np.array([self.gap])).width[0])
        return spread(area, steady, width, self.ds, longest=2 * float(self.place[-1]))

    def _sections(self, area: Floats, gap: Floats) -> Section:
        gap = gap if self.settings.squashed else np.full_like(gap, np.inf)
        return Section(area, gap, self.settings.contact_angle, self.run.face)

    def drop(self, volume: float, gap: Floats) -> Section:
        """Return the section of a round drop of a volume [mm³] under one gap of `section`, (1,) [mm]."""
        return Section.drop(volume, gap, self.settings.contact_angle, self.run.face)

    @cached_property
    def strand(self) -> Section:
        """The sections at the stations of a bead that is long everywhere."""
        return self._sections(self.area, self.nozzle_height)

    @cached_property
    def cell(self) -> float:
        """Cell size of the height map [mm]."""
        if self.settings.cell is not None:
            return self.settings.cell
        width = float(self.nominal_section.width[0])
        return min(_CELL, _CELLS_OF_A_BEAD * width) if width > 0 else _CELL

    @cached_property
    def end_length(self) -> Floats:
        """Length of bead with the volume of a round end at the stations, half of a round drop, (r,) [mm]."""
        return np.divide(self.strand.half_body(), self.area, out=np.zeros_like(self.area), where=self.area > 0)

    @cached_property
    def drops(self) -> NDArray[np.intp]:
        """The wet stretches shorter than their two round ends, each of which is one round drop, (k, 2)."""
        short = []
        for first, after in self.wet_stretches.tolist():
            place = self.ds * (np.arange(after - first) + 0.5)
            ends = self.end_length[first:after]
            begin = np.flatnonzero(place >= ends)
            end = np.flatnonzero(place[::-1] >= ends)
            if not begin.size or not end.size or begin[0] > end[-1]:
                short.append((first, after))
        return np.array(short, np.intp).reshape(-1, 2)

    @cached_property
    def section(self) -> Section:
        """The sections at the stations; along a drop, the section through its middle."""
        if not len(self.drops):
            return self.strand
        area = self.area.copy()
        laid = self.area * self.ds
        laid[[0, -1]] *= 0.5
        for first, after in self.drops.tolist():
            gap = self.strand.gap[(first + after - 1) // 2, None]
            area[first:after] = self.drop(float(laid[first:after].sum()), gap).area
        return self._sections(area, self.nozzle_height)

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
        """The nominal section under a nozzle at its nominal height."""
        return self._sections(np.array([self.nominal]), np.array([self.gap]))

    @cached_property
    def stretches(self) -> NDArray[np.intp]:
        """First tick of every stretch of dispensing that is no dot, and the first after it, (k, 2)."""
        stretches = spans(self.run.dispense)
        return stretches[~np.isin(stretches[:, 0], [dot.stretch[0] for dot in self.dots])] if self.dots else stretches

    @cached_property
    def bead_dispense(self) -> NDArray[np.bool_]:
        """Whether the dispenser is on for a bead, (n,)."""
        return self.run.dispense & ~self._dotted if self.dots else self.run.dispense

    @cached_property
    def wet_stretches(self) -> NDArray[np.intp]:
        """First station of every stretch of glue, and the first after it, (k, 2)."""
        least = _WET * (self.nominal if self.nominal > 0 else float(self.area.max()))
        return spans(self.area > least)


def _settings_of(bead: BeadSettings | BeadTrace | None) -> BeadSettings | None:
    return bead.settings if isinstance(bead, BeadTrace) else bead
