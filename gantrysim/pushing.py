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
    for k in range(x.size):
        i, j = int(x[k]), int(y[k])
        a, b = x[k] - i, y[k] - j
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
                total += max(z, 0.0) * max(1.0 - bend * u, 0.0)
            for n in range(count):
                u = w * ((2 * n + 1.0) / count - 1.0)
                beside = max(abs(u) - b, 0.0)
                z = math.sqrt(max(rho * rho - beside * beside, 0.0)) - rho * cosine
                share = part / count if total <= 0.0 else part * max(z, 0.0) * max(1.0 - bend * u, 0.0) / total
                cx, cy = px + left * u, py + up * u
                i, j = int(cx), int(cy)
                a, c = cx - i, cy - j
                for row, high in ((j, (1.0 - c) * share), (j + 1, c * share)):
                    glue[row, i] += (1.0 - a) * high
                    glue[row, i + 1] += a * high
                    if moment.size:
                        moment[row, i] += (1.0 - a) * high * g
                        moment[row, i + 1] += a * high * g


_DOWN = (-1, 0, 0, 1, -1, -1, 1, 1)
_RIGHT = (0, -1, 1, 0, -1, 1, -1, 1)
_UNSEEN, _FULL, _ROOM = 0, -1, -2  # marks of a cell; of a full one whose way is known, the way, 1 and more
_DEPTH = 16  # cells of which the neighbourhood is looked at first


@_jit
def _weight(height: float, ceiling: float, mark: int) -> float:
    """Weight with which a neighbour takes excess: its room, or evenly where it only hands it on."""
    return max(ceiling - height, 1e-3 * ceiling) if mark == _ROOM else 1.0


@_jit
def push_aside(height: Floats, ceiling: Floats, ripple: float, sweeps: int) -> None:
    """Push what stands above the ceiling into the nearest cells below it, through those that are full.

    In every sweep the full cells around those that stand above it are numbered by their way to the nearest cell with
    room, and hand their excess on in descending order of it. Neighbours are in turn four and eight, which makes a heap
    round, not square.

    Args:
        height: (ny, nx), changed.
        ceiling: (ny, nx).
        ripple: share of the ceiling that a full cell may be off it.
        sweeps: most of them.
    """
    ny, nx = height.shape
    mark = np.zeros((ny, nx), np.int32)
    over, region = np.empty(ny * nx, np.int32), np.empty(ny * nx, np.int32)
    queue, rooms = np.empty(ny * nx, np.int32), np.empty(ny * nx, np.int32)
    count = 0
    for j in range(ny):
        for i in range(nx):
            if height[j, i] > ceiling[j, i] * (1.0 + ripple):
                over[count] = j * nx + i
                count += 1
    depth = _DEPTH
    for sweep in range(sweeps):
        if not count:
            break
        around = 4 if sweep % 2 == 0 else 8
        # the full cells within so many of those above the ceiling
        for k in range(count):
            region[k] = over[k]
            mark[over[k] // nx, over[k] % nx] = _FULL
        size, begin = count, 0
        for _ in range(depth):
            end = size
            for k in range(begin, end):
                j, i = region[k] // nx, region[k] % nx
                for d in range(around):
                    p, q = j + _DOWN[d], i + _RIGHT[d]
                    inside = 0 <= p < ny and 0 <= q < nx
                    if inside and mark[p, q] == _UNSEEN and height[p, q] >= ceiling[p, q] * (1.0 - ripple):
                        mark[p, q] = _FULL
                        region[size] = p * nx + q
                        size += 1
            begin = end
            if begin == size:
                break
        # their ways to a cell with room
        queued, room = 0, 0
        for k in range(size):
            j, i = region[k] // nx, region[k] % nx
            for d in range(around):
                p, q = j + _DOWN[d], i + _RIGHT[d]
                if not (0 <= p < ny and 0 <= q < nx) or height[p, q] >= ceiling[p, q] * (1.0 - ripple):
                    continue
                if mark[p, q] == _UNSEEN:
                    mark[p, q] = _ROOM
                    rooms[room] = p * nx + q
                    room += 1
                if mark[j, i] == _FULL:
                    mark[j, i] = 1
                    queue[queued] = region[k]
                    queued += 1
        head = 0
        while head < queued:
            j, i = queue[head] // nx, queue[head] % nx
            head += 1
            for d in range(around):
                p, q = j + _DOWN[d], i + _RIGHT[d]
                if 0 <= p < ny and 0 <= q < nx and mark[p, q] == _FULL:
                    mark[p, q] = mark[j, i] + 1
                    queue[queued] = p * nx + q
                    queued += 1
        if queued < size:
            depth = min(2 * depth, nx + ny)
        for k in range(queued - 1, -1, -1):
            j, i = queue[k] // nx, queue[k] % nx
            excess = height[j, i] - ceiling[j, i]
            if excess <= ripple * ceiling[j, i]:
                continue
            onto = mark[j, i] - 1 if mark[j, i] > 1 else _ROOM
            total = 0.0
            for d in range(around):
                p, q = j + _DOWN[d], i + _RIGHT[d]
                if 0 <= p < ny and 0 <= q < nx and mark[p, q] == onto:
                    total += _weight(height[p, q], ceiling[p, q], onto)
            height[j, i] -= excess
            for d in range(around):
                p, q = j + _DOWN[d], i + _RIGHT[d]
                if 0 <= p < ny and 0 <= q < nx and mark[p, q] == onto:
                    height[p, q] += excess * _weight(height[p, q], ceiling[p, q], onto) / total
        count = 0
        for cells, number in ((region, size), (rooms, room)):
            for k in range(number):
                j, i = cells[k] // nx, cells[k] % nx
                mark[j, i] = _UNSEEN
                if height[j, i] > ceiling[j, i] * (1.0 + ripple):
                    over[count] = cells[k]
                    count += 1
