"""Limits of speed, acceleration and corners: the job's, and those that a program of printers' firmware sets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import at_least, positive
from gantrysim.base.jit import jit
from gantrysim.controllers.gcode.move_table import FEED, LIMITS
from gantrysim.paths.limits import Limited
from gantrysim.paths.track import Track

# The speed along pieces: feeds, corners and the limits of the axes, looking ahead over the whole program.
#
# Every piece is run at a constant acceleration, at its speed, and at a constant deceleration. On an arc of the radius r
# the share beta = sqrt(3)/2 of the acceleration a is for v^2 / r and the rest, sqrt(1 - beta^2) a = a / 2, for the
# change of the speed; together they are at most a in any direction.

# shares of the acceleration on an arc
INWARD = math.sqrt(0.75)
ALONG = 0.5


def turning_speed(radius: Floats, acceleration: Floats) -> Floats:
    """Return the largest speed on arcs [mm/s]."""
    return np.sqrt(INWARD * acceleration * radius)


def jump_speed(angle: Floats, acceleration: Floats, cycle: float) -> Floats:
    """Return the largest speed in corners, where the velocity jumps by at most a T in a cycle T [mm/s]."""
    with np.errstate(divide="ignore"):
        return acceleration * cycle / (2 * np.sin(0.5 * np.minimum(angle, math.pi)))


def junction_speed(angle: Floats, deviation: Floats, acceleration: Floats, reach: Floats) -> Floats:
    """Return the speed at which printers' firmware passes corners on the exact path [mm/s].

    It is that on an arc between the two lines: v^2 = a r, r = d cos(angle / 2) / (1 - cos(angle / 2)), where d is the
    distance of the arc from the corner, and r no larger than the arc that begins at the reach from the corner.
    """
    cosine = np.cos(0.5 * np.minimum(angle, math.pi))
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.minimum(deviation * cosine / (1 - cosine), reach / np.tan(0.5 * np.minimum(angle, math.pi)))
    return np.where(cosine < 1, np.sqrt(acceleration * radius), np.inf)


def planned_profile(lengths: Floats, speed: Floats, acceleration: Floats, joint: Floats) -> Limited:
    """Return the fastest speed profile from rest to rest.

    Args:
        lengths: of the pieces, (n,) [mm].
        speed: largest speed on each, (n,) [mm/s].
        acceleration: largest on each, (n,) [mm/s²].
        joint: largest speed where pieces meet, (n - 1,) [mm/s].
    """
    top = np.zeros(lengths.size + 1)
    top[1:-1] = np.minimum(np.minimum(speed[:-1], speed[1:]), joint) ** 2
    square = _reachable_squares(lengths, acceleration, top)
    s, v = _nodes(lengths, speed, acceleration, square)
    return Limited(s, v)


@jit
def _reachable_squares(lengths: Floats, acceleration: Floats, top: Floats) -> Floats:
    """Squares of the highest speeds at the joints that can be braked from and reached, (n + 1,)."""
    x = top.copy()
    for k in range(lengths.size - 1, -1, -1):
        x[k] = min(x[k], x[k + 1] + 2.0 * acceleration[k] * lengths[k])
    for k in range(lengths.size):
        x[k + 1] = min(x[k + 1], x[k] + 2.0 * acceleration[k] * lengths[k])
    return x


@jit
def _nodes(lengths: Floats, speed: Floats, acceleration: Floats, square: Floats) -> tuple[Floats, Floats]:
    """Arc lengths where the acceleration changes, and the speeds there.

    Of nodes at one place the first is taken, as their speeds agree. Compiled, as whole arrays of all candidates take
    ten times the memory of the nodes.

    Args:
        lengths: of the pieces, (n,) [mm].
        speed: largest speed on each, (n,) [mm/s].
        acceleration: on each, (n,) [mm/s²].
        square: of the speeds where pieces meet, (n + 1,) [mm²/s²].
    """
    count = 0
    places = np.empty(0)
    speeds = np.empty(0)
    for is_counted in (False, True):
        if is_counted:
            places = np.empty(count)
            speeds = np.empty(count)
        count = 0
        begin = 0.0
        previous = -1.0
        for k in range(lengths.size):
            length = lengths[k]
            low = square[k]
            high = square[k + 1]
            reached = 0.5 * (low + high) + acceleration[k] * length
            peak = min(max(speed[k] ** 2, max(low, high)), reached)
            end = begin + length
            rise = min(max((peak - low) / (2.0 * acceleration[k]), 0.0), length)
            fall = min(max((peak - high) / (2.0 * acceleration[k]), 0.0), length)
            top = min(begin + rise, end)
            for place, value in ((begin, low), (top, peak), (min(max(end - fall, top), end), peak)):
                if place > previous:
                    if is_counted:
                        places[count] = place
                        speeds[count] = np.sqrt(value)
                    count += 1
                    previous = place
            begin = end
        if begin > previous:
            if is_counted:
                places[count] = begin
                speeds[count] = 0.0
            count += 1
    return places, speeds


Three = tuple[float, float, float]
UNLIMITED = (math.inf, math.inf, math.inf)


class MotionLimits(NamedTuple):
    """Limits of a move; what is None is the job's.

    Attributes:
        speed: along the path [mm/s].
        acceleration: along the path [mm/s²].
        axis_speeds: of x, y and z [mm/s].
        axis_accelerations: of x, y and z [mm/s²].
        corner_speed: at a right angle, from which the speed of all corners follows [mm/s].
        deviation: distance from a corner of the arc whose speed is the corner's [mm].
    """

    speed: float = math.inf
    acceleration: float | None = None
    axis_speeds: Three = UNLIMITED
    axis_accelerations: Three | None = None
    corner_speed: float | None = None
    deviation: float | None = None


_UNITS = {
    "speed": "mm/s",
    "axis_speeds": "mm/s",
    "axis_accelerations": "mm/s²",
    "corner_speed": "mm/s",
    "deviation": "mm",
}


def check_limit(name: str, value: float | tuple[float, ...] | None) -> None:
    """Check a limit that a program sets: a number or those of x, y and z, of which None and inf are no limit.

    Raises:
        InputError: one that is not above 0; the speed of corners may be 0, a stop at each, as in Klipper and Marlin.
    """
    for number in value if isinstance(value, tuple) else (value,):
        if number is None or number == math.inf:
            continue
        if name == "corner_speed":
            at_least("corner speed", number, 0, _UNITS[name])
        else:
            positive(name.replace("_", " "), number, _UNITS[name])


class PieceLimits(NamedTuple):
    """Limits of the pieces of a path, (m,) each.

    Attributes:
        speed: along the path [mm/s].
        acceleration: along the path [mm/s²].
        turning: acceleration in any direction, as on an arc [mm/s²].
        deviation: by which firmware's planner limits the speed of corners; nan where the mode of the move counts [mm].
    """

    speed: Floats
    acceleration: Floats
    turning: Floats
    deviation: Floats


@dataclass(frozen=True)
class PlanSettings:
    """What a program is planned with.

    Attributes:
        rapid: largest speed of each axis in rapid moves [mm/s].
        limits: of all moves, where the program sets none.
        cycle: period in which the velocity may jump by acceleration x cycle at a corner that is not rounded [s].
        override: factor on the feeds.
    """

    rapid: float
    limits: MotionLimits
    cycle: float
    override: float


def piece_limits(rows: list[MotionLimits], index: Floats, share: Floats, job_limits: MotionLimits) -> PieceLimits:
    """Return the limits of pieces.

    Args:
        rows: limits in force, which pieces refer to.
        index: of the limits of each piece, (m,).
        share: of a piece's motion in x, y and z, 0 to 1, (m, 3).
        job_limits: those of the job, which hold where a program sets none.
    """
    k = index.astype(np.intp)
    with np.errstate(divide="ignore"):
        per_share = 1 / share
    limits = [_filled_limits(row, job_limits) for row in rows]
    axis_speeds = np.array([row.axis_speeds for row in limits])[k]
    axis_accelerations = np.array([row.axis_accelerations for row in limits])[k]
    path_acceleration = np.array([row.acceleration for row in limits])[k]
    # of an axis without limit that does not move
    with np.errstate(invalid="ignore"):
        speed = np.nanmin(axis_speeds * per_share, axis=1)
        acceleration = np.nanmin(axis_accelerations * per_share, axis=1)
    turning = np.minimum(path_acceleration, axis_accelerations.min(axis=1))
    deviation = np.full(k.size, math.nan)
    for number, row in enumerate(limits):
        chosen = k == number
        if row.deviation is not None:
            deviation[chosen] = row.deviation
        elif row.corner_speed is not None:
            # the speed on the arc that is this far away from a right angle, whose radius is v^2 / a
            deviation[chosen] = row.corner_speed**2 * (math.sqrt(2) - 1) / turning[chosen]
    return PieceLimits(
        np.minimum(speed, np.array([row.speed for row in limits])[k]),
        np.minimum(acceleration, path_acceleration),
        turning,
        deviation,
    )


def _filled_limits(row: MotionLimits, job_limits: MotionLimits) -> MotionLimits:
    x, y, z = map(min, row.axis_speeds, job_limits.axis_speeds)
    return row._replace(
        acceleration=job_limits.acceleration if row.acceleration is None else row.acceleration,
        axis_accelerations=job_limits.axis_accelerations if row.axis_accelerations is None else row.axis_accelerations,
        axis_speeds=(x, y, z),
        speed=min(row.speed, job_limits.speed),
    )


def limits_of(
    track: Track, moves: Floats, moves_of: NDArray[np.intp], rows: tuple[MotionLimits, ...], settings: PlanSettings
) -> PieceLimits:
    """Limits of every piece; its speed is at most the feed.

    Args:
        track: the path.
        moves: of the program.
        moves_of: the move of each piece.
        rows: limits in force, which the moves refer to.
        settings: of the planner.
    """
    share = shares(track)
    limits = piece_limits(list(rows), moves[moves_of, LIMITS], share, settings.limits)
    feed = moves[moves_of, FEED]
    rapid = settings.rapid / np.maximum(share.max(axis=1), 1e-9)
    speed = np.minimum(np.where(feed > 0, feed * settings.override, rapid), limits.speed)
    acceleration = limits.acceleration.copy()
    tightest = track.tightest
    bent = np.isfinite(tightest)
    turning = limits.turning[bent]
    speed[bent] = np.minimum(speed[bent], turning_speed(np.maximum(tightest[bent], 1e-9), turning))
    acceleration[bent] = ALONG * turning
    return limits._replace(speed=speed, acceleration=acceleration)


def shares(track: Track) -> Floats:
    """Share of x, y and z in the motion along every piece, (m, 3); an arc may have any direction."""
    first, _ = track.end_tangents()
    return np.where(track.coil[:, None], 1.0, np.abs(first))
