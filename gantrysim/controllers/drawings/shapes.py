"""The shapes of a drawing: straight lines, ellipses and splines, in space, each with a direction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

LARGEST_COORDINATE = 1e6  # coordinate [mm]
FASTEST_SPEED = 1e6  # [mm/s]
_CIRCULAR = 1e-9  # relative difference of a circle's half axes, and cosine of the angle between them


@dataclass(frozen=True)
class Segment:
    """A straight line.

    Args:
        begin, finish: its ends, (3,).
    """

    begin: Floats
    finish: Floats

    @property
    def ends(self) -> tuple[Floats, Floats]:
        return self.begin, self.finish

    def moved(self, place: Callable[[Floats], Floats]) -> Segment:
        return Segment(place(self.begin), place(self.finish))

    def reversed(self) -> Segment:
        return Segment(self.finish, self.begin)


@dataclass(frozen=True)
class Ellipse:
    """A part of an ellipse, p(t) = c + u cos(t) + v sin(t).

    Args:
        centre: c, (3,).
        u, v: its conjugate half diameters, (3,).
        begin, finish: t at the ends; t may descend [rad].
    """

    centre: Floats
    u: Floats
    v: Floats
    begin: float
    finish: float

    @property
    def ends(self) -> tuple[Floats, Floats]:
        first, last = self.at(np.array([self.begin, self.finish]))[0]
        return first, last

    @property
    def knots(self) -> Floats:
        """Parameters between which the curve is approximated: quarter turns."""
        turns = abs(self.finish - self.begin) / (0.5 * math.pi)
        return np.linspace(self.begin, self.finish, max(math.ceil(turns - 1e-9), 1) + 1)

    @property
    def circular(self) -> bool:
        """Whether it is a circular arc in a level plane."""
        a = math.hypot(*self.u)
        b = math.hypot(*self.v)
        even = abs(a - b) <= _CIRCULAR * a and abs(self.u @ self.v) <= _CIRCULAR * a * b
        return bool(even and max(abs(self.u[2]), abs(self.v[2])) <= _CIRCULAR * a)

    def at(self, t: Floats) -> tuple[Floats, Floats]:
        """Return points and derivatives, (n, 3) each, in the sense of the motion."""
        c = np.cos(t)[:, None]
        s = np.sin(t)[:, None]
        sense = math.copysign(1.0, self.finish - self.begin)
        return self.centre + c * self.u + s * self.v, sense * (c * self.v - s * self.u)

    def moved(self, place: Callable[[Floats], Floats]) -> Ellipse:
        centre = place(self.centre)
        u = place(self.centre + self.u) - centre
        v = place(self.centre + self.v) - centre
        return replace(self, centre=centre, u=u, v=v)

    def reversed(self) -> Ellipse:
        return replace(self, begin=self.finish, finish=self.begin)


@dataclass(frozen=True)
class Spline:
    """A rational B-spline.

    Args:
        vector: of knots, (n + degree + 1,).
        control: control points, (n, 3).
        weights: (n,).
        degree: of the polynomials.
        backwards: whether it is run from its last knot to its first.
    """

    vector: Floats
    control: Floats
    weights: Floats
    degree: int
    backwards: bool = False

    def __post_init__(self) -> None:
        count = len(self.control)
        if not 1 <= self.degree < count or self.vector.shape != (count + self.degree + 1,):
            raise InputError(
                f"spline of degree {self.degree}, {count} control points and {self.vector.size} knots: must have "
                "more control points than its degree, and as many knots as both together plus one"
            )
        if not (np.isfinite(self.vector).all() and np.isfinite(self.control).all()):
            raise InputError("spline: knots and control points must be finite")
        if np.any(np.diff(self.vector) < 0) or not self.vector[self.degree] < self.vector[count]:
            raise InputError("spline: knots must ascend")
        if self.weights.shape != (count,) or not (np.isfinite(self.weights).all() and self.weights.min() > 0):
            raise InputError("spline: weights must be positive, one for each control point")

    @property
    def ends(self) -> tuple[Floats, Floats]:
        first, last = self.at(self.knots[[0, -1]])[0]
        return first, last

    @property
    def knots(self) -> Floats:
        """Distinct knots in the order of the motion."""
        inside = np.unique(self.vector[self.degree : len(self.control) + 1])
        return inside[::-1] if self.backwards else inside

    def at(self, t: Floats) -> tuple[Floats, Floats]:
        """Return points and derivatives, (n, 3) each, in the sense of the motion.

        With the homogeneous curve (w p, w) they are p = (w p) / w and p' = ((w p)' - w' p) / w.
        """
        from scipy.interpolate import BSpline  # slow to import

        homogeneous = np.column_stack([self.weights[:, None] * self.control, self.weights])
        curve = BSpline(self.vector, homogeneous, self.degree)
        value = curve(t)
        slope = curve(t, 1)
        weight = value[:, 3:]
        point = value[:, :3] / weight
        return point, (-1.0 if self.backwards else 1.0) * (slope[:, :3] - slope[:, 3:] * point) / weight

    def moved(self, place: Callable[[Floats], Floats]) -> Spline:
        return replace(self, control=place(self.control))

    def reversed(self) -> Spline:
        return replace(self, backwards=not self.backwards)


Curve = Ellipse | Spline
Shape = Segment | Curve


@dataclass(frozen=True)
class Stroke:
    """Shapes that are drawn without a gap, or a dot.

    Attributes:
        shapes: one after the other, each from the end of the one before; none for a dot.
        where: place in the drawing, for messages.
        names: of its layers, groups and colours, in lower case.
        dot: its place, of a dot (3,).
        dot_time: for which the dot is dispensed, if the drawing states it [s].
        glue: whether each shape lays glue, if the drawing states it.
        speed: of each shape, if the drawing states it [mm/s].
        lines: of a table of points, which state the speed of each shape.
    """

    shapes: tuple[Shape, ...]
    where: str
    names: frozenset[str] = frozenset()
    dot: Floats | None = None
    dot_time: float | None = None
    glue: tuple[bool, ...] | None = None
    speed: tuple[float, ...] | None = None
    lines: tuple[int, ...] = ()

    @property
    def start(self) -> Floats:
        return self.shapes[0].ends[0] if self.dot is None else self.dot

    @property
    def end(self) -> Floats:
        return self.shapes[-1].ends[1] if self.dot is None else self.dot

    @property
    def points(self) -> Floats:
        """Points that define the shapes, to be checked, (n, 3)."""
        points = [np.zeros((0, 3))] if self.dot is None else [self.dot[None]]
        for shape in self.shapes:
            if isinstance(shape, Spline):
                points.append(shape.control)
            elif isinstance(shape, Ellipse):
                points.append(np.array([shape.centre, shape.u, shape.v, [shape.begin, shape.finish, 0.0]]))
            else:
                points.append(np.array(shape.ends))
        return np.concatenate(points)

    def moved(self, place: Callable[[Floats], Floats]) -> Stroke:
        """Return the stroke with its points mapped by `place`, an affine map of (..., 3)."""
        dot = None if self.dot is None else place(self.dot)
        return replace(self, shapes=tuple(shape.moved(place) for shape in self.shapes), dot=dot)

    def reversed(self) -> Stroke:
        """Return the stroke in the other direction."""
        glue = self.glue and self.glue[::-1]
        speed = self.speed and self.speed[::-1]
        shapes = tuple(shape.reversed() for shape in self.shapes[::-1])
        return replace(self, shapes=shapes, glue=glue, speed=speed, lines=self.lines[::-1])


@dataclass(frozen=True)
class Sheet:
    """A drawing that was read.

    Attributes:
        strokes: in the order in which they are drawn; lengths in mm.
        ignored: number of entities of each kind that are not traced.
        remarks: assumptions on the drawing.
    """

    strokes: tuple[Stroke, ...]
    ignored: dict[str, int]
    remarks: tuple[str, ...] = ()


def checked_stroke(stroke: Stroke) -> Stroke:
    """Return a stroke whose coordinates are finite and within bounds, or raise InputError."""
    worst = np.abs(stroke.points).max(initial=0.0)
    if not worst <= LARGEST_COORDINATE:
        raise InputError(
            f"{stroke.where}: coordinate of {worst:.10g} mm: must be finite and within ± {LARGEST_COORDINATE:g} mm"
        )
    return stroke


def point(x: float, y: float, z: float = 0.0) -> Floats:
    """Return a point, (3,)."""
    return np.array([x, y, z], float)


def bezier(*control: Floats) -> Spline:
    """Return a Bézier curve through the first and the last of its control points, (3,) each."""
    degree = len(control) - 1
    return Spline(np.repeat([0.0, 1.0], degree + 1), np.array(control), np.ones(degree + 1), degree)


def bulged_line(first: Floats, last: Floats, bulge: float) -> Shape:
    """Return the line between two points of a level plane, or the arc of a bulge: tan of a quarter of its angle.

    The arc is counter-clockwise where the bulge is positive.
    """
    if abs(bulge) < 1e-12 or np.array_equal(first, last):
        return Segment(first, last)
    chord = complex(*(last - first)[:2])
    # distance of the centre to the left of the chord's middle, as a share of the chord
    to_the_left = (1 - bulge**2) / (4 * bulge)
    middle = complex(*(0.5 * (first + last))[:2])
    centre = middle + 1j * chord * to_the_left
    out = complex(*first[:2]) - centre
    u = point(out.real, out.imag)
    v = point(-out.imag, out.real)
    return Ellipse(point(centre.real, centre.imag, first[2]), u, v, 0.0, 4 * math.atan(bulge))
