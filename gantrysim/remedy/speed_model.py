"""Speeds by place: what a run uses of its tolerances along the path, how that depends on the speeds, and few of them.

In a stretch at the speed v, an error uses the share u = a v^p of its limit; two runs with all speeds changed alike give
a and p. Where p is near 0, as for friction, the speed does not matter. A change of the speed between two stretches adds
to the errors beside it, in proportion to the change: it accelerates the axes along the path, and a flow that lags
follows it late.

The speeds are then written as people would write them: with few digits, and few changes along the program.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.controllers.speeds import Stretches
from gantrysim.glue.bead import Bead
from gantrysim.job.tolerance import Tolerance
from gantrysim.metrics.analysis import Analysis
from gantrysim.results.checks import NEAR_LIMIT
from gantrysim.results.glue import BeadWidth

LARGEST_ERROR, LEVEL, WIDTH, ENDS = range(4)
# powers of the speed with which these errors grow: the following error of a curve of the radius R is v² / (R k²); a
# valve that is late by t switches v t late, and a flow that lags by t marks v t of the bead
EXPONENTS = np.array([2.0, 2.0, 1.0, 1.0])
HALVES = 2

# share of a stretch's time below its level: the limit of 95 % is one of the whole path, and the reversal of an axis
# takes more than 5 % of the time of a short stretch
_LEVEL_SHARE = 80.0

TARGET = 0.975 * NEAR_LIMIT  # share of a limit that a stretch is to use
# exponents, as shares of those of the physics; below the first, the speed does not matter
_LEAST_EXPONENT = 0.15
_HIGHEST_EXPONENT = 2.0
_TELLING_CHANGE = 0.05  # change of a speed's logarithm from which two runs show an exponent
_STEP_PER_LENGTH = 0.02  # [1/mm], of a longer one
_FIRST_STEP = 0.25  # change of the speed between stretches, as a share of the slower one
_STEP_BOUNDS = (0.02, 4.0)  # bounds of it
_STEP_FACTORS = (0.3, 2.0)  # by which it changes from a run to the next
_SPEEDS_BEYOND = (0.6, 1.5)  # speeds beyond those that have run
_AT_SPEED = 0.97  # share of its speed that a stretch reaches which is not bound by the ramps
_CRUISE = 1.0  # share of the speed that the ramps reach
_SLOW_END = 0.3  # share of the programmed speed
_LEVEL_BOUNDS = (0.7, 1.6)  # bounds of the level, as a share of the limit of 95 %

_SPEED_DIGITS = 3  # of a speed
_HALVINGS = 12
_TIME_SHARE = 0.01  # share of the program's time that fewer changes of the speed may cost
_SAME_SPEED = 0.03  # share by which a speed may exceed the programmed one, which then stays


@dataclass(frozen=True)
class LocalUsage:
    """Shares of the limits that a run uses by place.

    Attributes:
        shares: largest contour error, level of the contour error, width of the bead, starts and stops, in the halves of
            each stretch, 0 where nothing is judged, (4, m, 2).
        reached: fastest commanded speed in each stretch, 0 where no glue is laid, (m,) [mm/s].
    """

    shares: Floats
    reached: Floats

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Whether glue is laid in a stretch, (m,)."""
        return self.reached > 0


def local_usage(analysis: Analysis, bead: Bead, tolerance: Tolerance, stretches: Stretches) -> LocalUsage:
    """Return what a complete run uses of its tolerances by place."""
    count = stretches.ends.size
    shares = np.zeros((len(EXPONENTS), count * HALVES))
    contour = np.abs(analysis.nozzle.distance)
    half = _halves(stretches, analysis.nozzle.s)
    np.maximum.at(shares[LARGEST_ERROR], half, contour / tolerance.path_max)
    shares[LEVEL] = np.repeat(_levels(contour, half // HALVES, count), HALVES) / tolerance.path_p95
    if bead.nominal > 0 and bead.total_volume > 0:
        width = BeadWidth(bead, tolerance)
        ticks = np.searchsorted(bead.length, bead.place[width.judged]).clip(0, bead.length.size - 1)
        error = np.abs(width.error[width.judged])
        np.maximum.at(shares[WIDTH], _halves(stretches, _feet(analysis, ticks)), error / tolerance.bead_width)
        opening, closing = bead.stretches.T
        stopped = closing[closing < len(bead.run.time)]
        missing = np.abs(bead.missing_at_starts) / tolerance.start_length
        excess = np.abs(bead.excess_at_stops) / tolerance.stop_length
        np.maximum.at(shares[ENDS], _halves(stretches, _feet(analysis, opening)), missing)
        np.maximum.at(shares[ENDS], _halves(stretches, _feet(analysis, stopped - 1)), excess)
    return LocalUsage(shares.reshape(len(EXPONENTS), count, HALVES), _reached_speeds(analysis, stretches))


def _halves(stretches: Stretches, s: Floats) -> NDArray[np.intp]:
    """Index of the half of a stretch at arc lengths of the requested path, (n,)."""
    index = stretches.at(s)
    middle = stretches.ends[index] - 0.5 * stretches.lengths[index]
    return HALVES * index + (s > middle)


def _levels(error: Floats, index: NDArray[np.intp], count: int) -> Floats:
    """Level of an error in each stretch, (count,)."""
    levels = np.zeros(count)
    order = np.argsort(index, kind="stable")
    begins = np.searchsorted(index[order], np.arange(count + 1))
    for k in range(count):
        here = error[order[begins[k] : begins[k + 1]]]
        if here.size:
            levels[k] = np.percentile(here, _LEVEL_SHARE)
    return levels


def _feet(analysis: Analysis, ticks: NDArray[np.intp]) -> Floats:
    """Arc lengths of the requested path of the nozzle at ticks, (n,) [mm]."""
    return analysis.nozzle.s[np.searchsorted(analysis.ticks, ticks).clip(0, analysis.ticks.size - 1)]


def _reached_speeds(analysis: Analysis, stretches: Stretches) -> Floats:
    speeds = np.zeros(stretches.ends.size)
    progress = analysis.progress
    following = np.diff(analysis.ticks) == 1
    steps = np.diff(progress)[following] / analysis.run.period
    np.maximum.at(speeds, stretches.at(progress[:-1][following]), steps)
    return speeds


class SpeedModel:
    """Shares of the limits as functions of the speeds.

    Args:
        stretches: of the program, at its own speeds.

    Attributes:
        level: share of the limit of 95 % that each stretch may use.
    """

    def __init__(self, stretches: Stretches) -> None:
        self.level = 1.0
        self._stretches = stretches
        count = stretches.ends.size
        self._first: LocalUsage | None = None
        self._exponent = np.tile(EXPONENTS[:, None, None], (1, count, HALVES))
        self._share = np.zeros((len(EXPONENTS), count, HALVES))  # at 1 mm/s
        # from each stretch to the next
        # a controller ramps from one speed to the other on the longer stretch
        longer = np.maximum(stretches.lengths[1:], stretches.lengths[:-1])
        self._steps = np.clip(_STEP_PER_LENGTH * longer, _FIRST_STEP, 1.0)
        self._slowest = np.full(count, np.inf)
        self._fastest = np.zeros(count)
        self._ramps = np.full(count, np.inf)  # what the ramps reach [mm/s]
        self._bounds = np.full(count, np.inf)  # of the speeds, where starts and stops need slow ones [mm/s]

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Stretches with glue and a stated speed, (m,)."""
        judged = np.zeros(self._stretches.ends.size, bool) if self._first is None else self._first.judged
        return judged & (self._stretches.speeds > 0)

    def add_even_run(self, usage: LocalUsage, factor: float) -> None:
        """Add a run at the programmed speeds, all changed by a factor."""
        speeds = factor * self._stretches.speeds
        self._note_range(usage.reached, speeds)
        reached = usage.reached[None, :, None]
        if self._first is not None:
            before = self._first
            with np.errstate(divide="ignore", invalid="ignore"):
                change = np.log(reached / before.reached[None, :, None])
                shown = np.log(usage.shares / before.shares) / change
            powers = EXPONENTS[:, None, None]
            exponent = np.where(shown < _LEAST_EXPONENT * powers, 0.0, np.minimum(shown, _HIGHEST_EXPONENT * powers))
            is_shown = (usage.shares > 0) & (before.shares > 0) & (np.abs(change) > _TELLING_CHANGE)
            self._exponent = np.where(is_shown, exponent, self._exponent)
        else:
            self._first = usage
        self._share = self._shares_at_one(usage)

    def _shares_at_one(self, usage: LocalUsage) -> Floats:
        """Return the shares at 1 mm/s by a run, (4, m, 2)."""
        reached = usage.reached[None, :, None]
        known = (usage.shares > 0) & (reached > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = usage.shares / reached**self._exponent
        return np.where(known, share, self._share)

    def slow_ends(self) -> Floats:
        """Return the programmed speeds, slow where glue starts and stops, and growing by steps, (m,) [mm/s]."""
        judged = np.concatenate([[False], self.judged, [False]])
        is_end = self.judged & ~(judged[:-2] & judged[2:])
        speeds = np.where(is_end, _SLOW_END, 1.0) * self._stretches.speeds
        return self._with_steps(speeds)

    def add_slow_ends(self, usage: LocalUsage, speeds: Floats) -> None:
        """Add a run with `slow_ends`, whose errors are the smaller: starts and stops stay as slow."""
        self._note_range(usage.reached, speeds)
        self._share = self._shares_at_one(usage)
        self._bounds = np.where(speeds < self._stretches.speeds, speeds, np.inf)

    def add_run(self, usage: LocalUsage, speeds: Floats, used: float) -> None:
        """Add a run with speeds of its own.

        Args:
            usage: by place.
            speeds: of the stretches, (m,) [mm/s].
            used: share of the limit of 95 % that the whole path uses, nan where it is not judged.
        """
        self._note_range(usage.reached, speeds)
        if used > 0:
            self.level = float(np.clip(self.level * TARGET / used, *_LEVEL_BOUNDS))
        expected = self._share * np.maximum(usage.reached, 1e-9)[None, :, None] ** self._exponent
        limit = self._limits
        change = self._changes(speeds)
        beside = np.zeros((speeds.size, HALVES))
        beside[1:, 0] = change
        beside[:-1, 1] = change
        known = (usage.shares > 0) & (expected > 0)
        even = known & (beside < _STEP_BOUNDS[0])[None]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(known, usage.shares / expected, 1.0)
            room = np.where(usage.shares > expected, (limit - expected) / (usage.shares - expected), np.inf)
        # the model is wrong where no change of the speed is near, or where it leaves no room for one
        wrong = even | (known & (usage.shares > limit) & (expected > 0.9 * limit))
        self._share = np.where(wrong, self._share * ratio, self._share)
        factor = np.where(
            known & ((self._exponent > 0) | (expected < limit)), np.clip(room, *_STEP_FACTORS), _STEP_FACTORS[1]
        ).min(axis=0)
        of_step = np.minimum(factor[:-1, 1], factor[1:, 0])
        moved = np.clip(change * of_step, *_STEP_BOUNDS)
        self._steps = np.where(change < _STEP_BOUNDS[0], self._steps, moved)

    def speeds(self, slowest: float, fastest: float) -> Floats:
        """Return the speeds at which each stretch uses its share of the limits, (m,) [mm/s].

        Args:
            slowest: least share of the programmed speed.
            fastest: largest share of it.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            allowed = (self._limits / self._share) ** (1 / self._exponent)
        free = (self._exponent == 0) | (self._share == 0)
        speeds = np.where(free, np.inf, allowed).min(axis=(0, 2))
        speeds = np.clip(speeds, _SPEEDS_BEYOND[0] * self._slowest, _SPEEDS_BEYOND[1] * self._fastest)
        # a speed that the ramps do not reach gains no time, and leaves no stretch of steady flow
        speeds = np.minimum(speeds, np.maximum(self._ramps, self._stretches.speeds))
        programmed = self._stretches.speeds
        speeds = np.clip(speeds, slowest * programmed, fastest * programmed)
        return self._with_steps(np.where(self.judged, np.minimum(speeds, self._bounds), programmed))

    @property
    def _limits(self) -> Floats:
        """Share that each error is to use, (4, 1, 1)."""
        limits = np.full((len(EXPONENTS), 1, 1), TARGET)
        limits[LEVEL] *= self.level
        return limits

    def _with_steps(self, speeds: Floats) -> Floats:
        """Return speeds, lowered where they change too much from a stretch to the next."""
        judged = self.judged
        lowered = speeds.copy()
        for order in (range(1, speeds.size), range(speeds.size - 2, -1, -1)):
            for k in order:
                other = k - 1 if order.step > 0 else k + 1
                if judged[k] and judged[other]:
                    step = self._steps[min(k, other)]
                    lowered[k] = min(lowered[k], (1 + step) * lowered[other])
        return lowered

    def _changes(self, speeds: Floats) -> Floats:
        """Change of the speed from each stretch to the next, as a share of the slower one, (m - 1,)."""
        judged = self.judged
        low = np.minimum(speeds[1:], speeds[:-1])
        change = np.abs(np.diff(speeds)) / np.maximum(low, 1e-9)
        return np.where(judged[1:] & judged[:-1], change, 0.0)

    def _note_range(self, reached: Floats, speeds: Floats) -> None:
        bound = (reached > 0) & (reached < _AT_SPEED * speeds)
        self._ramps = np.where(bound, np.minimum(self._ramps, _CRUISE * reached), self._ramps)
        self._slowest = np.minimum(self._slowest, np.where(reached > 0, reached, np.inf))
        self._fastest = np.maximum(self._fastest, reached)


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
    allowed = (1 + _TIME_SHARE) * time(speeds)
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
    if programmed <= wanted < (1 + _SAME_SPEED) * programmed:
        return programmed
    step = 10.0 ** (math.floor(math.log10(wanted)) + 1 - _SPEED_DIGITS)
    # without the digits of a division
    return float(f"{math.floor(wanted / step * (1 + 1e-12)) * step:.{_SPEED_DIGITS}g}")
