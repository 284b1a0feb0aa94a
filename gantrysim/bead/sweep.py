"""The bead as one swept mesh of a fixed number of rings: its section along the trace, with round ends.

Rings stand where there is glue, by distance and turn of the trace. Those not yet laid collapse onto the end of the
growing bead, so that its cost hardly depends on its length. As on the height map an end is half the body of revolution
of the section, made of the last glue of its stretch.
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
_RINGS = (800, 4000)  # between the ends: fewer look coarse, more cost time that nobody sees
_TURNED = np.radians([90, 90, 75, 60, 45, 30, 15, 0])  # of the rings of an end; the first is a point on its rim
_END = _TURNED.size


class TooFewRingsError(GantryError, ValueError):
    """A bead needs more rings than its mesh has."""


class Sweep:
    """The mesh of a run's bead.

    Args:
        run: the run.
        settings: shape of the bead.
        like: a mesh of whose number of rings and, if they suffice, distance this one is made; by default they follow
            from length, turns and number of stretches.

    Attributes:
        bead_trace: the bead.
        rings: number of rings.

    Raises:
        TooFewRingsError: too few rings for the ends of all stretches.
    """

    def __init__(self, run: Run, settings: BeadSettings | None = None, like: Sweep | None = None) -> None:
        self.bead_trace = BeadTrace(run, settings)
        self._stretches = self.bead_trace.wet_stretches
        self._kept: tuple[int, list[Mesh]] = (0, [])
        needed = float(self._needed[-1])
        ends = (2 * _END + 2) * max(len(self._stretches), 1)
        self.rings: int = int(np.clip(np.ceil(needed), *_RINGS)) + ends if like is None else like.rings
        if self.rings <= ends:
            raise TooFewRingsError(f"rings of the mesh = {self.rings}: must be more than {ends}, for the bead's ends")
        self._step: float = max(needed / (self.rings - ends), 0.0 if like is None else like._step)

    def faces(self) -> NDArray[np.int32]:
        """Triangles of the mesh, (f, 3)."""
        k, j = np.meshgrid(np.arange(self.rings - 1), np.arange(SIDES), indexing="ij")
        a = (k * (SIDES + 1) + j).ravel()
        b, c, d = a + 1, a + SIDES + 1, a + SIDES + 2
        return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]).astype(np.int32)

    def mesh(self, tick: int) -> Mesh:
        """Return the bead laid up to a tick, of all its rings."""
        laid, volume = float(self.bead_trace.length[tick]), float(self.bead_trace.volume[tick])
        begun = [
            k
            for k, (first, _) in enumerate(self._stretches)
            if self._edges[first] <= laid and self._held[first] < volume
        ]
        stops = [self._stretches[k][1] + 1 for k in begun]
        complete = sum(self._edges[stop] <= laid and self._held[stop] <= volume for stop in stops)
        growing = [self._stretch(k, laid, volume) for k in begun[complete:]]
        return joined([*self._complete(complete), *growing] or [self._nothing]).of_length(self.rings)

    def _complete(self, count: int) -> list[Mesh]:
        """Return the first stretches as one mesh, if there are any; cached until the next one is complete."""
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
    def _needed(self) -> Floats:
        """Number of rings needed up to each station, (r,)."""
        bead_trace = self.bead_trace
        steps = bead_trace.ds / _DISTANCE + np.abs(np.diff(bead_trace.heading)) / _TURN
        wet = np.zeros(steps.size, bool)
        for first, last in self._stretches:
            wet[first:last] = True
        return np.concatenate([[0.0], np.cumsum(steps * wet)])

    @cached_property
    def _between(self) -> list[Mesh]:
        """The rings of each stretch, without its ends."""
        meshes = []
        for first, last in self._stretches:
            needed, place = (values[first : last + 1] for values in (self._needed, self.bead_trace.place))
            count = max(int(np.ceil((needed[-1] - needed[0]) / self._step)), 1) + 1 if self._step > 0 else 2
            where = np.interp(np.linspace(needed[0], needed[-1], count), needed, place)
            meshes.append(self._rings(where, np.zeros(count)).mesh(self._contact))
        return meshes

    def _rings(self, where: Floats, turned: Floats, section: Section | None = None) -> Rings:
        """Return rings at places of the trace, of the bead's own section there or of another."""
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
    def _edges(self) -> Floats:
        """Edges of the stations' shares of the trace, (r + 1,) [mm]."""
        bead_trace = self.bead_trace
        return np.clip((np.arange(bead_trace.place.size + 1) - 0.5) * bead_trace.ds, 0.0, bead_trace.place[-1])

    @cached_property
    def _held(self) -> Floats:
        """Glue up to each edge, (r + 1,) [mm³]."""
        return np.concatenate([[0.0], np.cumsum(self.bead_trace.area * np.diff(self._edges))])

    @cached_property
    def _before(self) -> Floats:
        """Glue up to each station, (r,) [mm³]."""
        return np.interp(self.bead_trace.place, self._edges, self._held)

    @cached_property
    def _half(self) -> Floats:
        """Glue of a round end at each station, (r,) [mm³]."""
        return self.bead_trace.section.half_body()

    @cached_property
    def _starts(self) -> list[float]:
        """Middle of the first end of each stretch, inf for a stretch with too little glue [mm]."""
        place, glue = self.bead_trace.place, self._before
        parts = [slice(first, last + 1) for first, last in self._stretches]
        return [_crossing(place[p], glue[p] - self._held[p.start] - self._half[p]) for p in parts]

    def _stretch(self, number: int, laid: float, volume: float) -> Mesh:
        """Return the mesh of a stretch up to a place of the trace [mm] and a volume of the bead [mm³]."""
        first, last = self._stretches[number]
        place, gap = self.bead_trace.place, self.bead_trace.section.gap
        stop = min(laid, float(self._edges[last + 1]))
        upto = slice(first, max(int(np.searchsorted(place, stop, side="right")), first + 1))
        left = np.interp(stop, self._edges, self._held) - self._before[upto] - self._half[upto]
        begin, end = self._starts[number], _crossing(place[upto][::-1], left[::-1])
        if not begin < end < np.inf:  # a drop of two ends
            middle = 0.5 * (float(self._edges[first]) + stop)
            held = min(volume, float(self._held[last + 1])) - float(self._held[first])
            under = np.array([np.interp(middle, place, gap)])
            drop = Section.drop(held, under, self.bead_trace.settings.contact_angle)
            return joined([self._end(middle, -1.0, drop), self._end(middle, 1.0, drop)])
        between = self._between[number]
        rings = slice(*np.searchsorted(between.place, [begin, end], side="right").tolist())
        return joined([self._end(begin, -1.0), between.part(rings), self._end(end, 1.0)])

    def _end(self, at: float, sign: float, section: Section | None = None) -> Mesh:
        """Return the round end about a place of the trace, at the start (sign -1) or stop (1) of a stretch."""
        mesh = self._rings(np.full(_END, at), sign * _TURNED, section).mesh(self._contact)
        vertices, normals = (part.reshape(_END, SIDES + 1, 3) for part in (mesh.vertices, mesh.normals))
        vertices[0] = vertices[0, 0]
        order = slice(None, None, -1 if sign > 0 else 1)
        return Mesh(vertices[order].reshape(-1, 3), normals[order].reshape(-1, 3), mesh.place, mesh.width)


def _crossing(place: Floats, values: Floats) -> float:
    """Interpolate the first place where values are not negative; inf where all are."""
    above = values >= 0
    k = int(above.argmax())
    if k == 0:
        return float(place[0]) if above[0] else np.inf
    return float(place[k] - (place[k] - place[k - 1]) * values[k] / (values[k] - values[k - 1]))
