"""The frame that moves along a path, at arc lengths."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, scaled


@dataclass(frozen=True)
class Local:
    """A path and its frame at arc lengths.

    Attributes:
        position: points c, (n, 3) [mm].
        heading: cosine and sine of the heading theta, (n,) each.
        sine: of the angle of climb beta, (n,).
        turning: kappa = d(theta)/ds, (n,) [1/mm].
        frames: directions u, v, w of planes, (m, 3, 3).
        plane: which of them each point has, (n,).
    """

    position: Floats
    heading: tuple[Floats, Floats]
    sine: Floats
    turning: Floats
    frames: Floats
    plane: NDArray[np.intp]

    @cached_property
    def along(self) -> Floats:
        """Directions h of the heading, in the plane, (n, 3)."""
        cosine, sine = self.heading
        along = scaled(self._direction(0), cosine)
        along += scaled(self._direction(1), sine)
        return along

    @cached_property
    def normal(self) -> Floats:
        """Left normals n, (n, 3)."""
        cosine, sine = self.heading
        normal = scaled(self._direction(1), cosine)
        normal -= scaled(self._direction(0), sine)
        return normal

    @cached_property
    def up(self) -> Floats:
        """Normals w of the plane, (n, 3)."""
        return self._direction(2)

    @cached_property
    def cosine(self) -> Floats:
        """Cosine of the angle of climb, (n,)."""
        return np.sqrt(np.maximum(1 - self.sine**2, 0.0))

    @property
    def tangent(self) -> Floats:
        """Unit tangents t, (n, 3)."""
        return scaled(self.along, self.cosine) + scaled(self.up, self.sine)

    @property
    def curvature(self) -> Floats:
        """Curvature vectors kappa cos(beta) n, that is dt/ds at a constant climb, (n, 3) [1/mm]."""
        return scaled(self.normal, self.turning * self.cosine)

    def _direction(self, k: int) -> Floats:
        """Return one direction of each point's plane, (n, 3)."""
        if len(self.frames) == 1:  # most paths have one plane
            return np.broadcast_to(self.frames[0, k], (self.plane.size, 3))
        return self.frames[self.plane, k]
