"""Compiled functions that lay glue on a grid and push it aside under the nozzle's face.

Heights are volumes per cell, places are in cells.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.jit import jit

_COARSEST = 16  # rows or columns
_FINER = 0.25  # ripple of a coarser grid over that of the finer one
_LEAST_RIPPLE = 1e-3
_CHUNK = 20  # sweeps
_ROUGH = 1.7
_ROUGH_SWEEPS = 200


@jit
def drop(
    glue: Floats, moment: Floats, crest: Floats, x: Floats, y: Floats, volume: Floats, gap: float, height: float
) -> None:
    """Share volumes at points among the four cells around each; the other arguments are as for `lay`."""
    ny, nx = glue.shape
    for k in range(x.size):
        px, py = min(max(x[k], 0.0), nx - 1.001), min(max(y[k], 0.0), ny - 1.001)
        i, j = int(px), int(py)
        a, b = px - i, py - j
        for row, high in ((j, 1.0 - b), (j + 1, b)):
            for column, share in ((i, (1.0 - a) * high), (i + 1, a * high)):
                glue[row, column] += share * volume[k]
                if moment.size:
                    moment[row, column] += share * volume[k] * gap
                if crest.size:
                    crest[row, column] = max(crest[row, column], height)


@jit
def lay(
    glue: Floats,
    moment: Floats,
    crest: Floats,
    stations: tuple[Floats, ...],
    volume: Floats,
    cosine: float,
    cell: float,
    steps: int,
    samples: float,
) -> None:
    """Lay the volumes between stations in steps across the trace.

    Args:
        glue: volume of each cell, (ny, nx), added to.
        moment: the same times the gap, (ny, nx), added to, or empty.
        crest: largest height of the sections that lay glue there, (ny, nx) [mm], raised, or empty.
        stations: x and y in cells, heading [rad] and curvature to the left [1/mm] of the trace, area [mm²], half the
            width, half the flat, groove and radius of the sections, vertical heights of nozzle and crest [mm], (r,)
            each.
        volume: between the stations, (r - 1,) [mm³].
        cosine: of the contact angle.
        cell: size of a cell [mm].
        steps: between two stations.
        samples: per cell, across.
    """
    x, y, heading, curvature, area, half, flat, groove, radius, gap, top = stations
    ny, nx = glue.shape
    widest = 0.0
    for k in range(volume.size):
        if volume[k] > 0.0:
            widest = max(widest, half[k], half[k + 1])
    most = math.ceil(2.0 * widest / cell * samples) + 3
    place, weight = np.empty(most), np.empty(most)
    for k in range(volume.size):
        if volume[k] <= 0.0:
            continue
        mean = 0.5 * (area[k] + area[k + 1])
        h = max(top[k], top[k + 1])
        for step in range(steps):
            f = (step + 0.5) / steps
            part = volume[k] / steps * (((1.0 - f) * area[k] + f * area[k + 1]) / mean)
            w = (1.0 - f) * half[k] + f * half[k + 1]
            b = (1.0 - f) * flat[k] + f * flat[k + 1]
            d = (1.0 - f) * groove[k] + f * groove[k + 1]
            rho = (1.0 - f) * radius[k] + f * radius[k + 1]
            bend = (1.0 - f) * curvature[k] + f * curvature[k + 1]
            angle = (1.0 - f) * heading[k] + f * heading[k + 1]
            g = (1.0 - f) * gap[k] + f * gap[k + 1]
            px, py = (1.0 - f) * x[k] + f * x[k + 1], (1.0 - f) * y[k] + f * y[k + 1]
            left, up = -math.sin(angle) / cell, math.cos(angle) / cell
            # evenly in the flat and in each of the halves beside it, as a groove has steep walls
            count, total, edge = 0, 0.0, b if d > 0.0 else 0.0
            for low, high in ((-w, -edge), (-edge, edge), (edge, w)):
                among = math.ceil((high - low) / cell * samples)
                for n in range(among):
                    u = low + (high - low) * (n + 0.5) / among
                    beside = max(abs(u) - b, 0.0)
                    z = math.sqrt(max(rho * rho - beside * beside, 0.0)) - rho * cosine - (d if abs(u) < edge else 0.0)
                    place[count] = u
                    weight[count] = max(z, 0.0) * max(1.0 - bend * u, 0.0) * (high - low) / among
                    total += weight[count]
                    count += 1
            if count == 0:
                place[0], count = 0.0, 1
            for n in range(count):
                u = place[n]
                share = part / count if total <= 0.0 else part * weight[n] / total
                # beyond the grid, on its rim
                cx, cy = min(max(px + left * u, 0.0), nx - 1.001), min(max(py + up * u, 0.0), ny - 1.001)
                i, j = int(cx), int(cy)
                a, c = cx - i, cy - j
                for row, much in ((j, (1.0 - c) * share), (j + 1, c * share)):
                    glue[row, i] += (1.0 - a) * much
                    glue[row, i + 1] += a * much
                    if moment.size:
                        moment[row, i] += (1.0 - a) * much * g
                        moment[row, i + 1] += a * much * g
                    if crest.size:
                        crest[row, i] = max(crest[row, i], h)
                        crest[row, i + 1] = max(crest[row, i + 1], h)


@jit
def cover(under: Floats, x: Floats, y: Floats, volume: Floats, radius: float) -> None:
    """Raise the share of each cell that the needle's face passes over while it lays the volumes between stations.

    The edge is blurred by a hat two cells wide, as glue is shared among cells.

    Args:
        under: the share, (ny, nx).
        x: of the stations, (r,) [cells].
        y: likewise.
        volume: between the stations, (r - 1,) [mm³].
        radius: of the face [cells].
    """
    ny, nx = under.shape
    reach = radius + 1.0
    for k in range(volume.size):
        if volume[k] <= 0.0:
            continue
        dx, dy = x[k + 1] - x[k], y[k + 1] - y[k]
        square = dx * dx + dy * dy
        low, high = min(y[k], y[k + 1]) - reach, max(y[k], y[k + 1]) + reach
        left, right = min(x[k], x[k + 1]) - reach, max(x[k], x[k + 1]) + reach
        for j in range(max(math.ceil(low), 0), min(math.floor(high), ny - 1) + 1):
            for i in range(max(math.ceil(left), 0), min(math.floor(right), nx - 1) + 1):
                px, py = i - x[k], j - y[k]
                along = min(max((px * dx + py * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
                distance = math.hypot(px - along * dx, py - along * dy)
                share = _hat_below(radius - distance) - _hat_below(-radius - distance)
                under[j, i] = max(under[j, i], share)


@jit
def _hat_below(t: float) -> float:
    """Share of a hat from -1 to 1 that lies below t."""
    if t <= 0.0:
        return 0.5 * max(1.0 + t, 0.0) ** 2
    return 1.0 - 0.5 * max(1.0 - t, 0.0) ** 2


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
        coarse = _handed_on(
            _coarser(height, False), _coarser(ceiling, True), 4.0 * _coarser(rise, True), finer, sweeps
        )
        handed = 4.0 * _finer(coarse, *height.shape)
        _hand_on(height, handed)
    cells, listed, count = _to_push(height, ceiling, handed, ripple)
    for first in range(0, sweeps, _CHUNK):  # in chunks, as an interrupt needs Python
        # the coarse start leaves short waves, which need little over-relaxation; the long ones follow
        # for a square of so many cells: Jacobi's spectral radius is cos(pi / side) / (1 + k)
        radius = math.cos(math.pi / max(math.sqrt(count), 4.0)) / (1.0 + float(rise.mean()))
        best = 2.0 / (1.0 + math.sqrt(1.0 - radius**2))
        factor = min(best, _ROUGH) if first < _ROUGH_SWEEPS and min(height.shape) > _COARSEST else best
        settled, count = _sweep(
            height, ceiling, rise, handed, cells, listed, count, ripple, factor, min(_CHUNK, sweeps - first)
        )
        if settled:
            break
    return handed


@jit
def _coarser(values: Floats, edge: bool) -> Floats:
    """Means over two by two cells; beyond the rim they are filled with its values if `edge`, else with zeros."""
    ny, nx = values.shape
    coarse = np.zeros(((ny + 1) // 2, (nx + 1) // 2))
    for j in range(2 * coarse.shape[0]):
        for i in range(2 * coarse.shape[1]):
            if edge or (j < ny and i < nx):
                coarse[j // 2, i // 2] += 0.25 * values[min(j, ny - 1), min(i, nx - 1)]
    return coarse


@jit
def _finer(values: Floats, ny: int, nx: int) -> Floats:
    """Interpolate values at the middles of (ny, nx) cells half as wide."""
    fine = np.empty((ny, nx))
    for j in range(ny):
        q = j // 2
        p = min(max(q + (1 if j % 2 else -1), 0), values.shape[0] - 1)
        for i in range(nx):
            m = i // 2
            n = min(max(m + (1 if i % 2 else -1), 0), values.shape[1] - 1)
            near, far = 0.75 * values[q, m] + 0.25 * values[p, m], 0.75 * values[q, n] + 0.25 * values[p, n]
            fine[j, i] = 0.75 * near + 0.25 * far
    return fine


@jit
def _hand_on(height: Floats, handed: Floats) -> None:
    ny, nx = height.shape
    for j in range(ny):
        for i in range(nx):
            change = handed[j, i]
            around = (j > 0) + (j < ny - 1) + (i > 0) + (i < nx - 1)
            if change == 0.0:
                continue
            height[j, i] -= change
            for p, q in ((j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)):
                if 0 <= p < ny and 0 <= q < nx:
                    height[p, q] += change / around


@jit
def _to_push(height: Floats, ceiling: Floats, handed: Floats, ripple: float) -> tuple[Any, Any, int]:
    """Return the cells above the ceiling or with u > 0 as a list and as a mask, and their number."""
    ny, nx = height.shape
    listed = np.zeros((ny, nx), np.bool_)
    cells = np.empty(ny * nx, np.int32)
    count = 0
    for j in range(ny):
        for i in range(nx):
            if height[j, i] > ceiling[j, i] * (1.0 + ripple) or handed[j, i] > 0.0:
                cells[count] = j * nx + i
                listed[j, i] = True
                count += 1
    return cells, listed, count


@jit
def _sweep(
    height: Floats,
    ceiling: Floats,
    rise: Floats,
    handed: Floats,
    cells: Any,
    listed: Any,
    count: int,
    ripple: float,
    factor: float,
    sweeps: int,
) -> tuple[bool, int]:
    """Sweep over the listed cells; return whether all are settled, and their number, which may have grown."""
    ny, nx = height.shape
    for _ in range(sweeps):
        settled = True
        for k in range(count):  # cells added meanwhile wait for the next sweep
            j, i = cells[k] // nx, cells[k] % nx
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
