"""The bead as one swept mesh: a half-elliptic section at every ring along the nozzle's trace.

The mesh has a number of rings that the whole trace sets, spread evenly over it. A bead that is still growing has
the rings not yet laid collapsed onto its end, so that its cost does not depend on its length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.controllers.path import Floats
from gantrysim.run import Run

__all__ = ["Bead"]

Singles = NDArray[np.float32]

_RING_DISTANCE = 2.0  # [mm]; a chord of it is 0.05 mm off a circle of 10 mm
_RINGS = (1250, 8000)
_SIDES = 8  # facets of a section
_SHORTEST = 1e-6  # [mm], of a bead that is no more than a dot


@dataclass(frozen=True)
class Bead:
    """Deposit of a run, for drawing. Volume is conserved from ring to ring: A = integral(Q dt) / ds.

    Args:
        run: the run.
        gap: height of the nozzle above the surface where its z is 0 [mm].
    """

    run: Run
    gap: float

    @cached_property
    def _length(self) -> Floats:
        """Length of the nozzle's trace up to each tick, (n,) [mm]."""
        steps = np.linalg.norm(np.diff(self.run.nozzle, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def rings(self) -> int:
        """Number of rings of the mesh."""
        return int(np.clip(np.ceil(self._length[-1] / _RING_DISTANCE), *_RINGS))

    @cached_property
    def _rings(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Place along the trace (r,), points (r, 3), widths (r,) and heights (r,) of the rings [mm]."""
        length, nozzle = self._length, self.run.nozzle
        place = np.linspace(0.0, max(length[-1], _SHORTEST), self.rings)
        ascending = length + np.arange(len(length)) * 1e-12  # np.interp wants it strict where the nozzle rests
        points = np.stack([np.interp(place, ascending, nozzle[:, i]) for i in range(3)], axis=1)
        volume = np.concatenate([[0.0], np.cumsum(self.run.flow[:-1] * np.diff(self.run.time))])
        ds = place[1] - place[0]
        edges = np.concatenate([[-ds], place]) + 0.5 * ds
        laid = np.diff(np.interp(edges, ascending, volume))
        laid[[0, -1]] *= 2  # the first and the last ring stand for half a length
        area = self._spread(np.maximum(laid / ds, 0.0), ds)
        height = np.minimum(np.sqrt(2 * area / np.pi), self.gap)
        width = np.divide(4 * area, np.pi * height, out=np.zeros_like(area), where=height > 0)
        return place, points, width, height

    def _spread(self, area: Floats, ds: float) -> Floats:
        """Where more than usual is laid, at a stop or in a slow corner, let it spread as far as the bead is wide."""
        from scipy.ndimage import uniform_filter1d  # slow to import, and needed by pictures alone

        if not area.any():
            return area
        usual = float(np.median(area[area > 0]))
        width = 4 * usual / (np.pi * min(np.sqrt(2 * usual / np.pi), self.gap))
        reach = 2 * int(np.ceil(0.5 * width / ds)) + 1
        excess = np.maximum(area - usual, 0.0)
        for _ in range(2):
            excess = uniform_filter1d(excess, reach, mode="mirror")  # which keeps the volume at the ends
        return np.minimum(area, usual) + np.maximum(excess, 0.0)

    @cached_property
    def _sections(self) -> tuple[Singles, Singles]:
        """Vertices and normals of all rings, (r, sides + 1, 3) [m] and unit."""
        _, points, width, height = self._rings
        along = np.gradient(points, axis=0)
        heading = np.arctan2(along[:, 1], along[:, 0])
        left = np.stack([-np.sin(heading), np.cos(heading), np.zeros(self.rings)], axis=1)
        up = np.array([0.0, 0.0, 1.0])
        angle = np.linspace(0.0, np.pi, _SIDES + 1)
        cos, sin = np.cos(angle)[None, :, None], np.sin(angle)[None, :, None]
        w, h = 0.5 * width[:, None, None], height[:, None, None]
        base = points - self.gap * up
        vertices = base[:, None, :] + w * cos * left[:, None, :] + h * sin * up
        normals = h * cos * left[:, None, :] + w * sin * up + 1e-12 * up
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        return (1e-3 * vertices).astype(np.float32), normals.astype(np.float32)

    def faces(self) -> NDArray[np.int32]:
        """Triangles of the mesh, with a ring collapsed to a point at either end, (f, 3)."""
        k, j = np.meshgrid(np.arange(self.rings + 1), np.arange(_SIDES), indexing="ij")
        a = (k * (_SIDES + 1) + j).ravel()
        b, c, d = a + 1, a + _SIDES + 1, a + _SIDES + 2
        return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]).astype(np.int32)

    def mesh(self, tick: int) -> tuple[Singles, Singles]:
        """Return vertices [m] and normals of the bead laid up to a tick, ((r + 2) (sides + 1), 3) each."""
        vertices, normals = self._sections
        place = self._rings[0]
        laid = int(np.searchsorted(place, self._length[tick], side="right"))
        # the end stands under the nozzle, between two rings
        before, after = max(laid - 1, 0), min(laid, self.rings - 1)
        share = np.float32(np.clip((self._length[tick] - place[before]) / (place[1] - place[0]), 0.0, 1.0))
        end = vertices[before] + share * (vertices[after] - vertices[before])
        waiting = self.rings - laid + 1
        grown = np.concatenate([vertices[:1], vertices[:laid], np.repeat(end[None], waiting, axis=0)])
        facing = np.concatenate([normals[:1], normals[:laid], np.repeat(normals[before][None], waiting, axis=0)])
        grown[0] = 0.5 * (vertices[0, 0] + vertices[0, -1])
        grown[-1] = 0.5 * (end[0] + end[-1])
        return grown.reshape(-1, 3), facing.reshape(-1, 3)
