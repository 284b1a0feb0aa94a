"""Parts of a log that differ in time, direction, speed, place or torque."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.identify.pieces import WHOLE, Starts, gradient, smoothed

_SMOOTH = 0.004  # standard deviation of the filter of speed and torque that sort samples [s]


def partitions(
    position: Floats, torque: Floats, used: NDArray[np.bool_], period: float, starts: Starts = WHOLE
) -> dict[str, list[NDArray[np.bool_]]]:
    """Return masks over all samples, (n,) each, by the quantity in which parts differ; samples at rest are in none.

    Args:
        position: (n,) [u].
        torque: (n,) [N·m].
        used: whether a sample is in motion, (n,) bool.
        period: of the samples [s].
        starts: of the pieces.
    """
    width = max(_SMOOTH / period, 1.0)
    speed = smoothed(gradient(position, period, starts), width, starts)
    size = np.abs(smoothed(torque, width, starts))
    time = np.arange(used.size, dtype=np.float64)
    return {
        "time": _as_many(time, used, 3),
        "direction": [used & (speed < 0), used & (speed >= 0)],
        "speed": _as_many(np.abs(speed), used, 3),
        "position": as_wide(position, used, 4),
        "torque": _as_many(size, used, 3),
    }


def _as_many(values: Floats, used: NDArray[np.bool_], count: int) -> list[NDArray[np.bool_]]:
    """Return masks of parts with as many samples each."""
    edges = np.quantile(values[used], np.linspace(0, 1, count + 1)[1:-1])
    number = np.searchsorted(edges, values)
    return [used & (number == k) for k in range(count)]


def as_wide(values: Floats, used: NDArray[np.bool_], count: int) -> list[NDArray[np.bool_]]:
    """Return masks of parts that span as much of the values' range each."""
    edges = np.linspace(values[used].min(), values[used].max(), count + 1)[1:-1]
    number = np.searchsorted(edges, values)
    return [used & (number == k) for k in range(count)]
