"""The height map of the glue on the work, which conserves volume."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats
from gantrysim.bead.laying import cover, drop, headroom, lay
from gantrysim.bead.pushing import means, push_aside
from gantrysim.bead.section import Section
from gantrysim.bead.trace import BeadTrace
from gantrysim.errors import InputError

_SAMPLES = 3.0  # per cell, across the bead and along it
_MARGIN = 4  # cells around the bead
_SPREADING = 0.25  # further margin, of the bead's width
_MOST_CELLS = 2e7
_WIDEST = 1 / 3  # cell, of the nominal width
_BLOCK = 8  # cells in a row that make one of the coarse map
_EVEN = 1e-3  # of the gap; smaller changes of the nozzle's height are ignored
_RIPPLE = 0.02  # unevenness of a flat, of the nozzle's height
_SPREAD = 0.5  # distance over which excess beside the face spreads, of the nominal width
_SWEEPS = 5000  # in which the nozzle pushes glue aside
_TRIAL = 300  # the same on the coarse map

_End = tuple[Floats, Floats, float, float]


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Height of the glue over the surface, on a grid in the work frame.

    The bead is laid along the trace, three samples to a cell, and across it as the section's profile times
    1 - kappa u, with the trace's curvature kappa and the distance u to its left, as the inner side of a bend is
    shorter. Its ends are round, half the body of revolution of the section. Where beads overlap their heights add.

    The needle's face pushes what is higher than it aside, for the whole map at once, whatever the order of the turns.
    Beside the face, glue has room up to the height of the beads laid there; what exceeds that rises, spread over about
    half a bead's width. What the face cannot push aside is the `ridge`. A bead that is not squashed is not pushed. Only
    a nozzle that lays glue pushes. All steps conserve volume.

    Attributes:
        x, y: middles of the cells, (nx,) and (ny,) [mm].
        height: mean height over each cell, (ny, nx) [mm].
        contact: height at the rim of a nominal bead, as the cells blur it [mm].
        ridge: height of remaining glue above the nozzle, over that of the nozzle; 0 where the map has settled.
    """

    x: Floats
    y: Floats
    height: Floats
    contact: float
    ridge: float = 0.0

    @classmethod
    def of(cls, bead: BeadTrace) -> HeightMap:
        """Return the map of a bead.

        Raises:
            InputError: cells that are too small, so that there are too many, or too large for the bead's width.
        """
        cell = bead.settings.cell
        width = float(bead.nominal_section.width[0])
        if cell > _WIDEST * width > 0:
            raise InputError(
                f"cell = {cell:g} mm: must be at most {_WIDEST * width:.4g} mm, a third of the bead's width of "
                f"{width:.4g} mm"
            )
        # before any array as long as the bead is wide
        _check_cells(bead, (np.ptp(bead.point[:, :2], axis=0) + width) / cell)
        volume = 0.5 * (bead.area[1:] + bead.area[:-1]) * bead.ds
        wet = volume.copy()
        ends = list(_round_ends(bead, volume))
        x, y = _grid(bead, volume, ends)
        glue = np.zeros((y.size, x.size))
        upright = _upright(bead)
        uneven = bead.settings.squashed and bool(np.ptp(upright) > _EVEN * bead.gap)
        none = np.zeros((0, 0))
        moment = np.zeros_like(glue) if uneven else none
        crest = np.zeros_like(glue) if bead.settings.squashed else none
        for points, shares, gap, top in ends:
            place = ((points[:, 0] - x[0]) / cell, (points[:, 1] - y[0]) / cell)
            drop(glue, moment, crest, *place, shares, gap, top)
        at = ((bead.point[:, 0] - x[0]) / cell, (bead.point[:, 1] - y[0]) / cell)
        trace = (bead.heading, np.gradient(bead.heading, bead.ds))
        shape = bead.section
        sections = (bead.area, 0.5 * shape.width, 0.5 * shape.flat, shape.groove, shape.radius)
        heights = (upright, shape.height * upright / bead.nozzle_height)
        cosine = math.cos(math.radians(bead.settings.contact_angle))
        steps = max(math.ceil(bead.ds * _SAMPLES / cell), 1)
        lay(glue, moment, crest, (*at, *trace, *sections, *heights), volume, cosine, cell, steps, _SAMPLES)
        height, excess = glue / cell**2, 0.0
        if bead.settings.squashed:
            under = np.full_like(glue, float(math.isinf(bead.run.face)))
            if not under.all():
                cover(under, *at, wet, 0.5 * bead.run.face / cell)
            ceiling, rise = headroom(under, glue, moment, crest, bead.gap, _rise(bead))
            x, y, height, ceiling, rise = _with_room(bead, x, y, height, ceiling, rise)
            excess = push_aside(height, ceiling, rise, _RIPPLE, _SWEEPS)
        return cls(x, y, height, _contact(bead, cell), excess if excess > 2 * _RIPPLE else 0.0)

    @property
    def cell(self) -> float:
        """Size of a cell [mm]."""
        return float(self.x[1] - self.x[0])

    @property
    def volume(self) -> float:
        """Volume on the map [mm³]."""
        return float(self.height.sum()) * self.cell**2

    def at(self, points: ArrayLike) -> Floats:
        """Return the height at points in plan view, bilinear between the cells' middles, 0 off the map.

        Args:
            points: (..., 2), or with further columns, which are ignored [mm].
        """
        place = np.asarray(points, float)
        column, row = (place[..., 0] - self.x[0]) / self.cell, (place[..., 1] - self.y[0]) / self.cell
        inside = (column >= 0) & (row >= 0) & (column < self.x.size - 1) & (row < self.y.size - 1)
        column, row = np.where(inside, column, 0.0), np.where(inside, row, 0.0)
        i, j = column.astype(np.intp), row.astype(np.intp)
        a, b = column - i, row - j
        h = self.height
        low = (1 - a) * h[j, i] + a * h[j, i + 1]
        high = (1 - a) * h[j + 1, i] + a * h[j + 1, i + 1]
        return np.where(inside, (1 - b) * low + b * high, 0.0)

    def wet(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether there is glue at points, as `at` takes them."""
        return self.at(points) > self.contact


def _grid(bead: BeadTrace, volume: Floats, ends: list[_End]) -> tuple[Floats, Floats]:
    """Middles of the cells of the bead and its margin, (nx,) and (ny,) [mm]."""
    cell = bead.settings.cell
    laid = np.flatnonzero(volume > 0)
    places = [bead.point[:1, :2], *(points for points, *_ in ends)]
    for stations in (laid, laid + 1):
        half = 0.5 * bead.width[stations, None]
        places += [bead.point[stations, :2] - half, bead.point[stations, :2] + half]
    covered = np.concatenate(places)
    low, high = covered.min(axis=0), covered.max(axis=0)
    around = _MARGIN * cell + _SPREADING * float(bead.width[laid].max(initial=0.0))
    low = np.floor((low - around) / cell) * cell
    count = np.ceil((high + around - low) / cell) + 1
    _check_cells(bead, count)
    nx, ny = int(count[0]), int(count[1])
    return low[0] + cell * np.arange(nx), low[1] + cell * np.arange(ny)


def _check_cells(bead: BeadTrace, count: ArrayLike) -> None:
    cells = float(np.prod(np.asarray(count, float)))
    if not cells <= _MOST_CELLS:
        raise InputError(
            f"cell = {bead.settings.cell:g} mm: the height map of a bead {float(bead.nominal_section.width[0]):.4g} mm "
            f"wide, {float(bead.width.max()):.4g} mm at its widest, has {cells:.3g} cells, at most {_MOST_CELLS:g}"
        )


def _rise(bead: BeadTrace) -> float:
    """Rise of a free surface that spreads excess over a share of the nominal width; see `push_aside`."""
    spread = _SPREAD * float(bead.nominal_section.width[0])
    return (0.5 * bead.settings.cell / spread) ** 2 if spread > 0 and math.isfinite(bead.run.face) else 0.0


def _with_room(
    bead: BeadTrace, x: Floats, y: Floats, height: Floats, ceiling: Floats, rise: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return a map with the dry cells around it that the excess will need, as tried on a map of coarse cells."""
    if not (height > ceiling * (1 + _RIPPLE)).any():
        return x, y, height, ceiling, rise
    dry, free = bead.gap, _rise(bead)
    coarse, over, soft = means(height, _BLOCK, 0.0), means(ceiling, _BLOCK, dry), _BLOCK**2 * means(rise, _BLOCK, free)
    room = 0  # coarse cells
    while True:
        tried = np.pad(coarse, room)
        beyond = np.pad(over, room, constant_values=dry)
        push_aside(tried, beyond, np.pad(soft, room, constant_values=_BLOCK**2 * free), _RIPPLE, _TRIAL)
        if not max(tried[0].max(), tried[-1].max(), tried[:, 0].max(), tried[:, -1].max()) > 0:
            break
        room = max(2 * room, 1)
        _check_cells(bead, (np.array(coarse.shape) + 2 * room) * float(_BLOCK))
    if not room:
        return x, y, height, ceiling, rise
    # the wet part with a coarse cell around it; the grid moves by whole cells
    wet = np.argwhere(tried)
    before = _BLOCK * np.maximum(room - wet.min(axis=0) + 1, 0)
    after = _BLOCK * np.maximum(wet.max(axis=0) + 2 - room - np.array(coarse.shape), 0)
    ny, nx = np.array(height.shape) + before + after
    _check_cells(bead, (ny, nx))
    around, cell = np.stack([before, after], axis=1), bead.settings.cell
    x, y = x[0] + cell * (np.arange(nx) - before[1]), y[0] + cell * (np.arange(ny) - before[0])
    padded = np.pad(ceiling, around, constant_values=dry), np.pad(rise, around, constant_values=free)
    return x, y, np.pad(height, around), *padded


def _round_ends(bead: BeadTrace, volume: Floats) -> Iterator[_End]:
    """Yield points, (k, 2), volumes there, (k,), and heights of nozzle and crest for each end of a stretch of bead.

    An end takes the volume of its half body of revolution from the intervals of the last stations, whose `volume` is
    set to 0; a stretch shorter than its two ends is one round drop.
    """
    drops, half = bead.drops.tolist(), bead.end_length
    for first, after in bead.wet_stretches.tolist():
        if [first, after] in drops:
            whole = slice(max(first - 1, 0), after)
            total = float(volume[whole].sum())
            volume[whole] = 0.0
            middle = (first + after - 1) // 2
            gap = bead.section.gap[middle : middle + 1]
            yield _round(bead, middle, bead.drop(total, gap), total, None)
            continue
        stations = np.arange(first, after)
        begin = np.flatnonzero(bead.ds * (stations - first + 0.5) >= half[stations])
        end = np.flatnonzero(bead.ds * (after - 1 - stations + 0.5) >= half[stations])
        for station, taken, away in (
            (stations[begin[0]], slice(max(first - 1, 0), stations[begin[0]]), np.pi),
            (stations[end[-1]], slice(stations[end[-1]], after), 0.0),
        ):
            total = float(volume[taken].sum())
            volume[taken] = 0.0
            if total > 0:
                area, gap = bead.area[station : station + 1], bead.section.gap[station : station + 1]
                section = Section(area, gap, bead.settings.contact_angle, bead.run.face)
                yield _round(bead, station, section, total, bead.heading[station] + away)


def _round(bead: BeadTrace, station: int, section: Section, volume: float, towards: float | None) -> _End:
    """Points and volumes of a body of revolution about a station, or of its half `towards` an angle."""
    rim = 0.5 * float(section.width[0])
    _check_cells(bead, (2 * rim / bead.settings.cell, 2 * rim / bead.settings.cell))
    rings = math.ceil(rim * _SAMPLES / bead.settings.cell) + 1
    r = rim * (np.arange(rings) + 0.5) / rings
    span = 2 * np.pi if towards is None else np.pi
    around = math.ceil(span * rings)
    angle = (0.0 if towards is None else towards - 0.5 * np.pi) + span * (np.arange(around) + 0.5) / around
    weight = np.repeat((section.profile(r)[0] * r)[:, None], around, axis=1)
    weight *= volume / weight.sum()
    points = bead.point[station, :2] + r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    gap = float(_upright(bead)[station])
    return (
        points.reshape(-1, 2),
        weight.ravel(),
        gap,
        float(section.height[0]) * gap / float(bead.nozzle_height[station]),
    )


def _upright(bead: BeadTrace) -> Floats:
    """Vertical height of the nozzle over the surface, more than the normal one where the path climbs, (r,) [mm]."""
    along = np.gradient(bead.point, axis=0)
    ahead, length = np.linalg.norm(along[:, :2], axis=1), np.linalg.norm(along, axis=1)
    cosine = np.divide(ahead, length, out=np.ones_like(length), where=length > 0)
    return bead.nozzle_height / np.maximum(cosine, math.sqrt(0.5))


def _contact(bead: BeadTrace, cell: float) -> float:
    """Height of the map at the rim of the nominal section.

    The cells and the interpolation blur it, each as a hat two cells wide; together they are the cubic B-spline.
    """
    section = bead.nominal_section
    t = (np.arange(400) + 0.5) / 100 - 2
    u = np.abs(t)
    kernel = np.where(u < 1, 2 / 3 - u**2 + 0.5 * u**3, (2 - u) ** 3 / 6)
    kernel /= kernel.sum()
    return float(section.profile(0.5 * section.width[0] - cell * t)[0] @ kernel)
