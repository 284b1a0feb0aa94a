"""Curved moves: arcs and helices by their centre or radius, and splines in the XY plane, Bézier curves as chords."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.move_table import ARC, PLANES, MoveRow, centre_by_radius, swept_angle
from gantrysim.controllers.gcode.program_state import FARTHEST_COORDINATE, OpenCurve, ProgramState, WordBlock

_CENTRES = "IJK"
_LENGTHS = "IJKR"
_MOST_TURNS = 10_000
_SMALLEST_RADIUS = 1e-6  # radius [mm]
_RELATIVE = 1e-3  # difference of an arc's radii, of the radius
_ERROR_OVER_TOLERANCE = 100  # times the tolerance, which the relative one does not excuse
_COARSE_TOLERANCE = 2.54  # times the tolerance, in inches

_CHORD = 1e-3  # largest distance of a chord from its curve [mm]
_MOST_CHORDS = 20_000  # chords of a curve


@dataclass(frozen=True)
class _Arc:
    """An arc in its plane, as x + iy of the plane's axes, in the program's coordinates [mm]."""

    start: complex
    end: complex
    centre: complex
    angle: float

    @property
    def length(self) -> float:
        """In the plane; of a spiral, with radii that differ within the tolerance, nearly [mm]."""
        radius = 0.5 * (abs(self.start - self.centre) + abs(self.end - self.centre))
        return self.angle * radius


def add_arc(state: ProgramState, block: WordBlock, clockwise: bool) -> None:
    """Add an arc, with the words X Y Z I J K R P of a block, seen against the plane's normal."""
    state.spline_control = None
    frames = state.frames
    modes = state.modes
    values = block.values
    for letter in _LENGTHS:
        if letter in values:
            values[letter] *= frames.unit
    u, v, w = PLANES[modes.plane]
    turns = values.pop("P", 1.0)
    if turns != int(turns) or not 1 <= turns <= _MOST_TURNS:
        raise InputError(f"P = {turns:g}: must be a whole number of turns, from 1 to {_MOST_TURNS}")
    start = frames.here
    before = frames.program(start)
    end = frames.end(values, in_machine=False)
    after = frames.program(end)
    arc = _arc(state, block, (complex(before[u], before[v]), complex(after[u], after[v])), clockwise, int(turns))
    centre = list(before)
    centre[u] = arc.centre.real
    centre[v] = arc.centre.imag
    placed = frames.machine(centre)
    if modes.plane and frames.turns[frames.system]:
        raise InputError(f"G{17 + modes.plane} arc under a turned coordinate system: must be in G17")
    feed = state.feed_at(math.hypot(arc.length, end[w] - start[w]))
    if not max(*map(abs, end), *map(abs, placed)) <= FARTHEST_COORDINATE:
        raise InputError(f"arc to {[round(c, 3) for c in end]} mm: must be within {FARTHEST_COORDINATE:g} mm")
    x, y, z = end
    state.add(
        MoveRow(
            kind=ARC,
            x=x,
            y=y,
            z=z,
            u=placed[u],
            v=placed[v],
            plane=modes.plane,
            angle=arc.angle,
            feed=feed,
            mode=modes.path,
            naive=modes.naive,
            work=True,
            source=state.line,
            flow=block.fed,
            limits=state.limits.index(block.fed > 0),
            outputs=state.outputs.index,
            advance=state.extruder.index,
            analogue=state.flow_value,
        )
    )


def _arc(state: ProgramState, block: WordBlock, ends: tuple[complex, complex], clockwise: bool, turns: int) -> _Arc:
    """The arc between two points of the plane, by the words of its centre or R."""
    plane = state.modes.plane
    first, second, across = (_CENTRES[axis] for axis in PLANES[plane])
    start, end = ends
    i = block.values.pop(first, None)
    j = block.values.pop(second, None)
    if block.values.get(across) == 0:
        del block.values[across]
        refused = "" if state.dialect.lenient else ", which LinuxCNC itself refuses"
        state.ignored[f"{across}0 of arcs in G{17 + plane}{refused}"] += 1
    if across in block.values:
        raise InputError(f"{across} in G{17 + plane}: the centre must be given in the plane")
    radius = block.values.pop("R", None)
    if radius is not None:
        if i is not None or j is not None:
            raise InputError("arc by R and by its centre: must be one of them")
        centre = centre_by_radius(start, end, radius, clockwise, state.setup.arc_tolerance)
    elif i is None and j is None:
        raise InputError(f"arc without {first}, {second} and R: must have a centre or a radius")
    else:
        if state.modes.centres and (i is None or j is None) and not state.dialect.lenient:
            raise InputError(f"arc in G90.1: must have both {first} and {second}, the place of its centre")
        centre = complex(i or 0.0, j or 0.0) + (0.0 if state.modes.centres else start)
    _check_radii(state, abs(start - centre), abs(end - centre), (first, second))
    return _Arc(start, end, centre, swept_angle(start - centre, end - centre, clockwise, turns))


def _check_radii(state: ProgramState, radius: float, reached: float, words: tuple[str, str]) -> None:
    """Check that the end lies on the arc: coordinates are rounded, in inches to coarser steps."""
    centre = "{}, {}".format(*words)
    if radius < _SMALLEST_RADIUS:
        raise InputError(f"the start of the arc is its centre, by {centre}: radius = 0 mm must be greater than 0 mm")
    if reached < _SMALLEST_RADIUS:
        raise InputError(
            f"the end of the arc is its centre, by {centre}: radius = {radius:.6g} mm at the start, 0 mm at the end"
        )
    error = abs(radius - reached)
    tolerance = state.setup.arc_tolerance * (1.0 if state.frames.unit == 1.0 else _COARSE_TOLERANCE)
    if error > _ERROR_OVER_TOLERANCE * tolerance or (error > tolerance and error > _RELATIVE * max(radius, reached)):
        raise InputError(
            f"radius = {radius:.6g} mm at the start, {reached:.6g} mm at the end: difference {error:.4g} mm "
            f"must be at most arc_tolerance, {tolerance:g} mm"
        )


@dataclass(frozen=True)
class _Words:
    """The words of a spline, as x + iy in the program's coordinates [mm].

    Attributes:
        start: of the curve.
        end: of the curve.
        first: control point I J from the start; None without both.
        last: control point P Q from the end.
        start_height: z at the start [mm].
        rise: from the start to the end [mm].
    """

    start: complex
    end: complex
    first: complex | None
    last: complex
    start_height: float
    rise: float


def add_cubic(state: ProgramState, block: WordBlock) -> None:
    """Add a cubic curve; without I and J it goes on smoothly from the cubic curve before."""
    words = _taken_words(state, block)
    first = state.spline_control if words.first is None else words.first
    if first is None:
        raise InputError("G5 without I and J: must follow another G5")
    _add_chords(state, words, [words.start, words.start + first, words.end + words.last, words.end])
    state.spline_control = -words.last


def add_quadratic(state: ProgramState, block: WordBlock) -> None:
    """Add a quadratic curve."""
    words = _taken_words(state, block)
    state.spline_control = None
    _add_chords(state, words, [words.start, words.start + (words.first or 0j), words.end])


def _taken_words(state: ProgramState, block: WordBlock) -> _Words:
    if state.modes.plane:
        raise InputError(f"G5 in G{17 + state.modes.plane}: must be in G17")
    frames = state.frames
    before = frames.program(frames.here)
    i, j, p, q = (_length(block, letter, frames.unit) for letter in "IJPQ")
    after = frames.program(frames.end(block.values, in_machine=False))
    return _Words(
        start=complex(before[0], before[1]),
        end=complex(after[0], after[1]),
        first=None if i is None and j is None else complex(i or 0.0, j or 0.0),
        last=complex(p or 0.0, q or 0.0),
        start_height=before[2],
        rise=after[2] - before[2],
    )


def _length(block: WordBlock, letter: str, unit: float) -> float | None:
    value = block.values.pop(letter, None)
    return None if value is None else value * unit


def _add_chords(state: ProgramState, words: _Words, points: list[complex]) -> None:
    feed = state.feed_at(abs(words.end - words.start))
    for place, share in chords(points):
        height = words.start_height + share * words.rise
        state.line_to(state.frames.machine([place.real, place.imag, height]), feed)


def chords(points: list[complex]) -> Iterator[tuple[complex, float]]:
    """Yield the ends of chords of a quadratic or cubic Bézier curve, and the completed share of its parameter.

    With n chords of equal parameter a chord's distance is at most max |c''| / (8 n^2), and |c''| at most
    d (d - 1) times the largest second difference of the d + 1 control points.
    """
    degree = len(points) - 1
    second = max(abs(a - 2 * b + c) for a, b, c in zip(points, points[1:], points[2:], strict=False))
    n = max(math.ceil(math.sqrt(degree * (degree - 1) * second / (8 * _CHORD))), 1)
    if n > _MOST_CHORDS:
        raise InputError(f"spline of {n} chords: must be at most {_MOST_CHORDS}")
    for k in range(1, n + 1):
        level = points
        t = k / n
        # de Casteljau: points between neighbours, until one is left
        while len(level) > 1:
            level = [(1 - t) * a + t * b for a, b in pairwise(level)]
        yield (points[-1] if k == n else level[0]), t


# NURBS in the selected plane, as chords within a micrometre: G5.2 to G5.3 with uniform knots, G6.2 with its own.
#
# A curve of the order k, the degree k - 1, has n control points P with weights w and n + k knots t; it runs from the
# knot t[k - 1] to the knot t[n]. Between two knots it is a rational Bézier curve, whose control points are the values
# of the curve's polar form at both knots. Halves of it are taken until their control points lie on the chord.

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
        # the last knots have no points
        count = len(curve.knots) - curve.order
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
