"""Volumes at single points, as of the round ends of a bead, laid on a grid; compiled."""

from __future__ import annotations

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.glue.bead.laying import Layer


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
