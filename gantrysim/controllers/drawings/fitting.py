"""Curves as lines and arcs within a tolerance.

A level curve becomes biarcs: two arcs with the curve's points and tangents at both ends, and a common tangent where
they meet. Their deviation falls with the third power of their length. A curve in space becomes short lines, whose
corners are then rounded; each takes half of the tolerance.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from gantrysim.base.arrays import Complexes, Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.drawings.shapes import Curve, Ellipse, Segment, Shape
from gantrysim.paths.pieces import Coil, Line, vector

MOST_PIECES = 200_000  # of a drawing
_SAFETY = 0.9  # share of the tolerance at the sampled points
_SAMPLES = np.linspace(0.0, 1.0, 18)[1:-1]  # of an interval, for its deviation
_WIDEST_ANGLE = math.radians(50)  # angle between the curve's tangents at an interval's ends and its chord
_HALVINGS = 40
_LARGEST_RADIUS = 1e7  # radius of an arc; more is a line [mm]
_LEVEL_HEIGHT = 1e-9  # height of a level curve [mm]
_TANGENT_NUDGE = 1e-4  # of an interval, to where the tangent is taken when the derivative vanishes at its end
_FIRST_INTERVALS = 4  # intervals between two knots, at the beginning


def pieces_of(shape: Shape, tolerance: float) -> list[Line | Coil]:
    """Return lines and arcs along a shape.

    Args:
        shape: a segment and a level circular arc are exact.
        tolerance: largest distance of the pieces from any other curve [mm].

    Raises:
        InputError: too many pieces.
    """
    if isinstance(shape, Segment):
        return [Line(vector(shape.begin), vector(shape.finish))]
    if isinstance(shape, Ellipse) and shape.circular:
        return [_circle(shape)]
    points = shape.at(_spread(shape.knots, _FIRST_INTERVALS))[0]
    if np.ptp(points[:, 2]) > _LEVEL_HEIGHT:
        return _lines(shape, 0.5 * tolerance)
    return _biarcs(shape, tolerance, float(points[0, 2]))


def arc_to(begin: complex, tangent: complex, end: complex, z: float) -> Line | Coil:
    """Return the arc from a point with a tangent to another point, a line if it is as good as straight.

    Args:
        begin: x + iy [mm].
        tangent: a unit vector, x + iy.
        end: x + iy [mm].
        z: height [mm].
    """
    chord = end - begin
    sine = (tangent.conjugate() * chord).imag / abs(chord)
    curvature = 2 * sine / abs(chord)
    if abs(curvature) * _LARGEST_RADIUS < 1:
        return Line((begin.real, begin.imag, z), (end.real, end.imag, z))
    angle = 2 * math.atan2(sine, (tangent.conjugate() * chord).real / abs(chord))
    centre = begin + 1j * tangent / curvature
    out = begin - centre
    # the radius from the chord, as the difference would lose digits
    radius = 1 / abs(curvature)
    return Coil((centre.real, centre.imag, z), (radius, radius), math.atan2(out.imag, out.real), angle)


def middle(begin: Complexes, first: Complexes, end: Complexes, last: Complexes) -> Complexes:
    """Return where the two arcs of biarcs meet, with the tangents of both at equal distances d.

    With v = end - begin and T = first + last, both unit tangents, d solves
    v.v - 2 d v.T + 2 d^2 (first.last - 1) = 0, and the arcs meet at (begin + end + d (first - last)) / 2.
    """
    v = end - begin
    along = (np.conj(v) * (first + last)).real
    square = np.abs(v) ** 2
    apart = np.maximum(1 - (np.conj(first) * last).real, 0.0)
    d = square / (along + np.sqrt(along**2 + 2 * apart * square))
    return 0.5 * (begin + end + d * (first - last))


def _circle(shape: Ellipse) -> Coil:
    radius = math.hypot(*shape.u[:2])
    sense = math.copysign(1.0, shape.u[0] * shape.v[1] - shape.u[1] * shape.v[0])
    begin = math.atan2(shape.u[1], shape.u[0]) + sense * shape.begin
    return Coil(vector(shape.centre), (radius, radius), begin, sense * (shape.finish - shape.begin))


def _spread(knots: Floats, parts: int) -> Floats:
    """Knots, and `parts` even intervals between every two."""
    share = np.arange(parts) / parts
    inner = knots[:-1, None] + share * np.diff(knots)[:, None]
    return np.append(inner.ravel(), knots[-1])


def _check_count(count: int) -> None:
    if count > MOST_PIECES:
        raise InputError(f"curve of more than {MOST_PIECES} pieces: must be simpler, or chord_tolerance larger")


def _lines(shape: Curve, tolerance: float) -> list[Line | Coil]:
    edges = _spread(shape.knots, _FIRST_INTERVALS)
    for _ in range(_HALVINGS):
        _check_count(edges.size)
        low = edges[:-1]
        high = edges[1:]
        t = low[:, None] + _SAMPLES * (high - low)[:, None]
        points = shape.at(t.ravel())[0].reshape(*t.shape, 3)
        ends = shape.at(edges)[0]
        chord = np.diff(ends, axis=0)
        along = np.einsum("nmi,ni->nm", points - ends[:-1, None], chord)
        square = np.einsum("ni,ni->n", chord, chord)[:, None]
        share = np.clip(np.divide(along, square, out=np.zeros_like(along), where=square > 0), 0.0, 1.0)
        deviation = np.linalg.norm(points - ends[:-1, None] - share[..., None] * chord[:, None], axis=2).max(axis=1)
        coarse = deviation > _SAFETY * tolerance
        if not coarse.any():
            break
        edges = np.sort(np.concatenate([edges, 0.5 * (low + high)[coarse]]))
        if shape.knots[0] > shape.knots[-1]:
            edges = edges[::-1]
    ends = shape.at(edges)[0]
    return [Line(vector(a), vector(b)) for a, b in pairwise(ends)]


def _biarcs(shape: Curve, tolerance: float, z: float) -> list[Line | Coil]:
    edges = _spread(shape.knots, _FIRST_INTERVALS)
    low = edges[:-1]
    high = edges[1:]
    # columns of the intervals whose biarc is within the tolerance
    fitted: list[list[Complexes]] = []
    for halving in range(_HALVINGS):
        _check_count(2 * (low.size + sum(columns[0].size for columns in fitted)))
        begin = _complex(shape.at(low)[0])
        end = _complex(shape.at(high)[0])
        first = _tangents(shape, low, high)
        last = _tangents(shape, high, low)
        t = low[:, None] + _SAMPLES * (high - low)[:, None]
        points = _complex(shape.at(t.ravel())[0]).reshape(t.shape)
        chord = end - begin
        size = np.maximum(np.abs(points - begin[:, None]).max(axis=1), np.abs(chord))
        is_short = size < 0.1 * tolerance
        with np.errstate(divide="ignore", invalid="ignore"):
            angle = np.maximum(np.abs(np.angle(first / chord)), np.abs(np.angle(last / chord)))
            join = middle(begin, first, end, last)
            deviation = _deviation(points, begin, first, join, end, last)
        fits = is_short | ((angle < _WIDEST_ANGLE) & (deviation < _SAFETY * tolerance))
        is_straight = is_short
        # as at a cusp, where no interval is short enough
        if halving == _HALVINGS - 1:
            is_straight = is_short | ~fits
            fits = np.ones_like(fits)
        # a tangent of 0 stands for a straight line
        fitted.append([values[fits] for values in (low, begin, first, join, end, np.where(is_straight, 0, last))])
        if fits.all():
            break
        middles = 0.5 * (low + high)[~fits]
        low = np.concatenate([low[~fits], middles])
        high = np.concatenate([middles, high[~fits]])
    parameter, *columns = map(np.concatenate, zip(*fitted, strict=True))
    order = np.argsort(parameter if shape.knots[0] < shape.knots[-1] else -parameter, kind="stable")
    pieces: list[Line | Coil] = []
    # begin, its tangent, joint, end and its tangent
    for a, t0, m, b, t1 in zip(*(column[order].tolist() for column in columns), strict=True):
        if a == b:
            continue
        # shorter than the tolerance, as at a cusp
        if t1 == 0:
            pieces.append(Line((a.real, a.imag, z), (b.real, b.imag, z)))
            continue
        common = (m - a) ** 2 / abs(m - a) ** 2 * t0.conjugate()
        pieces += [arc_to(a, t0, m, z), arc_to(m, common, b, z)]
    return pieces


def _deviation(
    points: Complexes, begin: Complexes, first: Complexes, join: Complexes, end: Complexes, last: Complexes
) -> Floats:
    """Largest distance of points, (n, m), from the biarcs, (n,)."""
    distances = []
    for start, tangent, stop in ((begin, first, join), (end, -last, join)):
        chord = stop - start
        curvature = 2 * (np.conj(tangent) * chord).imag / np.abs(chord) ** 2
        local = np.conj(tangent)[:, None] * (points - start[:, None])
        # distance from a circle of curvature k through 0 along the real axis, without its radius:
        # (k |z|^2 - 2 y) / (1 + |1 - k (y - i x)|)
        k = curvature[:, None]
        centred = np.abs(1 + 1j * k * local)
        distances.append(np.abs((k * np.abs(local) ** 2 - 2 * local.imag) / (1 + centred)))
    # a point belongs to the arc on its side of the joint
    common = (join - begin) ** 2 / np.abs(join - begin) ** 2 * np.conj(first)
    before = (np.conj(common)[:, None] * (points - join[:, None])).real < 0
    return np.where(before, *distances).max(axis=1)


def _tangents(shape: Curve, end: Floats, other: Floats) -> Complexes:
    """Unit tangents at one end of intervals, from inside where the derivative vanishes, (n,)."""
    # one side of a knot may differ from the other
    inside = end + 1e-9 * (other - end)
    slope = _complex(shape.at(inside)[1])
    scale = np.abs(_complex(shape.at(0.5 * (end + other))[1]))
    weak = np.abs(slope) <= 1e-6 * scale
    if weak.any():
        near = end[weak]
        far = other[weak]
        step = _complex(shape.at(near + _TANGENT_NUDGE * (far - near))[0]) - _complex(shape.at(near)[0])
        ascending = (far > near) == (shape.knots[-1] > shape.knots[0])
        slope[weak] = np.where(ascending, step, -step)
    length = np.abs(slope)
    return np.divide(slope, length, out=np.ones_like(slope), where=length > 0)


def _complex(points: Floats) -> Complexes:
    return points[:, 0] + 1j * points[:, 1]
