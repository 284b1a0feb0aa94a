"""The frame that moves along a path, at arc lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats


@dataclass(frozen=True)
class Local:
    """A path and its frame at arc lengths.

    Attributes:
        position: points c, (n, 3) [mm].
        along: directions h of the heading, in the plane, (n, 3).
        normal: left normals n, (n, 3).
        up: normals w of the plane, (n, 3).
        cosine, sine: of the angle of climb beta, (n,).
        turning: kappa = d(theta)/ds, (n,) [1/mm].
    """

    position: Floats
    along: Floats
    normal: Floats
    up: Floats
    cosine: Floats
    sine: Floats
    turning: Floats

    @classmethod
    def of(cls, position: Floats, heading: Floats, climb: Floats, frame: Floats, turning: Floats) -> Local:
        """Return the frame from the values of `Path`'s methods."""
        cos = np.cos(heading)[:, None]
        sin = np.sin(heading)[:, None]
        u = frame[:, 0]
        v = frame[:, 1]
        w = frame[:, 2]
        level = np.sqrt(np.maximum(1 - climb**2, 0.0))
        return cls(position, cos * u + sin * v, cos * v - sin * u, w, level, climb, turning)

    @property
    def tangent(self) -> Floats:
        """Unit tangents t, (n, 3)."""
        return self.cosine[:, None] * self.along + self.sine[:, None] * self.up

    @property
    def curvature(self) -> Floats:
        """Curvature vectors kappa cos(beta) n, that is dt/ds at a constant climb, (n, 3) [1/mm]."""
        return (self.turning * self.cosine)[:, None] * self.normal
