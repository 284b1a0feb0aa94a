"""The body under the bead of a path that climbs.

Its top is a ledge along the dispensed part of the requested path: level across the path and below it by the gap. Faces
join the ledges of neighbouring turns. Glue is laid from above: where the path passes above itself the ledge is the
lower turn's, which leaves room for the needle, and the upper bead spans the distance. Where most of a path lies above
itself, as on a helix, it leans on a thin wall beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.trace import LEVEL_CLIMB, BeadTrace, climb
from gantrysim.metrics.analysis import Analysis
from gantrysim.record.run import Run

Triangles = NDArray[np.int32]

_SAMPLE_DISTANCE = 1.5  # distance of the samples along the path [mm]
_CLEARANCE = 0.09  # beside the needle [mm]
_FILM = 0.02  # thickness below which the body is not drawn [mm]
_LEVEL_COSINE = 0.05  # cosine of the climb, below which the path has no direction in plan view
_LEDGE_SHARE = 0.45  # half width of a ledge, relative to the distance to its neighbour
_BEND_SHARE = 0.8  # half width of a ledge, relative to the radius of curvature
_SAME_TURN = 6.0  # distance along the path that is still the same turn, in half widths
_ROUND_COSINE = 0.7  # cosine of the angle between two directions, below which there is a corner between them
_MOAT = 1.0  # between the ledge of a turn and higher ones beside it [mm]
_LEANING_SHARE = 0.5  # share of the path above itself, from which it leans on a wall
_WALL = 2.0  # thickness of a wall [mm]
_WALL_DISTANCE = 0.95  # distance of a wall to all turns, relative to the one to its own
_CAP = np.radians([-90, -60, -30, 0, 30, 60, 90])  # corners of a ledge's round end


class WorkPiece(NamedTuple):
    """A body on the work, open below.

    Attributes:
        vertices: in the work frame, (v, 3) [m].
        faces: triangles, counter-clockwise from outside, (f, 3).
    """

    vertices: Floats
    faces: Triangles


def workpiece(run: Run, bead: BeadSettings | BeadTrace | None = None, level: float = 0.0) -> WorkPiece | None:
    """Return the body under the bead of a run, or None where its dispensed path does not climb.

    What carries a level bead above the work is not known, and nothing is drawn for it.

    Args:
        run: the run.
        bead: settings of the bead, or the bead itself.
        level: z of the nozzle where it is the run's gap above the work [mm].
    """
    if not run.dispense.any() or climb(run.requested.table[1][:, 2]) <= LEVEL_CLIMB:
        return None
    bead_trace = BeadTrace.of(run, bead)
    width = float(bead_trace.nominal_section.width[0]) if bead_trace.nominal > 0 else 0.0
    track = _track(run, bead_trace.analysis, bead_trace.gap)
    if width <= 0 or track is None or climb(track.point[:, 2]) <= LEVEL_CLIMB:
        return None
    floor = level - run.gap
    clear = 0.5 * (width + run.face) + _CLEARANCE
    above, below = _stacked_samples(track, clear, width)
    parts = [_solid(track, _reach(track, width), clear, floor)]
    if above.mean() > _LEANING_SHARE:
        parts += _walls(track, ~below, clear, floor)
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]).astype(np.int32)
    if not len(faces):
        return None
    return WorkPiece(1e-3 * np.concatenate([part.vertices for part in parts]), faces)


@dataclass(frozen=True, eq=False)
class _Track:
    """Samples of the dispensed path, lowered by the gap.

    Attributes:
        s: arc length, (k,) [mm].
        point: (k, 3) [mm].
        along: direction in plan view, (k, 2).
        turning: curvature in plan view, (k,) [1/mm].
        stretch: number of the continuous stretch that a sample belongs to, ascending, (k,).
    """

    s: Floats
    point: Floats
    along: Floats
    turning: Floats
    stretch: NDArray[np.intp]

    @property
    def left_normals(self) -> Floats:
        """Left normals in plan view, (k, 2)."""
        return np.stack([-self.along[:, 1], self.along[:, 0]], axis=1)

    def select(self, mask: NDArray[np.bool_]) -> _Track:
        """Return the selected samples; a gap divides a stretch."""
        parts = np.cumsum(np.diff(mask.astype(np.int8), prepend=0) == 1)
        _, stretch = np.unique(np.stack([self.stretch, parts])[:, mask], axis=1, return_inverse=True)
        return _Track(self.s[mask], self.point[mask], self.along[mask], self.turning[mask], stretch.ravel())


def _track(run: Run, analysis: Analysis, gap: float) -> _Track | None:
    """Sample the requested path wherever the program dispenses; None without a direction in plan view."""
    corners = run.requested.corners
    interruptions = np.flatnonzero(np.diff(analysis.ticks) > 1) + 1
    samples = []
    for feet in np.split(analysis.commanded.s, interruptions):
        first = float(feet.min())
        last = float(feet.max())
        even = np.linspace(first, last, max(int(np.ceil((last - first) / _SAMPLE_DISTANCE)), 1) + 1)
        samples.append(np.union1d(even, corners[(first < corners) & (corners < last)]))
    s = np.concatenate(samples)
    stretch = np.repeat(np.arange(len(samples)), [len(part) for part in samples])
    local = run.requested.local(s)
    tangent = local.tangent[:, :2]
    level = np.linalg.norm(tangent, axis=1)
    inclined = level > _LEVEL_COSINE
    if inclined.sum() < 2:
        return None
    along = tangent[inclined] / level[inclined, None]
    place = local.position[inclined] - [0.0, 0.0, gap]
    return _Track(s[inclined], place, along, local.turning[inclined] / level[inclined], stretch[inclined])


def _pairs(track: _Track, reach: float, width: float) -> tuple[NDArray[np.intp], Floats]:
    """Return pairs of samples of different turns within reach in plan view, (p, 2), and their distances, (p,)."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(track.point[:, :2]).query_pairs(reach, output_type="ndarray")
    other = np.abs(np.diff(track.s[pairs], axis=1)[:, 0]) > _SAME_TURN * width
    pairs = pairs[other]
    return pairs, np.linalg.norm(np.diff(track.point[pairs][..., :2], axis=1)[:, 0], axis=1)


def _stacked_samples(track: _Track, clear: float, width: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which samples have another turn below them, and which have one above, (k,) each."""
    pairs, _ = _pairs(track, clear, width)
    rise = np.diff(track.point[pairs, 2], axis=1)[:, 0]
    apart = np.abs(rise) > width
    pairs = pairs[apart]
    rise = rise[apart]
    upper = np.where(rise > 0, pairs[:, 1], pairs[:, 0])
    lower = np.where(rise > 0, pairs[:, 0], pairs[:, 1])
    above, below = np.zeros((2, len(track.s)), bool)
    above[upper] = True
    below[lower] = True
    return above, below


def _reach(track: _Track, width: float) -> Floats:
    """Return the half widths of the ledge, (k,) [mm]: the bead's width, or less beside other turns and in bends."""
    reach = np.full(len(track.s), width)
    pairs, apart = _pairs(track, width / _LEDGE_SHARE, width)
    for end in range(2):
        np.minimum.at(reach, pairs[:, end], _LEDGE_SHARE * apart)
    return np.minimum(reach, _BEND_SHARE / np.maximum(np.abs(track.turning), 1e-9))


def _solid(track: _Track, reach: Floats, clear: float, floor: float) -> WorkPiece:
    """Triangulate the ledges and the faces between them in plan view, and add a skirt from the rim to the floor."""
    from scipy.spatial import Delaunay

    reach = np.maximum(reach, clear)
    ends = np.flatnonzero(np.diff(track.stretch, prepend=-1) > 0)
    tips = np.concatenate([ends, np.append(ends[1:], len(track.s)) - 1])
    count = len(track.s)
    samples = np.arange(count)
    # sample of each corner: the middle, left and right of a ledge, then its round ends
    sample = np.concatenate([samples, samples, samples, np.repeat(tips, len(_CAP))])
    round_ends = np.repeat([-1.0, 1.0], len(ends))[:, None] * np.cos(_CAP)
    ahead = np.concatenate([np.zeros(3 * count), round_ends.ravel()]) * reach[sample]
    aside = np.concatenate([np.repeat([0.0, 1.0, -1.0], count), np.tile(np.sin(_CAP), len(tips))]) * reach[sample]
    plan = track.point[sample, :2] + ahead[:, None] * track.along[sample] + aside[:, None] * track.left_normals[sample]
    height = np.maximum(_ceiling(track, plan, sample, clear), floor)
    faces = Delaunay(plan).simplices
    a, b, c = np.moveaxis(plan[faces], 1, 0)
    double_area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces = np.where((double_area > 0)[:, None], faces, faces[:, ::-1])
    faces = faces[(np.abs(double_area) > 1e-9) & (height[faces].max(axis=1) > floor + _FILM)]
    top = np.column_stack([plan, height])
    rim = _rim(faces)
    foot = np.column_stack([plan, np.full(len(plan), floor)])
    skirt = _band(rim[:, 0] + len(top), rim[:, 1] + len(top), rim[:, 0] + 2 * len(top), rim[:, 1] + 2 * len(top))
    # separate vertices keep the edge sharp
    vertices = np.concatenate([top, top, foot])
    skirt = skirt[vertices[skirt, 2].max(axis=1) > floor]
    return WorkPiece(vertices, np.concatenate([faces, skirt]).astype(np.int32))


def _ceiling(track: _Track, plan: Floats, sample: NDArray[np.intp], clear: float) -> Floats:
    """Return the heights of corners, (v,) [mm]: that of their sample, or of a lower turn nearby."""
    from scipy.spatial import cKDTree

    near = cKDTree(plan).sparse_distance_matrix(cKDTree(track.point[:, :2]), clear + _MOAT, output_type="ndarray")
    corner = near["i"]
    nearby = near["j"]
    sample_of_corner = sample[corner]
    other_turn = np.abs(track.s[sample_of_corner] - track.s[nearby]) > _SAME_TURN * clear
    other_turn |= np.einsum("ij,ij->i", track.along[sample_of_corner], track.along[nearby]) < _ROUND_COSINE
    height = track.point[sample, 2].copy()
    np.minimum.at(height, corner[other_turn], track.point[nearby[other_turn], 2])
    return height


def _rim(faces: Triangles) -> Triangles:
    """Return the edges of a single triangle, in its sense of rotation, (e, 2)."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, where, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return edges[where[count == 1]]


def _band(a: NDArray[np.integer], b: NDArray[np.integer], c: NDArray[np.integer], d: NDArray[np.integer]) -> Triangles:
    """Return triangles of quadrilaterals with upper edges a to b and lower edges c to d, seen from outside."""
    return np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)]).astype(np.int32)


def _walls(track: _Track, top: NDArray[np.bool_], clear: float, floor: float) -> list[WorkPiece]:
    """Return walls as high as the top turn, on its inner side, clear of bead and needle."""
    from scipy.spatial import cKDTree

    side = np.where(track.turning < 0, -1.0, 1.0)
    near = track.point[:, :2] + (clear * side)[:, None] * track.left_normals
    far = track.point[:, :2] + ((clear + _WALL) * side)[:, None] * track.left_normals
    distance, _ = cKDTree(track.point[:, :2]).query(near)
    # in sharper bends the wall would fold
    stands = top & (distance > _WALL_DISTANCE * clear) & ((clear + _WALL) * np.abs(track.turning) < 1)
    upper = track.select(stands)
    side = side[stands]
    near = near[stands]
    far = far[stands]
    walls = []
    for number in np.unique(upper.stretch):
        rows = np.flatnonzero(upper.stretch == number)
        if len(rows) < 2:
            continue
        high = upper.point[rows, 2:]
        low = np.full_like(high, floor)
        edges = ((near[rows], high), (near[rows], low), (far[rows], low), (far[rows], high))
        corners = [np.hstack(edge) for edge in edges]
        walls.append(_box(corners if side[rows[0]] > 0 else corners[::-1]))
    return walls


def _box(corners: list[Floats]) -> WorkPiece:
    """Return a bar from the four edges along it, (m, 3) each, counter-clockwise seen from its end."""
    m = len(corners[0])
    vertices = []
    faces = []
    i = np.arange(m - 1)
    for k in range(4):
        start = 2 * k * m
        vertices += [corners[k], corners[(k + 1) % 4]]
        faces.append(_band(start + i, start + i + 1, start + m + i, start + m + i + 1))
    start = 8 * m
    for end, order in ((0, (0, 3, 2, 1)), (-1, (0, 1, 2, 3))):
        vertices.append(np.stack([corner[end] for corner in corners]))
        p, q, r, t = (start + k for k in order)
        faces.append(np.array([[p, q, r], [p, r, t]], np.int32))
        start += 4
    return WorkPiece(np.concatenate(vertices), np.concatenate(faces))
