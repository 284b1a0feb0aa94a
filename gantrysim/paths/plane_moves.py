"""Lines and arcs in a plane, as x + iy of its axes, and where two of them meet beside their programmed paths."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

_SMALLEST_LENGTH = 1e-9  # length, or angle of an arc, that counts [mm, rad]
_TOUCH_ROUNDING = 1e-6  # by which rounding may miss a circle that is only touched [mm]
_FULL_TURN = 2 * math.pi


@dataclass(frozen=True)
class PlaneMove:
    """A line or an arc in the plane.

    Attributes:
        start: of the move [mm].
        end: of the move [mm].
        centre: of an arc; None for a line [mm].
        angle: swept by an arc, positive counter-clockwise [rad].
    """

    start: complex
    end: complex
    centre: complex | None = None
    angle: float = 0.0

    @property
    def sense(self) -> float:
        """1 for an arc counter-clockwise, -1 for one clockwise."""
        return math.copysign(1.0, self.angle)

    @property
    def stands(self) -> bool:
        """Whether it does not move in the plane."""
        return self.centre is None and abs(self.end - self.start) < _SMALLEST_LENGTH

    @property
    def first_tangent(self) -> complex:
        """Unit vector along the move at its start."""
        return self._tangent(self.start)

    @property
    def last_tangent(self) -> complex:
        """Unit vector along the move at its end."""
        return self._tangent(self.end)

    @property
    def smallest_radius(self) -> float:
        """Of an arc; the radii differ within their tolerance [mm]."""
        assert self.centre is not None
        return min(abs(self.start - self.centre), abs(self.end - self.centre))

    def _tangent(self, place: complex) -> complex:
        along = self.end - self.start if self.centre is None else 1j * self.sense * (place - self.centre)
        return along / abs(along)

    def turns_towards(self, side: float) -> bool:
        """Return whether it is an arc about a centre on a side, positive for the left."""
        return self.centre is not None and side * self.angle > 0

    def offset_move(self, offset: float) -> PlaneMove:
        """Return the move at an offset, positive to the left [mm]."""
        start = self.start + 1j * offset * self.first_tangent
        end = self.end + 1j * offset * self.last_tangent
        return replace(self, start=start, end=end)

    def onward(self, place: complex) -> float:
        """Return how far a place of its line or circle lies behind its start [mm], of an arc [rad], below a turn."""
        return self._way(self.start, place)

    def back(self, place: complex) -> float:
        """Return how far a place of its line or circle lies before its end [mm], of an arc [rad], below a turn."""
        return self._way(place, self.end)

    def _way(self, begin: complex, end: complex) -> float:
        if self.centre is None:
            return ((end - begin) * self.first_tangent.conjugate()).real
        way = self.sense * cmath.phase((end - self.centre) / (begin - self.centre)) % _FULL_TURN
        return 0.0 if _FULL_TURN - way < _SMALLEST_LENGTH else way

    def begun_at(self, place: complex) -> PlaneMove:
        """Return the move from a place near its start, at the end of a move that passes almost straight into it."""
        if self.centre is None:
            return self
        later = cmath.phase((place - self.centre) / (self.start - self.centre))
        return replace(self, start=place, angle=self.angle - later)

    def without(self, begin: complex) -> PlaneMove:
        """Return what is left of the move from a place of it, at which it now begins."""
        if self.centre is None:
            return replace(self, start=begin)
        return replace(self, start=begin, angle=self.angle - self.sense * self.onward(begin))

    def until(self, end: complex) -> PlaneMove:
        """Return the move up to a place of it."""
        if self.centre is None:
            return replace(self, end=end)
        return replace(self, end=end, angle=self.angle - self.sense * self.back(end))


def meeting(before: PlaneMove, after: PlaneMove) -> complex | None:
    """Return where two moves that pass each other meet: the place that cuts the least off them, None without any.

    Args:
        before: beside its path, up to a corner.
        after: beside its path, from that corner.
    """
    places = [
        place
        for place in _crossings(before, after)
        if before.back(place) > -_SMALLEST_LENGTH and after.onward(place) > -_SMALLEST_LENGTH
    ]
    return min(
        places,
        key=lambda place: _cut_length(before, before.back(place)) + _cut_length(after, after.onward(place)),
        default=None,
    )


def _cut_length(move: PlaneMove, way: float) -> float:
    """The length of a way along a move [mm]."""
    return way if move.centre is None else way * abs(move.end - move.centre)


def _crossings(first: PlaneMove, second: PlaneMove) -> Iterator[complex]:
    """The places where the whole lines and circles of two moves cross."""
    if first.centre is None and second.centre is None:
        across = (first.first_tangent.conjugate() * second.first_tangent).imag
        if abs(across) > _SMALLEST_LENGTH:
            along = ((second.start - first.end).conjugate() * second.first_tangent).imag / across
            yield first.end + along * first.first_tangent
    elif first.centre is None:
        yield from _line_and_circle(first, second)
    elif second.centre is None:
        yield from _line_and_circle(second, first)
    else:
        yield from _circles(first.centre, abs(first.end - first.centre), second.centre, abs(second.end - second.centre))


def _line_and_circle(line: PlaneMove, arc: PlaneMove) -> Iterator[complex]:
    assert arc.centre is not None
    tangent = line.first_tangent
    # along and across the line
    arm = (arc.centre - line.start) * tangent.conjugate()
    radius = abs(arc.end - arc.centre)
    if abs(arm.imag) > radius + _TOUCH_ROUNDING:
        return
    half = math.sqrt(max(radius**2 - arm.imag**2, 0.0))
    foot = line.start + arm.real * tangent
    yield foot - half * tangent
    yield foot + half * tangent


def _circles(first: complex, first_radius: float, second: complex, second_radius: float) -> Iterator[complex]:
    apart = abs(second - first)
    if apart < _SMALLEST_LENGTH:
        return
    along = (apart**2 + first_radius**2 - second_radius**2) / (2 * apart)
    if abs(along) > first_radius + _TOUCH_ROUNDING:
        return
    half = math.sqrt(max(first_radius**2 - along**2, 0.0))
    direction = (second - first) / apart
    yield first + direction * complex(along, half)
    yield first + direction * complex(along, -half)
