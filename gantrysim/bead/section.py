"""The cross-section of a bead: a drop on the surface, or squashed under the nozzle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_BISECTIONS = 60


@dataclass(frozen=True, eq=False)
class Section:
    """Cross-sections of given areas, (m,).

    A sessile bead is a circular segment that meets the surface at the contact angle theta:

        A = w^2 / (8 sin^2 theta) (2 theta - sin 2 theta),  h = w/2 tan(theta/2)

    One that would stand higher than the gap g is squashed: a segment of height g, cut in halves, with a flat of width b
    in between,

        A = A_g + b g,  w = w_g + b,  h = g.

    Args:
        area: A, (m,) [mm²].
        gap: g, (m,), inf for a sessile bead [mm].
        contact_angle: theta, above 0 and at most 90 [deg].
    """

    area: Floats
    gap: Floats
    contact_angle: float

    @classmethod
    def drop(cls, volume: float, gap: Floats, contact_angle: float) -> Section:
        """Return the section of a round drop of a volume [mm³] under one gap, (1,) [mm]."""
        low, high = 0.0, 1.0

        def held(area: float) -> float:
            return 2 * float(cls(np.array([area]), gap, contact_angle).half_body()[0])

        while held(high) < volume:
            high *= 2
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if held(middle) < volume else (low, middle)
        return cls(np.array([high]), gap, contact_angle)

    @cached_property
    def _angle(self) -> float:
        return float(np.radians(self.contact_angle))

    @cached_property
    def _shape(self) -> float:
        """A / w^2 of the segment."""
        theta = self._angle
        return float((2 * theta - np.sin(2 * theta)) / (8 * np.sin(theta) ** 2))

    @cached_property
    def _segment(self) -> tuple[Floats, Floats]:
        """Widths w of the segments and b of the flats between their halves, (m,) each [mm]."""
        slope = np.tan(0.5 * self._angle)
        width = np.minimum(np.sqrt(self.area / self._shape), 2 * self.gap / slope)
        rest = self.area - self._shape * width**2
        flat = np.divide(rest, self.gap, out=np.zeros_like(width), where=np.isfinite(self.gap) & (rest > 0))
        return width, flat

    @property
    def flat(self) -> Floats:
        """Width b of the flat, (m,) [mm]."""
        return self._segment[1]

    @property
    def radius(self) -> Floats:
        """Radius of the segments, (m,) [mm]."""
        return 0.5 * self._segment[0] / float(np.sin(self._angle))

    @property
    def width(self) -> Floats:
        """Width where the bead meets the surface, (m,) [mm]."""
        width, flat = self._segment
        return width + flat

    @property
    def height(self) -> Floats:
        """Largest height, (m,) [mm]."""
        return 0.5 * self._segment[0] * np.tan(0.5 * self._angle)

    def profile(self, offset: ArrayLike) -> Floats:
        """Height over the surface at offsets (k,) or (m, k) from the middle of the bead, (m, k) [mm]."""
        radius = self.radius[:, None]
        beside = np.maximum(np.abs(np.asarray(offset, float)) - 0.5 * self.flat[:, None], 0.0)
        height = np.sqrt(np.maximum(radius**2 - beside**2, 0.0)) - radius * np.cos(self._angle)
        return np.maximum(height, 0.0)

    def half_body(self) -> Floats:
        """Volume of half the body of revolution of each section, a round end of a bead, (m,) [mm³]."""
        r = 0.25 * self.width[:, None] * (_NODES + 1)
        return np.pi * 0.25 * self.width * ((self.profile(r) * r) @ _WEIGHTS)
