"""The bead as one swept mesh of a fixed number of rings: its section along the trace, with round ends.

Rings stand where there is glue, by distance and turn of the trace. Those not yet laid collapse onto the end of the
growing bead, so that its cost hardly depends on its length. As on the height map an end is half the body of revolution
of the section, made of the last glue of its stretch. A dot is a cap.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import GantryError
from gantrysim.glue.bead.dots import Cap
from gantrysim.glue.bead.section import BeadSettings, Section
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.record.run import Run

# The rings of a bead's mesh.

Singles = NDArray[np.float32]

SIDES = 12  # facets of a section
_ANGLES = np.array([4, 3, 2, 1, 0, 0, 0, 0, 0, 1, 2, 3, 4]) / 4  # of a section's vertices, over the contact angle
_SIDE = np.array([-1, -1, -1, -1, -1, -1, 0, 1, 1, 1, 1, 1, 1])  # of the flat that they are on
_FLOOR = np.array([0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0])  # whether they are on the flat
_RIM = np.array([0, 0, 0, 0, 1, 1, 0, 1, 1, 0, 0, 0, 0])  # whether they are on a groove's walls


@dataclass(frozen=True, eq=False)
class Mesh:
    """Rings of vertices.

    Attributes:
        vertices: in the work frame, (rings (SIDES + 1), 3) [m].
        normals: of unit length, (rings (SIDES + 1), 3).
        place: of each ring along the nozzle's trace, (rings,) [mm].
        width: of the bead at each ring, (rings,) [mm].
        centre: of each ring on the surface, (rings, 3) [m].
    """

    vertices: Singles
    normals: Singles
    place: Floats
    width: Floats
    centre: Singles

    def of_length(self, rings: int) -> Mesh:
        """Return the mesh padded to a number of rings, which collapse onto its last point."""
        lacking = rings - self.place.size
        return Mesh(
            np.pad(self.vertices, ((0, lacking * (SIDES + 1)), (0, 0)), mode="edge"),
            np.pad(self.normals, ((0, lacking * (SIDES + 1)), (0, 0)), mode="edge"),
            np.pad(self.place, (0, lacking), mode="edge"),
            np.pad(self.width, (0, lacking), mode="edge"),
            np.pad(self.centre, ((0, lacking), (0, 0)), mode="edge"),
        )

    def part(self, rings: slice) -> Mesh:
        """Return a range of rings."""
        lines = slice((SIDES + 1) * rings.start, (SIDES + 1) * rings.stop)
        return Mesh(self.vertices[lines], self.normals[lines], self.place[rings], self.width[rings], self.centre[rings])


_ARRAYS = [field.name for field in fields(Mesh)]


def faces(count: int) -> NDArray[np.int32]:
    """Return the triangles between rings, (f, 3)."""
    k, j = np.meshgrid(np.arange(count - 1), np.arange(SIDES), indexing="ij")
    a = (k * (SIDES + 1) + j).ravel()
    b = a + 1
    c = a + SIDES + 1
    d = a + SIDES + 2
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]).astype(np.int32)


def rings(
    point: Floats,
    heading: Floats,
    shape: tuple[Floats, Floats, Floats],
    turned: Floats,
    place: Floats,
    contact: float,
) -> Mesh:
    """Return sections about points on the surface, whose halves are both turned ahead from across the trace.

    Turned from 90 to 0 deg about one point they make half a body of revolution.

    Args:
        point: points on the surface, (k, 3) [mm].
        heading: heading of the trace, (k,) [rad].
        shape: radius, flat and groove of the sections, (k,) each [mm].
        turned: angle ahead, (k,) [rad].
        place: place along the trace, (k,) [mm].
        contact: contact angle [rad].
    """
    radius = shape[0][:, None]
    flat = shape[1][:, None]
    groove = shape[2][:, None]
    nothing = np.zeros_like(heading)
    ahead = np.stack([np.cos(heading), np.sin(heading), nothing], axis=1)
    right = np.stack([ahead[:, 1], -ahead[:, 0], nothing], axis=1) * np.cos(turned)[:, None]
    ahead *= np.sin(turned)[:, None]
    outwards = _SIDE[:, None] * right[:, None] + ahead[:, None]
    up = np.array([0.0, 0.0, 1.0])
    angle = contact * _ANGLES
    beside = (radius * np.sin(angle) + 0.5 * flat) * np.abs(_SIDE)
    height = radius * (np.cos(angle) - np.cos(contact)) - groove * _FLOOR
    # the shading rounds a groove, as a mesh has one normal at an edge
    lean = angle - np.arctan2(groove, flat) * _RIM
    vertices = point[:, None] + beside[..., None] * outwards + height[..., None] * up
    normals = np.sin(lean)[..., None] * outwards + np.cos(lean)[..., None] * up
    return Mesh(
        (1e-3 * vertices.reshape(-1, 3)).astype(np.float32),
        normals.reshape(-1, 3).astype(np.float32),
        place,
        (2 * radius * np.sin(contact) + flat)[:, 0],
        (1e-3 * point).astype(np.float32),
    )


def joined_meshes(parts: list[Mesh]) -> Mesh:
    """Return meshes as one, in their order."""
    return Mesh(*(np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS))


_DISTANCE = 2.0  # of the rings [mm]
_TURN = np.radians(15)  # of the trace, between two rings
_RINGS = (800, 4000)  # between the ends: fewer look coarse, more cost time that nobody sees
_RING_ANGLES = np.radians([90, 90, 75, 60, 45, 30, 15, 0])  # of the rings of an end; the first is a point on its rim
_END = _RING_ANGLES.size


class TooFewRingsError(GantryError, ValueError):
    """A bead needs more rings than its mesh has."""


class Sweep:
    """The mesh of a run's bead.

    Args:
        run: the run.
        bead: settings of the bead, or the bead itself.
        like: a mesh with the same number of rings, at least as close to each other; by default both follow from length,
            turns and stretches of the bead.

    Attributes:
        bead_trace: the bead.
        surface: height of the surface below the nozzle at each tick, (n,) [mm].
        rings: number of rings.

    Raises:
        TooFewRingsError: too few rings for the ends of all stretches.
    """

    def __init__(self, run: Run, bead: BeadSettings | BeadTrace | None = None, like: Sweep | None = None) -> None:
        trace = self.bead_trace = BeadTrace.of(run, bead)
        self._stretches = trace.wet_stretches
        steps = trace.ds / _DISTANCE + np.abs(np.diff(trace.heading)) / _TURN
        wet = np.zeros(steps.size, bool)
        for first, after in self._stretches:
            wet[first : after - 1] = True
        # rings up to each station
        self._needed: Floats = np.concatenate([[0.0], np.cumsum(steps * wet)])
        needed = float(self._needed[-1])
        ends = (2 * _END + 2) * max(len(self._stretches), 1) + 2 * _END * len(trace.dots)
        self.rings: int = int(np.clip(np.ceil(needed), *_RINGS)) + ends if like is None else like.rings
        if self.rings <= ends:
            raise TooFewRingsError(f"rings of the mesh = {self.rings}: must be more than {ends}, for the bead's ends")
        self._step: float = max(needed / (self.rings - ends), 0.0 if like is None else like._step)
        self.surface = trace.surface()
        # surface below the stations
        self._base = np.column_stack([trace.point[:, :2], trace.along(self.surface)])
        # edges of the stations' shares of the trace, glue up to these and to the stations, and glue of an end there
        self._edges = np.clip((np.arange(trace.place.size + 1) - 0.5) * trace.ds, 0.0, trace.place[-1])
        self._held = np.concatenate([[0.0], np.cumsum(trace.area * np.diff(self._edges))])
        self._before = np.interp(trace.place, self._edges, self._held)
        self._half = trace.strand.half_body()
        self._finished: tuple[int, list[Mesh]] = (0, [])
        # stretches and dots in the order in which they are laid: whether it is a dot, and its number
        starts = [int(np.searchsorted(trace.length, self._edges[first])) for first in self._stretches[:, 0].tolist()]
        self._order: list[tuple[int, bool, int]] = sorted(
            [(tick, False, k) for k, tick in enumerate(starts)]
            + [(dot.stretch[0], True, k) for k, dot in enumerate(trace.dots)]
        )

    def faces(self) -> NDArray[np.int32]:
        """Triangles of the mesh, (f, 3)."""
        return faces(self.rings)

    def mesh(self, tick: int) -> Mesh:
        """Return the bead laid up to a tick, of all its rings."""
        return self.laid(tick).of_length(self.rings)

    def laid(self, tick: int) -> Mesh:
        """Return the bead laid up to a tick, of the rings that this takes; one below the start if it is none."""
        laid = float(self.bead_trace.length[tick])
        volume = float(self.bead_trace.volume[tick])
        begun: list[tuple[bool, int]] = []
        complete = 0
        for start_tick, is_dot, number in self._order:
            if start_tick > tick:
                break
            if is_dot:
                dot = self.bead_trace.dots[number]
                has_begun = dot.stretch[0] < tick and dot.volume > 0
                is_complete = dot.share[1] <= tick
            else:
                start, stop = self._stretches[number].tolist()
                has_begun = self._edges[start] <= laid and self._held[start] < volume
                is_complete = self._edges[stop] <= laid and self._held[stop] <= volume
            if has_begun:
                # each is complete before the next one begins
                complete += is_complete and complete == len(begun)
                begun.append((is_dot, number))
        growing = [
            self._dot(number, tick) if is_dot else self._stretch(number, laid, volume)
            for is_dot, number in begun[complete:]
        ]
        return joined_meshes([*self._complete(begun[:complete]), *growing] or [self._nothing])

    def _complete(self, parts: list[tuple[bool, int]]) -> list[Mesh]:
        """Return the first parts as one mesh, if there are any; cached until the next one is complete."""
        count = len(parts)
        if count != self._finished[0]:
            before, mesh = self._finished if self._finished[0] < count else (0, [])
            last = len(self.bead_trace.run.time) - 1
            added = [
                self._dot(number, last) if is_dot else self._stretch(number, np.inf, np.inf)
                for is_dot, number in parts[before:]
            ]
            self._finished = (count, [joined_meshes([*mesh, *added])] if count else [])
        return self._finished[1]

    def _dot(self, number: int, tick: int) -> Mesh:
        """Return the mesh of a dot as laid up to a tick."""
        trace = self.bead_trace
        dot = trace.dots[number]
        run = trace.run
        first, after = dot.share
        laid = float(run.flow[first : min(after, tick)].sum()) * run.period
        cap = Cap.of(min(laid, dot.volume), trace.settings)
        angle = 2 * float(np.arctan2(cap.height, cap.radius))
        sphere = np.full(_END, cap.radius / np.sin(angle) if angle else 0.0)
        point = np.tile(dot.foot, (_END, 1))
        flat = np.zeros(_END)
        place = np.full(_END, trace.length[dot.stretch[0]])
        halves = [rings(point, flat, (sphere, flat, flat), sign * _RING_ANGLES, place, angle) for sign in (-1.0, 1.0)]
        return joined_meshes([_closed_end(half, sign) for half, sign in zip(halves, (-1.0, 1.0), strict=True)])

    @property
    def _nothing(self) -> Mesh:
        """A point below the start of the trace."""
        point = 1e-3 * self._base[0]
        up = np.array([0.0, 0.0, 1.0])
        vertices = np.tile(point.astype(np.float32), (SIDES + 1, 1))
        normals = np.tile(up.astype(np.float32), (SIDES + 1, 1))
        return Mesh(vertices, normals, np.zeros(1), np.zeros(1), vertices[:1])

    @cached_property
    def _between(self) -> list[Mesh]:
        """The rings of each stretch, without its ends."""
        meshes = []
        for first, after in self._stretches:
            needed = self._needed[first:after]
            place = self.bead_trace.place[first:after]
            count = max(int(np.ceil((needed[-1] - needed[0]) / self._step)), 1) + 1 if self._step > 0 else 2
            where = np.interp(np.linspace(needed[0], needed[-1], count), needed, place)
            meshes.append(self._rings(where, np.zeros(count)))
        return meshes

    def _rings(self, where: Floats, turned: Floats, section: Section | None = None) -> Mesh:
        """Return rings at places of the trace, of the bead's own section there or of another."""
        trace = self.bead_trace
        point = np.stack([np.interp(where, trace.place, self._base[:, i]) for i in range(3)], axis=1)
        if section is None:
            shape = _Shape(*(np.interp(where, trace.place, values) for values in self._shape))
        else:
            shape = _Shape(*(np.full(where.size, values[0]) for values in _shape_of(section)))
        heading = np.interp(where, trace.place, trace.heading)
        contact = float(np.radians(trace.settings.contact_angle))
        return rings(point, heading, shape, turned, where, contact)

    @cached_property
    def _shape(self) -> _Shape:
        """The sections at the stations."""
        return _shape_of(self.bead_trace.strand)

    @cached_property
    def _starts(self) -> list[float]:
        """Middle of the first end of each stretch, inf for a stretch with too little glue [mm]."""
        place = self.bead_trace.place
        glue = self._before
        parts = [slice(first, after) for first, after in self._stretches]
        return [_crossing(place[p], glue[p] - self._held[p.start] - self._half[p]) for p in parts]

    def _stretch(self, number: int, laid: float, volume: float) -> Mesh:
        """Return the mesh of a stretch up to a place of the trace [mm] and a volume of the bead [mm³]."""
        first, after = self._stretches[number]
        place = self.bead_trace.place
        gap = self.bead_trace.section.gap
        stop = min(laid, float(self._edges[after]))
        upto = slice(first, max(int(np.searchsorted(place, stop, side="right")), first + 1))
        missing = np.interp(stop, self._edges, self._held) - self._before[upto] - self._half[upto]
        begin = self._starts[number]
        end = _crossing(place[upto][::-1], missing[::-1])
        if not begin < end < np.inf:  # a drop of two ends
            middle = 0.5 * (float(self._edges[first]) + stop)
            held = min(volume, float(self._held[after])) - float(self._held[first])
            under = np.array([np.interp(middle, place, gap)])
            drop = self.bead_trace.drop(held, under)
            return joined_meshes([self._end(middle, -1.0, drop), self._end(middle, 1.0, drop)])
        between = self._between[number]
        part = slice(*np.searchsorted(between.place, [begin, end], side="right").tolist())
        return joined_meshes([self._end(begin, -1.0), between.part(part), self._end(end, 1.0)])

    def _end(self, place: float, sign: float, section: Section | None = None) -> Mesh:
        """Return the round end about a place of the trace, at the start (sign -1) or stop (1) of a stretch."""
        return _closed_end(self._rings(np.full(_END, place), sign * _RING_ANGLES, section), sign)


def _closed_end(mesh: Mesh, sign: float) -> Mesh:
    """Return the rings of a round end as a part of a bead: they begin or end in a point on its rim."""
    vertices = mesh.vertices.reshape(_END, SIDES + 1, 3)
    normals = mesh.normals.reshape(_END, SIDES + 1, 3)
    vertices[0] = vertices[0, 0]
    order = slice(None, None, -1 if sign > 0 else 1)
    # all its rings stand about one place
    return replace(mesh, vertices=vertices[order].reshape(-1, 3), normals=normals[order].reshape(-1, 3))


class _Shape(NamedTuple):
    """Radius, flat and groove of sections, (r,) each [mm]."""

    radius: Floats
    flat: Floats
    groove: Floats


def _shape_of(section: Section) -> _Shape:
    return _Shape(section.radius, section.flat, section.groove)


def _crossing(place: Floats, values: Floats) -> float:
    """Interpolate the first place where values are not negative; inf where all are."""
    above = values >= 0
    k = int(above.argmax())
    if k == 0:
        return float(place[0]) if above[0] else np.inf
    return float(place[k] - (place[k] - place[k - 1]) * values[k] / (values[k] - values[k - 1]))
