"""The height map of the glue on the work, which conserves volume."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, extremes
from gantrysim.base.errors import InputError
from gantrysim.glue.bead.dots import Dot
from gantrysim.glue.bead.ends import MOST_CELLS, End, check_cells, round_ends
from gantrysim.glue.bead.glue import lay_glue, stacked_layers
from gantrysim.glue.bead.layers import layers_of
from gantrysim.glue.bead.trace import BeadTrace

_MARGIN = 4  # cells around the bead
_SPREADING = 0.25  # further margin, of the bead's width
_WIDEST = 1 / 3  # cell, of the nominal width
_IN_A_CELL = 8  # samples of a dot in a cell, along x and along y


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
        if cell > _WIDEST * width > 0:
            raise InputError(
                f"cell = {cell:g} mm: must be at most {_WIDEST * width:.4g} mm, a third of the bead's width of "
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
    around = _MARGIN * cell + _SPREADING * float(bead.width[laid].max(initial=0.0))
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
