"""The bead as one swept mesh of a fixed number of rings: its section at stations along the trace, its ends round.

The stations are spread evenly over the whole trace. Of a bead that is still growing the rings not yet laid are
collapsed onto its end, so that its cost does not depend on its length. As on the height map an end is half the body
that the section makes when it turns about its middle, and takes the glue for it from the last of its stretch.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.bead.section import Section
from gantrysim.bead.strand import BeadSettings, Strand, surface_steps
from gantrysim.controllers.path import Floats
from gantrysim.run import Run

__all__ = ["Mesh", "Sweep"]

Singles = NDArray[np.float32]

_RING_DISTANCE = 2.0  # [mm]; a chord of it is 0.05 mm off a circle of 10 mm
_RINGS = (800, 8000)
_ANGLES = np.array([-4, -3, -2, -1, 0, 0, 0, 1, 2, 3, 4]) / 4  # of a section's vertices, of the contact angle
_FLAT = np.array([-1, -1, -1, -1, -1, 0, 1, 1, 1, 1, 1])  # on which side of the flat they are
_SIDES = 10  # facets of a section
_TURN = np.radians([90, 75, 60, 45, 30, 15])  # of the rings of an end, from its tip
_END = _TURN.size + 2  # rings of an end, with a point on its rim, and the section
_WET = 1e-3  # of the nominal section, below which a stretch of bead has ended


@dataclass(frozen=True, eq=False)
class Mesh:
    """The bead laid up to a tick.

    Attributes:
        vertices: in the work frame, (rings (sides + 1), 3) [m].
        normals: of unit length, (rings (sides + 1), 3).
        place: of each ring along the nozzle's trace, (rings,) [mm].
    """

    vertices: Singles
    normals: Singles
    place: Floats


@dataclass(frozen=True, eq=False)
class _Rings:
    """Rings about points on the surface, turned from across the trace by an angle towards where an end points."""

    point: Floats  # (k, 3) [mm]
    heading: Floats  # (k,) [rad]
    radius: Floats  # (k,) [mm]
    flat: Floats  # (k,) [mm]
    turned: Floats  # (k,) [rad], positive ahead
    place: Floats  # (k,) [mm]

    def mesh(self, contact: float) -> Mesh:
        """Return their vertices, for a contact angle [rad]."""
        nothing = np.zeros_like(self.heading)
        ahead = np.stack([np.cos(self.heading), np.sin(self.heading), nothing], axis=1)
        right = np.stack([ahead[:, 1], -ahead[:, 0], nothing], axis=1) * np.cos(self.turned)[:, None]
        ahead *= np.sin(self.turned)[:, None]
        angle = contact * _ANGLES
        across = self.radius[:, None] * np.sin(angle) + 0.5 * self.flat[:, None] * _FLAT
        height = self.radius[:, None] * (np.cos(angle) - np.cos(contact))
        up = np.array([0.0, 0.0, 1.0])

        def placed(sideways: Floats, upwards: Floats) -> Floats:
            level = sideways[..., None] * right[:, None] + np.abs(sideways)[..., None] * ahead[:, None]
            vectors: Floats = level + upwards[..., None] * up
            return vectors

        vertices = self.point[:, None] + placed(across, height)
        normals = placed(*np.broadcast_arrays(np.sin(angle), np.cos(angle) + 0 * across))
        return Mesh(
            (1e-3 * vertices.reshape(-1, 3)).astype(np.float32), normals.reshape(-1, 3).astype(np.float32), self.place
        )


class Sweep:
    """Deposit of a run, for drawing.

    Args:
        run: the run.
        settings: how the glue lies.
        rings: number of rings; by default as many as the length of the trace and the number of its ends ask for.

    Attributes:
        strand: the bead at the stations.
        rings: number of rings.
    """

    def __init__(self, run: Run, settings: BeadSettings | None = None, rings: int | None = None) -> None:
        ends = 2 * _END * max(int(np.count_nonzero(np.diff(run.asked > 0))), 1)  # with some in hand
        if rings is None:
            length = float(surface_steps(run.nozzle).sum())
            rings = int(np.clip(np.ceil(length / _RING_DISTANCE), *_RINGS)) + ends
        self.rings = rings
        self.strand = Strand(run, settings, stations=max(rings - ends, 2))
        self._kept: tuple[int, list[Mesh]] = (0, [])

    def faces(self) -> NDArray[np.int32]:
        """Triangles of the mesh, (f, 3)."""
        k, j = np.meshgrid(np.arange(self.rings - 1), np.arange(_SIDES), indexing="ij")
        a = (k * (_SIDES + 1) + j).ravel()
        b, c, d = a + 1, a + _SIDES + 1, a + _SIDES + 2
        return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]).astype(np.int32)

    def mesh(self, tick: int) -> Mesh:
        """Return the bead laid up to a tick."""
        laid, volume = float(self.strand.length[tick]), float(self.strand.volume[tick])
        begun = [ends for ends in self._stretches if self._from[ends[0]] <= laid and self._held[ends[0]] < volume]
        whole = sum(self._from[last + 1] <= laid and self._held[last + 1] <= volume for _, last in begun)
        growing = [self._stretch(*ends, laid, volume) for ends in begun[whole:]]
        return self._filled(_joined([*self._whole(whole), *growing] or [self._nothing]))

    def _whole(self, count: int) -> list[Mesh]:
        """Return the first stretches as one mesh, if there are any; it is kept until the next of them is whole."""
        if count != self._kept[0]:
            there, mesh = self._kept if self._kept[0] < count else (0, [])
            added = [self._stretch(*ends, np.inf, np.inf) for ends in self._stretches[there:count]]
            self._kept = count, [_joined([*mesh, *added])] if count else []
        return self._kept[1]

    @property
    def _nothing(self) -> Mesh:
        """A point below the start of the trace."""
        up = np.array([[0, 0, 1]], np.float32)
        return Mesh((1e-3 * self._base[:1]).astype(np.float32), up, np.zeros(1))

    @cached_property
    def _base(self) -> Floats:
        """Points of the surface below the stations, (r, 3) [mm]."""
        strand = self.strand
        return np.column_stack([strand.point[:, :2], strand.along(strand.surface)])

    @cached_property
    def _stations(self) -> Mesh:
        """The sections at all stations."""
        strand, section = self.strand, self.strand.section
        rings = _Rings(
            self._base, strand.heading, section.radius, section.flat, np.zeros_like(strand.place), strand.place
        )
        return rings.mesh(self._contact)

    @property
    def _contact(self) -> float:
        return float(np.radians(self.strand.settings.contact_angle))

    @cached_property
    def _from(self) -> Floats:
        """Where what the stations hold begins, (r + 1,) [mm]: a station stands in the middle of it."""
        strand = self.strand
        return np.clip((np.arange(strand.place.size + 1) - 0.5) * strand.ds, 0.0, strand.place[-1])

    @cached_property
    def _held(self) -> Floats:
        """Glue up to `_from`, (r + 1,) [mm³]."""
        return np.concatenate([[0.0], np.cumsum(self.strand.area * np.diff(self._from))])

    @cached_property
    def _stretches(self) -> list[tuple[int, int]]:
        """First and last station of each stretch of glue."""
        area = self.strand.area
        least = _WET * (self.strand.nominal if self.strand.nominal > 0 else float(area.max()))
        edges = np.diff(np.concatenate([[0], (area > least).astype(np.int8), [0]]))
        return list(zip(np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True))

    @cached_property
    def _before(self) -> Floats:
        """Glue up to each station, (r,) [mm³]."""
        return np.interp(self.strand.place, self._from, self._held)

    @cached_property
    def _half(self) -> Floats:
        """Glue of a round end at each station, (r,) [mm³]."""
        return self.strand.section.half_body()

    def _stretch(self, first: int, last: int, laid: float, volume: float) -> Mesh:
        """Return what lies of a stretch while the nozzle is at a place of the trace [mm] and so much is laid [mm³]."""
        strand, place = self.strand, self.strand.place
        stop = min(laid, self._from[last + 1])
        stations = slice(first, max(int(np.searchsorted(place, stop, side="right")), first + 1))
        half, before = self._half[stations], self._before[stations]
        begin = _crossing(place[stations], before - self._held[first] - half)
        end = _crossing(place[stations][::-1], (np.interp(stop, self._from, self._held) - before - half)[::-1])
        if begin is None or end is None or end <= begin:  # a drop that its two ends make
            middle = 0.5 * (self._from[first] + stop)
            gap = np.array([np.interp(middle, place, strand.section.gap)])
            held = min(volume, self._held[last + 1]) - self._held[first]
            drop = Section.drop(held, gap, strand.settings.contact_angle)
            return _joined([self._end(middle, -1.0, drop), self._end(middle, 1.0, drop)])
        between = slice(*np.searchsorted(place, [begin, end], side="right").tolist())
        rings = slice((_SIDES + 1) * between.start, (_SIDES + 1) * between.stop)
        middle_part = Mesh(self._stations.vertices[rings], self._stations.normals[rings], place[between])
        return _joined([self._end(begin, -1.0), middle_part, self._end(end, 1.0)])

    def _end(self, at: float, sign: float, section: Section | None = None) -> Mesh:
        """Return the round end about a place of the trace, at a stretch's start (sign -1) or stop (1)."""
        strand, place = self.strand, self.strand.place

        def there(values: Floats) -> Floats:
            return np.full(_END, np.interp(at, place, values))

        shape = strand.section if section is None else section
        radius, flat = (there(v) if section is None else np.full(_END, v[0]) for v in (shape.radius, shape.flat))
        point = np.stack([there(self._base[:, i]) for i in range(3)], axis=1)
        turned = sign * np.concatenate([[0.5 * np.pi], _TURN, [0.0]])
        mesh = _Rings(point, there(strand.heading), radius, flat, turned, np.full(_END, at)).mesh(self._contact)
        vertices = mesh.vertices.reshape(-1, _SIDES + 1, 3)
        vertices[0] = vertices[0, 0]
        normals = mesh.normals.reshape(-1, _SIDES + 1, 3)
        order = slice(None, None, -1 if sign > 0 else 1)
        return Mesh(vertices[order].reshape(-1, 3), normals[order].reshape(-1, 3), mesh.place)

    def _filled(self, mesh: Mesh) -> Mesh:
        """Return a mesh with all rings: those that it lacks lie on its last point; what is too much is left out."""
        kept = self.rings * (_SIDES + 1)
        lacking = max(kept - len(mesh.vertices), 0)
        place = np.pad(mesh.place, (0, max(self.rings - mesh.place.size, 0)), mode="edge")
        vertices, normals = (
            np.concatenate([part, part[-1:].repeat(lacking, axis=0)])[:kept] for part in (mesh.vertices, mesh.normals)
        )
        return Mesh(vertices, normals, place[: self.rings])


def _crossing(place: Floats, values: Floats) -> float | None:
    """Return the first place where values become positive, between two stations; None where they never do."""
    above = np.flatnonzero(values >= 0)
    if not above.size:
        return None
    k = int(above[0])
    if k == 0:
        return float(place[0])
    return float(place[k] - (place[k] - place[k - 1]) * values[k] / (values[k] - values[k - 1]))


def _joined(parts: list[Mesh]) -> Mesh:
    """Return meshes as one, one after the other."""
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.place for part in parts]),
    )
