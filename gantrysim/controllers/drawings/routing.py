"""From the strokes of a drawing to one path: order, joints, and the travel between."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.drawings.corners import Count, Leg, legs_with_corners, length, points_at
from gantrysim.controllers.drawings.fitting import MOST_PIECES, pieces_of
from gantrysim.controllers.drawings.shapes import Stroke
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import XY, Coil, Line, vector

_SHORTEST_PIECE = 1e-6  # length of a piece [mm]
_NO_GAP = 1e-9  # [mm]
_MOST_ORDERED = 20_000  # stretches that are put in the order of their distances
_APPROACH = 1.0  # way to a first dot [mm]
_CLOSED_SHARE = 10  # an arc is turned to close a gap of less than this part of its chord


@dataclass(frozen=True)
class Manner:
    """Speeds, tolerances and order of the strokes.

    Attributes:
        speed, travel_speed: [mm/s].
        lift: height of the travel between strokes above the higher end [mm].
        join: largest gap between two strokes that are joined [mm].
        chord: largest deviation of a curve's pieces [mm].
        corner: largest deviation of a rounded corner [mm].
        dot_time: of a dot that states none [s].
        nearest: whether stretches are run in the order of their distances.
        reverse: whether strokes may be run backwards.
        start: where the path begins, None at the first stroke (3,) [mm].
    """

    speed: float
    travel_speed: float
    lift: float
    join: float
    chord: float
    corner: float
    dot_time: float
    nearest: bool
    reverse: bool
    start: Floats | None


@dataclass(frozen=True)
class Route:
    """The whole path.

    Attributes:
        legs: each from the end of the one before, of positive length.
        chain: their pieces.
        stretches: number of strokes after joining.
        corners: those within stretches.
    """

    legs: tuple[Leg, ...]
    chain: Chain
    stretches: int
    corners: Count

    def progress(self, s: Floats, requested: Route) -> Floats:
        """Return the arc lengths of the requested route of the same drawing at those of this one, (n,) [mm]."""
        order = np.interp(s, *self._order)
        arc_length, place = requested._order
        return np.interp(order, place, arc_length)

    @cached_property
    def _order(self) -> tuple[Floats, Floats]:
        """Arc lengths along the legs, and their places in the order of the drawing, (n,) each."""
        edges = np.concatenate([[0.0], self.chain.ends])
        arc_length = [0.0]
        place = [self.legs[0].order[0]]
        for leg, (begin, end) in zip(self.legs, pairwise(edges.tolist()), strict=True):
            parts = len(leg.order) - 1
            arc_length += [begin + (end - begin) * number / parts for number in range(1, parts + 1)]
            place += leg.order[1:]
        return np.array(arc_length), np.maximum.accumulate(place)


def routed_path(strokes: list[Stroke], manner: Manner) -> Route:
    """Return the path along strokes, whose `glue` is given.

    Raises:
        InputError: no path of positive length, or too many pieces.
    """
    # before any is fitted: each shape becomes at least one piece
    _check_pieces(sum(len(stroke.shapes) for stroke in strokes))
    stretches = _joined_strokes(strokes, manner)
    if manner.nearest:
        stretches = _joined_strokes(_by_distance(stretches, manner.reverse), manner)
    legs: list[Leg] = []
    count = Count()
    up = np.array([0.0, 0.0, manner.lift])
    position = manner.start
    for number, stretch in enumerate(stretches):
        dot = stretch[0].dot
        drawn: list[Leg] = []
        first = dot
        if dot is None:
            drawn = legs_with_corners(_drawn_legs(stretch, manner, 2.0 * number + 1), manner.corner, count)
            if not drawn:  # shorter than any piece
                continue
            first = drawn[0].start
        assert first is not None
        travel: list[Line] = []
        if position is not None:
            travel = _travel(position, first, manner.lift, started=bool(legs))
        elif manner.lift > 0:
            travel = [Line(vector(first + up), vector(first))]
        legs += _ordered_legs(
            [Leg(line, False, manner.travel_speed, travel=True) for line in travel], 2.0 * number, 1.0
        )
        if dot is not None:
            # the time of a dot is a pause at the end of a leg
            if not legs:
                line = Line(_beside(dot, stretches), vector(dot))
                legs += _ordered_legs([Leg(line, False, manner.travel_speed, travel=True)], 2.0 * number, 1.0)
            lays_glue = bool((stretch[0].glue or (1,))[0])
            stated_time = stretch[0].dot_time
            dot_time = manner.dot_time if stated_time is None else stated_time
            legs[-1] = replace(legs[-1], pause=legs[-1].pause + dot_time, dot=lays_glue)
        legs += drawn
        position = first if dot is not None else drawn[-1].end
        _check_pieces(len(legs))
    if position is None or not legs:
        raise InputError("drawing: must have a line of positive length that is traced")
    if manner.lift > 0:
        lift = Leg(Line(vector(position), vector(position + up)), False, manner.travel_speed, travel=True)
        legs += _ordered_legs([lift], 2.0 * len(stretches), 1.0)
    return Route(tuple(legs), Chain(leg.piece for leg in legs), len(stretches), count)


def _ordered_legs(legs: list[Leg], begin: float, size: float) -> list[Leg]:
    """Return legs with their place in the order of the drawing, from `begin` on, in shares of their lengths."""
    ends = np.cumsum([0.0, *(leg.length for leg in legs)])
    places = begin + size * ends / max(float(ends[-1]), _SHORTEST_PIECE)
    return [replace(leg, order=order) for leg, order in zip(legs, pairwise(places.tolist()), strict=True)]


def _beside(dot: Floats, stretches: list[list[Stroke]]) -> tuple[float, float, float]:
    """Return where the motion begins that has neither start nor lift and comes to a dot first: towards the next place.

    So it is no further out than the drawing.
    """
    apart = [stretch[0].start - dot for stretch in stretches if math.dist(stretch[0].start, dot) > _SHORTEST_PIECE]
    ahead = apart[0] if apart else np.array([1.0, 0.0, 0.0])
    distance = math.hypot(*ahead)
    return vector(dot + ahead * (min(_APPROACH, 0.5 * distance) / distance))


def _check_pieces(count: int) -> None:
    if count > MOST_PIECES:
        raise InputError(f"drawing of more than {MOST_PIECES} pieces: must be simpler, or chord_tolerance larger")


def _joined_strokes(strokes: list[Stroke] | list[list[Stroke]], manner: Manner) -> list[list[Stroke]]:
    """Return stretches: strokes, or stretches of them, joined in their order where their ends meet."""
    stretches: list[list[Stroke]] = []
    for item in strokes:
        stretch = item if isinstance(item, list) else [item]
        joint = None
        if stretches and stretch[0].dot is None and stretches[-1][0].dot is None:
            joint = _joint(stretches[-1], stretch, manner)
        if joint is None:
            stretches.append(list(stretch))
            continue
        before, after = joint
        if before is not stretches[-1]:
            stretches[-1] = before
        # in place: a stretch of n strokes is not copied n times
        stretches[-1].extend(after)
    return stretches


def _joint(before: list[Stroke], after: list[Stroke], manner: Manner) -> tuple[list[Stroke], list[Stroke]] | None:
    """Return two stretches in the directions in which the first ends where the second begins, None if none does."""
    choices = [(before, after)]
    if manner.reverse:
        choices.append((before, _back(after)))
        # a longer stretch has its direction by the joints within it
        if len(before) == 1:
            choices += [(_back(before), after), (_back(before), _back(after))]
    for first, second in choices:
        if math.dist(first[-1].end, second[0].start) <= manner.join:
            return first, second
    return None


def _back(stretch: list[Stroke]) -> list[Stroke]:
    return [stroke.reversed() for stroke in stretch[::-1]]


def _by_distance(stretches: list[list[Stroke]], reverse: bool) -> list[list[Stroke]]:
    """Stretches from the first, always the one whose start is the nearest; with `reverse` also backwards."""
    if len(stretches) > _MOST_ORDERED:
        raise InputError(
            f'order = "nearest" of {len(stretches)} stretches: must be at most {_MOST_ORDERED}, or order = "drawn"'
        )
    starts = np.array([stretch[0].start for stretch in stretches])
    ends = np.array([stretch[-1].end for stretch in stretches])
    remaining = np.ones(len(stretches), bool)
    ordered = []
    k = 0
    backwards = False
    while True:
        remaining[k] = False
        ordered.append(_back(stretches[k]) if backwards else stretches[k])
        if not remaining.any():
            return ordered
        position = starts[k] if backwards else ends[k]
        to_start = np.where(remaining, np.linalg.norm(starts - position, axis=1), np.inf)
        to_end = np.full(remaining.size, np.inf)
        if reverse:
            to_end = np.where(remaining, np.linalg.norm(ends - position, axis=1), np.inf)
        backwards = bool(to_end.min() < to_start.min())
        k = int((to_end if backwards else to_start).argmin())


def _drawn_legs(stretch: list[Stroke], manner: Manner, begin: float) -> list[Leg]:
    """Legs along the strokes of a stretch, each from the end of the one before.

    Args:
        stretch: the strokes.
        manner: of the path.
        begin: of the stretch in the order of the drawing; it ends 1 further on.
    """
    legs: list[Leg] = []
    size = 1 / max(sum(len(stroke.shapes) for stroke in stretch), 1)
    number = 0
    for stroke in stretch:
        glue = stroke.glue or (True,) * len(stroke.shapes)
        speeds = stroke.speed or (math.nan,) * len(stroke.shapes)
        lines = stroke.lines or (0,) * len(stroke.shapes)
        # along consecutive curves in space
        space: list[Leg] = []
        for shape, lays, stated_speed, line in zip(stroke.shapes, glue, speeds, lines, strict=True):
            speed = stated_speed
            if math.isnan(stated_speed):
                speed = manner.speed if lays else manner.travel_speed
            pieces = pieces_of(shape, manner.chord)
            own_legs = [Leg(piece, lays, speed, line=line) for piece in pieces]
            legs_of_shape = _ordered_legs(own_legs, begin + number * size, size)
            number += 1
            climbs = any(leg.start[2] != leg.end[2] for leg in legs_of_shape)
            if len(pieces) > 1 and isinstance(pieces[0], Line) and climbs:
                space += legs_of_shape
                continue
            _append(legs, _smooth(space, manner))
            space = []
            _append(legs, legs_of_shape)
            _check_pieces(len(legs))
        _append(legs, _smooth(space, manner))
    return legs


def _smooth(legs: list[Leg], manner: Manner) -> list[Leg]:
    """Return lines along curves in space with their corners rounded, within the other half of the tolerance."""
    long_enough = [leg for leg in legs if leg.length > _SHORTEST_PIECE]
    return legs_with_corners(long_enough, 0.5 * manner.chord, Count()) if long_enough else []


def _append(legs: list[Leg], new_legs: list[Leg]) -> None:
    """Append legs, each moved to the end of the one before."""
    for leg in new_legs:
        if leg.length <= _SHORTEST_PIECE:
            continue
        if legs and math.dist(legs[-1].end, leg.start) > _NO_GAP:
            legs.append(_closed_up(legs, leg))
        else:
            legs.append(leg)


def _closed_up(legs: list[Leg], leg: Leg) -> Leg:
    """The next leg, with the gap before it closed: a line or an arc is moved at one of its ends, else a line added."""
    end = legs[-1].end
    start = leg.start
    piece = leg.piece
    before = legs[-1].piece
    if isinstance(piece, Line):
        moved = Line(vector(end), piece.end)
        if length(moved) > _SHORTEST_PIECE:
            return replace(leg, piece=moved)
    elif isinstance(before, Line) and math.dist(before.start, start) > _SHORTEST_PIECE:
        legs[-1] = replace(legs[-1], piece=Line(before.start, vector(start)))
        return leg
    else:
        turned = _turned_arc(piece, end)
        if turned is not None:
            return replace(leg, piece=turned)
    if math.dist(end, start) > _SHORTEST_PIECE:
        legs.append(replace(leg, piece=Line(vector(end), vector(start)), order=(leg.order[0], leg.order[0])))
    return leg


def _turned_arc(arc: Coil, start: Floats) -> Coil | None:
    """An arc turned and scaled about its end so that it begins elsewhere, None if it is closed or in another plane."""
    first, last = points_at(arc, np.array([0.0, 1.0]))
    chord = complex(*(first - last)[:2])
    new_chord = complex(*(start - last)[:2])
    if arc.frame != XY or abs(new_chord - chord) * _CLOSED_SHARE > abs(chord) or abs(start[2] - first[2]) > _NO_GAP:
        return None
    change = new_chord / chord
    centre = complex(*last[:2]) + change * complex(*(np.array(arc.centre) - last)[:2])
    radius = abs(change) * arc.radius[0]
    begin = arc.begin + math.atan2(change.imag, change.real)
    return Coil((centre.real, centre.imag, arc.centre[2]), (radius, radius), begin, arc.angle)


def _travel(begin: Floats, end: Floats, lift: float, started: bool) -> list[Line]:
    """Lines from one place to another, lifted; the first travel of all comes from above."""
    places = [begin, end]
    if lift > 0:
        top = max(begin[2], end[2]) + lift
        above = [np.array([x, y, top]) for x, y, _ in places]
        places = [begin, *above, end] if started else [*above, end]
    lines = [Line(vector(a), vector(b)) for a, b in pairwise(places)]
    return [line for line in lines if length(line) > _SHORTEST_PIECE]
