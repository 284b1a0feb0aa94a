"""Compiled functions that lay glue on a grid, and mark where the needle's face passes.

Heights are volumes per cell, places are in cells.
"""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit


@jit
def drop(
    glue: Floats, moment: Floats, crest: Floats, x: Floats, y: Floats, volume: Floats, gap: float, height: float
) -> None:
    """Share volumes at points among the four cells around each; the other arguments are as for `lay`."""
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
    place = np.empty(most)
    weight = np.empty(most)
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
            px = (1.0 - f) * x[k] + f * x[k + 1]
            py = (1.0 - f) * y[k] + f * y[k + 1]
            left = -math.sin(angle) / cell
            up = math.cos(angle) / cell
            # evenly in the flat and in each of the halves beside it, as a groove has steep walls
            count = 0
            total = 0.0
            edge = b if d > 0.0 else 0.0
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
                cx = min(max(px + left * u, 0.0), nx - 1.001)
                cy = min(max(py + up * u, 0.0), ny - 1.001)
                i = int(cx)
                j = int(cy)
                a = cx - i
                c = cy - j
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
        dx = x[k + 1] - x[k]
        dy = y[k + 1] - y[k]
        square = dx * dx + dy * dy
        per_square = 1.0 / square if square > 0.0 else 0.0
        low = min(y[k], y[k + 1]) - reach
        high = max(y[k], y[k + 1]) + reach
        left = min(x[k], x[k + 1]) - reach
        right = max(x[k], x[k + 1]) + reach
        for j in range(max(math.ceil(low), 0), min(math.floor(high), ny - 1) + 1):
            py = j - y[k]
            for i in range(max(math.ceil(left), 0), min(math.floor(right), nx - 1) + 1):
                px = i - x[k]
                along = min(max((px * dx + py * dy) * per_square, 0.0), 1.0)
                across = px - along * dx
                upward = py - along * dy
                distance = across * across + upward * upward  # squared: most cells need no root
                if distance >= reach * reach or under[j, i] == 1.0:
                    continue
                if radius >= 1.0 and distance <= (radius - 1.0) ** 2:
                    under[j, i] = 1.0
                    continue
                distance = math.sqrt(distance)
                share = hat_below(radius - distance) - hat_below(-radius - distance)
                under[j, i] = max(under[j, i], share)


@jit
def hat_below(t: float) -> float:
    """Share of a hat from -1 to 1 that lies below t."""
    if t <= 0.0:
        return 0.5 * max(1.0 + t, 0.0) ** 2
    return 1.0 - 0.5 * max(1.0 - t, 0.0) ** 2


@jit
def headroom(
    under: Floats, glue: Floats, moment: Floats, crest: Floats, gap: float, free: float
) -> tuple[Floats, Floats]:
    """Return the height that glue may have in each cell, and how far its surface there rises with excess.

    Args:
        under: share of each cell that the needle's face passes over, (ny, nx).
        glue: as in `lay`, like the next two.
        moment: empty where the nozzle's height is everywhere `gap`; else its mean over the glue laid in a cell counts.
        crest: of the beads laid beside the face.
        gap: the nozzle's height over cells without glue [mm].
        free: rise of a free surface, see `pushing.push_aside`.
    """
    ceiling = np.empty(under.shape)
    rise = np.empty(under.shape)
    for j in range(under.shape[0]):
        for i in range(under.shape[1]):
            face = moment[j, i] / glue[j, i] if moment.size and glue[j, i] > 0.0 else gap
            beside = 1.0 - under[j, i]
            ceiling[j, i] = under[j, i] * face + beside * max(crest[j, i], face)
            rise[j, i] = beside * free
    return ceiling, rise
