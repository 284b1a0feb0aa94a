"""The parameters of the path speed, the feed clamp by radius, and spliced speed profiles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import positive
from gantrysim.paths.limits import Limited


@dataclass(frozen=True)
class Clamp:
    """Feed clamp by the radius of an arc: sqrt(r / radius) feed, at least the floor (1731, 1730, 1732).

    Args:
        radius: reference radius Rp [mm].
        feed: feed Vp allowed at the reference radius [mm/min].
        floor: lowest feed to which the clamp reduces F [mm/min].
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
        # at sqrt(r / Rp) Vp the acceleration towards the centre, F^2 / r, is that of Vp at Rp
        return np.maximum(self.feed * np.sqrt(np.asarray(r, float) / self.radius), self.floor)


@dataclass(frozen=True)
class Feeding:
    """The arguments of a `Program` that determine the path speed, by the same names."""

    acceleration: float
    clamp: Clamp | None
    feed_in_space: bool
    blend_time: float
    dry_run: float | None
    dry_run_from: float
    dry_run_until: float
    rotary_velocity: float
    rotary_acceleration: float


class Spliced:
    """Speed profiles, each replacing the one before.

    Args:
        profiles: one or more, of distances from the start of the path.
        times: at which each begins [s].
    """

    def __init__(self, profiles: list[Limited], times: list[float]) -> None:
        self._profiles = profiles
        self._times = np.array(times)

    @property
    def length(self) -> float:
        return self._profiles[-1].length

    @property
    def duration(self) -> float:
        return float(self._times[-1] + self._profiles[-1].duration)

    def _sampled(self, t: ArrayLike, name: str) -> Floats:
        time = np.asarray(t, float)
        k = np.clip(np.searchsorted(self._times, time, side="right") - 1, 0, len(self._profiles) - 1)
        values = np.empty(time.shape)
        for index, profile in enumerate(self._profiles):
            chosen = k == index
            values[chosen] = getattr(profile, name)(time[chosen] - self._times[index])
        return values

    def position(self, t: ArrayLike) -> Floats:
        return self._sampled(t, "position")

    def velocity(self, t: ArrayLike) -> Floats:
        return self._sampled(t, "velocity")
