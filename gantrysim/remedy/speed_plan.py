"""Speeds by place that people would write: few digits, and few changes along the program."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from gantrysim.controllers.speeds import Stretches

_DIGITS = 3  # of a speed
_HALVINGS = 12
_COST = 0.01  # share of the program's time that fewer changes of the speed may cost
_SAME = 0.03  # share by which a speed may exceed the programmed one, which then stays


def few_speeds(wanted: Mapping[int, float], stretches: Stretches) -> dict[int, float]:
    """Return speeds that change as seldom as one percent of the program's time allows, none above those wanted.

    Places that follow one another in the program are joined at the speed of the slowest, if theirs are alike.

    Args:
        wanted: fastest path speeds by place [mm/s].
        stretches: of the program, whose speeds stay where they are just below those wanted.
    """
    lengths: dict[int, float] = {}
    programmed: dict[int, float] = {}
    rows = zip(stretches.places.tolist(), stretches.lengths.tolist(), stretches.speeds.tolist(), strict=True)
    for place, length, speed in rows:
        lengths[place] = lengths.get(place, 0.0) + length
        programmed[place] = speed
    places = sorted(wanted)
    speeds = [_written_speed(wanted[place], programmed[place]) for place in places]

    def time(speeds: Iterable[float]) -> float:
        return sum(lengths[place] / speed for place, speed in zip(places, speeds, strict=True))

    # the widest hysteresis that costs no more
    allowed = (1 + _COST) * time(speeds)
    low = 0.0
    high = 1.0
    joined = speeds
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        trial = _merged_speeds(speeds, share)
        if time(trial) > allowed:
            high = share
        else:
            low = share
            joined = trial
    return dict(zip(places, joined, strict=True))


def _merged_speeds(speeds: Sequence[float], share: float) -> list[float]:
    """Return speeds of which neighbours that differ by at most a share of the fastest are one, the slowest of them."""
    joined: list[float] = []
    first = 0
    while first < len(speeds):
        low = high = speeds[first]
        after = first + 1
        while after < len(speeds) and min(low, speeds[after]) >= (1 - share) * max(high, speeds[after]):
            low = min(low, speeds[after])
            high = max(high, speeds[after])
            after += 1
        joined += [low] * (after - first)
        first = after
    return joined


def _written_speed(wanted: float, programmed: float) -> float:
    """Return the largest speed of few digits that is not above the one wanted."""
    if programmed <= wanted < (1 + _SAME) * programmed:
        return programmed
    step = 10.0 ** (math.floor(math.log10(wanted)) + 1 - _DIGITS)
    # without the digits of a division
    return float(f"{math.floor(wanted / step * (1 + 1e-12)) * step:.{_DIGITS}g}")
