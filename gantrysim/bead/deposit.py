"""What lies on the work: a map of the glue's height in plan view, which conserves volume."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.bead.pushing import drop, lay, push_aside
from gantrysim.bead.section import Section
from gantrysim.bead.strand import Strand
from gantrysim.controllers.path import Floats
from gantrysim.errors import InputError

__all__ = ["HeightMap"]

_SAMPLES = 3.0  # per cell, across the bead and along it
_MARGIN = 4  # cells around the bead
_SPREADING = 0.25  # of its width, around it
_MOST_CELLS = 2e7
_EVEN = 1e-3  # of the gap, within which the nozzle's height is one
_RIPPLE = 0.02  # of the nozzle's height, by which a flat may be uneven
_SWEEPS = 5000  # in which the nozzle pushes glue aside
_WET = 1e-3  # of the nominal section, below which a stretch of bead has ended
_BISECTIONS = 60


_End = tuple[Floats, Floats, float]


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Height of the glue over the surface, on a grid in the work frame; of a climbing path over the surface it climbs.

    The bead is laid along the trace, three samples to a cell, and across it as the section's profile times
    1 - kappa u, with the trace's curvature kappa and the distance u to its left: the inner side of a bend has less
    way to lie on. Its ends are round: half the body that the section makes when it turns about its middle. Where
    beads overlap their heights add. Where that is higher than the nozzle stood its face pushes the excess aside, into
    the nearest cells with room; what finds none stays as a ridge. That is done at the end, for the whole map at once,
    and so knows no order of the turns. A bead that is not squashed is not pushed. All steps conserve volume.

    Attributes:
        x, y: middles of the cells, (nx,) and (ny,) [mm].
        height: mean over each cell, (ny, nx) [mm].
        contact: height at which a bead of the nominal section ends, as the cells blur it [mm].
    """

    x: Floats
    y: Floats
    height: Floats
    contact: float

    @classmethod
    def of(cls, bead: Strand) -> HeightMap:
        """Return the map of a bead.

        Raises:
            InputError: cells so small that there are too many.
        """
        cell = bead.settings.cell
        _check_cells((np.ptp(bead.point[:, :2], axis=0) + bead.nominal_section.width) / cell, cell)
        volume = 0.5 * (bead.area[1:] + bead.area[:-1]) * bead.ds
        ends = list(_round_ends(bead, volume))
        x, y = _grid(bead, volume, ends)
        glue = np.zeros((y.size, x.size))
        upright = _upright(bead)
        uneven = bead.settings.squashed and bool(np.ptp(upright) > _EVEN * bead.gap)
        moment = np.zeros_like(glue) if uneven else np.zeros((0, 0))
        for points, shares, gap in ends:
            drop(glue, moment, (points[:, 0] - x[0]) / cell, (points[:, 1] - y[0]) / cell, shares, gap)
        lay(
            glue,
            moment,
            (bead.point[:, 0] - x[0]) / cell,
            (bead.point[:, 1] - y[0]) / cell,
            bead.heading,
            np.gradient(bead.heading, bead.ds),
            volume,
            bead.area,
            0.5 * bead.width,
            0.5 * bead.section.flat,
            bead.section.radius,
            math.cos(math.radians(bead.settings.contact_angle)),
            upright,
            cell,
            max(math.ceil(bead.ds * _SAMPLES / cell), 1),
            _SAMPLES,
        )
        height = glue / cell**2
        if bead.settings.squashed:
            ceiling = np.full_like(glue, bead.gap)
            if uneven:  # the nozzle's height over a cell is the mean over the glue laid there
                np.divide(moment, glue, out=ceiling, where=glue > 0)
            push_aside(height, ceiling, _RIPPLE, _SWEEPS)
        return cls(x, y, height, _contact(bead, cell))

    @property
    def cell(self) -> float:
        """Size of a cell [mm]."""
        return float(self.x[1] - self.x[0])

    @property
    def volume(self) -> float:
        """Volume on the map [mm³]."""
        return float(self.height.sum()) * self.cell**2

    def at(self, points: ArrayLike) -> Floats:
        """Return the height at points in plan view, between the middles of the cells in proportion, 0 off the map.

        Args:
            points: (..., 2) or more columns, of which the first two count [mm].
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
        height: Floats = np.where(inside, (1 - b) * low + b * high, 0.0)
        return height

    def wet(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether there is glue at points, as `at` takes them: it stands higher than where a bead ends."""
        wet: NDArray[np.bool_] = self.at(points) > self.contact
        return wet


def _grid(bead: Strand, volume: Floats, ends: list[_End]) -> tuple[Floats, Floats]:
    """Middles of the cells that the bead covers, with some around it, (nx,) and (ny,) [mm]."""
    cell = bead.settings.cell
    laid = np.flatnonzero(volume > 0)
    places = [bead.point[:1, :2], *(points for points, _, _ in ends)]
    for stations in (laid, laid + 1):
        half = 0.5 * bead.width[stations, None]
        places += [bead.point[stations, :2] - half, bead.point[stations, :2] + half]
    low, high = (
        np.min([p.min(axis=0) for p in places if p.size], axis=0),
        np.max([p.max(axis=0) for p in places if p.size], axis=0),
    )
    # what is pushed aside spreads further
    around = _MARGIN * cell + _SPREADING * float(bead.width[laid].max(initial=0.0))
    low = np.floor((low - around) / cell) * cell
    count = np.ceil((high + around - low) / cell) + 1
    if count.prod() > _MOST_CELLS:
        raise InputError(f"cell = {cell:g} mm: makes a height map of {count.prod():.3g} cells, at most {_MOST_CELLS:g}")
    nx, ny = int(count[0]), int(count[1])
    return low[0] + cell * np.arange(nx), low[1] + cell * np.arange(ny)


def _check_cells(count: Floats, cell: float) -> None:
    if count.prod() > _MOST_CELLS:
        raise InputError(f"cell = {cell:g} mm: makes a height map of {count.prod():.3g} cells, at most {_MOST_CELLS:g}")


def _round_ends(bead: Strand, volume: Floats) -> Iterator[_End]:
    """Yield for each end of a stretch of bead points, (k, 2), volumes there, (k,), and the nozzle's height.

    An end takes the volume that half a body of revolution of its section holds from the last stations' intervals, whose
    `volume` is set to 0; a stretch shorter than its two ends is one round drop.
    """
    least = _WET * (bead.nominal if bead.nominal > 0 else float(bead.area.max()))
    if least <= 0:
        return
    edges = np.diff(np.concatenate([[0], (bead.area >= least).astype(np.int8), [0]]))
    half = np.divide(bead.section.half_body(), bead.area, out=np.zeros_like(bead.area), where=bead.area >= least)
    for first, last in zip(
        np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True
    ):
        stations = np.arange(first, last + 1)
        begin = np.flatnonzero(bead.ds * (stations - first + 0.5) >= half[stations])  # the nearest
        end = np.flatnonzero(bead.ds * (last - stations + 0.5) >= half[stations])
        if not begin.size or not end.size or begin[0] > end[-1]:
            whole = slice(max(first - 1, 0), last + 1)
            total = float(volume[whole].sum())
            volume[whole] = 0.0
            middle = (first + last) // 2
            yield _round(bead, middle, _drop_section(bead, total, middle), total, None)
            continue
        for station, taken, away in (
            (stations[begin[0]], slice(max(first - 1, 0), stations[begin[0]]), np.pi),
            (stations[end[-1]], slice(stations[end[-1]], last + 1), 0.0),
        ):
            total = float(volume[taken].sum())
            volume[taken] = 0.0
            if total > 0:
                section = _part(bead, slice(station, station + 1))
                yield _round(bead, station, section, total, bead.heading[station] + away)


def _part(bead: Strand, stations: slice) -> Section:
    gap = bead.section.gap[stations]
    return Section(bead.area[stations], gap, bead.settings.contact_angle)


def _drop_section(bead: Strand, volume: float, station: int) -> Section:
    """The section that holds a volume as a body of revolution, under the nozzle at a station."""
    gap = bead.section.gap[station : station + 1]
    low, high = 0.0, 1.0

    def section(area: float) -> Section:
        return Section(np.array([area]), gap, bead.settings.contact_angle)

    while 2 * float(section(high).half_body()[0]) < volume:
        high *= 2
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 2 * float(section(middle).half_body()[0]) < volume else (low, middle)
    return section(high)


def _round(bead: Strand, station: int, section: Section, volume: float, towards: float | None) -> _End:
    """Points of a body of revolution about a station, or of its half `towards` an angle, with their volumes."""
    rim = 0.5 * float(section.width[0])
    rings = math.ceil(rim * _SAMPLES / bead.settings.cell) + 1
    r = rim * (np.arange(rings) + 0.5) / rings
    span = 2 * np.pi if towards is None else np.pi
    around = math.ceil(span * rings)
    angle = (0.0 if towards is None else towards - 0.5 * np.pi) + span * (np.arange(around) + 0.5) / around
    weight = np.repeat((section.profile(r)[0] * r)[:, None], around, axis=1)
    weight *= volume / weight.sum()
    points = bead.point[station, :2] + r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points.reshape(-1, 2), weight.ravel(), float(_upright(bead)[station])


def _upright(bead: Strand) -> Floats:
    """Height of the nozzle over the surface, straight up; of a climbing path more than square to it, (r,) [mm]."""
    along = np.gradient(bead.point, axis=0)
    ahead, length = np.linalg.norm(along[:, :2], axis=1), np.linalg.norm(along, axis=1)
    cosine = np.divide(ahead, length, out=np.ones_like(length), where=length > 0)
    upright: Floats = bead.nozzle_height / np.maximum(cosine, math.sqrt(0.5))
    return upright


def _contact(bead: Strand, cell: float) -> float:
    """Height that a map shows at the rim of the nominal section: blurred by its cells, and by looking between them.

    Both are hats as wide as two cells; together they are the cubic B-spline.
    """
    section = bead.nominal_section
    t = (np.arange(400) + 0.5) / 100 - 2
    u = np.abs(t)
    kernel = np.where(u < 1, 2 / 3 - u**2 + 0.5 * u**3, (2 - u) ** 3 / 6)
    kernel /= kernel.sum()
    return float(section.profile(0.5 * section.width[0] - cell * t)[0] @ kernel)
