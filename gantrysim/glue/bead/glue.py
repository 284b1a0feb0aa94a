"""The glue of one layer of a bead on a grid: laid along the trace, then pushed aside by the needle's face."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.glue.bead.ends import SAMPLES, End, check_cells, upright
from gantrysim.glue.bead.footprint import cover, footprint, headroom, wet_where_pushed
from gantrysim.glue.bead.laying import Layer, Sampling, Stations, drop, lay
from gantrysim.glue.bead.pushing import exceeds, means, push_aside
from gantrysim.glue.bead.trace import BeadTrace

_BLOCK = 8  # cells in a row that make one of the coarse map
_EVEN = 1e-3  # of the gap; smaller changes of the nozzle's height are ignored
_RIPPLE = 0.02  # unevenness of a flat, of the nozzle's height
_SPREAD = 0.5  # distance over which excess beside the face spreads, of the nominal width
_SWEEPS = 5000  # in which the nozzle pushes glue aside
_TRIAL = 300  # the same on the coarse map


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
    uneven = bead.settings.squashed and bool(np.ptp(vertical) > _EVEN * bead.gap)
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
