"""The bead that a run lays, along the trace and on the map, and its figures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.bead.height_map import HeightMap
from gantrysim.bead.trace import BeadTrace
from gantrysim.errors import InputError
from gantrysim.metrics.analysis import Range

_TOUCHING = 1e-6  # [mm], within which neighbouring turns neither overlap nor leave a gap
_LINKS = 1000  # between neighbouring turns, along which the annulus is looked at
_ON_A_LINK = 48  # points
_GOLDEN = 0.618034
_SETTLED = 1e-5  # of the flow asked for, within which it has settled


@dataclass(frozen=True)
class BeadValues:
    """The figures of a bead, in mm, mm² and mm³.

    What is laid beyond the nominal section is told in parts that add up,

        error = ramps + starts + running + stops,

    of which `ramps` is the program's and the others are the dispenser's: a fixed flow asks for as much while the path
    speed ramps as at speed, and so for more than the nominal section on the way; an area asks for the nominal section
    at any speed, and its ramps are 0. A start lasts until the flow has settled: until it is off the flow asked for by
    as much as it is in the median over the stretch of dispensing; a stop begins where that is last so. Between the two
    lies what a limit withholds.

    Start and stop are told twice. By volume: at a start the glue that is missing of what was asked for, and at a stop
    what is laid beyond it, each as length of the nominal section. By place: how far behind the nozzle's place
    at the program's command half the nominal section is reached first, and last; that is where the bead is seen to
    begin and to end. The ranges are over the stretches of dispensing.

    Attributes:
        nominal: section asked for [mm²].
        width: along the path, while the dispenser is on.
        section: the same of the cross-section.
        clearance: distance of neighbouring turns less their mean width, negative where they overlap; None where the
            trace has no neighbouring turns.
        overlapping: share of the turns' length on which they overlap; None likewise.
        gapping: share on which they leave a gap; None likewise.
        coverage: share of the area between neighbouring turns that is wet, on the height map; None likewise.
        start: missing where positive, by volume.
        stop: too much where positive, by volume; None where no stretch ends within the record.
        begins: late by so much where positive, by place; None where no stretch reaches half the section.
        ends: overrun where positive, by place; None likewise.
        laid: volume laid.
        asked: volume of the nominal section along the commanded path, while the dispenser is on.
        ramps: volume that the program asks for beyond that, negative for less.
        starts: volume laid beyond what the program asks for until the flow has settled, negative where it is missing.
        running: the same from there on, as a limit makes it.
        stops: the same from where the flow no longer is the settled one, to the record's end.
        ridge: of glue that has found no room on the height map, over the nozzle's height, as its share; 0 where the
            map has settled, as `HeightMap.ridge`.
    """

    nominal: float
    width: Range
    section: Range
    clearance: Range | None
    overlapping: float | None
    gapping: float | None
    coverage: float | None
    start: Range
    stop: Range | None
    begins: Range | None
    ends: Range | None
    laid: float
    asked: float
    ramps: float
    starts: float
    running: float
    stops: float
    ridge: float

    @property
    def ridge_note(self) -> str:
        """What is wrong with a height map that has not settled."""
        return (
            f"glue found no room and stands {100 * self.ridge:.3g} % above the nozzle: "
            "heights and coverage are not right"
        )

    @property
    def error(self) -> float:
        """Volume laid beyond what was asked for [mm³]."""
        return self.laid - self.asked

    @property
    def error_percent(self) -> float:
        """The same, of what was asked for [%]."""
        return 100 * self.error / self.asked

    @property
    def dispenser(self) -> float:
        """What the dispenser makes of the error, at starts, stops and while running [mm³]."""
        return self.starts + self.running + self.stops


class Bead(BeadTrace):
    """The bead of a run: stations along the nozzle's trace, the height map, and the figures; see `BeadTrace`."""

    @cached_property
    def map(self) -> HeightMap:
        """The height map."""
        return HeightMap.of(self)

    @cached_property
    def values(self) -> BeadValues:
        """The figures; of a run that a fault ended, those up to the fault.

        Raises:
            InputError: no glue is asked for while the nozzle is to move, or not at a speed that is steady before a
                fault.
        """
        if not self.nominal > 0:
            if self.run.fault is not None and self.run.flow_demand.any():
                raise InputError(
                    "the fault came before the path speed was steady: what section was asked for is unknown"
                )
            raise InputError("the run asks for no glue while the nozzle moves: its bead has no figures")
        on = self.dispensing
        clearance, weight = self.clearance, self._turn_lengths
        length = float(weight.sum())
        turns = clearance.size > 0 and length > 0
        run, parts = self.run, self._parts
        # of a stretch that the record's end cuts off there is no stop to tell
        stopped = self.stretches[:, 1] < len(run.time)
        start, stop = -parts[:, 0] / self.nominal, parts[stopped, 2] / self.nominal
        begins, ends = self._ends
        return BeadValues(
            nominal=self.nominal,
            width=Range.of(self.width[on]),
            section=Range.of(self.area[on]),
            clearance=Range.of(clearance) if turns else None,
            overlapping=float(weight[clearance < -_TOUCHING].sum()) / length if turns else None,
            gapping=float(weight[clearance > _TOUCHING].sum()) / length if turns else None,
            coverage=self._coverage if turns else None,
            start=Range.of(start),
            stop=Range.of(stop) if stop.size else None,
            begins=Range.of(begins) if begins.size else None,
            ends=Range.of(ends) if ends.size else None,
            laid=self.laid,
            asked=self.asked,
            ramps=float(run.flow_demand[:-1].sum()) * run.period - self.asked,
            starts=float(parts[:, 0].sum()),
            running=float(parts[:, 1].sum()),
            stops=float(parts[:, 2].sum()),
            ridge=self.map.ridge,
        )

    @property
    def laid(self) -> float:
        """Volume laid [mm³]."""
        return float(self.volume[-1])

    @property
    def asked(self) -> float:
        """Volume of the nominal section along the commanded path, while the dispenser is on [mm³]."""
        return self.nominal * float(self.commanded_steps[self.run.dispense[:-1]].sum())

    @cached_property
    def dispensing(self) -> NDArray[np.bool_]:
        """Stations that the nozzle passes while the dispenser is on, (r,)."""
        on = np.zeros(self.place.size, bool)
        for first, after in self.stretches:
            low, high = self.length[first], self.length[min(after, self.length.size - 1)]
            on |= (self.place >= low) & (self.place <= high)
        if not on.any():  # a stretch shorter than the stations are apart
            on[np.abs(self.place - self.length[self.stretches[0, 0]]).argmin()] = True
        return on

    @cached_property
    def _turn_lengths(self) -> Floats:
        """Length of the path that each point of the spacing stands for, (m,) [mm]."""
        s = self.analysis.spacing.s
        return np.gradient(s) if s.size > 1 else np.zeros(s.size)

    @cached_property
    def clearance(self) -> Floats:
        """Distance of neighbouring turns less their mean width, at the points of the analysis' spacing, (m,) [mm]."""
        spacing, foot = self.analysis.spacing, self.analysis.nozzle
        width = np.interp(self.length[self.analysis.ticks], self.place, self.width)
        forward = np.concatenate([[True], foot.s[1:] > np.maximum.accumulate(foot.s)[:-1]])
        s, width = foot.s[forward], width[forward]
        both = 0.5 * (np.interp(spacing.s, s, width) + np.interp(spacing.next_s, s, width))
        return spacing.distance - both

    @cached_property
    def _coverage(self) -> float:
        """Share of the links between neighbouring turns that is wet, by the area that they stand for."""
        link, distance = self.analysis.spacing.link, self.analysis.spacing.distance
        cumulated = np.concatenate([[0.0], np.cumsum(self._turn_lengths)])
        some = np.minimum(
            np.searchsorted(cumulated, cumulated[-1] * (np.arange(_LINKS) + 0.5) / _LINKS) - 1, distance.size - 1
        )
        # not at the same distances from the trace on every link
        share = (np.arange(_ON_A_LINK) + (_GOLDEN * np.arange(_LINKS)[:, None]) % 1.0) / _ON_A_LINK
        begin, end = link[some, 0, :2], link[some, 1, :2]
        points = begin[:, None] + share[..., None] * (end - begin)[:, None]
        wet = self.map.wet(points).mean(axis=1)
        return float(np.average(wet, weights=distance[some]))

    @cached_property
    def _bounds(self) -> NDArray[np.intp]:
        """Ticks from which on what is laid belongs to each stretch; between two half to the one, half to the other."""
        between = (self.stretches[:-1, 1] + self.stretches[1:, 0]) // 2
        return np.concatenate([[0], between, [len(self.run.time) - 1]])

    @cached_property
    def _parts(self) -> Floats:
        """Volume laid beyond the flow asked for at start, while running and at stop of every stretch, (k, 3) [mm³]."""
        run = self.run
        more = np.concatenate([[0.0], np.cumsum((run.flow - run.flow_demand)[:-1])]) * run.period
        last = more.size - 1
        ticks = [
            [low, *self._settled(on, min(off, last)), high]
            for (on, off), low, high in zip(self.stretches.tolist(), self._bounds[:-1], self._bounds[1:], strict=True)
        ]
        return np.diff(more[np.array(ticks)], axis=1)

    def _settled(self, on: int, off: int) -> tuple[int, int]:
        """Tick at which the flow of a stretch has settled, and that from which on it no longer is so."""
        asked = self.run.flow_demand[on:off]
        excess = self.run.flow[on:off] - asked
        usual = float(np.median(excess)) if excess.size else 0.0
        # on a ramp the flow may pass what it settles to
        full = asked >= 0.5 * asked.max(initial=0.0)
        near = np.flatnonzero(full & (np.abs(excess - usual) <= _SETTLED * asked))
        middle = (on + off) // 2
        if not near.size or usual <= -asked.max(initial=0.0) * (1 - _SETTLED):  # too short to settle
            return middle, middle
        return on + int(near[0]), on + int(near[-1]) + 1

    @cached_property
    def _ends(self) -> tuple[Floats, Floats]:
        """Begin and end by place, those that there are of every stretch [mm]."""
        wet = np.concatenate([[0.0], (self.area >= 0.5 * self.nominal).astype(float), [0.0]])
        first, last = (np.flatnonzero(np.diff(wet) == step) for step in (1, -1))
        rises = np.array([self._crossing(k - 1, k) for k in first.tolist()])
        falls = np.array([self._crossing(k - 1, k) for k in last.tolist()])
        begins: list[float] = []
        ends: list[float] = []
        for k, (on, off) in enumerate(self.stretches.tolist()):
            low, middle, high = int(self._bounds[k]), (on + off) // 2, int(self._bounds[k + 1])
            begun = rises[(rises >= self.length[low]) & (rises <= self.length[middle])]
            if begun.size:
                begins.append(float(begun[0] - self.length[on]))
            if off >= len(self.run.time):
                continue
            ended = falls[(falls >= self.length[middle]) & (falls <= self.length[high])]
            if ended.size:
                ends.append(float(ended[-1] - self.length[off]))
        return np.array(begins), np.array(ends)

    def _crossing(self, before: int, after: int) -> float:
        """Place between two stations where the section is half the nominal one; at the trace's ends these [mm]."""
        if before < 0:
            return float(self.place[0])
        if after >= self.place.size:
            return float(self.place[-1])
        a, b = float(self.area[before]), float(self.area[after])
        return float(self.place[before]) + self.ds * (0.5 * self.nominal - a) / (b - a)
