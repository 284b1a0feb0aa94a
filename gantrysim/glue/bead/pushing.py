"""Glue on a grid pushed aside under the needle's face: the sweeps over cells are compiled, the rest is NumPy's."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit

_COARSEST_GRID = 16  # rows or columns
_FINER_RIPPLE = 0.25  # ripple of a coarser grid over that of the finer one
_LEAST_RIPPLE = 1e-3
_CHUNK = 20  # sweeps
_BAND = 32  # rows compared at a time: their products stay near the processor
_FIRST_RELAXATION = 1.7
_ROUGH_SWEEPS = 200


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
    sandpile, whose heap about a point is a disc (Levine and Peres, arXiv 0704.0688). Excess so flows
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
    surface = _Surface(height, ceiling, rise, handed)
    if min(height.shape) > _COARSEST_GRID:
        finer = _FINER_RIPPLE * ripple if ripple > _LEAST_RIPPLE else ripple
        coarse = _handed_on(means(height, 2, 0.0), means(ceiling, 2), 4.0 * means(rise, 2), finer, sweeps)
        _start_from(coarse, surface, listed, ripple)
    queue, count = _to_push(listed)
    mean_rise = float(rise.mean())
    # in chunks, as an interrupt needs Python
    for first in range(0, sweeps, _CHUNK):
        # the coarse start leaves short waves, which need little over-relaxation; the long ones follow
        # for a square of so many cells: Jacobi's spectral radius is cos(pi / side) / (1 + k)
        radius = math.cos(math.pi / max(math.sqrt(count), 4.0)) / (1.0 + mean_rise)
        best = 2.0 / (1.0 + math.sqrt(1.0 - radius**2))
        factor = min(best, _FIRST_RELAXATION) if first < _ROUGH_SWEEPS and min(height.shape) > _COARSEST_GRID else best
        settled, count = _sweep(surface, queue, count, ripple, factor, min(_CHUNK, sweeps - first))
        if settled:
            break
    return handed


def means(values: Floats, size: int, beyond: float | None = None) -> Floats:
    """Return means over blocks of cells; incomplete ones are filled with a value, or with those of the rim.

    Args:
        values: of the cells, (ny, nx).
        size: rows and columns of a block.
        beyond: the value.
    """
    ny, nx = values.shape
    coarse = np.empty((-(-ny // size), -(-nx // size)))
    _find_means(values, size, beyond is None, 0.0 if beyond is None else beyond, coarse)
    return coarse


@jit
def _find_means(values: Floats, size: int, has_rim: bool, beyond: float, coarse: Floats) -> None:
    """Write means, see `means`."""
    ny, nx = values.shape
    for j in range(coarse.shape[0]):
        written = 0
        if size == 2 and 2 * j + 1 < ny:  # several at once
            upper = values[2 * j]
            lower = values[2 * j + 1]
            row = coarse[j]
            for i in range(nx // 2):
                row[i] = 0.25 * (upper[2 * i] + upper[2 * i + 1] + lower[2 * i] + lower[2 * i + 1])
            written = nx // 2
        for i in range(written, coarse.shape[1]):
            total = 0.0
            for q in range(j * size, (j + 1) * size):
                for p in range(i * size, (i + 1) * size):
                    if has_rim or (q < ny and p < nx):
                        total += values[min(q, ny - 1), min(p, nx - 1)]
                    else:
                        total += beyond
            coarse[j, i] = total / (size * size)


def _start_from(coarse: Floats, surface: _Surface, listed: NDArray[np.bool_], ripple: float) -> None:
    """Let cells hand on four times what coarse cells have handed on, interpolated, and list those that may be pushed.

    Args:
        coarse: u of cells twice as wide.
        surface: of the cells; its height is changed, and u, which is 0 so far.
        listed: whether cells are above their ceiling by more than a ripple, (ny, nx); updated, with those that have
            handed on anything.
        ripple: over the ceiling.
    """
    active = coarse > 0.0
    first = active.argmax(axis=1)
    last = np.where(active.any(axis=1), coarse.shape[1] - 1 - active[:, ::-1].argmax(axis=1), -1)
    _refine(coarse, surface, listed, ripple, (first, last))


@jit
def _refine(
    coarse: Floats,
    surface: _Surface,
    listed: NDArray[np.bool_],
    ripple: float,
    columns: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> None:
    """Start from a coarse grid, see `_start_from`, given the first and the last active cell of its rows, (my,) each.

    A row without any has none up to its last, -1.
    """
    height, ceiling, _, handed = surface
    ny, nx = height.shape
    for j in range(ny):
        row = j // 2
        beside_row = min(max(row + 2 * (j % 2) - 1, 0), coarse.shape[0] - 1)
        first, last = _reach(row, beside_row, columns, nx)
        for i in range(first, last + 1):
            column = i // 2
            beside_column = min(max(column + 2 * (i % 2) - 1, 0), coarse.shape[1] - 1)
            here = 0.75 * coarse[row, column] + 0.25 * coarse[beside_row, column]
            beside = 0.75 * coarse[row, beside_column] + 0.25 * coarse[beside_row, beside_column]
            given = 4.0 * (0.75 * here + 0.25 * beside)
            if given == 0.0:
                continue
            handed[j, i] = given
            height[j, i] -= given
            share = given / ((j > 0) + (j < ny - 1) + (i > 0) + (i < nx - 1))
            for q, p in ((j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)):
                if 0 <= q < ny and 0 <= p < nx:
                    height[q, p] += share
    # when all heights are known: of these cells and their neighbours
    for j in range(ny):
        row = j // 2
        beside_row = min(max(row + 2 * (j % 2) - 1, 0), coarse.shape[0] - 1)
        first, last = _reach(row, beside_row, columns, nx)
        for i in range(first, last + 1):
            if handed[j, i] == 0.0:
                continue
            for q, p in ((j, i), (j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)):
                if 0 <= q < ny and 0 <= p < nx:
                    listed[q, p] = handed[q, p] > 0.0 or height[q, p] > ceiling[q, p] * (1.0 + ripple)


@jit
def _reach(row: int, beside: int, columns: tuple[NDArray[np.intp], NDArray[np.intp]], nx: int) -> tuple[int, int]:
    """Return the first and the last of nx cells that the active cells of two rows of half as many reach."""
    first = nx
    last = -1
    for k in (row, beside):
        if columns[1][k] >= 0:
            first = min(first, 2 * columns[0][k] - 1)
            last = max(last, 2 * columns[1][k] + 2)
    return max(first, 0), min(last, nx - 1)


def _places(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the cells of a mask row by row, in a third of the time that `numpy.nonzero` takes."""
    rows, columns = np.divmod(np.flatnonzero(mask), mask.shape[1])
    return rows, columns


def _to_push(listed: NDArray[np.bool_]) -> tuple[_Queue, int]:
    """Return the queue of the cells of a mask, which it uses, and their number."""
    rows, columns = _places(listed)
    cells = np.empty((listed.size, 2), np.int64)
    cells[: rows.size, 0] = rows
    cells[: rows.size, 1] = columns
    return _Queue(cells, listed), rows.size


@jit
def _sweep(surface: _Surface, queue: _Queue, count: int, ripple: float, factor: float, sweeps: int) -> tuple[bool, int]:
    """Sweep over the listed cells; return whether all are settled, and their number, which may have grown."""
    height, ceiling, rise, handed = surface
    cells, listed = queue
    ny, nx = height.shape
    for _ in range(sweeps):
        settled = True
        # cells added meanwhile wait for the next sweep
        for k in range(count):
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
