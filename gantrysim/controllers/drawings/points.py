"""Strokes and dots through the points of a table.

An empty line begins another stroke; so do the kinds "start", "move" and "dot" of a point, and the one after "end". Glue
and speed of a point hold on the way to it. The way through a point of the kind "arc" is the circular arc from the point
before through it to the point after, in space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.drawings.point_table import ARC, DOT, END, MOVE, START, PointRow, PointTable
from gantrysim.controllers.drawings.shapes import Ellipse, Segment, Shape, Sheet, Stroke, bezier

_SAME = 1e-6  # distance up to which two points are one [mm]
_STRAIGHT = 1e-9  # sine of the angle at a point of an arc, up to which its three points lie on a line


@dataclass
class _Strokes:
    """Strokes and dots as they are collected.

    Attributes:
        strokes: in the order of the table.
        single: number of points that are neither.
    """

    strokes: list[Stroke] = field(default_factory=list)
    single: int = 0

    def close(self, rows: list[PointRow], curve: str) -> None:
        """Add the stroke through rows, and empty them."""
        if len(rows) > 1:
            self.strokes.append(_stroke(rows, curve))
        self.single += len(rows) == 1
        rows.clear()


def read_points(text: str, unit: float | None, curve: str, dots: bool) -> Sheet:
    """Return the strokes and dots through the points of a text.

    Args:
        text: the file's content.
        unit: length of a unit [mm]; None for the table's own, or mm.
        curve: "lines", or "spline" for a cubic spline through the points of a stroke.
        dots: whether single points are dots.

    Raises:
        InputError: a line that cannot be read, by its number.
    """
    table = PointTable.of(text, unit)
    collected = _Strokes()
    ignored_dots = 0
    for block in table.blocks:
        rows: list[PointRow] = []
        lone = len({tuple(row.point) for row in block}) == 1 and not block[0].kind
        for row in block:
            if row.kind == DOT or (lone and dots):
                collected.close(rows, curve)
                if dots:
                    collected.strokes.append(_dot(row))
                else:
                    ignored_dots += 1
                if lone:
                    break
                continue
            if row.kind in (START, MOVE):
                collected.close(rows, curve)
            if row.kind == MOVE or (rows and math.dist(rows[-1].point, row.point) <= _SAME):
                continue
            rows.append(row)
            if row.kind == END:
                collected.close(rows, curve)
        collected.close(rows, curve)
    ignored = {"single point": collected.single, "dot": ignored_dots}
    remarks = (f"columns that are not used: {', '.join(table.unused)}",) if table.unused else ()
    return Sheet(tuple(collected.strokes), {kind: count for kind, count in ignored.items() if count}, remarks)


def _dot(row: PointRow) -> Stroke:
    time = None if math.isnan(row.time) else row.time
    return Stroke((), f"line {row.line}", dot=row.point, dot_time=time, glue=(row.glue,))


def _stroke(rows: list[PointRow], curve: str) -> Stroke:
    """Return the stroke through rows: a spline between two changes of the glue, or lines and arcs."""
    glue = [row.glue for row in rows[1:]]
    speed = [row.speed for row in rows[1:]]
    shapes: list[Shape] = []
    if curve == "spline":
        first = 0
        for last in range(1, len(rows)):
            if last < len(rows) - 1 and glue[last] == glue[first]:
                continue
            points = np.array([row.point for row in rows[first : last + 1]])
            if len(points) > 2:
                shapes += _spline(points, rows[first].line)
            else:
                shapes.append(Segment(points[0], points[1]))
            first = last
        return Stroke(tuple(shapes), f"line {rows[0].line}", glue=tuple(glue), speed=tuple(speed))
    kept_glue = []
    kept_speed = []
    k = 1
    while k < len(rows):
        if rows[k].kind == ARC:
            if k + 1 == len(rows):
                raise InputError(f"line {rows[k].line}: point of an arc without a point after it")
            shapes.append(_arc(rows[k - 1].point, rows[k].point, rows[k + 1].point))
            k += 1
        else:
            shapes.append(Segment(rows[k - 1].point, rows[k].point))
        kept_glue.append(glue[k - 1])
        kept_speed.append(speed[k - 1])
        k += 1
    return Stroke(tuple(shapes), f"line {rows[0].line}", glue=tuple(kept_glue), speed=tuple(kept_speed))


def _arc(first: Floats, middle: Floats, last: Floats) -> Shape:
    """Return the circular arc through three points in space, or the line through those that lie on one.

    With a = middle - first and b = last - first, the centre is first + ((a.a) b - (b.b) a) x (a x b) / 2 |a x b|^2.
    """
    a = middle - first
    b = last - first
    normal = np.cross(a, b)
    if math.hypot(*normal) <= _STRAIGHT * math.hypot(*a) * math.hypot(*b):
        return Segment(first, last)
    centre = first + np.cross((a @ a) * b - (b @ b) * a, normal) / (2 * (normal @ normal))
    u = first - centre
    radius = math.hypot(*u)
    v = np.cross(normal / math.hypot(*normal), u)
    to_last = last - centre
    angle = math.atan2(to_last @ v, to_last @ u)
    return Ellipse(centre, u, v / math.hypot(*v) * radius, 0.0, angle if angle > 0 else angle + 2 * math.pi)


def _spline(points: Floats, line: int) -> list[Shape]:
    """Cubic spline through points, parametrised by their chords, as Bézier curves; periodic if it is closed.

    In an interval of length h with p = c0 + c1 t + c2 t^2 + c3 t^3, the inner control points are c0 + c1 h / 3 and
    p(h) - p'(h) h / 3.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    closed = len(points) > 3 and math.dist(points[0], points[-1]) <= _SAME
    if closed:
        points = np.concatenate([points[:-1], points[:1]])
    chord = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    if not np.diff(chord).min() > 0:
        raise InputError(f"line {line}: spline of {chord[-1]:g} mm: has points that are too close for its length")
    slope = CubicSpline(chord, points, bc_type="periodic" if closed else "natural")(chord, 1)
    third = np.diff(chord)[:, None] / 3
    after = points[:-1] + third * slope[:-1]
    before = points[1:] - third * slope[1:]
    return [bezier(*control) for control in zip(points[:-1], after, before, points[1:], strict=True)]
