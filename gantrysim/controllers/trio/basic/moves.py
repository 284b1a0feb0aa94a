"""The moves of Trio BASIC: what each does with its axes, as a function of the distance that its profile has covered.

What the parameters of corners bound is in Trio's Motion Coordinator Technical Reference Manual. The law between the
bounds is not documented in the sources at hand: linear in the angle between DECEL_ANGLE and STOP_ANGLE, and in
proportion to the radius below FULL_SP_RADIUS, are assumptions.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit

IDLE = 0
MOVE = 1
MOVEABS = 2
MHELICAL = 3
MOVECIRC = 4
MOVESP = 6
MOVEABSSP = 7
MOVECIRCSP = 8
MHELICALSP = 9
FORWARD = 10
REVERSE = 11
CAM = 13
CAMBOX = 20
CONNECT = 21
MOVELINK = 22

# moves that state their path
STATED_MOVES = frozenset({MOVE, MOVEABS, MHELICAL, MOVECIRC, MOVESP, MOVEABSSP, MHELICALSP, MOVECIRCSP})

SMALLEST_RADIUS = 1e-3  # of a circle [units]

SHARP_CORNERS = 2  # bits of CORNER_MODE
SMALL_CIRCLES = 8
_STRAIGHT_TURN = 1e-7  # change of direction that is rounding [rad]


class Shape:
    """A path in the units of its axes: no protocol, as `isinstance` of its subclasses would take long.

    Attributes:
        length: to its end along the path, inf for none.
        brakes: whether the axes slow down for the end.
    """

    length: float
    brakes: bool

    def displacement(self, s: float) -> tuple[float, ...]:
        """Displacements of the axes from the start at the distance s."""
        raise NotImplementedError

    def displacements(self, s: Floats) -> Floats:
        """Displacements at each of the distances, (axes, n)."""
        return np.array([self.displacement(distance) for distance in s.tolist()]).T


def _finite(length: float) -> float:
    if not math.isfinite(length):
        raise InputError(f"move of length {length:g}: must be finite")
    return length


@dataclass
class Straight(Shape):
    """MOVE and MOVEABS: all axes in proportion."""

    deltas: tuple[float, ...]
    length: float = field(init=False)
    brakes: bool = True

    def __post_init__(self) -> None:
        self.length = _finite(math.hypot(*self.deltas))

    def displacement(self, s: float) -> tuple[float, ...]:
        if s >= self.length:
            return self.deltas
        share = s / self.length
        return tuple(share * delta for delta in self.deltas)

    def displacements(self, s: Floats) -> Floats:
        places: Floats = np.array(self.deltas)[:, None] * (s / self.length)
        return places


@dataclass
class Arc(Shape):
    """MOVECIRC and MHELICAL: an arc about a centre relative to the start, and an even climb.

    As on the controller, the centre and the start give the radius, and the stated end gives the angle alone: where it
    does not lie on the circle, the move ends on the circle, on the line from the centre through it.

    Args:
        end: stated for the arc, relative to the start; (0, 0) for a full circle.
        centre: relative to the start.
        clockwise: direction 1, seen with the first axis to the right and the second one up.
        rise: of the third axis, None for two axes.
        flat: whether the length, which SPEED applies to, is that of the circle alone (mode 1 of MHELICAL).

    Attributes:
        reached: where the arc ends, relative to the start.
        off_circle: distance of the stated end from there.
    """

    end: tuple[float, float]
    centre: tuple[float, float]
    clockwise: bool
    rise: float | None = None
    flat: bool = True
    reached: tuple[float, float] = field(init=False)
    off_circle: float = field(init=False)
    radius: float = field(init=False)
    begin: float = field(init=False)
    angle: float = field(init=False)
    length: float = field(init=False)
    brakes: bool = True

    def __post_init__(self) -> None:
        ex, ey = self.end
        cx, cy = self.centre
        self.radius = math.hypot(cx, cy)
        if self.radius <= SMALLEST_RADIUS:
            raise InputError(
                f"circle about ({cx:g}, {cy:g}) of radius {self.radius:g}: a radius must be above {SMALLEST_RADIUS:g}"
            )
        to_end = math.hypot(ex - cx, ey - cy)
        if to_end <= SMALLEST_RADIUS:
            raise InputError(f"circle about ({cx:g}, {cy:g}): its end is its centre: must lie on the circle")
        stretch = self.radius / to_end
        self.off_circle = abs(to_end - self.radius)
        self.begin = math.atan2(-cy, -cx)
        swept = (math.atan2(ey - cy, ex - cx) - self.begin) * (-1 if self.clockwise else 1)
        full = math.hypot(ex, ey) <= 1e-9 * self.radius
        turned = swept % (2 * math.pi)
        if min(turned, 2 * math.pi - turned) <= 1e-9 and not full:
            raise InputError(
                f"circle about ({cx:g}, {cy:g}): its end ({ex:g}, {ey:g}) lies in the direction of the start, but "
                f"{self.off_circle:.4g} off it: must be (0, 0) for a full circle"
            )
        self.angle = 2 * math.pi if full else turned
        self.reached = (0.0, 0.0) if full else (cx + stretch * (ex - cx), cy + stretch * (ey - cy))
        arc = self.radius * self.angle
        self.length = _finite(arc if self.flat else math.hypot(arc, self.rise or 0.0))

    def displacement(self, s: float) -> tuple[float, ...]:
        share = s / self.length
        if share >= 1:
            return self.reached if self.rise is None else (*self.reached, self.rise)
        psi = self.begin + (-1 if self.clockwise else 1) * self.angle * share
        x = self.centre[0] + self.radius * math.cos(psi)
        y = self.centre[1] + self.radius * math.sin(psi)
        return (x, y) if self.rise is None else (x, y, self.rise * share)

    def displacements(self, s: Floats) -> Floats:
        places = np.empty((2 if self.rise is None else 3, len(s)))
        turned = (-1 if self.clockwise else 1) * self.angle
        _find_turned(s, (self.length, self.begin, turned, self.radius, *self.centre), places)
        if self.rise is not None:
            np.multiply(self.rise, s / self.length, out=places[2])
        return places


@jit
def _find_turned(s: Floats, arc: tuple[float, float, float, float, float, float], places: Floats) -> None:
    """Write the first two displacements along an arc, (axes, n) [units].

    Compiled for the library's cosine and sine of single numbers, as `Arc.displacement` takes them: NumPy's of arrays
    differ in the last bit.

    Args:
        s: distances, (n,) [units].
        arc: length, angle at its beginning, angle swept, radius, and centre.
        places: written.
    """
    length, begin, turned, radius, x, y = arc
    for k in range(s.size):
        psi = begin + turned * (s[k] / length)
        places[0, k] = x + radius * math.cos(psi)
        places[1, k] = y + radius * math.sin(psi)


@dataclass
class Jog(Shape):
    """FORWARD and REVERSE: on and on."""

    sign: float
    length: float = math.inf
    brakes: bool = True

    def displacement(self, s: float) -> tuple[float, ...]:
        return (self.sign * s,)


@dataclass
class Table(Shape):
    """CAM and CAMBOX: positions at even distances, straight between them.

    Args:
        values: displacements from the first one.
        length: over which all of them are run through.
    """

    values: tuple[float, ...]
    length: float
    brakes: bool = False

    def displacement(self, s: float) -> tuple[float, ...]:
        place = min(max(s / self.length, 0.0), 1.0) * (len(self.values) - 1)
        k = min(int(place), len(self.values) - 2)
        return (self.values[k] + (place - k) * (self.values[k + 1] - self.values[k]),)


class Ramps(Shape):
    """MOVELINK: from rest, at an even rate, and back to rest, over distances of the link axis.

    Args:
        distance: of the axis.
        length: of the link axis in all.
        up, down: of the link axis while the axis speeds up and slows down; where they exceed `length`, they shrink
            in proportion.
    """

    brakes = False

    def __init__(self, distance: float, length: float, up: float, down: float) -> None:
        shrink = min(1.0, length / (up + down)) if up + down > 0 else 1.0
        up = up * shrink
        down = down * shrink
        self.length = length
        rate = distance / (length - 0.5 * (up + down))
        if not math.isfinite(rate):
            raise InputError(f"{distance:g} over a link distance of {length:g}: must be a finite rate")
        # distance, position and rate at the corners of the trapezium
        self._corners = (0.0, up, length - down)
        self._values = (0.0, 0.5 * rate * up, distance - 0.5 * rate * down)
        self._rates = (0.0, rate, rate)
        self._slopes = (rate / up if up else 0.0, 0.0, -rate / down if down else 0.0)

    def displacement(self, s: float) -> tuple[float, ...]:
        place = min(max(s, 0.0), self.length)
        k = max(bisect.bisect_right(self._corners, place) - 1, 0)
        past_corner = place - self._corners[k]
        return (self._values[k] + past_corner * (self._rates[k] + 0.5 * self._slopes[k] * past_corner),)


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
        if not self.mode & SHARP_CORNERS or angle <= max(self.decel_angle, _STRAIGHT_TURN):
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


@dataclass(eq=False)
class Move:
    """A move as a program has ordered it.

    Attributes:
        kind: its MTYPE.
        line: of the program.
        axes: numbers of its axes; the first one holds it.
        targets: of MOVEABS in the axes' coordinates; its shape follows when it is loaded.
        shape: of a move with a profile, and of CAMBOX and MOVELINK over their link axis' distance.
        driver: number of the axis that it is linked to.
        ratio: of CONNECT.
        repeats: whether CAMBOX or MOVELINK repeats.
        forward_only: whether the link is active in the positive direction alone.
        link_start: position of the link axis at which it starts; None for at once.
        s: distance covered.
        displaced: displacements of the axes there.
        start: positions of the axes when it was loaded.
        stopping: whether it was cancelled and slows down.
        finished: whether it was run to its end.
        beside: other axes that had a move when it was loaded.
        speeds: of a move whose name ends in SP.
        corners: rules of its joint with the move before, and of its circle.
    """

    kind: int
    line: int
    axes: tuple[int, ...]
    shape: Shape = field(default_factory=lambda: Jog(1.0))
    targets: tuple[float, ...] | None = None
    driver: int | None = None
    ratio: float = 1.0
    repeats: bool = False
    forward_only: bool = False
    link_start: float | None = None
    s: float = 0.0
    displaced: tuple[float, ...] = ()
    start: tuple[float, ...] = ()
    stopping: bool = False
    finished: bool = False
    beside: tuple[int, ...] = ()
    speeds: MoveSpeeds | None = None
    corners: CornerRules = FULL_SPEED

    @property
    def has_profile(self) -> bool:
        """Whether SPEED, ACCEL and DECEL of its axis apply."""
        return self.driver is None

    @property
    def has_limits(self) -> bool:
        """Whether more than SPEED may limit its speed."""
        return self.speeds is not None or self.corners.act
