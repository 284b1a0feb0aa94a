"""The height map of the glue on the work, which conserves volume.

The glue of a layer is laid along the trace, with round ends, and then pushed aside by the needle's face.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, extremes
from gantrysim.base.errors import InputError
from gantrysim.glue.bead.dots import Dot
from gantrysim.glue.bead.footprint import cover, footprint, headroom, wet_where_pushed
from gantrysim.glue.bead.layers import layers_of
from gantrysim.glue.bead.laying import Layer, Sampling, Stations, drop, lay
from gantrysim.glue.bead.pushing import exceeds, means, push_aside
from gantrysim.glue.bead.section import Section
from gantrysim.glue.bead.trace import BeadTrace

_MARGIN_CELLS = 4  # cells around the bead
_SPREADING = 0.25  # further margin, of the bead's width
_WIDEST_CELL = 1 / 3  # cell, of the nominal width
_IN_A_CELL = 8  # samples of a dot in a cell, along x and along y

_BLOCK = 8  # cells in a row that make one of the coarse map
_EVEN_HEIGHT = 1e-3  # of the gap; smaller changes of the nozzle's height are ignored
_RIPPLE = 0.02  # unevenness of a flat, of the nozzle's height
_SPREAD = 0.5  # distance over which excess beside the face spreads, of the nominal width
_SWEEPS = 5000  # in which the nozzle pushes glue aside
_TRIAL = 300  # the same on the coarse map

SAMPLES = 3.0  # per cell, across the bead and along it
MOST_CELLS = 2e7


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Height of the glue over the surface, on a grid in the work frame.

    The bead is laid along the trace with three samples per cell. Across the trace, its height is the section's profile
    times 1 - kappa u, with the trace's curvature kappa and the distance u to the left, because the inner side of a bend
    is shorter. Its ends are round, half the body of revolution of the section. Heights of overlapping beads add up.

    The needle's face pushes glue above it aside, in the whole map at once, whatever the order of the turns. Beside the
    face, glue fills the space up to the height of the beads laid there; the excess rises, spread over about half a
    bead's width. Glue that the face cannot push aside forms the `ridge`. A bead that is not squashed is not pushed, and
    only a dispensing nozzle pushes. Dots are caps, which the face does not push, as it leaves them. All steps conserve
    volume.

    A height map is a single-valued surface, level across the trace. Where the trace returns to the same place at a
    height that differs by three quarters of the bead's height or more, the glue is in another layer: it neither adds to
    the first layer nor is pushed into it; see `layers`.

    Attributes:
        x, y: centres of the cells, (nx,) and (ny,) [mm].
        layers: mean height over each cell, of every layer over its own surface, (layers, ny, nx) [mm].
        covered: wet fraction of each cell of every layer, which resolves gaps narrower than a cell, (layers, ny, nx).
        contact: height at the rim of a nominal bead, blurred by the cells [mm].
        ridge: largest height of glue above the nozzle that remains, relative to the nozzle's height; 0 once the map has
            settled.
        layer: layer of each interval between two stations of the trace, (r - 1,).
    """

    x: Floats
    y: Floats
    layers: Floats
    covered: Floats
    contact: float
    ridge: float
    layer: NDArray[np.int64]

    @classmethod
    def of(cls, bead: BeadTrace) -> HeightMap:
        """Return the map of a bead.

        Raises:
            InputError: cells that are too small, so that there are too many, or too large for the bead's width.
        """
        cls.check(bead)
        cell = bead.cell
        volume = 0.5 * (bead.area[1:] + bead.area[:-1]) * bead.ds
        wet = volume.copy()
        ends = list(round_ends(bead, volume))
        x, y = _grid(bead, volume, ends)
        layer = layers_of(bead, wet > 0, int(MOST_CELLS / (x.size * y.size)))
        count = int(layer.max()) + 1
        check_cells(bead, (x.size, y.size), count)
        glue = []
        for number in range(count):
            inside = layer == number
            round_parts = [end for end in ends if layer[min(end.station, layer.size - 1)] == number]
            glue.append(lay_glue(bead, (x, y), np.where(inside, volume, 0.0), np.where(inside, wet, 0.0), round_parts))
        x, y, layers, covered = stacked_layers(glue, cell)
        if bead.dots:
            layers, covered = _with_dots(bead.dots, (x, y), layers, covered)
        return cls(x, y, layers, covered, _contact(bead, cell), max(part.ridge for part in glue), layer)

    @staticmethod
    def check(bead: BeadTrace) -> None:
        """Raise InputError for cells that no map of a bead can have, before any array as long as the bead is wide."""
        cell = bead.cell
        width = float(bead.nominal_section.width[0])
        if cell > _WIDEST_CELL * width > 0:
            raise InputError(
                f"cell = {cell:g} mm: must be at most {_WIDEST_CELL * width:.4g} mm, a third of the bead's width of "
                f"{width:.4g} mm"
            )
        check_cells(bead, (np.ptp(bead.point[:, :2], axis=0) + width) / cell)

    @cached_property
    def height(self) -> Floats:
        """Mean height of the glue over the surface in each cell, of the highest of its layers, (ny, nx) [mm]."""
        return self.layers[0] if len(self.layers) == 1 else self.layers.max(axis=0)

    @property
    def cell(self) -> float:
        """Size of a cell [mm]."""
        return float(self.x[1] - self.x[0])

    @property
    def volume(self) -> float:
        """Volume on the map [mm³]."""
        return float(self.layers.sum()) * self.cell**2

    def at(self, points: ArrayLike) -> Floats:
        """Return the height at points in plan view, bilinear between the centres of the cells, 0 outside the map.

        Args:
            points: (..., 2), or with further columns, which are ignored [mm].
        """
        return self._between_cells(self.height, points)

    def wet_share(self, points: ArrayLike, layer: int) -> Floats:
        """Return the wet fraction of a layer at points given as for `at`, from 0 to 1."""
        return self._between_cells(self.covered[layer], points)

    def _between_cells(self, values: Floats, points: ArrayLike) -> Floats:
        place = np.asarray(points, float)
        column = (place[..., 0] - self.x[0]) / self.cell
        row = (place[..., 1] - self.y[0]) / self.cell
        inside = (column >= 0) & (row >= 0) & (column < self.x.size - 1) & (row < self.y.size - 1)
        column = np.where(inside, column, 0.0)
        row = np.where(inside, row, 0.0)
        i = column.astype(np.intp)
        j = row.astype(np.intp)
        a = column - i
        b = row - j
        first = j * self.x.size + i
        # with one index, in a fifth of the time
        flat = values.ravel()
        low = (1 - a) * flat[first] + a * flat[first + 1]
        first += self.x.size
        high = (1 - a) * flat[first] + a * flat[first + 1]
        return np.where(inside, (1 - b) * low + b * high, 0.0)

    def wet(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether there is glue at points given as for `at`."""
        return self.at(points) > self.contact


def _grid(bead: BeadTrace, volume: Floats, ends: list[End]) -> tuple[Floats, Floats]:
    """Middles of the cells of the bead and its margin, (nx,) and (ny,) [mm]."""
    cell = bead.cell
    laid = np.flatnonzero(volume > 0)
    places = [bead.point[:1, :2], *(end.points for end in ends)]
    for dot in bead.dots:
        middle = np.array([dot.place[:2]])
        places += [middle - dot.cap.radius, middle + dot.cap.radius]
    for stations in (laid, laid + 1):
        half = 0.5 * bead.width[stations, None]
        places += [bead.point[stations, :2] - half, bead.point[stations, :2] + half]
    low, high = extremes(np.concatenate(places))
    around = _MARGIN_CELLS * cell + _SPREADING * float(bead.width[laid].max(initial=0.0))
    low = np.floor((low - around) / cell) * cell
    count = np.ceil((high + around - low) / cell) + 1
    check_cells(bead, count)
    nx = int(count[0])
    ny = int(count[1])
    return low[0] + cell * np.arange(nx), low[1] + cell * np.arange(ny)


def _with_dots(
    dots: tuple[Dot, ...], grid: tuple[Floats, Floats], layers: Floats, covered: Floats
) -> tuple[Floats, Floats]:
    """Return heights and wet shares of the layers with dots on the first of them."""
    x, y = grid
    cell = float(x[1] - x[0])
    layers = layers.copy()
    covered = covered.copy()
    offset = cell * ((np.arange(_IN_A_CELL) + 0.5) / _IN_A_CELL - 0.5)
    for dot in dots:
        reach = dot.cap.radius + cell
        columns = slice(*np.searchsorted(x, [dot.place[0] - reach, dot.place[0] + reach]).tolist())
        rows = slice(*np.searchsorted(y, [dot.place[1] - reach, dot.place[1] + reach]).tolist())
        dx = (x[columns, None] + offset).ravel() - dot.place[0]
        dy = (y[rows, None] + offset).ravel() - dot.place[1]
        distance = np.hypot(dx[None, :], dy[:, None])
        shape = (rows.stop - rows.start, _IN_A_CELL, columns.stop - columns.start, _IN_A_CELL)
        heights = dot.cap.profile(distance).reshape(shape).mean(axis=(1, 3))
        total = float(heights.sum()) * cell**2
        if total > 0:
            layers[0, rows, columns] += heights * (dot.volume / total)
            wet = (distance <= dot.cap.radius).reshape(shape).mean(axis=(1, 3))
            covered[0, rows, columns] = np.maximum(covered[0, rows, columns], wet)
    return layers, covered


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


@dataclass(frozen=True, eq=False)
class Glue:
    """The glue of a layer.

    Attributes:
        x, y: middles of the cells, (nx,) and (ny,) [mm].
        height: mean height over each cell, (ny, nx) [mm].
        covered: wet share of each cell, (ny, nx).
        ridge: height of remaining glue above the nozzle, over that of the nozzle; 0 where the glue has settled.
    """

    x: Floats
    y: Floats
    height: Floats
    covered: Floats
    ridge: float


def lay_glue(bead: BeadTrace, grid: tuple[Floats, Floats], volume: Floats, wet: Floats, ends: list[End]) -> Glue:
    """Return the glue of a layer on a grid, widened where the nozzle pushes glue beyond it.

    Args:
        bead: the trace of the bead.
        grid: middles of the cells, (nx,) and (ny,) [mm].
        volume: laid between the stations, without the round ends, (r - 1,) [mm³].
        wet: the same with what the round ends have taken [mm³].
        ends: the round ends.
    """
    x, y = grid
    cell = bead.cell
    glue = np.zeros((y.size, x.size))
    vertical = upright(bead)
    uneven = bead.settings.squashed and bool(np.ptp(vertical) > _EVEN_HEIGHT * bead.gap)
    none = np.zeros((0, 0))
    moment = np.zeros_like(glue) if uneven else none
    crest = np.zeros_like(glue) if bead.settings.squashed else none
    layer = Layer(glue, moment, crest)
    for end in ends:
        drop(layer, (end.points[:, 0] - x[0]) / cell, (end.points[:, 1] - y[0]) / cell, end.volumes, end.gap, end.top)
    column = (bead.point[:, 0] - x[0]) / cell
    row = (bead.point[:, 1] - y[0]) / cell
    shape = bead.section
    stations = Stations(
        x=column,
        y=row,
        heading=bead.heading,
        curvature=np.gradient(bead.heading, bead.ds),
        area=bead.area,
        half=0.5 * shape.width,
        flat=0.5 * shape.flat,
        groove=shape.groove,
        radius=shape.radius,
        gap=vertical,
        top=shape.height * vertical / bead.nozzle_height,
    )
    cosine = math.cos(math.radians(bead.settings.contact_angle))
    steps = max(math.ceil(bead.ds * SAMPLES / cell), 1)
    lay(layer, stations, volume, cosine, Sampling(cell, steps, SAMPLES))
    drops = _drops(volume, ends, column, row, cell)
    covered = footprint(glue.shape, column, row, 0.5 * shape.width / cell, volume, drops)
    height = glue / cell**2
    excess = 0.0
    if bead.settings.squashed:
        under = np.full_like(glue, float(math.isinf(bead.run.face)))
        if not under.all():
            cover(under, column, row, wet, 0.5 * bead.run.face / cell)
        ceiling, rise = headroom(under, layer, bead.gap, _rise(bead))
        x, y, height, ceiling, rise = _with_room(bead, x, y, height, ceiling, rise)
        covered = _on_grid(covered, grid, (x, y), cell)
        laid = height.copy()
        excess = push_aside(height, ceiling, rise, _RIPPLE, _SWEEPS)
        wet_where_pushed(covered, laid, height, ceiling)
    return Glue(x, y, height, covered, excess if excess > 2 * _RIPPLE else 0.0)


def _drops(volume: Floats, ends: list[End], column: Floats, row: Floats, cell: float) -> Floats:
    """Return x, y and radius of the ends without bead on either side, (k, 3) [cells]."""
    dry = np.concatenate([[True], volume <= 0]) & np.concatenate([volume <= 0, [True]])
    alone = [end for end in ends if dry[end.station]]
    return np.array([[column[end.station], row[end.station], end.radius / cell] for end in alone]).reshape(-1, 3)


def stacked_layers(glue: list[Glue], cell: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the grid that holds all layers, (nx,) and (ny,) [mm], and their heights and shares, (layers, ny, nx)."""
    if len(glue) == 1:
        return glue[0].x, glue[0].y, glue[0].height[None], glue[0].covered[None]
    x = _joined_cells([layer.x for layer in glue], cell)
    y = _joined_cells([layer.y for layer in glue], cell)
    heights = [_on_grid(layer.height, (layer.x, layer.y), (x, y), cell) for layer in glue]
    shares = [_on_grid(layer.covered, (layer.x, layer.y), (x, y), cell) for layer in glue]
    return x, y, np.stack(heights), np.stack(shares)


def _joined_cells(places: list[Floats], cell: float) -> Floats:
    """Return the middles of the cells that hold several rows of equal cells [mm]."""
    low = min(float(row[0]) for row in places)
    high = max(float(row[-1]) for row in places)
    return np.asarray(low + cell * np.arange(round((high - low) / cell) + 1), np.float64)


def _on_grid(values: Floats, grid: tuple[Floats, Floats], wider: tuple[Floats, Floats], cell: float) -> Floats:
    """Return values of cells, (ny, nx), on a wider grid of equal cells, 0 beyond."""
    before = round(float(grid[0][0] - wider[0][0]) / cell)
    below = round(float(grid[1][0] - wider[1][0]) / cell)
    after = wider[0].size - grid[0].size - before
    above = wider[1].size - grid[1].size - below
    if not any((before, below, after, above)):
        return values
    return np.pad(values, ((below, above), (before, after)))


def _rise(bead: BeadTrace) -> float:
    """Rise of a free surface that spreads excess over a share of the nominal width; see `push_aside`."""
    spread = _SPREAD * float(bead.nominal_section.width[0])
    return (0.5 * bead.cell / spread) ** 2 if spread > 0 and math.isfinite(bead.run.face) else 0.0


def _with_room(
    bead: BeadTrace, x: Floats, y: Floats, height: Floats, ceiling: Floats, rise: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return a map with the dry cells around it that the excess will need, as tried on a map of coarse cells."""
    if not exceeds(height, ceiling, _RIPPLE).any():
        return x, y, height, ceiling, rise
    dry = bead.gap
    free = _rise(bead)
    coarse = means(height, _BLOCK, 0.0)
    over = means(ceiling, _BLOCK, dry)
    soft = _BLOCK**2 * means(rise, _BLOCK, free)
    room = 0  # coarse cells
    while True:
        tried = np.pad(coarse, room)
        beyond = np.pad(over, room, constant_values=dry)
        push_aside(tried, beyond, np.pad(soft, room, constant_values=_BLOCK**2 * free), _RIPPLE, _TRIAL)
        if not max(tried[0].max(), tried[-1].max(), tried[:, 0].max(), tried[:, -1].max()) > 0:
            break
        room = max(2 * room, 1)
        check_cells(bead, (np.array(coarse.shape) + 2 * room) * float(_BLOCK))
    if not room:
        return x, y, height, ceiling, rise
    # the wet part with a coarse cell around it; the grid moves by whole cells
    wet = np.argwhere(tried)
    before = _BLOCK * np.maximum(room - wet.min(axis=0) + 1, 0)
    after = _BLOCK * np.maximum(wet.max(axis=0) + 2 - room - np.array(coarse.shape), 0)
    ny, nx = np.array(height.shape) + before + after
    check_cells(bead, (ny, nx))
    around = np.stack([before, after], axis=1)
    cell = bead.cell
    x = x[0] + cell * (np.arange(nx) - before[1])
    y = y[0] + cell * (np.arange(ny) - before[0])
    ceiling = np.pad(ceiling, around, constant_values=dry)
    rise = np.pad(rise, around, constant_values=free)
    return x, y, np.pad(height, around), ceiling, rise


@dataclass(frozen=True, eq=False)
class End:
    """A round end of a stretch of bead, or a round drop.

    Attributes:
        station: about which it is round.
        radius: of its rim [mm].
        points: in plan view, (k, 2) [mm].
        volumes: at the points, (k,) [mm³].
        gap: vertical height of the nozzle [mm].
        top: vertical height of the crest [mm].
    """

    station: int
    radius: float
    points: Floats
    volumes: Floats
    gap: float
    top: float


def round_ends(bead: BeadTrace, volume: Floats) -> Iterator[End]:
    """Yield the round ends of all stretches of a bead.

    An end takes the volume of its half body of revolution from the intervals of the last stations, whose `volume` is
    set to 0; a stretch shorter than its two ends is one round drop.
    """
    drops = bead.drops.tolist()
    half = bead.end_length
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
                area = bead.area[station : station + 1]
                gap = bead.section.gap[station : station + 1]
                section = Section(area, gap, bead.settings.contact_angle, bead.run.face)
                yield _round(bead, station, section, total, bead.heading[station] + away)


def _round(bead: BeadTrace, station: int, section: Section, volume: float, towards: float | None) -> End:
    """Points and volumes of a body of revolution about a station, or of its half `towards` an angle."""
    rim = 0.5 * float(section.width[0])
    check_cells(bead, (2 * rim / bead.cell, 2 * rim / bead.cell))
    rings = math.ceil(rim * SAMPLES / bead.cell) + 1
    r = rim * (np.arange(rings) + 0.5) / rings
    span = 2 * np.pi if towards is None else np.pi
    around = math.ceil(span * rings)
    angle = (0.0 if towards is None else towards - 0.5 * np.pi) + span * (np.arange(around) + 0.5) / around
    weight = np.repeat((section.profile(r)[0] * r)[:, None], around, axis=1)
    weight *= volume / weight.sum()
    points = bead.point[station, :2] + r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    gap = float(upright(bead)[station])
    top = float(section.height[0]) * gap / float(bead.nozzle_height[station])
    return End(station, rim, points.reshape(-1, 2), weight.ravel(), gap, top)


def upright(bead: BeadTrace) -> Floats:
    """Vertical height of the nozzle over the surface, more than the normal one where the path climbs, (r,) [mm]."""
    return bead.nozzle_height / np.maximum(bead.level, math.sqrt(0.5))


def check_cells(bead: BeadTrace, count: ArrayLike, layers: int = 1) -> None:
    """Raise InputError for a height map of too many cells, given as their number along x and along y."""
    # not NumPy's product, which warns where it is infinite
    cells = layers * math.prod(np.asarray(count, float).tolist())
    if not cells <= MOST_CELLS:
        stacked = f" in {layers} layers" if layers > 1 else ""
        wide = float(bead.nominal_section.width[0])
        widest = float(bead.width.max())
        # as large as few enough need, in steps of a tenth of the present ones
        steps = math.ceil(10 * math.sqrt(cells / MOST_CELLS) + 1) if cells < math.inf else math.inf
        larger = 0.1 * bead.cell * steps
        suits = f"; bead.cell = {larger:.4g} has few enough" if larger <= _WIDEST_CELL * wide else ""
        raise InputError(
            f"cell = {bead.cell:g} mm: the height map of a bead {wide:.4g} mm wide, {widest:.4g} mm at its "
            f"widest, has {cells:.3g} cells{stacked}, at most {MOST_CELLS:g}{suits}"
        )
