"""Limits of speed, acceleration and corners: the job's, and those that a program of printers' firmware sets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.controllers.gcode.lookahead import ALONG, turning_speed
from gantrysim.controllers.gcode.move_table import FEED, LIMITS
from gantrysim.paths.track import Track

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
    limits = [_filled(row, job_limits) for row in rows]
    axis_speeds = np.array([row.axis_speeds for row in limits])[k]
    axis_accelerations = np.array([row.axis_accelerations for row in limits])[k]
    path_acceleration = np.array([row.acceleration for row in limits])[k]
    with np.errstate(invalid="ignore"):  # of an axis without limit that does not move
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


def _filled(row: MotionLimits, job_limits: MotionLimits) -> MotionLimits:
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
