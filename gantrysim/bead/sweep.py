"""The bead as one swept mesh: its section at every ring along the nozzle's trace.

The mesh has a number of rings that the whole trace sets, spread evenly over it. A bead that is still growing has
the rings not yet laid collapsed onto its end, so that its cost does not depend on its length.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.bead.strand import BeadSettings, Strand, surface_steps
from gantrysim.run import Run

__all__ = ["Sweep"]

Singles = NDArray[np.float32]

_RING_DISTANCE = 2.0  # [mm]; a chord of it is 0.05 mm off a circle of 10 mm
_RINGS = (1250, 8000)
_ANGLES = np.array([-4, -3, -2, -1, 0, 0, 0, 1, 2, 3, 4]) / 4  # of a section's vertices, of the contact angle
_FLAT = np.array([-1, -1, -1, -1, -1, 0, 1, 1, 1, 1, 1])  # on which side of the flat they are
_SIDES = 10  # facets of a section


class Sweep:
    """Deposit of a run, for drawing.

    Args:
        run: the run.
        settings: how the glue lies.
        rings: number of rings; by default as many as the length of the trace asks for.

    Attributes:
        strand: the bead at the rings.
    """

    def __init__(self, run: Run, settings: BeadSettings | None = None, rings: int | None = None) -> None:
        if rings is None:
            length = float(surface_steps(run.nozzle).sum())
            rings = int(np.clip(np.ceil(length / _RING_DISTANCE), *_RINGS))
        self.strand = Strand(run, settings, stations=rings)

    @property
    def rings(self) -> int:
        """Number of rings of the mesh."""
        return self.strand.place.size

    @cached_property
    def _sections(self) -> tuple[Singles, Singles]:
        """Vertices and normals of all rings, (r, sides + 1, 3) [m] and unit."""
        strand, section = self.strand, self.strand.section
        heading = strand.heading
        left = np.stack([-np.sin(heading), np.cos(heading), np.zeros(self.rings)], axis=1)
        up = np.array([0.0, 0.0, 1.0])
        contact = np.radians(strand.settings.contact_angle)
        angle = contact * _ANGLES
        radius = section.radius[:, None]
        across = radius * np.sin(angle) + 0.5 * section.flat[:, None] * _FLAT
        height = radius * (np.cos(angle) - np.cos(contact))
        base = strand.point - strand.nozzle_height[:, None] * up
        vertices = base[:, None, :] - across[..., None] * left[:, None, :] + height[..., None] * up
        normals = np.cos(angle)[:, None] * up - np.sin(angle)[:, None] * left[:, None, :]
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
        place, length = self.strand.place, float(self.strand.length[tick])
        laid = int(np.searchsorted(place, length, side="right"))
        # the end stands under the nozzle, between two rings
        before, after = max(laid - 1, 0), min(laid, self.rings - 1)
        share = np.float32(np.clip((length - place[before]) / self.strand.ds, 0.0, 1.0))
        end = vertices[before] + share * (vertices[after] - vertices[before])
        waiting = self.rings - laid + 1
        grown = np.concatenate([vertices[:1], vertices[:laid], np.repeat(end[None], waiting, axis=0)])
        facing = np.concatenate([normals[:1], normals[:laid], np.repeat(normals[before][None], waiting, axis=0)])
        grown[0] = 0.5 * (vertices[0, 0] + vertices[0, -1])
        grown[-1] = 0.5 * (end[0] + end[-1])
        return grown.reshape(-1, 3), facing.reshape(-1, 3)
