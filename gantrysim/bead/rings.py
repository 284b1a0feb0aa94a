"""Rings about a bead's trace, of which its mesh is made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats

Singles = NDArray[np.float32]

SIDES = 10  # facets of a section
_ANGLES = np.array([-4, -3, -2, -1, 0, 0, 0, 1, 2, 3, 4]) / 4  # of a section's vertices, of the contact angle
_FLAT = np.array([-1, -1, -1, -1, -1, 0, 1, 1, 1, 1, 1])  # on which side of the flat they are


@dataclass(frozen=True, eq=False)
class Mesh:
    """Rings of vertices.

    Attributes:
        vertices: in the work frame, (rings (SIDES + 1), 3) [m].
        normals: of unit length, (rings (SIDES + 1), 3).
        place: of each ring along the nozzle's trace, (rings,) [mm].
        width: of the bead at each ring, (rings,) [mm].
    """

    vertices: Singles
    normals: Singles
    place: Floats
    width: Floats

    def of_length(self, rings: int) -> Mesh:
        """Return it with so many rings: those that it lacks lie on its last point."""
        lacking = rings - self.place.size
        place, width = (np.pad(values, (0, lacking), mode="edge") for values in (self.place, self.width))
        vertices, normals = (
            np.concatenate([part, part[-1:].repeat(lacking * (SIDES + 1), axis=0)])
            for part in (self.vertices, self.normals)
        )
        return Mesh(vertices, normals, place, width)

    def part(self, rings: slice) -> Mesh:
        """Return some of its rings."""
        lines = slice((SIDES + 1) * rings.start, (SIDES + 1) * rings.stop)
        return Mesh(self.vertices[lines], self.normals[lines], self.place[rings], self.width[rings])


@dataclass(frozen=True, eq=False)
class Rings:
    """Sections about points on the surface, each turned from across the trace, to either side, by one angle.

    Turned from 90 deg to 0 about one point they are half the body that the section makes when it turns about its
    middle.

    Attributes:
        point: on the surface, (k, 3) [mm].
        heading: of the trace, (k,) [rad].
        radius: of the section, (k,) [mm].
        flat: of the section, (k,) [mm].
        turned: angle, positive ahead, (k,) [rad].
        place: along the trace, (k,) [mm].
    """

    point: Floats
    heading: Floats
    radius: Floats
    flat: Floats
    turned: Floats
    place: Floats

    def mesh(self, contact: float) -> Mesh:
        """Return their vertices, for a contact angle [rad]."""
        nothing = np.zeros_like(self.heading)
        ahead = np.stack([np.cos(self.heading), np.sin(self.heading), nothing], axis=1)
        right = np.stack([ahead[:, 1], -ahead[:, 0], nothing], axis=1) * np.cos(self.turned)[:, None]
        ahead *= np.sin(self.turned)[:, None]
        angle = contact * _ANGLES
        across = self.radius[:, None] * np.sin(angle) + 0.5 * self.flat[:, None] * _FLAT
        height = self.radius[:, None] * (np.cos(angle) - np.cos(contact))
        up = np.array([0.0, 0.0, 1.0])

        def placed(sideways: Floats, upwards: Floats) -> Floats:
            level = sideways[..., None] * right[:, None] + np.abs(sideways)[..., None] * ahead[:, None]
            return level + upwards[..., None] * up

        vertices = self.point[:, None] + placed(across, height)
        normals = placed(*np.broadcast_arrays(np.sin(angle), np.cos(angle) + 0 * across))
        return Mesh(
            (1e-3 * vertices.reshape(-1, 3)).astype(np.float32),
            normals.reshape(-1, 3).astype(np.float32),
            self.place,
            2 * self.radius * np.sin(contact) + self.flat,
        )


def joined(parts: list[Mesh]) -> Mesh:
    """Return meshes as one, one after the other."""
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.place for part in parts]),
        np.concatenate([part.width for part in parts]),
    )
