"""The bead that a run lays, along the trace and on the map, and its figures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.bead.deposit import HeightMap
from gantrysim.bead.strand import BeadSettings, Strand
from gantrysim.controllers.path import Floats
from gantrysim.errors import InputError
from gantrysim.metrics import Range

__all__ = ["Bead", "BeadFigures", "BeadSettings"]

_TOUCHING = 1e-6  # [mm], within which neighbouring turns neither overlap nor leave a gap
_LINKS = 1000  # between neighbouring turns, along which the annulus is looked at
_ON_A_LINK = 48  # points
_GOLDEN = 0.618034


@dataclass(frozen=True)
class BeadFigures:
    """The figures of a bead, in mm, mm² and mm³.

    Start and stop are told twice. By volume: at a start the glue that is missing of what was asked for, up to the
    middle of the stretch of dispensing, and at a stop what is laid beyond it from there on, each as length of the
    nominal section; that is what the dispenser's lags and leads make. By place: how far behind the nozzle's place
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
        start: late by so much where positive, by volume.
        stop: too much where positive, by volume; None where no stretch ends within the record.
        begins: late by so much where positive, by place; None where no stretch reaches half the section.
        ends: overrun where positive, by place; None likewise.
        laid: volume laid.
        asked: volume of the nominal section along the commanded path, while the dispenser is on.
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

    @property
    def error(self) -> float:
        """Volume laid beyond what was asked for [mm³]."""
        return self.laid - self.asked

    @property
    def error_percent(self) -> float:
        """The same, of what was asked for [%]."""
        return 100 * self.error / self.asked


class Bead(Strand):
    """The bead of a run: stations along the nozzle's trace, the height map, and the figures; see `Strand`."""

    @cached_property
    def map(self) -> HeightMap:
        """The height map."""
        return HeightMap.of(self)

    @cached_property
    def figures(self) -> BeadFigures:
        """The figures; of a run that a fault ended, those up to the fault.

        Raises:
            InputError: no glue is asked for while the nozzle is to move.
        """
        if not self.nominal > 0:
            raise InputError("the run asks for no glue while the nozzle moves: its bead has no figures")
        on = self.dispensing
        clearance, weight = self.clearance, self._turn_lengths
        length = float(weight.sum())
        turns = clearance.size > 0 and length > 0
        start, stop, begins, ends = self._ends
        return BeadFigures(
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
        clearance: Floats = spacing.distance - both
        return clearance

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
    def _ends(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Start and stop by volume, begin and end by place, those that there are of every stretch [mm]."""
        run, ticks = self.run, len(self.run.time)
        more = np.concatenate([[0.0], np.cumsum(run.flow - run.asked)]) * run.period / self.nominal
        wet = np.concatenate([[0.0], (self.area >= 0.5 * self.nominal).astype(float), [0.0]])
        first, last = (np.flatnonzero(np.diff(wet) == step) for step in (1, -1))
        rises = np.array([self._crossing(k - 1, k) for k in first.tolist()])
        falls = np.array([self._crossing(k - 1, k) for k in last.tolist()])
        found: tuple[list[float], ...] = ([], [], [], [])
        # what is laid between two stretches belongs half way to the one and half way to the other
        bounds = np.concatenate([[0], (self.stretches[:-1, 1] + self.stretches[1:, 0]) // 2, [ticks - 1]])
        for k, (on, off) in enumerate(self.stretches.tolist()):
            low, middle, high = int(bounds[k]), (on + off) // 2, int(bounds[k + 1])
            found[0].append(float(more[low] - more[middle]))
            begun = rises[(rises >= self.length[low]) & (rises <= self.length[middle])]
            if begun.size:
                found[2].append(float(begun[0] - self.length[on]))
            if off >= ticks:
                continue
            found[1].append(float(more[high] - more[middle]))
            ended = falls[(falls >= self.length[middle]) & (falls <= self.length[high])]
            if ended.size:
                found[3].append(float(ended[-1] - self.length[off]))
        start, stop, begins, ends = (np.array(values) for values in found)
        return start, stop, begins, ends

    def _crossing(self, before: int, after: int) -> float:
        """Place between two stations where the section is half the nominal one; at the trace's ends these [mm]."""
        if before < 0:
            return float(self.place[0])
        if after >= self.place.size:
            return float(self.place[-1])
        a, b = float(self.area[before]), float(self.area[after])
        return float(self.place[before]) + self.ds * (0.5 * self.nominal - a) / (b - a)
