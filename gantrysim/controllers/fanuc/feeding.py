"""How the path speed is set: the feed's parameters, its clamp by radius, and laws that take over from one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.controllers.limits import Limited
from gantrysim.errors import positive


@dataclass(frozen=True)
class Clamp:
    """Feed clamp by the radius of an arc: at most sqrt(r / radius) feed, but not below the floor (1731, 1730, 1732).

    Args:
        radius: Rp [mm].
        feed: Vp [mm/min].
        floor: [mm/min].
    """

    radius: float
    feed: float
    floor: float

    def __post_init__(self) -> None:
        positive("clamp radius", self.radius, "mm")
        positive("clamp feed", self.feed, "mm/min")
        positive("clamp floor", self.floor, "mm/min")

    def limit(self, r: ArrayLike) -> Floats:
        """Return the largest feed at radii, (n,) [mm/min]."""
        return np.maximum(self.feed * np.sqrt(np.asarray(r, float) / self.radius), self.floor)


@dataclass(frozen=True)
class Feeding:
    """How the controller sets the path speed.

    Args:
        acceleration: of every axis [mm/s²].
        clamp: of the feed by the radius, or None.
        in_space: whether F counts the height of a helix or a cone.
        blend_time: of the moving average that rounds corners, 0 to stop at them [s].
        dry_run: feed that replaces F, or None [mm/min].
        dry_from: time from which it does [s].
        dry_until: time until which it does [s].
        rotary_velocity: limit of the rotary axis [deg/s].
        rotary_acceleration: limit of the rotary axis; inf where `acceleration` is [deg/s²].
    """

    acceleration: float
    clamp: Clamp | None
    in_space: bool
    blend_time: float
    dry_run: float | None
    dry_from: float
    dry_until: float
    rotary_velocity: float
    rotary_acceleration: float


class Spliced:
    """Laws that take over from one another.

    Args:
        laws: one or more, each of the way from the start of the path.
        times: at which each begins [s].
    """

    def __init__(self, laws: list[Limited], times: list[float]) -> None:
        self._laws, self._times = laws, np.array(times)

    @property
    def length(self) -> float:
        """Way in all [mm]."""
        return self._laws[-1].length

    @property
    def duration(self) -> float:
        """Time in all [s]."""
        return float(self._times[-1] + self._laws[-1].duration)

    def _each(self, t: ArrayLike, name: str) -> Floats:
        at = np.asarray(t, float)
        k = np.clip(np.searchsorted(self._times, at, side="right") - 1, 0, len(self._laws) - 1)
        values = np.empty(at.shape)
        for index, law in enumerate(self._laws):
            chosen = k == index
            values[chosen] = getattr(law, name)(at[chosen] - self._times[index])
        return values

    def position(self, t: ArrayLike) -> Floats:
        """Way at the times t, (n,) [mm]."""
        return self._each(t, "position")

    def velocity(self, t: ArrayLike) -> Floats:
        """Speed at the times t, (n,) [mm/s]."""
        return self._each(t, "velocity")
