"""The bead as one swept mesh of a fixed number of rings: its section along the trace, its ends round.

The rings stand where there is glue, one every so many millimetres and degrees of turn. Of a bead that is still growing
those not yet laid are collapsed onto its end, so that its cost hardly depends on its length. As on the height map an
end is half the body that the section makes when it turns about its middle, and takes the glue for it from the last of
its stretch.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.bead.rings import SIDES, Mesh, Rings, joined
from gantrysim.bead.section import Section
from gantrysim.bead.trace import BeadSettings, BeadTrace
from gantrysim.errors import GantryError
from gantrysim.run import Run

_DISTANCE = 2.0  # of the rings [mm]
_TURN = np.radians(15)  # of the trace, between two rings
_RINGS = (800, 4000)  # between the ends: with fewer a short bead looks coarse, more take longer than they show
_TURNED = np.radians([90, 90, 75, 60, 45, 30, 15, 0])  # of the rings of an end; the first is a point on its rim
_END = _TURNED.size
_WET = 1e-3  # of the nominal section, below which a stretch of bead has ended


class TooFewRingsError(GantryError, ValueError):
    """A bead asks for more rings than its mesh has."""


class Sweep:
    """Deposit of a run, for drawing.

    Args:
        run: the run.
        settings: how the glue lies.
        like: another, of as many rings, which stand as far apart as these, or further where they would not suffice; by
            default as many as length, turns and number of stretches ask for.

    Attributes:
        bead_trace: the bead.
        rings: number of rings.

    Raises:
        TooFewRingsError: the other's rings are too few for the ends of all stretches.
    """

    def __init__(self, run: Run, settings: BeadSettings | None = None, like: Sweep | None = None) -> None:
        self.bead_trace = BeadTrace(run, settings)
        self._kept: tuple[int, list[Mesh]] = (0, [])
        asked = float(self._asked[-1])
        ends = (2 * _END + 2) * max(len(self._stretches), 1)
        if like is None:
            self.rings = int(np.clip(np.ceil(asked), *_RINGS)) + ends
        else:
            self.rings = like.rings
        between = self.rings - ends
        if between <= 0:
            raise TooFewRingsError(f"rings of the mesh = {self.rings}: must be more than {ends}, for the bead's ends")
        self._step: float = max(asked / between, 0.0 if like is None else like._step)

    def faces(self) -> NDArray[np.int32]:
        """Triangles of the mesh, (f, 3)."""
        k, j = np.meshgrid(np.arange(self.rings - 1), np.arange(SIDES), indexing="ij")
        a = (k * (SIDES + 1) + j).ravel()
        b, c, d = a + 1, a + SIDES + 1, a + SIDES + 2
        return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]).astype(np.int32)

    def mesh(self, tick: int) -> Mesh:
        """Return the bead laid up to a tick, of all its rings."""
        laid, volume = float(self.bead_trace.length[tick]), float(self.bead_trace.volume[tick])
        begun = [k for k, (first, _) in enumerate(self._stretches) if self._from[first] <= laid]
        begun = [k for k in begun if self._held[self._stretches[k][0]] < volume]
        stops = [self._stretches[k][1] + 1 for k in begun]
        whole = sum(self._from[stop] <= laid and self._held[stop] <= volume for stop in stops)
        growing = [self._stretch(k, laid, volume) for k in begun[whole:]]
        return joined([*self._whole(whole), *growing] or [self._nothing]).of_length(self.rings)

    def _whole(self, count: int) -> list[Mesh]:
        """Return the first stretches as one mesh, if there are any; it is kept until the next of them is whole."""
        if count != self._kept[0]:
            there, mesh = self._kept if self._kept[0] < count else (0, [])
            added = [self._stretch(k, np.inf, np.inf) for k in range(there, count)]
            self._kept = count, [joined([*mesh, *added])] if count else []
        return self._kept[1]

    @property
    def _nothing(self) -> Mesh:
        """A point below the start of the trace."""
        point, up = 1e-3 * self._base[0], np.array([0.0, 0.0, 1.0])
        vertices, normals = (np.tile(part.astype(np.float32), (SIDES + 1, 1)) for part in (point, up))
        return Mesh(vertices, normals, np.zeros(1), np.zeros(1))

    @cached_property
    def _base(self) -> Floats:
        """Points of the surface below the stations, (r, 3) [mm]."""
        bead_trace = self.bead_trace
        return np.column_stack([bead_trace.point[:, :2], bead_trace.along(bead_trace.surface)])

    @cached_property
    def _asked(self) -> Floats:
        """Number of rings that the trace asks for up to each station, where there is glue, (r,)."""
        bead_trace = self.bead_trace
        steps = bead_trace.ds / _DISTANCE + np.abs(np.diff(bead_trace.heading)) / _TURN
        wet = np.zeros(steps.size, bool)
        for first, last in self._stretches:
            wet[first:last] = True
        return np.concatenate([[0.0], np.cumsum(steps * wet)])

    @cached_property
    def _between(self) -> list[Mesh]:
        """The rings of each stretch, without its ends."""
        bead_trace, meshes = self.bead_trace, []
        for first, last in self._stretches:
            asked = self._asked[first : last + 1]
            count = max(int(np.ceil((asked[-1] - asked[0]) / self._step)), 1) + 1 if self._step > 0 else 2
            # a station's own, or between two of them
            where = np.interp(np.linspace(asked[0], asked[-1], count), asked, bead_trace.place[first : last + 1])
            meshes.append(self._rings(where, np.zeros(count)).mesh(self._contact))
        return meshes

    def _rings(self, where: Floats, turned: Floats, section: Section | None = None) -> Rings:
        """Return rings at places of the trace, of the bead's own section there, or of another."""
        place = self.bead_trace.place
        point = np.stack([np.interp(where, place, self._base[:, i]) for i in range(3)], axis=1)
        if section is None:
            radius, flat = (np.interp(where, place, values) for values in self._shape)
        else:
            radius, flat = (np.full(where.size, values[0]) for values in (section.radius, section.flat))
        return Rings(point, np.interp(where, place, self.bead_trace.heading), radius, flat, turned, where)

    @cached_property
    def _shape(self) -> tuple[Floats, Floats]:
        """Radius and flat of the sections at the stations, (r,) each [mm]."""
        return self.bead_trace.section.radius, self.bead_trace.section.flat

    @property
    def _contact(self) -> float:
        return float(np.radians(self.bead_trace.settings.contact_angle))

    @cached_property
    def _from(self) -> Floats:
        """Where what the stations hold begins, (r + 1,) [mm]: a station stands in the middle of it."""
        bead_trace = self.bead_trace
        return np.clip((np.arange(bead_trace.place.size + 1) - 0.5) * bead_trace.ds, 0.0, bead_trace.place[-1])

    @cached_property
    def _held(self) -> Floats:
        """Glue up to `_from`, (r + 1,) [mm³]."""
        return np.concatenate([[0.0], np.cumsum(self.bead_trace.area * np.diff(self._from))])

    @cached_property
    def _stretches(self) -> list[tuple[int, int]]:
        """First and last station of each stretch of glue."""
        area = self.bead_trace.area
        least = _WET * (self.bead_trace.nominal if self.bead_trace.nominal > 0 else float(area.max()))
        edges = np.diff(np.concatenate([[0], (area > least).astype(np.int8), [0]]))
        return list(zip(np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True))

    @cached_property
    def _before(self) -> Floats:
        """Glue up to each station, (r,) [mm³]."""
        return np.interp(self.bead_trace.place, self._from, self._held)

    @cached_property
    def _half(self) -> Floats:
        """Glue of a round end at each station, (r,) [mm³]."""
        return self.bead_trace.section.half_body()

    @cached_property
    def _begins(self) -> list[float]:
        """Where the middle of the first end of each stretch is, inf where the stretch does not hold so much [mm]."""
        begins = []
        for first, last in self._stretches:
            part = slice(first, last + 1)
            begins.append(
                _crossing(self.bead_trace.place[part], self._before[part] - self._held[first] - self._half[part])
            )
        return begins

    def _stretch(self, number: int, laid: float, volume: float) -> Mesh:
        """Return what lies of a stretch while the nozzle is at a place of the trace [mm] and so much is laid [mm³]."""
        first, last = self._stretches[number]
        place, gap = self.bead_trace.place, self.bead_trace.section.gap
        stop = min(laid, float(self._from[last + 1]))
        upto = slice(first, max(int(np.searchsorted(place, stop, side="right")), first + 1))
        left = np.interp(stop, self._from, self._held) - self._before[upto] - self._half[upto]
        begin, end = self._begins[number], _crossing(place[upto][::-1], left[::-1])
        if not begin < end < np.inf:  # a drop that its two ends make
            middle = 0.5 * (float(self._from[first]) + stop)
            held = min(volume, float(self._held[last + 1])) - float(self._held[first])
            under = np.array([np.interp(middle, place, gap)])
            drop = Section.drop(held, under, self.bead_trace.settings.contact_angle)
            return joined([self._end(middle, -1.0, drop), self._end(middle, 1.0, drop)])
        between = self._between[number]
        rings = slice(*np.searchsorted(between.place, [begin, end], side="right").tolist())
        return joined([self._end(begin, -1.0), between.part(rings), self._end(end, 1.0)])

    def _end(self, at: float, sign: float, section: Section | None = None) -> Mesh:
        """Return the round end about a place of the trace, at a stretch's start (sign -1) or stop (1)."""
        mesh = self._rings(np.full(_END, at), sign * _TURNED, section).mesh(self._contact)
        vertices, normals = (part.reshape(_END, SIDES + 1, 3) for part in (mesh.vertices, mesh.normals))
        vertices[0] = vertices[0, 0]
        order = slice(None, None, -1 if sign > 0 else 1)
        return Mesh(vertices[order].reshape(-1, 3), normals[order].reshape(-1, 3), mesh.place, mesh.width)


def _crossing(place: Floats, values: Floats) -> float:
    """Return the first place where values are positive, between two stations; inf where they never are."""
    above = np.flatnonzero(values >= 0)
    if not above.size:
        return np.inf
    k = int(above[0])
    if k == 0:
        return float(place[0])
    return float(place[k] - (place[k] - place[k - 1]) * values[k] / (values[k] - values[k - 1]))
