"""Names the confusion of units that makes an inertia, a torque or a travel that is no machine's of this table."""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import correlate

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import WHOLE_LOG, Starts, gradient, smoothed
from gantrysim.identify.sizes import number_words, times_beside
from gantrysim.machine.axis import Axis

# Relation of the torque to the motion beside it: torque = J a + b v + Fc sign v + constant, low-passed.

EXPLAINED_VARIANCE = 0.5  # least share of the torque's variance that acceleration and friction explain
WIDTH = 0.004  # standard deviation of the low-pass [s]
_MOVING_SPEED = 0.02  # share of the highest speed from which an axis slides
_SLIDING_SHARE = 0.9  # share of the samples around one that must be in motion
_ACCELERATION_JUMP = 3.0  # acceleration that no motion has, of that which 98 % of the samples stay below
_LOG_SAMPLES = 500  # samples; a shorter log is refused by the regression


class Relation(NamedTuple):
    """Regression of a torque on a motion.

    Attributes:
        explained: share of the torque's variance.
        inertia: [N·m·s²/u].
    """

    explained: float
    inertia: float


def relation_of(position: Floats, torque: Floats, period: float, starts: Starts = WHOLE_LOG) -> Relation | None:
    """Return the regression of the torque where the axis slides; None of an axis that hardly does."""
    width = WIDTH / period
    if position.size < _LOG_SAMPLES:
        return None
    speed = gradient(smoothed(position, width, starts), period, starts)
    least = _MOVING_SPEED * float(np.quantile(np.abs(speed), 0.99))
    slides = smoothed((np.abs(speed) > least).astype(np.float64), width, starts) > _SLIDING_SHARE
    if not least > 0 or slides.sum() < _LOG_SAMPLES:
        return None
    acceleration = gradient(speed, period, starts)
    # jumps of the position are the matter of another check
    slides &= np.abs(acceleration) < _ACCELERATION_JUMP * float(np.quantile(np.abs(acceleration[slides]), 0.98))
    direction = smoothed(np.sign(gradient(position, 1.0, starts)), width, starts)
    A = np.stack([acceleration, speed, direction, np.ones_like(speed)], axis=1)[slides]
    smooth = smoothed(torque, width, starts)[slides]
    size = np.maximum(np.abs(A).max(axis=0), 1e-300)
    coefficients = np.linalg.lstsq(A / size, smooth, rcond=None)[0]
    variance = float(np.var(smooth))
    if not variance > 0:
        return None
    remainder = float(np.var(smooth - (A / size) @ coefficients))
    return Relation(1 - remainder / variance, float(coefficients[0] / size[0]))


UNUSABLE_RATIO = 5.0  # ratio of the inertia to that of the table, or its inverse, from which the log is refused
TRAVEL = 2.0  # largest travel of the log, of the axis': its table may leave out the ends
_SAME_FACTOR = 1.5  # ratio of two factors that may be the same: machines differ from their tables by as much
_PEAK_OVER_RATED = (2.0, 5.0)  # peak torque of servo drives over the rated one


def torque_slips(axis: Axis, factor: float) -> list[str]:
    """Return the units of a torque that is this many times too large when read as N·m."""
    slips = {
        "mN·m": (1e3, 1e3),
        "N·cm": (1e2, 1e2),
        "ozf·in": (141.6, 141.6),
        "lbf·in": (8.851, 8.851),
        "kgf·m": (1 / 9.81, 1 / 9.81),
        "kN·m": (1e-3, 1e-3),
    }
    if math.isfinite(axis.motor_constant) and axis.motor_constant > 0:
        slips[f"A ({axis.motor_constant:g} N·m/A)"] = (1 / axis.motor_constant,) * 2
    if math.isfinite(axis.peak_torque) and axis.peak_torque > 0:
        low = _PEAK_OVER_RATED[0] / axis.peak_torque
        high = _PEAK_OVER_RATED[1] / axis.peak_torque
        slips["% of the rated torque"] = (1e2 * low, 1e2 * high)
        slips["per mille of the rated torque"] = (1e3 * low, 1e3 * high)
    return _matching(slips, factor)


def position_slips(axis: Axis, factor: float) -> list[str]:
    """Return the units of a position that is this many times too large when read as mm or deg."""
    if axis.unit == "mm":
        units = {"m": 1e-3, "µm": 1e3, "inches": 1 / 25.4}
    else:
        units = {"rad": math.pi / 180, "turns": 1 / 360, "mdeg": 1e3}
    units["rad of the motor"] = 1 / axis.scale
    units["turns of the motor"] = 1 / (2 * math.pi * axis.scale)
    units["degrees of the motor"] = math.degrees(1 / axis.scale)
    if axis.resolution > 0:
        units["counts"] = 1 / axis.resolution
    return _matching({name: (size, size) for name, size in units.items() if abs(math.log(size)) > 0.1}, factor)


def _matching(slips: dict[str, tuple[float, float]], factor: float) -> list[str]:
    """Return the names of the ranges that hold a factor, nearest first."""
    distances = {}
    for name, (low, high) in slips.items():
        outside = max(math.log(low / factor), math.log(factor / high), 0.0)
        if outside < math.log(_SAME_FACTOR):
            distances[name] = outside
    return sorted(distances, key=lambda name: distances[name])


def check_travel(axis: Axis, position: Floats, ratio: float) -> None:
    """Refuse a position that goes further than the axis can.

    Args:
        axis: of the machine.
        position: (n,) [u].
        ratio: of the log's inertia to that of the table; nan where it is not known.

    Raises:
        NotIdentifiedError: with the travel, the bound and the unit that the inertia suggests.
    """
    distance = float(np.ptp(position))
    low, high = axis.travel
    longest = TRAVEL * (high - low)
    if not (math.isfinite(longest) and distance > longest > 0):
        return
    slips = position_slips(axis, 1 / ratio) if ratio > 0 else []
    hint = f"position in {' or '.join(slips)} read as {axis.unit}?" if slips else "check its unit"
    raise NotIdentifiedError(
        f"axis {axis.name}: its position goes over {number_words(distance)} {axis.unit}, the axis over "
        f"{high - low:.4g} {axis.unit}: must be at most {TRAVEL:g} times as far; {hint}"
    )


def inertia_ratio(
    table: AxisModel, position: Floats, torque: Floats, period: float, starts: Starts = WHOLE_LOG
) -> float:
    """Return the log's inertia over that of the table; nan where the motion does not explain the torque."""
    relation = relation_of(position, torque, period, starts)
    if relation is None or relation.explained < EXPLAINED_VARIANCE:
        return math.nan
    return relation.inertia / table.inertia


# inertia by torque over acceleration, which has the time squared
_TIME_SLIPS = {"ms": (1e6, 1e6), "µs": (1e12, 1e12)}


def inertia_hint(axis: Axis, ratio: float) -> str:
    """Return the confusions that make an inertia this many times that of the table, as a question or an advice."""
    slips = [f"torque in {name} read as N·m" for name in torque_slips(axis, ratio)]
    slips += [f"position in {name} read as {axis.unit}" for name in position_slips(axis, 1 / ratio)]
    slips += [f"time in {name} read as s" for name in _matching(_TIME_SLIPS, ratio)]
    return f"{', or '.join(slips)}?" if slips else "check units, lead and gear ratio"


def check_inertia(axis: Axis, ratio: float) -> None:
    """Refuse an inertia of the log that is no machine's of this table.

    Args:
        axis: of the machine.
        ratio: of the inertia by the regression to that of the table, as `inertia_ratio` has it.

    Raises:
        NotIdentifiedError: the ratio or its inverse exceeds `UNUSABLE_RATIO`.
    """
    if not ratio > 0 or 1 / UNUSABLE_RATIO <= ratio <= UNUSABLE_RATIO:
        return
    raise NotIdentifiedError(
        f"axis {axis.name}: the log gives {times_beside(ratio, UNUSABLE_RATIO, 1 / UNUSABLE_RATIO)} the inertia of the "
        f"machine's table, must be {1 / UNUSABLE_RATIO:g} to {UNUSABLE_RATIO:g} times; {inertia_hint(axis, ratio)}"
    )


# Check of the log: the torque must be that of the motion beside it.
#
# Acceleration and friction explain 82 % and more of the torque on healthy logs of whatever friction, 30 % and less once
# the columns are apart by 15 ms, 2 % with the torque of another axis. The torque's unit changes nothing of that.

_RELATED_SHARE = 0.8  # share of the torque that is explained, from which another reading of the columns is named
_LONGEST_SHIFT = 0.5  # longest shift between the columns that is searched [s]


def check_columns(axis: str, position: Floats, torque: Floats, period: float, starts: Starts = WHOLE_LOG) -> None:
    """Refuse a torque that has not made the motion beside it, and name the confusion where another reading fits.

    Args:
        axis: its name.
        position: (n,) [u].
        torque: (n,) [N·m].
        period: of the samples [s].
        starts: of the pieces.

    Raises:
        NotIdentifiedError: with the share of the torque that is explained.
    """
    relation = relation_of(position, torque, period, starts)
    if relation is None:
        return
    percent = 100 * relation.explained
    bound = f"must explain at least {100 * EXPLAINED_VARIANCE:.0f} %"
    if relation.explained >= EXPLAINED_VARIANCE:
        if relation.inertia > 0:
            return
        raise NotIdentifiedError(
            f"axis {axis}: its torque accelerates it backwards, with an inertia of {relation.inertia:.3g} N·m·s²: must "
            "be greater than 0; the torque or the position has the wrong sign"
        )
    shift = _shift(position, torque, period, starts)
    later = np.roll(torque, -shift)
    shifted = relation_of(position, later, period, starts)
    if shift and shifted is not None and shifted.explained >= _RELATED_SHARE and shifted.inertia > 0:
        side = "late" if shift > 0 else "early"
        raise NotIdentifiedError(
            f"axis {axis}: its acceleration explains {percent:.0f} % of its torque, {bound}: the torque is "
            f"{1e3 * abs(shift) * period:.3g} ms {side} against the position, shifted by which "
            f"{100 * shifted.explained:.0f} % are explained; log both by one clock"
        )
    raise NotIdentifiedError(
        f"axis {axis}: its acceleration and friction explain {percent:.0f} % of its torque, {bound}: the torque "
        "belongs to another axis or to another time"
    )


def check_swapped(axis: str, position: Floats, torque: Floats, period: float, starts: Starts = WHOLE_LOG) -> None:
    """Refuse columns of which each is the other's.

    Raises:
        NotIdentifiedError: the position makes a torque of the torque's motion, and the reverse does not hold.
    """
    relation = relation_of(position, torque, period, starts)
    swapped = relation_of(torque, position, period, starts)
    if swapped is None or (relation is not None and relation.explained >= EXPLAINED_VARIANCE):
        return
    if swapped.explained >= _RELATED_SHARE and swapped.inertia > 0:
        raise NotIdentifiedError(
            f"axis {axis}: its columns of torque and position are swapped: read the other way round, acceleration and "
            f"friction explain {100 * swapped.explained:.0f} % of the torque"
        )


def _shift(position: Floats, torque: Floats, period: float, starts: Starts) -> int:
    """Return the samples by which the torque follows the acceleration that correlates with it most."""
    width = WIDTH / period
    speed = gradient(smoothed(position, width, starts), period, starts)
    acceleration = gradient(speed, period, starts)
    smooth = smoothed(torque - torque.mean(), width, starts)
    correlation = correlate(smooth, acceleration - acceleration.mean(), "full", "fft")
    lags = np.arange(correlation.size) - (position.size - 1)
    near = np.abs(lags) <= round(_LONGEST_SHIFT / period)
    return int(lags[near][int(np.argmax(correlation[near]))])
