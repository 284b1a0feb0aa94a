"""Glue on a grid pushed aside under the needle's face: the sweeps over cells are compiled, the rest is NumPy's."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import plain_jit

_COARSEST = 16  # rows or columns
_FINER = 0.25  # ripple of a coarser grid over that of the finer one
_LEAST_RIPPLE = 1e-3
_CHUNK = 20  # sweeps
_BAND = 32  # rows compared at a time: their products stay near the processor
_ROUGH = 1.7
_ROUGH_SWEEPS = 200


_Places = tuple[NDArray[np.intp], NDArray[np.intp]]  # rows and columns of cells


class _Surface(NamedTuple):
    """Height h, ceiling c, rise k and total u handed on of the cells, (ny, nx) each."""

    height: Floats
    ceiling: Floats
    rise: Floats
    handed: Floats


class _Queue(NamedTuple):
    """Cells to be swept, row and column in a list with room for all, (ny * nx, 2), and as a mask, (ny, nx)."""

    cells: NDArray[np.int64]
    listed: NDArray[np.bool_]


def push_aside(height: Floats, ceiling: Floats, rise: Floats, ripple: float, sweeps: int) -> float:
    """Push glue above the ceiling aside, and return the largest height that remains above it, over the ceiling.

    A cell above its ceiling c hands its excess in equal parts to its neighbours, which do likewise: the divisible
    sandpile, whose heap about a point is a disc (Levine and Peres, Potential Analysis 30, 2009). Excess so flows
    through full cells, as a liquid between two plates does. With u the total that a cell hands on,

        h = h0 - u + sum(u / 4 of the neighbours),  u >= 0,  h <= c + k u,  and h = c + k u where u > 0,

    an obstacle problem, solved by successive over-relaxation with projection. A hard ceiling has k = 0. With k > 0 it
    is a free surface that rises as glue is pushed through below it: the excess spreads over about a / (2 sqrt(k)) cells
    of size a = 1 instead of to the nearest room. The solution starts from four times the u of a grid with cells twice
    as large, and k four times as large, found in the same way, so that the number of sweeps does not grow with the
    distance that glue has to move.

    Args:
        height: h, (ny, nx), changed; its sum is conserved.
        ceiling: c, (ny, nx).
        rise: k, (ny, nx).
        ripple: permitted deviation from the ceiling, over the ceiling.
        sweeps: largest number of sweeps.
    """
    handed = _handed_on(height, ceiling, rise, ripple, sweeps)
    over = _places(height > ceiling)
    ratio = height[over] / (ceiling[over] + rise[over] * handed[over])
    return max(float(ratio.max(initial=1.0)) - 1.0, 0.0)


def exceeds(height: Floats, ceiling: Floats, ripple: float) -> NDArray[np.bool_]:
    """Whether cells are above their ceiling by more than a ripple, over the ceiling, (ny, nx)."""
    above = np.empty(height.shape, bool)
    for first in range(0, len(height), _BAND):
        rows = slice(first, first + _BAND)
        np.greater(height[rows], ceiling[rows] * (1.0 + ripple), out=above[rows])
    return above


def _handed_on(height: Floats, ceiling: Floats, rise: Floats, ripple: float, sweeps: int) -> Floats:
    """Push aside, and return the total u that every cell has handed on, (ny, nx)."""
    handed = np.zeros(height.shape)
    listed = exceeds(height, ceiling, ripple)
    if not listed.any():
        return handed
    if min(height.shape) > _COARSEST:
        finer = _FINER * ripple if ripple > _LEAST_RIPPLE else ripple
        coarse = _handed_on(_coarser(height, False), _coarser(ceiling, True), 4.0 * _coarser(rise, True), finer, sweeps)
        # few cells hand anything on: those alone are looked at
        cells = _finer(coarse, handed)
        changed = _hand_on(height, handed, cells)
        listed[changed] = height[changed] > ceiling[changed] * (1.0 + ripple)
        listed[cells] |= handed[cells] > 0.0
    surface = _Surface(height, ceiling, rise, handed)
    queue, count = _to_push(listed)
    mean_rise = float(rise.mean())
    for first in range(0, sweeps, _CHUNK):  # in chunks, as an interrupt needs Python
        # the coarse start leaves short waves, which need little over-relaxation; the long ones follow
        # for a square of so many cells: Jacobi's spectral radius is cos(pi / side) / (1 + k)
        radius = math.cos(math.pi / max(math.sqrt(count), 4.0)) / (1.0 + mean_rise)
        best = 2.0 / (1.0 + math.sqrt(1.0 - radius**2))
        factor = min(best, _ROUGH) if first < _ROUGH_SWEEPS and min(height.shape) > _COARSEST else best
        settled, count = _sweep(surface, queue, count, ripple, factor, min(_CHUNK, sweeps - first))
        if settled:
            break
    return handed


def means(values: Floats, size: int, beyond: float) -> Floats:
    """Return means over blocks of `size` by `size` cells; incomplete ones are filled with `beyond`."""
    ny, nx = values.shape
    sums = np.zeros((-(-ny // size), -(-nx // size)))
    for j in range(size):
        for i in range(size):
            part = values[j::size, i::size]
            rows, columns = part.shape
            sums[:rows, :columns] += part
            sums[rows:] += beyond
            sums[:rows, columns:] += beyond
    return np.asarray(sums / size**2)


def _coarser(values: Floats, edge: bool) -> Floats:
    """Means over two by two cells; beyond the rim they are filled with its values if `edge`, else with zeros."""
    ny, nx = values.shape
    coarse = np.empty((-(-ny // 2), -(-nx // 2)))
    inside = coarse[: ny // 2, : nx // 2]
    np.add(values[: ny - ny % 2 : 2, : nx - nx % 2 : 2], values[: ny - ny % 2 : 2, 1::2], out=inside)
    inside += values[1::2, : nx - nx % 2 : 2]
    inside += values[1::2, 1::2]
    inside *= 0.25
    fill: Literal["edge", "constant"] = "edge" if edge else "constant"
    if nx % 2:
        coarse[:, -1] = _coarser(np.pad(values[:, -1:], ((0, ny % 2), (0, 1)), fill), edge)[:, 0]
    if ny % 2:
        coarse[-1, : nx // 2] = _coarser(np.pad(values[-1:, : nx - nx % 2], ((0, 1), (0, 0)), fill), edge)[0]
    return coarse


def _finer(coarse: Floats, handed: Floats) -> _Places:
    """Write four times what coarse cells have handed on, interpolated, and return the cells that this may reach.

    Args:
        coarse: u of cells twice as wide.
        handed: u at the middles of the cells, (ny, nx), zeros so far; written.

    Returns:
        The cells, row by row.
    """
    ny, nx = handed.shape
    near = np.zeros((ny, nx), bool)
    rows, columns = _places(coarse > 0.0)
    around = np.arange(-1, 3)  # halves of a cell and those beside them
    j = (2 * rows[:, None] + around).clip(0, ny - 1)
    i = (2 * columns[:, None] + around).clip(0, nx - 1)
    near[j[:, :, None], i[:, None, :]] = True
    cells = _places(near)
    row, beside_row = _halves(cells[0], coarse.shape[0])
    column, beside_column = _halves(cells[1], coarse.shape[1])
    here = 0.75 * coarse[row, column] + 0.25 * coarse[beside_row, column]
    beside = 0.75 * coarse[row, beside_column] + 0.25 * coarse[beside_row, beside_column]
    handed[cells] = 4.0 * (0.75 * here + 0.25 * beside)
    return cells


def _places(mask: NDArray[np.bool_]) -> _Places:
    """Return the cells of a mask row by row, in a third of the time that `numpy.nonzero` takes."""
    rows, columns = np.divmod(np.flatnonzero(mask), mask.shape[1])
    return rows, columns


def _halves(half: NDArray[np.intp], coarse: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which of so many coarse cells in a row each half cell lies in, and beside which."""
    cell = half // 2
    return cell, np.clip(cell + np.where(half % 2 == 1, 1, -1), 0, coarse - 1)


def _hand_on(height: Floats, handed: Floats, cells: _Places) -> _Places:
    """Take from cells what they hand on, share it among the neighbours that each has, and return all these cells.

    Args:
        height: of the glue, (ny, nx), changed.
        handed: what every cell hands on, (ny, nx).
        cells: those that do, row by row.
    """
    ny, nx = height.shape
    row, column = cells
    given = handed[cells]
    lower = row > 0
    upper = row < ny - 1
    lesser = column > 0
    greater = column < nx - 1
    share = given / (lower * 1 + upper + lesser + greater)
    changed = [cells]
    # in the order in which a pass over the rows reaches a cell, so that sums are rounded as they are there
    for down, across, inside in ((1, 0, upper), (0, 1, greater), (0, 0, None), (0, -1, lesser), (-1, 0, lower)):
        if inside is None:
            height[cells] -= given
            continue
        neighbours = row[inside] + down, column[inside] + across
        height[neighbours] += share[inside]
        changed.append(neighbours)
    return np.concatenate([places[0] for places in changed]), np.concatenate([places[1] for places in changed])


def _to_push(listed: NDArray[np.bool_]) -> tuple[_Queue, int]:
    """Return the queue of the cells of a mask, which it uses, and their number."""
    rows, columns = _places(listed)
    cells = np.empty((listed.size, 2), np.int64)
    cells[: rows.size, 0] = rows
    cells[: rows.size, 1] = columns
    return _Queue(cells, listed), rows.size


@plain_jit
def _sweep(surface: _Surface, queue: _Queue, count: int, ripple: float, factor: float, sweeps: int) -> tuple[bool, int]:
    """Sweep over the listed cells; return whether all are settled, and their number, which may have grown."""
    height, ceiling, rise, handed = surface
    cells, listed = queue
    ny, nx = height.shape
    for _ in range(sweeps):
        settled = True
        for k in range(count):  # cells added meanwhile wait for the next sweep
            j = cells[k, 0]
            i = cells[k, 1]
            off = height[j, i] - ceiling[j, i] - rise[j, i] * handed[j, i]
            if settled and abs(off) > ripple * ceiling[j, i] and (off > 0.0 or handed[j, i] > 0.0):
                settled = False
            # every cell waits for the one before, so the two divisions are left out where they change nothing
            change = factor * off
            if rise[j, i] != 0.0:
                change /= 1.0 + rise[j, i]
            change = max(change, -handed[j, i])
            around = (j > 0) + (j < ny - 1) + (i > 0) + (i < nx - 1)
            if change == 0.0 or around == 0:
                continue
            handed[j, i] += change
            height[j, i] -= change
            share = 0.25 * change if around == 4 else change / around
            for p, q in ((j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)):
                if around == 4 or (0 <= p < ny and 0 <= q < nx):
                    height[p, q] += share
                    if not listed[p, q] and height[p, q] > ceiling[p, q] * (1.0 + ripple):
                        listed[p, q] = True
                        cells[count, 0] = p
                        cells[count, 1] = q
                        count += 1
        if settled:
            return True, count
    return False, count
