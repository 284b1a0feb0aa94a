"""Glue laid on a grid; functions that go from cell to cell are compiled.

Heights are volumes per cell, places are in cells.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit


class Layer(NamedTuple):
    """Glue of a layer on a grid, added to in place.

    Attributes:
        glue: volume of each cell, (ny, nx) [mm³].
        moment: the same times the gap, (ny, nx) [mm⁴], or empty.
        crest: largest height of the sections that lay glue there, (ny, nx) [mm], or empty.
    """

    glue: Floats
    moment: Floats
    crest: Floats


class Stations(NamedTuple):
    """The bead at the stations of its trace, (r,) each.

    Attributes:
        x, y: [cells].
        heading: of the trace [rad].
        curvature: to the left [1/mm].
        area: of the section [mm²].
        half, flat, groove, radius: half the width, half the flat, depth of the groove and radius of the section [mm].
        gap, top: vertical heights of nozzle and crest [mm].
    """

    x: Floats
    y: Floats
    heading: Floats
    curvature: Floats
    area: Floats
    half: Floats
    flat: Floats
    groove: Floats
    radius: Floats
    gap: Floats
    top: Floats


class Sampling(NamedTuple):
    """Size of a cell [mm], steps between two stations along the trace, and samples per cell across it."""

    cell: float
    steps: int
    samples: float


class _Samples(NamedTuple):
    """Samples of a section across the trace, (n,) each, and what each of the four cells around them receives.

    Attributes:
        place: to the left of the trace [mm].
        weight: share of the section's volume, before it is divided by the sum of all.
        cell: index of the lowest of the four cells, of those of the grid row by row.
        low, low_right, high, high_right: volume that the four cells receive [mm³].
    """

    place: Floats
    weight: Floats
    cell: NDArray[np.int64]
    low: Floats
    low_right: Floats
    high: Floats
    high_right: Floats


class _Interpolated(NamedTuple):
    """Half the width, half the flat, groove, radius [mm] and curvature [1/mm] between two stations."""

    half: float
    flat: float
    groove: float
    radius: float
    bend: float


def lay(layer: Layer, stations: Stations, volume: Floats, cosine: float, sampling: Sampling) -> None:
    """Lay the volumes between stations in steps across the trace.

    Args:
        layer: added to.
        stations: of the bead.
        volume: between the stations, (r - 1,) [mm³].
        cosine: of the contact angle.
        sampling: of the sections.
    """
    laid = volume > 0.0
    widest = max(stations.half[:-1][laid].max(initial=0.0), stations.half[1:][laid].max(initial=0.0))
    most = math.ceil(2.0 * widest / sampling.cell * sampling.samples) + 3
    place, weight, low, low_right, high, high_right = np.empty((6, most))
    samples = _Samples(place, weight, np.empty(most, np.int64), low, low_right, high, high_right)
    cells = Layer(layer.glue.ravel(), layer.moment.ravel(), layer.crest.ravel())
    _lay(cells, stations, volume, layer.glue.shape, (cosine, sampling, samples))


@jit
def _lay(
    layer: Layer, stations: Stations, volume: Floats, shape: tuple[int, int], section: tuple[float, Sampling, _Samples]
) -> None:
    """Lay volumes, see `lay`.

    Args:
        layer: added to; its cells row by row, (ny * nx,).
        stations: of the bead.
        volume: between the stations, (r - 1,) [mm³].
        shape: of the grid, (ny, nx).
        section: cosine of the contact angle, sampling of the sections, and the arrays for their samples.
    """
    cosine, sampling, samples = section
    cell, steps, _ = sampling
    x, y, heading, curvature, area, half, flat, groove, radius, gap, top = stations
    for k in range(volume.size):
        if volume[k] <= 0.0:
            continue
        mean = 0.5 * (area[k] + area[k + 1])
        height = max(top[k], top[k + 1])
        for step in range(steps):
            f = (step + 0.5) / steps
            part = volume[k] / steps * (((1.0 - f) * area[k] + f * area[k + 1]) / mean)
            angle = (1.0 - f) * heading[k] + f * heading[k + 1]
            g = (1.0 - f) * gap[k] + f * gap[k + 1]
            px = (1.0 - f) * x[k] + f * x[k + 1]
            py = (1.0 - f) * y[k] + f * y[k + 1]
            # unit vector to the left, in cells per mm
            across = -math.sin(angle) / cell
            upward = math.cos(angle) / cell
            interpolated = _Interpolated(
                half=(1.0 - f) * half[k] + f * half[k + 1],
                flat=(1.0 - f) * flat[k] + f * flat[k + 1],
                groove=(1.0 - f) * groove[k] + f * groove[k + 1],
                radius=(1.0 - f) * radius[k] + f * radius[k + 1],
                bend=(1.0 - f) * curvature[k] + f * curvature[k + 1],
            )
            count = _sample(interpolated, cosine, sampling, samples)
            _share(samples, count, part, (px, py, across, upward), shape)
            _add(layer, samples, count, shape[1], (g, height))


@jit
def _sample(section: _Interpolated, cosine: float, sampling: Sampling, samples: _Samples) -> int:
    """Sample a section across the trace, and return the number of samples.

    Args:
        section: between two stations.
        cosine: of the contact angle.
        sampling: of the section.
        samples: of which place and weight are written.
    """
    w, b, d, rho, bend = section
    # Evenly in the flat and in each of the halves beside it, as a groove has steep walls. A loop that keeps no sum, and
    # writes arrays from their first element on, computes several samples at once; so does that of `_share`.
    count = 0
    edge = b if d > 0.0 else 0.0
    for low, high in ((-w, -edge), (-edge, edge), (edge, w)):
        among = max(math.ceil((high - low) / sampling.cell * sampling.samples), 0)
        place = samples.place[count : count + among]
        weight = samples.weight[count : count + among]
        for n in range(among):
            u = low + (high - low) * (n + 0.5) / among
            beside = max(abs(u) - b, 0.0)
            z = math.sqrt(max(rho * rho - beside * beside, 0.0)) - rho * cosine - (d if abs(u) < edge else 0.0)
            place[n] = u
            # in a bend, a strip on the inner side is shorter
            weight[n] = max(z, 0.0) * max(1.0 - bend * u, 0.0) * (high - low) / among
        count += among
    if count == 0:  # a section without width
        samples.place[0] = 0.0
        samples.weight[0] = 0.0
        count = 1
    return count


@jit
def _share(
    samples: _Samples, count: int, volume: float, line: tuple[float, float, float, float], shape: tuple[int, int]
) -> None:
    """Share a volume among samples across the trace, and each sample among the four cells around it.

    Args:
        samples: of which the cells and what they receive are written.
        count: number of samples.
        volume: to be shared [mm³].
        line: place of the trace [cells], and the direction to its left [cells/mm].
        shape: of the grid, (ny, nx).
    """
    px, py, across, upward = line
    ny, nx = shape
    total = 0.0
    for n in range(count):
        total += samples.weight[n]
    if total <= 0.0:
        samples.weight[:count] = 1.0
        total = float(count)
    for n in range(count):
        u = samples.place[n]
        share = volume * samples.weight[n] / total
        # beyond the grid, on its rim
        cx = min(max(px + across * u, 0.0), nx - 1.001)
        cy = min(max(py + upward * u, 0.0), ny - 1.001)
        i = int(cx)
        j = int(cy)
        a = cx - i
        b = cy - j
        low = (1.0 - b) * share
        high = b * share
        samples.cell[n] = j * nx + i
        samples.low[n] = (1.0 - a) * low
        samples.low_right[n] = a * low
        samples.high[n] = (1.0 - a) * high
        samples.high_right[n] = a * high


@jit
def _add(layer: Layer, samples: _Samples, count: int, nx: int, heights: tuple[float, float]) -> None:
    """Add what the cells around samples receive.

    Args:
        layer: added to; its cells row by row, (ny * nx,).
        samples: across the trace.
        count: number of samples.
        nx: number of cells in a row.
        heights: of the nozzle and the crest [mm].
    """
    glue, moment, crest = layer
    gap, height = heights
    # Several samples in a row lie between the same cells, whose glue is at hand meanwhile: the sums are those of adding
    # one sample after the other to the map, without waiting for the map each time.
    last = samples.cell[0]
    low = glue[last]
    low_right = glue[last + 1]
    high = glue[last + nx]
    high_right = glue[last + nx + 1]
    for n in range(count):
        k = samples.cell[n]
        if k != last:
            _write(glue, (low, low_right, high, high_right), crest, height, (last, nx))
            low = glue[k]
            low_right = glue[k + 1]
            high = glue[k + nx]
            high_right = glue[k + nx + 1]
            last = k
        low += samples.low[n]
        low_right += samples.low_right[n]
        high += samples.high[n]
        high_right += samples.high_right[n]
    _write(glue, (low, low_right, high, high_right), crest, height, (last, nx))
    if moment.size:
        for n in range(count):
            k = samples.cell[n]
            moment[k] += samples.low[n] * gap
            moment[k + 1] += samples.low_right[n] * gap
            moment[k + nx] += samples.high[n] * gap
            moment[k + nx + 1] += samples.high_right[n] * gap


@jit
def _write(
    glue: Floats, four: tuple[float, float, float, float], crest: Floats, height: float, place: tuple[int, int]
) -> None:
    """Write the glue of the four cells at a place, index of the lowest and cells in a row; raise the crest there."""
    k, nx = place
    glue[k] = four[0]
    glue[k + 1] = four[1]
    glue[k + nx] = four[2]
    glue[k + nx + 1] = four[3]
    if crest.size:
        for cell in (k, k + 1, k + nx, k + nx + 1):
            crest[cell] = max(crest[cell], height)


# Volumes at single points, as of the round ends of a bead, laid on a grid; compiled.


@jit
def drop(layer: Layer, x: Floats, y: Floats, volume: Floats, gap: float, height: float) -> None:
    """Share volumes at points among the four cells around each.

    Args:
        layer: added to.
        x: of the points, (n,) [cells].
        y: likewise.
        volume: at each of them, (n,) [mm³].
        gap: under the nozzle [mm].
        height: of the drop [mm].
    """
    glue, moment, crest = layer
    ny, nx = glue.shape
    for k in range(x.size):
        px = min(max(x[k], 0.0), nx - 1.001)
        py = min(max(y[k], 0.0), ny - 1.001)
        i = int(px)
        j = int(py)
        a = px - i
        b = py - j
        for row, high in ((j, 1.0 - b), (j + 1, b)):
            for column, share in ((i, (1.0 - a) * high), (i + 1, a * high)):
                glue[row, column] += share * volume[k]
                if moment.size:
                    moment[row, column] += share * volume[k] * gap
                if crest.size:
                    crest[row, column] = max(crest[row, column], height)
