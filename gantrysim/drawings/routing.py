"""From the strokes of a drawing to one path: order, joints, and the ways between."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.drawings.corners import Count, Leg, length, place, rounded
from gantrysim.drawings.fitting import MOST_PIECES, pieces_of
from gantrysim.drawings.shapes import Stroke
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import XY, Coil, Line, vector

_SHORTEST = 1e-6  # length of a piece [mm]
_NO_GAP = 1e-9  # [mm]
_MOST_ORDERED = 20_000  # stretches that are put in the order of their distances
_SPAN = 10  # an arc is turned to close a gap of less than this part of its chord


@dataclass(frozen=True)
class Manner:
    """How strokes are run.

    Attributes:
        speed, travel_speed: [mm/s].
        lift: height of the ways between strokes above the higher end [mm].
        join: largest gap between two strokes that are joined [mm].
        chord: largest deviation of a curve's pieces [mm].
        corner: largest deviation of a rounded corner [mm].
        dot_time: [s].
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
        legs: one from the end of the other, each of positive length.
        chain: their pieces.
        stretches: number of strokes after joining.
        corners: those within stretches.
    """

    legs: tuple[Leg, ...]
    chain: Chain
    stretches: int
    corners: Count


def routed(strokes: list[Stroke], manner: Manner) -> Route:
    """Return the path along strokes, whose `glue` is given.

    Raises:
        InputError: no path of positive length, or too many pieces.
    """
    # before any is fitted: each shape becomes one piece at least
    _check_pieces(sum(len(stroke.shapes) for stroke in strokes))
    stretches = _joined(strokes, manner)
    if manner.nearest:
        stretches = _joined(_by_distance(stretches, manner.reverse), manner)
    legs: list[Leg] = []
    count = Count()
    up = np.array([0.0, 0.0, manner.lift])
    here = manner.start
    for stretch in stretches:
        drawn = rounded(_drawn(stretch, manner), manner.corner, count) if stretch[0].dot is None else []
        first = stretch[0].dot if stretch[0].dot is not None else drawn[0].start if drawn else None
        if first is None:  # shorter than any piece
            continue
        if here is None and manner.lift > 0:
            here = first + up
            way = [Line(vector(here), vector(first))]
        else:
            way = [] if here is None else _way(here, first, manner.lift, started=bool(legs))
        legs += [Leg(line, False, manner.travel_speed, travel=True) for line in way]
        if stretch[0].dot is not None:
            if not legs:
                raise InputError(f"{stretch[0].where}: a dot comes first: must have start or lift, to come to it")
            legs[-1] = replace(legs[-1], pause=legs[-1].pause + manner.dot_time, dot=bool((stretch[0].glue or (1,))[0]))
        legs += drawn
        here = first if stretch[0].dot is not None else drawn[-1].end
        _check_pieces(len(legs))
    if here is None or not legs:
        raise InputError("drawing: must have a line of positive length that is traced")
    if manner.lift > 0:
        legs.append(Leg(Line(vector(here), vector(here + up)), False, manner.travel_speed, travel=True))
    return Route(tuple(legs), Chain(leg.piece for leg in legs), len(stretches), count)


def _check_pieces(count: int) -> None:
    if count > MOST_PIECES:
        raise InputError(f"drawing of more than {MOST_PIECES} pieces: must be simpler, or chord_tolerance larger")


def _joined(strokes: list[Stroke] | list[list[Stroke]], manner: Manner) -> list[list[Stroke]]:
    """Strokes, or stretches of them, joined in their order where their ends meet."""
    made: list[list[Stroke]] = []
    for item in strokes:
        stretch = item if isinstance(item, list) else [item]
        if made and stretch[0].dot is None and made[-1][0].dot is None:
            before = made[-1]
            choices = [(before, stretch)]
            if manner.reverse:
                choices += [(before, _back(stretch)), (_back(before), stretch), (_back(before), _back(stretch))]
                choices = choices[: 4 if len(before) == 1 else 2]
            joint = next((pair for pair in choices if _apart(pair[0][-1].end, pair[1][0].start) <= manner.join), None)
            if joint is not None:
                made[-1] = [*joint[0], *joint[1]] if joint[0] is not before else before
                if joint[0] is before:
                    before.extend(joint[1])
                continue
        made.append(list(stretch))
    return made


def _back(stretch: list[Stroke]) -> list[Stroke]:
    return [stroke.reversed() for stroke in stretch[::-1]]


def _apart(a: Floats, b: Floats) -> float:
    return math.dist(a, b)


def _by_distance(stretches: list[list[Stroke]], reverse: bool) -> list[list[Stroke]]:
    """Stretches from the first, always the one whose start is the nearest; with `reverse` also backwards."""
    if len(stretches) > _MOST_ORDERED:
        raise InputError(
            f'order = "nearest" of {len(stretches)} stretches: must be at most {_MOST_ORDERED}, or order = "drawn"'
        )
    starts = np.array([stretch[0].start for stretch in stretches])
    ends = np.array([stretch[-1].end for stretch in stretches])
    left = np.ones(len(stretches), bool)
    made = []
    k = 0
    backwards = False
    while True:
        left[k] = False
        made.append(_back(stretches[k]) if backwards else stretches[k])
        if not left.any():
            return made
        here = starts[k] if backwards else ends[k]
        forward = np.where(left, np.linalg.norm(starts - here, axis=1), np.inf)
        other = np.where(left, np.linalg.norm(ends - here, axis=1), np.inf) if reverse else np.full(left.size, np.inf)
        backwards = bool(other.min() < forward.min())
        k = int((other if backwards else forward).argmin())


def _drawn(stretch: list[Stroke], manner: Manner) -> list[Leg]:
    """Legs along the strokes of a stretch, each from the end of the one before."""
    legs: list[Leg] = []
    for stroke in stretch:
        glue = stroke.glue or (True,) * len(stroke.shapes)
        speeds = stroke.speed or (math.nan,) * len(stroke.shapes)
        space: list[Leg] = []  # along consecutive curves in space
        for shape, lays, stated in zip(stroke.shapes, glue, speeds, strict=True):
            speed = stated if stated == stated else manner.speed if lays else manner.travel_speed
            pieces = pieces_of(shape, manner.chord)
            made = [Leg(piece, lays, speed) for piece in pieces]
            if len(pieces) > 1 and isinstance(pieces[0], Line) and any(a.start[2] != a.end[2] for a in made):
                space += made
                continue
            _append(legs, _smooth(space, manner))
            space = []
            _append(legs, made)
            _check_pieces(len(legs))
        _append(legs, _smooth(space, manner))
    return legs


def _smooth(legs: list[Leg], manner: Manner) -> list[Leg]:
    kept = [leg for leg in legs if leg.length > _SHORTEST]
    return rounded(kept, 0.5 * manner.chord, Count()) if kept else []


def _append(legs: list[Leg], more: list[Leg]) -> None:
    """Append legs, each moved to the end of the one before."""
    for leg in more:
        if leg.length <= _SHORTEST:
            continue
        if legs:
            end = legs[-1].end
            start = leg.start
            if _apart(end, start) > _NO_GAP:
                leg = _closed_up(legs, leg, end, start)
        legs.append(leg)


def _closed_up(legs: list[Leg], leg: Leg, end: Floats, start: Floats) -> Leg:
    """The next leg, with the gap before it closed: a line or an arc is moved at one of its ends, else a line added."""
    piece = leg.piece
    before = legs[-1].piece
    if isinstance(piece, Line):
        moved = Line(vector(end), piece.end)
        if length(moved) > _SHORTEST:
            return replace(leg, piece=moved)
    elif isinstance(before, Line) and math.dist(before.start, start) > _SHORTEST:
        legs[-1] = replace(legs[-1], piece=Line(before.start, vector(start)))
        return leg
    else:
        turned = _turned(piece, end)
        if turned is not None:
            return replace(leg, piece=turned)
    if _apart(end, start) > _SHORTEST:
        legs.append(replace(leg, piece=Line(vector(end), vector(start))))
    return leg


def _turned(arc: Coil, start: Floats) -> Coil | None:
    """An arc turned and scaled about its end so that it begins elsewhere, None if it is closed or in another plane."""
    first, last = place(arc, np.array([0.0, 1.0]))
    z, w = (complex(*(at - last)[:2]) for at in (first, start))
    if arc.frame != XY or abs(w - z) * _SPAN > abs(z) or abs(start[2] - first[2]) > _NO_GAP:
        return None
    change = w / z
    centre = complex(*last[:2]) + change * complex(*(np.array(arc.centre) - last)[:2])
    radius = abs(change) * arc.radius[0]
    begin = arc.begin + math.atan2(change.imag, change.real)
    return Coil((centre.real, centre.imag, arc.centre[2]), (radius, radius), begin, arc.angle)


def _way(here: Floats, there: Floats, lift: float, started: bool) -> list[Line]:
    """Lines from one place to another, lifted; the first way of all comes from above."""
    if lift > 0:
        top = max(here[2], there[2]) + lift
        above = [np.array([at[0], at[1], top]) for at in (here, there)]
        places = [here, *above, there] if started else [*above, there]
    else:
        places = [here, there]
    lines = [Line(vector(a), vector(b)) for a, b in pairwise(places)]
    return [line for line in lines if length(line) > _SHORTEST]
