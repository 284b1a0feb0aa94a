"""Glue on a grid pushed aside under the needle's face: the sweeps over cells are compiled, the rest is NumPy's."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit

_COARSEST = 16  # rows or columns
_FINER = 0.25  # ripple of a coarser grid over that of the finer one
_LEAST_RIPPLE = 1e-3
_CHUNK = 20  # sweeps
_ROUGH = 1.7
_ROUGH_SWEEPS = 200


class _Surface(NamedTuple):
    """Height h, ceiling c, rise k and total u handed on of the cells, (ny, nx) each."""

    height: Floats
    ceiling: Floats
    rise: Floats
    handed: Floats


class _Queue(NamedTuple):
    """Cells to be swept, as a list with room for all, and as a mask, (ny, nx)."""

    cells: NDArray[np.int32]
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
    return max(float((height / (ceiling + rise * handed)).max()) - 1.0, 0.0)


def _handed_on(height: Floats, ceiling: Floats, rise: Floats, ripple: float, sweeps: int) -> Floats:
    """Push aside, and return the total u that every cell has handed on, (ny, nx)."""
    handed = np.zeros(height.shape)
    if not (height > ceiling * (1.0 + ripple)).any():
        return handed
    if min(height.shape) > _COARSEST:
        finer = _FINER * ripple if ripple > _LEAST_RIPPLE else ripple
        coarse = _handed_on(_coarser(height, False), _coarser(ceiling, True), 4.0 * _coarser(rise, True), finer, sweeps)
        handed = 4.0 * _finer(coarse, *height.shape)
        _hand_on(height, handed)
    surface = _Surface(height, ceiling, rise, handed)
    queue, count = _to_push(surface, ripple)
    for first in range(0, sweeps, _CHUNK):  # in chunks, as an interrupt needs Python
        # the coarse start leaves short waves, which need little over-relaxation; the long ones follow
        # for a square of so many cells: Jacobi's spectral radius is cos(pi / side) / (1 + k)
        radius = math.cos(math.pi / max(math.sqrt(count), 4.0)) / (1.0 + float(rise.mean()))
        best = 2.0 / (1.0 + math.sqrt(1.0 - radius**2))
        factor = min(best, _ROUGH) if first < _ROUGH_SWEEPS and min(height.shape) > _COARSEST else best
        settled, count = _sweep(surface, queue, count, ripple, factor, min(_CHUNK, sweeps - first))
        if settled:
            break
    return handed


def means(values: Floats, size: int, beyond: float) -> Floats:
    """Return means over blocks of `size` by `size` cells; incomplete ones are filled with `beyond`."""
    ny, nx = values.shape
    rows = -(-ny // size)
    columns = -(-nx // size)
    blocks = np.full((rows * size, columns * size), beyond)
    blocks[:ny, :nx] = values
    sums = np.zeros((rows, columns))
    for j in range(size):
        for i in range(size):
            sums += blocks[j::size, i::size]
    return np.asarray(sums / size**2)


def _coarser(values: Floats, edge: bool) -> Floats:
    """Means over two by two cells; beyond the rim they are filled with its values if `edge`, else with zeros."""
    ny, nx = values.shape
    quarters = 0.25 * np.pad(values, ((0, ny % 2), (0, nx % 2)), mode="edge" if edge else "constant")
    upper = quarters[::2, ::2] + quarters[::2, 1::2]
    return np.asarray(upper + quarters[1::2, ::2] + quarters[1::2, 1::2])


def _finer(values: Floats, ny: int, nx: int) -> Floats:
    """Interpolate values at the middles of (ny, nx) cells half as wide."""
    rows, beside_rows = _halves(ny, values.shape[0])
    columns, beside_columns = _halves(nx, values.shape[1])
    between = 0.75 * values[rows] + 0.25 * values[beside_rows]
    return np.asarray(0.75 * between[:, columns] + 0.25 * between[:, beside_columns])


def _halves(count: int, coarse: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which of the coarse cells in a row each half cell lies in, and beside which, (count,)."""
    half = np.arange(count)
    cell = half // 2
    return cell, np.clip(cell + np.where(half % 2 == 1, 1, -1), 0, coarse - 1)


def _hand_on(height: Floats, handed: Floats) -> None:
    """Take from each cell what it hands on, and share it among the neighbours that it has."""
    ny, nx = height.shape
    around = np.full((ny, nx), 4)
    for rim in (around[0], around[-1], around[:, 0], around[:, -1]):
        rim -= 1
    share = handed / around
    # in the order in which a pass over the rows reaches a cell, so that sums are rounded as they are there
    height[1:] += share[:-1]
    height[:, 1:] += share[:, :-1]
    height -= handed
    height[:, :-1] += share[:, 1:]
    height[:-1] += share[1:]


def _to_push(surface: _Surface, ripple: float) -> tuple[_Queue, int]:
    """Return the cells above the ceiling or with u > 0, and their number."""
    listed = (surface.height > surface.ceiling * (1.0 + ripple)) | (surface.handed > 0.0)
    above = np.flatnonzero(listed)
    cells = np.empty(listed.size, np.int32)
    cells[: above.size] = above
    return _Queue(cells, listed), above.size


@jit
def _sweep(surface: _Surface, queue: _Queue, count: int, ripple: float, factor: float, sweeps: int) -> tuple[bool, int]:
    """Sweep over the listed cells; return whether all are settled, and their number, which may have grown."""
    height, ceiling, rise, handed = surface
    cells, listed = queue
    ny, nx = height.shape
    for _ in range(sweeps):
        settled = True
        for k in range(count):  # cells added meanwhile wait for the next sweep
            j = cells[k] // nx
            i = cells[k] % nx
            off = height[j, i] - ceiling[j, i] - rise[j, i] * handed[j, i]
            if abs(off) > ripple * ceiling[j, i] and (off > 0.0 or handed[j, i] > 0.0):
                settled = False
            change = max(factor * off / (1.0 + rise[j, i]), -handed[j, i])
            around = (j > 0) + (j < ny - 1) + (i > 0) + (i < nx - 1)
            if change == 0.0 or around == 0:
                continue
            handed[j, i] += change
            height[j, i] -= change
            for p, q in ((j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)):
                if 0 <= p < ny and 0 <= q < nx:
                    height[p, q] += change / around
                    if not listed[p, q] and height[p, q] > ceiling[p, q] * (1.0 + ripple):
                        listed[p, q] = True
                        cells[count] = p * nx + q
                        count += 1
        if settled:
            return True, count
    return False, count
