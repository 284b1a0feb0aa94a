"""The speed from which a faster program does not shorten a job."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from gantrysim.study.cases import Row
from gantrysim.study.speed.study import speed_of

_SATURATED = 1.02  # times the least duration: as short as the limits let it be


class Saturation(NamedTuple):
    """Where ramps, clamps and axis limits decide the duration.

    Attributes:
        speed: from which on they do [mm/s].
        duration: that remains [s].
    """

    speed: float
    duration: float


def durations(good: Sequence[Row]) -> dict[float, float]:
    """Return the duration of each speed of runs with values [s], by the speed [mm/s]."""
    return {speed_of(row): value for row in good if isinstance(value := row["duration_s"], float)}


def saturation_of(durations: Mapping[float, float]) -> Saturation | None:
    """Return the saturation of runs from the duration of each speed; None if the speeds do not reach it."""
    least = min(durations.values())
    enough = min(speed for speed, duration in durations.items() if duration <= _SATURATED * least)
    return None if enough == max(durations) else Saturation(enough, least)
