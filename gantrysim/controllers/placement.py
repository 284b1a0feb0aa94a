"""Where a program lies on the work: shifted, turned and scaled before anything is planned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import finite, positive
from gantrysim.paths.pieces import Vector, vector


@dataclass(frozen=True)
class Placement:
    """Origin of a program on the work, its rotation about z, and a scale factor for lengths; speeds are not scaled.

    Attributes:
        x: x of the program's origin in the work frame [mm].
        y: y of the program's origin in the work frame [mm].
        rotate: counter-clockwise rotation about the program's origin [deg].
        scale: scale factor on all lengths of the program.
        z: z of the program's origin in the work frame [mm].
        z_down: whether the program's z is a depth, positive downwards; x, y and the direction of rotation are
            unchanged.
    """

    x: float = 0.0
    y: float = 0.0
    rotate: float = 0.0
    scale: float = 1.0
    z: float = 0.0
    z_down: bool = False

    def __post_init__(self) -> None:
        for name, unit in (("x", "mm"), ("y", "mm"), ("z", "mm"), ("rotate", "deg")):
            finite(f"placement.{name}", getattr(self, name), unit)
        positive("placement.scale", self.scale)

    def direction(self, vectors: ArrayLike) -> Floats:
        """Return the program's directions or displacements, (..., 3), rotated and scaled to the work frame [mm]."""
        turned: Floats = self.scale * np.asarray(vectors, float) @ self._turn.T
        return turned

    def point(self, points: ArrayLike) -> Floats:
        """Return the program's points, (..., 3), in the work frame [mm]."""
        if self._only_shifts:
            shifted: Floats = np.asarray(points, float) + self._shift
            return shifted
        return self.direction(points) + self._shift

    def direct(self, direction: Vector) -> Vector:
        """Return a single direction in the work frame as numbers: arrays of three take longer."""
        return direction if self._only_shifts else vector(self.direction(direction))

    def place(self, point: Vector) -> Vector:
        """Return a single point in the work frame as numbers [mm], the same as `point`."""
        if not self._only_shifts:
            return vector(self.point(point))
        x, y, z = point
        shift_x, shift_y, shift_z = self._shift.tolist()
        return x + shift_x, y + shift_y, z + shift_z

    @property
    def upward(self) -> float:
        """Sign of the program's z in the work frame: 1, or -1 for depths, which mirror its planes."""
        return -1.0 if self.z_down else 1.0

    @property
    def _only_shifts(self) -> bool:
        """Whether a product with the rotation would return the same numbers."""
        return self.scale == 1 and self.rotate == 0 and not self.z_down

    @cached_property
    def _shift(self) -> Floats:
        # 0, not -0, which a point at -0 would keep
        return np.array([self.x, self.y, self.z]) + 0.0

    @cached_property
    def _turn(self) -> Floats:
        angle = math.radians(self.rotate)
        c, s = (round(f(angle), 15) for f in (math.cos, math.sin))  # quarter turns are exact
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, self.upward]])


def higher(upward: float, *heights: float) -> float:
    """Return the one of some z that is highest above the work, given the sign of z on it, see `Placement.upward`."""
    return upward * max(upward * height for height in heights)
