"""How the time of a measured trace goes with that of the run, from the instants of the run at its samples.

With t the trace's time and tau that of the run at the same place, either t = shift + (1 + clock) tau, with equal speeds
and a clock that runs fast or slow, or the speeds differ: then dtau/dt at places where the run's speed is steady is the
ratio of the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats, spans
from gantrysim.compare.estimates import Estimate, clustered_intervals
from gantrysim.compare.places import Rows

_MOVING = 0.1  # of the highest speed, from which an instant is known by its place
_STEADY = 0.02  # of the largest acceleration along the path, below which a speed is steady
_LONG = 0.05  # of a window in which its ratio is taken [s]
_FEWEST_WINDOWS = 4
_LARGEST_CLOCK = 2e-3  # rate by which a log's clock may be wrong; beyond, it is another speed
_SAME = 5.0  # residuals across the path by which places may differ at equal times
_LAG = 5e-3  # time by which a real axis may lag more or less than the simulated one [s]
_NEARLY_ALL = 0.999  # of the samples, that are no further
_FEWEST = 8  # samples in motion


class Motion(NamedTuple):
    """The instants of a run at the samples of a trace, those that are part of it.

    Attributes:
        time: of the trace, (n,) [s].
        instants: of the run, (n,) [s].
        speed: of the run's command along its path there, (n,) [mm/s].
        acceleration: likewise, (n,) [mm/s²].
        still: whether the trace stands still, (n,).
        dispense: whether glue flows there, whose speed is the feed, (n,).
    """

    time: Floats
    instants: Floats
    speed: Floats
    acceleration: Floats
    still: Rows
    dispense: Rows


@dataclass(frozen=True)
class Timing:
    """The time of a trace against that of the run.

    Attributes:
        kind: "shift" where both pass the same places at the same times, "clock" where the trace's clock is faster or
            slower, or "speed" where the speeds differ.
        shift: time of the trace less that of the run: its mean, weighted by speed [s].
        clock: rate of the trace's clock less 1, where the speeds are the same.
        middle: instant of the run about which the clock is faster [s].
        speed: of the trace, over that of the run, where glue flows and the run's is steady; None where it never is.
        duration: time of the trace in motion, over that of the run for the same way.
    """

    kind: str
    shift: Estimate
    clock: Estimate
    middle: float
    speed: Estimate | None
    duration: float

    def instants(self, time: Floats) -> Floats:
        """Return the instants of the run at times of a trace with the same speeds, (n,) [s]."""
        if self.kind == "clock":
            return self.middle + (time - self.middle - self.shift.value) / (1 + self.clock.value)
        return time - self.shift.value


def timing_of(motion: Motion, across: float) -> Timing | None:
    """Return how the time of a trace goes; None where it hardly moves.

    Args:
        motion: the instants of the run at its samples.
        across: rms of what is left across the path [mm or deg].
    """
    moving = ~motion.still & (motion.speed > _MOVING * motion.speed.max())
    if np.count_nonzero(moving) < _FEWEST:
        return None
    time, instants, speed = (values[moving] for values in (motion.time, motion.instants, motion.speed))
    middle = float(np.average(instants, weights=speed**2))
    # weighted by the speed, so that residuals are distances along the path
    slopes = np.stack([speed, speed * (instants - middle)], axis=1)[:, None, :]
    late = (time - instants) * speed
    shift, rate = np.linalg.lstsq(slopes[:, 0], late, rcond=None)[0].tolist()
    along = late - slopes[:, 0] @ [shift, rate]
    of_shift, of_rate = clustered_intervals(along[:, None], slopes).tolist()
    clock = Estimate(rate, of_rate)
    allowed = max(_SAME * across, _LAG * float(np.median(speed)))
    kind = "speed"
    if abs(rate) <= _LARGEST_CLOCK and float(np.quantile(np.abs(along), _NEARLY_ALL)) <= allowed:
        kind = "clock" if clock.distinguished and abs(rate) > _ROUNDING else "shift"
    steady = _steady_ratio(motion)
    way = float(np.ptp(instants))
    return Timing(kind, Estimate(shift, of_shift), clock, middle, steady, float(np.ptp(time)) / max(way, 1e-12))


_ROUNDING = 1e-9  # rate of a clock


def _steady_ratio(motion: Motion) -> Estimate | None:
    """Return the ratio of the speeds where that of the run is steady."""
    feed = ~motion.still & motion.dispense
    if not feed.any():
        return None
    is_steady = np.abs(motion.acceleration) <= _STEADY * float(np.abs(motion.acceleration).max())
    is_steady &= feed & (motion.speed > 0.5 * motion.speed[feed].max())
    ratios = []
    for first, after in spans(is_steady):
        # by windows: within one stretch of the run a trace may stop, as at a joint of two pieces
        windows = max(int((motion.instants[after - 1] - motion.instants[first]) / _LONG), 1)
        for rows in np.array_split(np.arange(first, after), windows):
            time = motion.time[rows] - motion.time[rows].mean()
            instants = motion.instants[rows] - motion.instants[rows].mean()
            if rows.size >= _FEWEST and np.ptp(instants) > 0:
                ratios.append(float(np.sum(time * instants) / np.sum(time**2)))
    if len(ratios) < _FEWEST_WINDOWS:
        return None
    ratio = float(np.median(ratios))
    # of a median of normal values, and their deviation from the median of its magnitudes
    deviation = 1.2533 * 1.4826 * float(np.median(np.abs(np.array(ratios) - ratio))) / len(ratios) ** 0.5
    return Estimate(ratio, 2 * deviation)
