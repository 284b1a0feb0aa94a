"""The cross-section of a bead: a drop on the surface, pressed down where the needle's face passes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, finite, positive

# Settings of a bead: its shape, and the resolution of its height map.

_LEAST_GAP = 1e-6  # smallest gap and cell [mm]
_HIGHEST_GAP = 1e9  # gap [mm]
_LEAST_ANGLE = 1.0  # [deg]; below, glue is a film without a shape


@dataclass(frozen=True)
class BeadSettings:
    """Shape of the bead, and resolution of its height map.

    Attributes:
        gap: height of the nozzle above the surface along the requested path; None for the machine's gap [mm].
        contact_angle: contact angle of the glue on the surface, 1 to 90 [deg].
        squashed: whether the bead keeps the section pressed by the needle's face; otherwise it relaxes to a sessile
            shape.
        cell: cell size of the height map; by default 0.25 mm, or a quarter of the bead's width where that is less [mm].
        dot_height: height of a dot, up to that of a hemisphere; by default it follows from the contact angle [mm].
        dot_target: volume that each dot must have; by default what the program requests, flow times time [mm³].
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    gap: float | None = None
    contact_angle: float = 60.0
    squashed: bool = True
    cell: float | None = None
    dot_height: float | None = None
    dot_target: float | None = None

    def __post_init__(self) -> None:
        if self.gap is not None:
            at_least("gap", self.gap, _LEAST_GAP, "mm", _HIGHEST_GAP)
        if not _LEAST_ANGLE <= finite("contact_angle", self.contact_angle, "deg") <= 90:
            raise InputError(
                f"contact_angle = {self.contact_angle:g} deg: must be at least {_LEAST_ANGLE:g} and at most 90 deg"
            )
        if self.cell is not None:
            at_least("cell", self.cell, _LEAST_GAP, "mm")
        if self.dot_height is not None:
            at_least("dot_height", self.dot_height, _LEAST_GAP, "mm", _HIGHEST_GAP)
        if self.dot_target is not None:
            positive("dot_target", self.dot_target, "mm³")


@dataclass(frozen=True, eq=False)
class Section:
    """Cross-sections of given areas, (m,).

    A sessile bead is a circular segment that meets the surface at the contact angle theta:

        A = w^2 / (8 sin^2 theta) (2 theta - sin 2 theta),  h = w/2 tan(theta/2)

    One that would stand higher than the gap g is cut in halves, with a flat of height g and width b in between,

        A = A_s + b g,  w = w_s + b,

    where A_s and w_s are area and width of the segment. The flat is as wide as the segment needs to stand no higher
    than the gap, but no wider than the needle's face, f:

        b = min((A - A_g) / g, f),  A_g = area of the segment of height g.

    Where it is as wide as the face, the halves rise freely beside it, h > g: the flat is a groove between two
    shoulders, which meet the needle's wall at a right angle. A thin needle leaves the sessile section, a wide one
    presses all of it to g.

    Args:
        area: A, (m,) [mm²].
        gap: g, (m,), inf for a sessile bead [mm].
        contact_angle: theta, above 0 and at most 90 [deg].
        face: f, outer diameter of the needle, inf for a plate [mm].
    """

    area: Floats
    gap: Floats
    contact_angle: float
    face: float = np.inf

    @classmethod
    def drop(cls, volume: float, gap: Floats, contact_angle: float, face: float = np.inf) -> Section:
        """Return the section of a round drop of a volume [mm³] under one gap, (1,) [mm]."""
        unit = cls(np.ones(1), gap, contact_angle, face)
        segment = unit._segment_of_unit_radius
        body = unit._body_of_unit_radius
        g = float(gap[0])
        # = body r^3 + b/4 segment r^2 + b^2/8 g
        share = volume / (2 * np.pi)
        radius = (share / body) ** (1 / 3)
        flat = 0.0
        highest = g / (1 - np.cos(unit._angle))
        if radius > highest:
            a = g / 8
            b = 0.25 * segment * highest**2
            beyond = share - body * highest**3
            radius = highest
            # no difference of near numbers, as in -b + root
            flat = 2 * beyond / (b + np.sqrt(b**2 + 4 * a * beyond))
        if flat > face:
            roots = np.roots([body, 0.25 * face * segment, 0.0, face**2 / 8 * g - share])
            # the other roots are negative
            radius = float(roots.real.max())
            flat = face
        pressed = flat * g if flat else 0.0
        return cls(np.array([segment * radius**2 + pressed]), gap, contact_angle, face)

    @classmethod
    def pressed_flat(cls, gap: float, contact_angle: float, face: float) -> Section:
        """Return the largest section without a groove, (1,): the face presses all of its flat, A = A_g + f g.

        Args:
            gap: g [mm].
            contact_angle: theta [deg].
            face: f [mm].
        """
        gaps = np.full(1, gap)
        unit = cls(np.ones(1), gaps, contact_angle, face)
        radius = gap / (1 - np.cos(unit._angle))
        return cls(np.full(1, unit._segment_of_unit_radius * radius**2 + face * gap), gaps, contact_angle, face)

    @cached_property
    def _angle(self) -> float:
        return float(np.radians(self.contact_angle))

    @property
    def _segment_of_unit_radius(self) -> float:
        """Area of a segment over the square of its radius."""
        theta = self._angle
        return float(theta - 0.5 * np.sin(2 * theta))

    @property
    def _body_of_unit_radius(self) -> float:
        """Integral of height times offset over half a segment, over the cube of its radius."""
        cosine = np.cos(self._angle)
        return float((1 - cosine) ** 2 * (2 + cosine) / 6)

    @cached_property
    def flat(self) -> Floats:
        """Width b of the flat, (m,) [mm]."""
        free = np.sqrt(self.area / self._segment_of_unit_radius)
        radius = np.minimum(free, self.gap / (1 - np.cos(self._angle)))
        excess = np.maximum(self.area - self._segment_of_unit_radius * radius**2, 0.0)
        needed = np.divide(excess, self.gap, out=np.zeros(self.area.shape), where=radius < free)
        return np.minimum(needed, self.face)

    @cached_property
    def _segment_area(self) -> Floats:
        """Area beside the flat, (m,) [mm²]."""
        return self.area - np.multiply(self.flat, self.gap, out=np.zeros(self.area.shape), where=self.flat > 0)

    @cached_property
    def radius(self) -> Floats:
        """Radius of the segments, (m,) [mm]."""
        return np.sqrt(self._segment_area / self._segment_of_unit_radius)

    @property
    def groove(self) -> Floats:
        """Depth of the flat below the shoulders beside it, (m,) [mm]."""
        return np.where(self.flat >= self.face, np.maximum(self.height - self.gap, 0.0), 0.0)

    @property
    def width(self) -> Floats:
        """Width where the bead meets the surface, (m,) [mm]."""
        return 2 * self.radius * np.sin(self._angle) + self.flat

    @property
    def height(self) -> Floats:
        """Largest height, (m,) [mm]."""
        return self.radius * (1 - np.cos(self._angle))

    def profile(self, offset: ArrayLike) -> Floats:
        """Height over the surface at offsets (k,) or (m, k) from the middle of the bead, (m, k) [mm]."""
        radius = self.radius[:, None]
        beside = np.abs(np.asarray(offset, float)) - 0.5 * self.flat[:, None]
        height = np.sqrt(np.maximum(radius**2 - beside**2, 0.0)) - radius * np.cos(self._angle)
        return np.where(beside < 0, self.gap[:, None], np.maximum(height, 0.0))

    def half_body(self) -> Floats:
        """Volume of half the body of revolution of each section, a round end of a bead, (m,) [mm³]."""
        beside = self._body_of_unit_radius * self.radius**3 + 0.25 * self.flat * self._segment_area
        return np.pi * (beside + 0.125 * self.flat * (self.area - self._segment_area))


# Spreading of surplus glue along the trace.


def spread(area: Floats, steady: Floats | float, width: float, ds: float, *, longest: float) -> Floats:
    """Spread the surplus of a section over a steady one along the trace, as far as it is wide, (r,) [mm²].

    What is wider than one, two, four ... steady widths spreads over as much, one after the other: the height of a bead
    is bounded by the nozzle, so that its section grows with its width.

    Args:
        area: section at the stations, (r,) [mm²].
        steady: section above which glue spreads, one or (r,) [mm²].
        width: of the steady section [mm].
        ds: distance of the stations [mm].
        longest: width from which nothing spreads further [mm].
    """
    limit = steady
    while (excess := np.maximum(area - limit, 0.0)).any() and width < longest:
        area = np.minimum(area, limit) + _averaged_section(excess, int(np.ceil(0.5 * width / ds)))
        width *= 2
        limit = 2 * limit
    return area


def _averaged_section(values: Floats, reach: int) -> Floats:
    """Moving average over `reach` to both sides, twice; mirrored at the ends, which conserves the sum."""
    for _ in range(2):
        sums = np.concatenate([[0.0], np.cumsum(np.pad(values, reach, mode="reflect"))])
        values = (sums[2 * reach + 1 :] - sums[: -2 * reach - 1]) / (2 * reach + 1)
    return np.maximum(values, 0.0)
