"""NURBS in the selected plane, as chords within a micrometre: G5.2 to G5.3 with uniform knots, G6.2 with its own.

A curve of the order k, the degree k - 1, has n control points P with weights w and n + k knots t; it runs from the knot
t[k - 1] to the knot t[n]. Between two knots it is a rational Bézier curve, whose control points are the values of the
curve's polar form at both knots. Halves of it are taken until their control points lie on the chord.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.move_table import PLANES
from gantrysim.controllers.gcode.open_curve import OpenCurve
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

_CHORD = 1e-3  # largest distance of a chord from its curve [mm]
_MOST_HALVES = 24
_DEFAULT_ORDER = 3
_HIGHEST_ORDER = 30
_NAMES = "XYZ"


@dataclass(frozen=True)
class Nurbs:
    """A curve in the plane, as x + iy of its axes.

    Attributes:
        order: one more than the degree.
        points: control points [mm].
        weights: of the points.
        knots: ascending, as many as points and order together.
    """

    order: int
    points: tuple[complex, ...]
    weights: tuple[float, ...]
    knots: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.points) < self.order:
            raise InputError(f"NURBS of {len(self.points)} control points: must have at least its order, {self.order}")
        if len(self.knots) != len(self.points) + self.order:
            raise InputError(f"NURBS of {len(self.knots)} knots: must have {len(self.points) + self.order}")
        if any(later < earlier for earlier, later in pairwise(self.knots)):
            raise InputError("NURBS knots: must not descend")
        if min(self.weights) <= 0:
            raise InputError(f"NURBS weight = {min(self.weights):g}: must be greater than 0")

    def chords(self, tolerance: float = _CHORD) -> Iterator[complex]:
        """Yield the ends of chords within a tolerance of the curve, from its start [mm]."""
        begin = True
        for span in range(self.order - 1, len(self.points)):
            low = self.knots[span]
            high = self.knots[span + 1]
            if high <= low:
                continue
            piece = [self._polar(span, low, high, highs) for highs in range(self.order)]
            if begin:
                yield piece[0][0] / piece[0][1]
                begin = False
            yield from _ends(piece, tolerance, _MOST_HALVES)

    def _polar(self, span: int, low: float, high: float, highs: int) -> tuple[complex, float]:
        """The weighted control point of the Bézier curve between two knots that takes the upper so many times."""
        degree = self.order - 1
        arguments = [high] * highs + [low] * (degree - highs)
        first = span - degree
        level = [
            (point * weight, weight)
            for point, weight in zip(self.points[first : span + 1], self.weights[first : span + 1], strict=True)
        ]
        for step, argument in enumerate(arguments, 1):
            for k in range(len(level) - 1):
                start = self.knots[first + k + step]
                share = (argument - start) / (self.knots[first + k + degree + 1] - start)
                level[k] = _between(level[k], level[k + 1], share)
            level.pop()
        return level[0]


def _between(first: tuple[complex, float], second: tuple[complex, float], share: float) -> tuple[complex, float]:
    return (
        (1 - share) * first[0] + share * second[0],
        (1 - share) * first[1] + share * second[1],
    )


def _ends(piece: list[tuple[complex, float]], tolerance: float, halves: int) -> Iterator[complex]:
    """The ends of the chords of a rational Bézier curve, by its weighted control points."""
    places = [point / weight for point, weight in piece]
    if not halves or max(_distance(place, places[0], places[-1]) for place in places) <= tolerance:
        yield places[-1]
        return
    first = [piece[0]]
    second = [piece[-1]]
    level = piece
    while len(level) > 1:
        level = [_between(a, b, 0.5) for a, b in pairwise(level)]
        first.append(level[0])
        second.append(level[-1])
    yield from _ends(first, tolerance, halves - 1)
    yield from _ends(second[::-1], tolerance, halves - 1)


def _distance(place: complex, start: complex, end: complex) -> float:
    """Distance of a place from a chord."""
    chord = end - start
    arm = place - start
    square = abs(chord) ** 2
    share = min(max((arm * chord.conjugate()).real / square, 0.0), 1.0) if square else 0.0
    return abs(arm - share * chord)


def add_uniform_point(state: ProgramState, block: WordBlock) -> None:
    """Take a control point of G5.2: its place, its weight P, and the order L of the curve."""
    weight = block.values.pop("P", None)
    curve = state.curve
    if curve is None:
        placed = _has_place(state, block)
        curve = OpenCurve("G5.2", _DEFAULT_ORDER)
        curve.add(_in_plane(state, state.frames.here), 1.0 if placed or weight is None else weight)
        state.curve = curve
    order = block.values.pop("L", None)
    if order is not None and order > _DEFAULT_ORDER:
        curve.order = _order("L", order)
    if _has_place(state, block):
        if weight is None:
            raise InputError("G5.2: every control point must have a weight P")
        curve.add(_taken_place(state, block), weight)


def end_uniform(state: ProgramState) -> None:
    """Add the curve of the control points of G5.2, with knots at whole numbers and its ends at the outer points."""
    curve = state.curve
    if curve is None or curve.name != "G5.2":
        raise InputError("G5.3: must follow control points of G5.2")
    inner = max(len(curve.points) - curve.order + 1, 1)
    knots = [0.0] * curve.order + [float(k) for k in range(1, inner)] + [float(inner)] * curve.order
    state.curve = None
    _add(state, Nurbs(curve.order, tuple(curve.points), tuple(curve.weights), tuple(knots)))


def add_knot(state: ProgramState, block: WordBlock) -> None:
    """Take a control point and knot of G6.2; the curve ends where as many last knots as its order are equal.

    P is the order, R the weight, K the knot; Q chooses how LinuxCNC steps along the curve, which is the same.
    """
    order = block.values.pop("P", None)
    if state.curve is None:
        if order is None:
            raise InputError("G6.2: the first control point must have the order P")
        state.curve = OpenCurve("G6.2", _order("P", order))
    curve = state.curve
    block.drop("Q")
    weight = block.values.pop("R", 1.0)
    if "K" not in block.values:
        raise InputError("G6.2: every control point must have a knot K")
    curve.knots.append(block.values.pop("K"))
    curve.add(_taken_place(state, block), weight)
    last = curve.knots[-curve.order :]
    if len(curve.knots) > curve.order and last[0] == last[-1]:
        state.curve = None
        count = len(curve.knots) - curve.order  # the last knots have no points
        _add(
            state,
            Nurbs(curve.order, tuple(curve.points[:count]), tuple(curve.weights[:count]), tuple(curve.knots)),
        )


def _order(letter: str, value: float) -> int:
    if value != int(value) or not 2 <= value <= _HIGHEST_ORDER:
        raise InputError(f"{letter} = {value:g}: must be the order of a NURBS, from 2 to {_HIGHEST_ORDER}")
    return int(value)


def _in_plane(state: ProgramState, place: Sequence[float]) -> complex:
    first, second, _ = PLANES[state.modes.plane]
    return complex(place[first], place[second])


def _has_place(state: ProgramState, block: WordBlock) -> bool:
    """Whether a block has both coordinates of the plane, or none.

    Raises:
        InputError: one of them alone.
    """
    letters = [_NAMES[axis] for axis in PLANES[state.modes.plane][:2]]
    given = [letter in block.values for letter in letters]
    if any(given) and not all(given):
        raise InputError(f"control point of a NURBS: must have both {letters[0]} and {letters[1]}")
    return all(given)


def _taken_place(state: ProgramState, block: WordBlock) -> complex:
    return _in_plane(state, state.frames.end(block.values, in_machine=False))


def _add(state: ProgramState, curve: Nurbs) -> None:
    places = list(curve.chords())
    length = math.fsum(abs(end - start) for start, end in pairwise(places))
    feed = state.feed_at(length)
    first, second, _ = PLANES[state.modes.plane]
    for place in places if places[0] != _in_plane(state, state.frames.here) else places[1:]:
        end = list(state.frames.here)
        end[first] = place.real
        end[second] = place.imag
        state.line_to(end, feed)
    state.motion = "G80"
