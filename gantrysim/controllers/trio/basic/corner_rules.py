"""Speeds that a program gives to a move: CORNER_MODE with its angles and radius, and the speeds of SP moves.

What the parameters bound is in Trio's Motion Coordinator Technical Reference Manual. The law between the bounds is not
documented in the sources at hand: linear in the angle between DECEL_ANGLE and STOP_ANGLE, and in proportion to the
radius below FULL_SP_RADIUS, are assumptions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SHARP_CORNERS = 2  # bits of CORNER_MODE
SMALL_CIRCLES = 8
_STRAIGHT = 1e-7  # change of direction that is rounding [rad]


@dataclass(frozen=True)
class CornerRules:
    """CORNER_MODE and what belongs to it.

    Attributes:
        mode: CORNER_MODE, a sum of 2 (corners) and 8 (circles).
        decel_angle: DECEL_ANGLE, largest change of direction at full speed [rad].
        stop_angle: STOP_ANGLE, least change of direction with a stop [rad].
        full_radius: FULL_SP_RADIUS, least radius at full speed [units].
    """

    mode: int = 0
    decel_angle: float = 0.0
    stop_angle: float = 0.0
    full_radius: float = 0.0

    @property
    def act(self) -> bool:
        """Whether a bit of the mode is set."""
        return self.mode != 0

    def share_at_corner(self, angle: float) -> float:
        """Return the share of the speed at a change of direction [rad].

        It is 1 up to DECEL_ANGLE, 0 from STOP_ANGLE on, and falls linearly between them, which is assumed.
        """
        if not self.mode & SHARP_CORNERS or angle <= max(self.decel_angle, _STRAIGHT):
            return 1.0
        if angle >= self.stop_angle:
            return 0.0
        return (self.stop_angle - angle) / (self.stop_angle - self.decel_angle)

    def share_on_circle(self, radius: float) -> float:
        """Return the share of the speed on a circle: 1 from FULL_SP_RADIUS on, radius / FULL_SP_RADIUS below.

        That it is in proportion is assumed.
        """
        if not self.mode & SMALL_CIRCLES or radius >= self.full_radius:
            return 1.0
        return radius / self.full_radius


FULL_SPEED = CornerRules()


@dataclass(frozen=True)
class MoveSpeeds:
    """Speeds of a move whose name ends in SP.

    Attributes:
        force: FORCE_SPEED, along the move; None for SPEED [units/s].
        start: STARTMOVE_SPEED, largest speed at its start, inf for no limit [units/s].
        end: ENDMOVE_SPEED, largest speed at its end where another move is merged, inf for no limit [units/s].
    """

    force: float | None = None
    start: float = math.inf
    end: float = math.inf
