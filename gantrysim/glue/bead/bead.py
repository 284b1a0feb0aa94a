"""The bead of a run along the trace and on the map, and its values."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, at_rows, compiled_view, spans
from gantrysim.base.columns import by_blocks
from gantrysim.base.display import Shown
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.glue.bead.height_map import HeightMap
from gantrysim.glue.bead.layers import merging_height
from gantrysim.glue.bead.trace import BeadTrace, cumulated_sums
from gantrysim.glue.bead.values import BeadValues
from gantrysim.metrics.analysis import Range
from gantrysim.metrics.spacing import forward

_TOUCHING_TURNS = 1e-6  # [mm], within which neighbouring turns neither overlap nor leave a gap
_LINKS = 1000  # links between neighbouring turns, on which coverage is sampled
_ON_A_LINK = 48  # samples
_GOLDEN = 0.618034
_SETTLED_FLOW = 1e-5  # tolerance of a settled flow, of the flow demand
_STEADY_RATE = 1e-3  # relative change of a flow that is steady, or drifts as a syringe empties [1/s]
_RAMP = 0.1  # relative change of a demand that rises or falls [1/s]


class Bead(BeadTrace, Shown):
    """The bead of a run: stations along the nozzle's trace, the height map, and its values.

    Args:
        run: the run.
        settings: shape of the bead, by default that of `BeadSettings()`.
        analysis: the analysis of the run, if there is one already.
        stations: number of stations; by default one every quarter of a millimetre.
    """

    def facts(self) -> dict[str, str]:
        remark = {"remark": self._no_values} if self._no_values else {}
        return {
            **remark,
            "machine": self.run.machine,
            "section": f"{self.nominal:.3g} mm²",
            "volume": f"{self.total_volume:.4g} mm³",
            "requested": f"{self.requested_volume:.4g} mm³",
        }

    @property
    def _no_values(self) -> str:
        """Why the bead has no values; empty where it has some."""
        run = self.run
        if self.nominal > 0:
            return ""
        if run.fault is not None and run.flow_demand.any():
            return "the fault came before the path speed was steady: the requested section is unknown"
        remedy = (
            "" if run.flow_demand.any() else "; run it with a dispenser, as dispenser=gantrysim.Dispenser(flow=100)"
        )
        return f"the run requests no glue while the nozzle moves: its bead has no values{remedy}"

    @cached_property
    def map(self) -> HeightMap:
        """The height map."""
        return HeightMap.of(self)

    @cached_property
    def values(self) -> BeadValues:
        """The values of the bead, up to a fault where there is one.

        Raises:
            InputError: no glue is requested while the nozzle moves, or a fault came before the speed was steady.
        """
        if self._no_values:
            raise InputError(self._no_values)
        on = self.dispensing
        excess_at_stop = self.excess_at_stops
        delay_at_start, overrun_at_stop = self._offsets
        length = float(self._turn_lengths.sum())
        turns = length > 0
        # before the columns of all turns, as a long run has no room for them beside the map while it is made
        ridge = self.map.ridge
        coverage, apart_share = self._coverage if turns else (None, None)
        clearance = self.clearance()
        weight = self._turn_lengths
        return BeadValues(
            nominal=self.nominal,
            width=Range.of(self.width[on]),
            section=Range.of(self.section.area[on]),
            clearance=Range.of(clearance) if turns else None,
            overlap_share=float(weight[clearance < -_TOUCHING_TURNS].sum()) / length if turns else None,
            gap_share=float(weight[clearance > _TOUCHING_TURNS].sum()) / length if turns else None,
            coverage=coverage,
            apart_share=apart_share,
            height_apart=self.analysis.spacing.rise if turns else None,
            missing_at_start=Range.of(self.missing_at_starts),
            excess_at_stop=Range.of(excess_at_stop) if excess_at_stop.size else None,
            delay_at_start=Range.of(delay_at_start) if delay_at_start.size else None,
            overrun_at_stop=Range.of(overrun_at_stop) if overrun_at_stop.size else None,
            volume=self.total_volume,
            requested_volume=self.requested_volume,
            ramp_error=self._demanded_volume - self.requested_volume,
            start_error=float(self._parts[:, 0].sum()),
            running_error=float(self._parts[:, 1].sum()),
            stop_error=float(self._parts[:, 2].sum()),
            ridge=ridge,
        )

    @cached_property
    def _wanted_at_ends(self) -> Floats:
        """Wanted sections at start and stop of every stretch, (k, 2) [mm²]."""
        length = self.length
        ends = np.minimum(self.stretches[:, 1], length.size - 1)
        place = length[np.stack([self.stretches[:, 0], ends], axis=1)]
        # the stations at the ends hold half of what lies beside the stretch
        inside = np.clip(place + np.array([self.ds, -self.ds]), place[:, :1], place[:, 1:])
        return self.wanted[np.rint(inside / self.ds).astype(np.intp)]

    @property
    def missing_at_starts(self) -> Floats:
        """Volume missing at the start of every stretch, as length of the section wanted there, (k,) [mm]."""
        return -self._parts[:, 0] / self._wanted_at_ends[:, 0]

    @property
    def excess_at_stops(self) -> Floats:
        """Excess volume at the stops within the record, as length of the section wanted there, (at most k,) [mm]."""
        stopped = self.stretches[:, 1] < len(self.run.time)
        return self._parts[stopped, 2] / self._wanted_at_ends[stopped, 1]

    @property
    def total_volume(self) -> float:
        """Volume dispensed, without dots [mm³]."""
        return float(self.volume[-1])

    @property
    def _demanded_volume(self) -> float:
        """Volume that the program demands, without dots [mm³]."""
        run = self.run
        return float(self.without_dots(run.flow_demand[:-1], slice(0, len(run.time) - 1)).sum()) * run.period

    @property
    def requested_volume(self) -> float:
        """Volume of the wanted section along the commanded path, while the dispenser is on [mm³]."""
        on = self.bead_dispense[:-1]
        steps = self.commanded_steps
        if not self.follows_material:
            return self.nominal * float(steps[on].sum())
        demand = self.without_dots(self.run.flow_demand[:-1], slice(0, len(self.run.time) - 1))
        return float(demand[steps > 0].sum()) * self.run.period

    @property
    def volume_error_percent(self) -> float:
        """Dispensed minus requested volume, relative to the latter [%]."""
        return 100 * (self.total_volume - self.requested_volume) / self.requested_volume

    @cached_property
    def dispensing(self) -> NDArray[np.bool_]:
        """Stations that the nozzle passes while the dispenser is on, (r,)."""
        passed = np.zeros(self.place.size, bool)
        for first, after in self.stretches:
            low = self.length[first]
            high = self.length[min(after, self.length.size - 1)]
            passed |= (self.place >= low) & (self.place <= high)
        # a stretch shorter than the distance of the stations
        if not passed.any():
            passed[np.abs(self.place - self.length[self.stretches[0, 0]]).argmin()] = True
        return passed

    @property
    def _turn_lengths(self) -> Floats:
        """Length of the path that each point of the spacing stands for, (m,) [mm]."""
        s = self.analysis.spacing.s
        return np.gradient(s) if s.size > 1 else np.zeros(s.size)

    def clearance(self) -> Floats:
        """Return the distance of neighbouring turns minus their mean width, at the analysis' spacing, (m,) [mm]."""
        spacing = self.analysis.spacing
        s, ticks = self._advancing_feet()
        width = by_blocks(lambda block: np.interp(self.length[ticks[block]], self.place, self.width), ticks.size)

        def clearance(block: slice) -> Floats:
            here = np.interp(spacing.s[block], s, width)
            there = np.interp(spacing.next_s[block], s, width)
            return spacing.distance[block] - 0.5 * (here + there)

        return by_blocks(clearance, len(spacing.s))

    def _advancing_feet(self) -> tuple[Floats, NDArray[np.intp]]:
        """Return the arc lengths of the nozzle's feet that exceed all before, and their ticks."""
        s = self.analysis.nozzle.s
        ticks = self.analysis.ticks
        ahead = forward(s)
        return (s, ticks) if ahead.all() else (s[ahead], ticks[ahead])

    @cached_property
    def _coverage(self) -> tuple[float | None, float]:
        """Wet share of the links between neighbouring turns of one layer, and share of the links between layers.

        Both are weighted by area; the first is None where no link is within a layer.
        """
        spacing = self.analysis.spacing
        cumulated = np.concatenate([[0.0], np.cumsum(self._turn_lengths)])
        some = np.minimum(
            np.searchsorted(cumulated, cumulated[-1] * (np.arange(_LINKS) + 0.5) / _LINKS) - 1, cumulated.size - 2
        )
        area = spacing.distance[some]
        link = spacing.link[some]
        begin_layer = self._layer_at(spacing.s[some])
        end_layer = self._layer_at(spacing.next_s[some])
        level = np.abs(link[:, 1, 2] - link[:, 0, 2]) < merging_height(self)
        within = (begin_layer == end_layer) & level
        apart_share = float(area[~within].sum() / area.sum())
        if not within.any():
            return None, apart_share
        # the golden ratio shifts the samples from link to link, so that they meet every distance from the trace
        share = (np.arange(_ON_A_LINK) + (_GOLDEN * np.arange(_LINKS)[:, None]) % 1.0) / _ON_A_LINK
        begin, end = np.moveaxis(link[..., :2], 1, 0)
        points = begin[:, None] + share[..., None] * (end - begin)[:, None]
        wet = np.zeros(len(some))
        for layer in np.unique(begin_layer[within]).tolist():
            inside = within & (begin_layer == layer)
            wet[inside] = self.map.wet_share(points[inside], layer).mean(axis=1)
        return float(np.average(wet[within], weights=area[within])), apart_share

    def _layer_at(self, s: Floats) -> NDArray[np.int64]:
        """Return the layers of points of the trace, given by their arc length on the requested path, (m,)."""
        feet, ticks = self._advancing_feet()
        place = np.interp(s, feet, at_rows(self.length, ticks))
        last = self.map.layer.size - 1
        return self.map.layer[np.minimum((place / self.ds).astype(np.intp), last)]

    @cached_property
    def _bounds(self) -> NDArray[np.intp]:
        """First ticks of the stretches' shares of the record, bounded midway between stretches, and its last one.

        A dot between two of them has a share of its own, whose flow does not count.
        """
        between = (self.stretches[:-1, 1] + self.stretches[1:, 0]) // 2
        return np.concatenate([[0], between, [len(self.run.time) - 1]])

    @cached_property
    def _parts(self) -> Floats:
        """Volume beyond the demand at start, in steady flow and at stop of every stretch, (k, 3) [mm³]."""
        run = self.run

        def beyond(block: slice) -> Floats:
            return self.without_dots(run.flow[block] - run.flow_demand[block], block)

        excess = cumulated_sums(by_blocks(beyond, len(self.length) - 1))
        excess *= run.period
        last = excess.size - 1
        ticks = []
        for (begin, end), low, high in zip(self.stretches.tolist(), self._bounds[:-1], self._bounds[1:], strict=True):
            ticks.append([low, *self._settled_ticks(begin, min(end, last)), high])
        return np.diff(excess[np.array(ticks)], axis=1)

    def _settled_ticks(self, begin: int, end: int) -> tuple[int, int]:
        """First tick of a stretch at which the flow has settled, and the tick after the last such.

        Between the first rise of the demand and its last fall, a flow has settled where it meets its demand: it comes
        as near as to stay there, or the demand crosses it, where a lagging flow turns. One that a limit holds short of
        the demand has settled where it is steady.
        """
        run = self.run
        stretch = slice(begin, end)
        first, after = _settled_flow(
            compiled_view(run.flow_demand[stretch]), compiled_view(run.flow[stretch]), run.period
        )
        # too short to settle, or without glue
        if not after:
            return (begin + end) // 2, (begin + end) // 2
        return begin + first, begin + after

    @cached_property
    def _offsets(self) -> tuple[Floats, Floats]:
        """Offsets of the bead's visible starts and stops from the nozzle's place at the commands [mm]."""
        edges = spans(self.area >= 0.5 * self.wanted)
        rises = np.array([self._crossing(k) for k in edges[:, 0].tolist()])
        falls = np.array([self._crossing(k) for k in edges[:, 1].tolist()])
        starts = []
        stops = []
        for k, (begin, end) in enumerate(self.stretches.tolist()):
            low, middle, high = self.length[[self._bounds[k], (begin + end) // 2, self._bounds[k + 1]]]
            start = rises[(rises >= low) & (rises <= middle)]
            starts += (start[:1] - self.length[begin]).tolist()
            if end < len(self.run.time):
                stop = falls[(falls >= middle) & (falls <= high)]
                stops += (stop[-1:] - self.length[end]).tolist()
        return np.array(starts), np.array(stops)

    def _crossing(self, station: int) -> float:
        """Place before a station where the section is half the wanted one, or the trace's end [mm]."""
        if station in (0, self.place.size):
            return float(self.place[min(station, self.place.size - 1)])
        near = slice(station - 1, station + 1)
        a, b = (self.area[near] - 0.5 * self.wanted[near]).tolist()
        return float(self.place[station - 1]) - self.ds * a / (b - a)


@jit
def _settled_flow(demand: Floats, flow: Floats, period: float) -> tuple[int, int]:
    """Return the first tick of a stretch at which the flow has settled and the tick after the last, 0 without any.

    Args:
        demand: flow demand, (n,) [mm³/s].
        flow: the flow, (n,) [mm³/s].
        period: from one tick to the next [s].
    """
    last = demand.size - 1
    first = 0
    while first <= last and demand[first] <= 0.0:
        first += 1
    while last > first and demand[last] <= 0.0:
        last -= 1
    # on its way up and down a flow may cross its demand, as one of a valve that opens before the motion does
    while first < demand.size - 1 and demand[first + 1] - demand[first] > _RAMP * period * demand[first]:
        first += 1
    while last > 0 and demand[last] - demand[last - 1] < -_RAMP * period * demand[last]:
        last -= 1
    settled = demand.size
    after = 0
    for k in range(first, last + 1):
        excess = flow[k] - demand[k]
        is_near = abs(excess) <= _SETTLED_FLOW * demand[k] and demand[k] > 0.0
        is_crossed = False
        if k < last:
            change = abs(flow[k + 1] - flow[k])
            is_near = is_near or (flow[k] > 0.0 and change <= _STEADY_RATE * period * flow[k])
            # a flow that itself runs through its demand overshoots
            turns = change < abs(demand[k + 1] - demand[k])
            is_crossed = turns and excess * (flow[k + 1] - demand[k + 1]) < 0.0
        if is_near or is_crossed:
            settled = min(settled, k if is_near else k + 1)
            after = k + 1
    return settled, after
