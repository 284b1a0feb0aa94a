"""Glue on a grid as native code: laid along a trace, and pushed aside under the nozzle's face.

Heights are volumes per cell here, places are in cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np

from gantrysim.controllers.path import Floats

__all__ = ["drop", "lay", "push_aside"]

_Function = TypeVar("_Function", bound=Callable[..., Any])


def _jit(function: _Function) -> _Function:
    compiled: _Function = numba.njit(cache=True, error_model="numpy")(function)
    return compiled


@_jit
def drop(glue: Floats, moment: Floats, x: Floats, y: Floats, volume: Floats, gap: float) -> None:
    """Share volumes at points between the four cells around each; `moment`, unless it is empty, sums volume * gap."""
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


@_jit
def lay(
    glue: Floats,
    moment: Floats,
    x: Floats,
    y: Floats,
    heading: Floats,
    curvature: Floats,
    volume: Floats,
    area: Floats,
    half: Floats,
    flat: Floats,
    radius: Floats,
    cosine: float,
    gap: Floats,
    cell: float,
    steps: int,
    samples: float,
) -> None:
    """Lay the volumes between stations, (r - 1,), in steps across the trace.

    Args:
        glue: volume of each cell, (ny, nx), added to.
        moment: the same times the gap, (ny, nx), added to, or empty.
        x: of the stations, (r,), in cells.
        y: of the stations, (r,), in cells.
        heading: (r,) [rad].
        curvature: to the left, (r,) [1/mm].
        volume: between the stations, (r - 1,).
        area: (r,).
        half: half the width, (r,) [mm].
        flat: half the flat's width, (r,) [mm].
        radius: of the segments, (r,) [mm].
        cosine: of the contact angle.
        gap: (r,) [mm].
        cell: [mm].
        steps: between two stations.
        samples: per cell, across.
    """
    ny, nx = glue.shape
    widest = 0.0
    for k in range(volume.size):
        if volume[k] > 0.0:
            widest = max(widest, half[k], half[k + 1])
    weight = np.empty(math.ceil(2.0 * widest / cell * samples) + 1)
    for k in range(volume.size):
        if volume[k] <= 0.0:
            continue
        for step in range(steps):
            f = (step + 0.5) / steps
            mean = 0.5 * (area[k] + area[k + 1])
            part = volume[k] / steps * (((1.0 - f) * area[k] + f * area[k + 1]) / mean)
            w = (1.0 - f) * half[k] + f * half[k + 1]
            b = (1.0 - f) * flat[k] + f * flat[k + 1]
            rho = (1.0 - f) * radius[k] + f * radius[k + 1]
            bend = (1.0 - f) * curvature[k] + f * curvature[k + 1]
            angle = (1.0 - f) * heading[k] + f * heading[k + 1]
            g = (1.0 - f) * gap[k] + f * gap[k + 1]
            px, py = (1.0 - f) * x[k] + f * x[k + 1], (1.0 - f) * y[k] + f * y[k + 1]
            left, up = -math.sin(angle) / cell, math.cos(angle) / cell
            count = max(math.ceil(2.0 * w / cell * samples), 1)
            total = 0.0
            for n in range(count):
                u = w * ((2 * n + 1.0) / count - 1.0)
                beside = max(abs(u) - b, 0.0)
                z = math.sqrt(max(rho * rho - beside * beside, 0.0)) - rho * cosine
                weight[n] = max(z, 0.0) * max(1.0 - bend * u, 0.0)
                total += weight[n]
            for n in range(count):
                u = w * ((2 * n + 1.0) / count - 1.0)
                share = part / count if total <= 0.0 else part * weight[n] / total
                # what would lie off the grid lies at its rim
                cx, cy = min(max(px + left * u, 0.0), nx - 1.001), min(max(py + up * u, 0.0), ny - 1.001)
                i, j = int(cx), int(cy)
                a, c = cx - i, cy - j
                for row, high in ((j, (1.0 - c) * share), (j + 1, c * share)):
                    glue[row, i] += (1.0 - a) * high
                    glue[row, i + 1] += a * high
                    if moment.size:
                        moment[row, i] += (1.0 - a) * high * g
                        moment[row, i + 1] += a * high * g


@_jit
def push_aside(height: Floats, ceiling: Floats, ripple: float, sweeps: int) -> int:
    """Push what stands above the ceiling aside, and return the number of sweeps.

    A cell above its ceiling c hands its excess in equal parts to its neighbours, which do likewise: the divisible
    sandpile, whose heap about a point is a disc (Levine and Peres, Potential Analysis 30, 2009). So excess finds room
    through cells that are full, as a liquid between two plates does. With u what a cell hands on in all,

        h = h0 - u + sum(u / 4 of the neighbours),  u >= 0,  h <= c,  and h = c where u > 0,

    which is an obstacle problem, solved by successive over-relaxation with projection.

    Args:
        height: h, (ny, nx), changed; its sum is kept.
        ceiling: c, (ny, nx).
        ripple: share of the ceiling by which a cell may be off it.
        sweeps: most of them; what has not found room by then stays as a ridge.
    """
    ny, nx = height.shape
    handed = np.zeros((ny, nx))
    listed = np.zeros((ny, nx), np.bool_)
    cells = np.empty(ny * nx, np.int32)
    count = 0
    for j in range(ny):
        for i in range(nx):
            if height[j, i] > ceiling[j, i] * (1.0 + ripple):
                cells[count] = j * nx + i
                listed[j, i] = True
                count += 1
    for sweep in range(sweeps):
        settled = True
        factor = 2.0 / (1.0 + math.pi / max(math.sqrt(count), 4.0))  # the best for a square of so many cells
        for k in range(count):  # grows meanwhile; the new ones wait for the next sweep
            j, i = cells[k] // nx, cells[k] % nx
            off = height[j, i] - ceiling[j, i]
            if abs(off) > ripple * ceiling[j, i] and (off > 0.0 or handed[j, i] > 0.0):
                settled = False
            change = max(factor * off, -handed[j, i])
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
            return sweep
    return sweeps
