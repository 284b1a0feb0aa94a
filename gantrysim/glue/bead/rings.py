"""The rings of a bead's mesh."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats

Singles = NDArray[np.float32]

SIDES = 12  # facets of a section
_ANGLES = np.array([4, 3, 2, 1, 0, 0, 0, 0, 0, 1, 2, 3, 4]) / 4  # of a section's vertices, over the contact angle
_SIDE = np.array([-1, -1, -1, -1, -1, -1, 0, 1, 1, 1, 1, 1, 1])  # of the flat that they are on
_FLOOR = np.array([0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0])  # whether they are on the flat
_RIM = np.array([0, 0, 0, 0, 1, 1, 0, 1, 1, 0, 0, 0, 0])  # whether they are on a groove's walls


@dataclass(frozen=True, eq=False)
class Mesh:
    """Rings of vertices.

    Attributes:
        vertices: in the work frame, (rings (SIDES + 1), 3) [m].
        normals: of unit length, (rings (SIDES + 1), 3).
        place: of each ring along the nozzle's trace, (rings,) [mm].
        width: of the bead at each ring, (rings,) [mm].
        centre: of each ring on the surface, (rings, 3) [m].
    """

    vertices: Singles
    normals: Singles
    place: Floats
    width: Floats
    centre: Singles

    def widened(self, factor: float) -> Singles:
        """Return the vertices of a bead so many times as wide, and as high as it is, (rings (SIDES + 1), 3) [m]."""
        if factor == 1:
            return self.vertices
        centres = self.centre.repeat(SIDES + 1, axis=0)
        vertices = self.vertices.copy()
        vertices[:, :2] += np.float32(factor - 1) * (self.vertices[:, :2] - centres[:, :2])
        return vertices

    def of_length(self, rings: int) -> Mesh:
        """Return the mesh padded to a number of rings, which collapse onto its last point."""
        lacking = rings - self.place.size
        return Mesh(
            np.pad(self.vertices, ((0, lacking * (SIDES + 1)), (0, 0)), mode="edge"),
            np.pad(self.normals, ((0, lacking * (SIDES + 1)), (0, 0)), mode="edge"),
            np.pad(self.place, (0, lacking), mode="edge"),
            np.pad(self.width, (0, lacking), mode="edge"),
            np.pad(self.centre, ((0, lacking), (0, 0)), mode="edge"),
        )

    def part(self, rings: slice) -> Mesh:
        """Return a range of rings."""
        lines = slice((SIDES + 1) * rings.start, (SIDES + 1) * rings.stop)
        return Mesh(self.vertices[lines], self.normals[lines], self.place[rings], self.width[rings], self.centre[rings])


_ARRAYS = [field.name for field in fields(Mesh)]


def faces(count: int) -> NDArray[np.int32]:
    """Return the triangles between rings, (f, 3)."""
    k, j = np.meshgrid(np.arange(count - 1), np.arange(SIDES), indexing="ij")
    a = (k * (SIDES + 1) + j).ravel()
    b = a + 1
    c = a + SIDES + 1
    d = a + SIDES + 2
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]).astype(np.int32)


def rings(
    point: Floats,
    heading: Floats,
    shape: tuple[Floats, Floats, Floats],
    turned: Floats,
    place: Floats,
    contact: float,
) -> Mesh:
    """Return sections about points on the surface, whose halves are both turned ahead from across the trace.

    Turned from 90 to 0 deg about one point they make half a body of revolution.

    Args:
        point: points on the surface, (k, 3) [mm].
        heading: heading of the trace, (k,) [rad].
        shape: radius, flat and groove of the sections, (k,) each [mm].
        turned: angle ahead, (k,) [rad].
        place: place along the trace, (k,) [mm].
        contact: contact angle [rad].
    """
    radius = shape[0][:, None]
    flat = shape[1][:, None]
    groove = shape[2][:, None]
    nothing = np.zeros_like(heading)
    ahead = np.stack([np.cos(heading), np.sin(heading), nothing], axis=1)
    right = np.stack([ahead[:, 1], -ahead[:, 0], nothing], axis=1) * np.cos(turned)[:, None]
    ahead *= np.sin(turned)[:, None]
    outwards = _SIDE[:, None] * right[:, None] + ahead[:, None]
    up = np.array([0.0, 0.0, 1.0])
    angle = contact * _ANGLES
    beside = (radius * np.sin(angle) + 0.5 * flat) * np.abs(_SIDE)
    height = radius * (np.cos(angle) - np.cos(contact)) - groove * _FLOOR
    # the shading rounds a groove, as a mesh has one normal at an edge
    lean = angle - np.arctan2(groove, flat) * _RIM
    vertices = point[:, None] + beside[..., None] * outwards + height[..., None] * up
    normals = np.sin(lean)[..., None] * outwards + np.cos(lean)[..., None] * up
    return Mesh(
        (1e-3 * vertices.reshape(-1, 3)).astype(np.float32),
        normals.reshape(-1, 3).astype(np.float32),
        place,
        (2 * radius * np.sin(contact) + flat)[:, 0],
        (1e-3 * point).astype(np.float32),
    )


def joined(parts: list[Mesh]) -> Mesh:
    """Return meshes as one, in their order."""
    return Mesh(*(np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS))
