"""The search for the fastest speed that keeps to a tolerance: which speeds to try next, and what the answer is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gantrysim.arrays import Floats

DIGITS = 4  # of a speed
_SWEEP = 9  # speeds of the first round, half an octave apart, the program's own in the middle
_OCTAVES = 2  # to both sides of the program's own
_FURTHER = 3  # more octaves to either side, one after the other, where the answer lies beyond
_INSIDE = 3  # speeds tried at a time inside the bracket


@dataclass(frozen=True)
class SpeedAnswer:
    """What a search has found.

    Attributes:
        fastest: the fastest speed tried at which, and below which at all that were tried, the run is within the
            tolerance; None where there is none [mm/s].
        above: the next faster speed tried, which is not within; None where there is none [mm/s].
        islands: speeds beyond that which are within again, ascending [mm/s].
    """

    fastest: float | None
    above: float | None
    islands: tuple[float, ...] = ()


def answer(tried: dict[float, bool]) -> SpeedAnswer:
    """Return the answer from what has been tried: whether each speed [mm/s] is within the tolerance."""
    speeds = sorted(tried)
    first = next((k for k, speed in enumerate(speeds) if not tried[speed]), len(speeds))
    islands = tuple(speed for speed in speeds[first:] if tried[speed])
    return SpeedAnswer(speeds[first - 1] if first else None, speeds[first] if first < len(speeds) else None, islands)


def next_speeds(tried: dict[float, bool], own: float, resolution: float) -> list[float]:
    """Return the speeds to be tried next, ascending; none where the search has come to its end [mm/s].

    At first a sweep two octaves to both sides of the program's own speed; beyond its end, an octave at a time, while
    everything tried is within the tolerance or nothing is; then speeds evenly, on a logarithmic scale, inside the
    bracket of the fastest one that is within and the next, until that is narrow enough.

    Args:
        tried: whether each speed is within the tolerance.
        own: the program's speed [mm/s].
        resolution: width of the bracket, relative.
    """
    if not tried:
        return _rounded(own * np.geomspace(2.0**-_OCTAVES, 2.0**_OCTAVES, _SWEEP))
    found, speeds = answer(tried), sorted(tried)
    furthest = 2.0 ** (_OCTAVES + _FURTHER) * (1 - 1e-3)
    if found.fastest is None:
        if speeds[0] * furthest <= own:
            return []
        return _rounded(np.array([0.5, math.sqrt(0.5)]) * speeds[0])
    if found.above is None:
        if speeds[-1] >= own * furthest:
            return []
        return _rounded(np.array([math.sqrt(2.0), 2.0]) * speeds[-1])
    if found.above <= found.fastest * (1 + resolution):
        return []
    inside = _rounded(np.geomspace(found.fastest, found.above, _INSIDE + 2)[1:-1])
    return [speed for speed in inside if speed not in tried]


def _rounded(speeds: Floats) -> list[float]:
    """Numbers that a program can hold, each once."""
    return sorted({float(f"{speed:.{DIGITS}g}") for speed in speeds})
