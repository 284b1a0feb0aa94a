"""Points as text: one in a line, with or without a header.

    x, y, z, glue, speed
    0, 0, 0
    50, 0, 0, 1, 40

The columns are separated by semicolons, tabs, commas or spaces; numbers may have a decimal comma where the separator is
none. An empty line begins another stroke. Glue and speed of a point hold on the way to it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from string import whitespace

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive
from gantrysim.drawings.shapes import FASTEST, LARGEST, Segment, Shape, Sheet, Stroke, bezier

COLUMNS = ("x", "y", "z", "glue", "speed")
_SWITCH = {"1": True, "true": True, "on": True, "yes": True, "0": False, "false": False, "off": False, "no": False}
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_SAME = 1e-6  # distance up to which two points are one [mm]
# sign in the line, regular expression, and whether a comma is the decimal sign beside it; the first that fits is taken
_SEPARATORS = ((";", ";", True), ("\t", "\t", True), (",", ",", False), ("", r"\s+", True))
_COMMENT = "#"


@dataclass(frozen=True)
class _Row:
    line: int
    point: Floats
    glue: bool
    speed: float


@dataclass(frozen=True)
class _Layout:
    """Columns of a text, and the signs that divide them.

    Attributes:
        separator: regular expression; blanks around it belong to no cell.
        comma: whether a comma is the decimal sign.
        columns: their names.
        header: number of the header's line, 0 for none.
    """

    separator: str
    comma: bool
    columns: tuple[str, ...]
    header: int

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line, without empty ones at its end."""
        cells = [cell.strip() for cell in re.split(self.separator, line.strip())]
        while len(cells) > 2 and not cells[-1]:
            cells.pop()
        return cells


def read_points(text: str, factor: float, curve: str) -> Sheet:
    """Return the strokes through the points of a text.

    Args:
        text: the file's content.
        factor: length of a unit [mm].
        curve: "lines", or "spline" for a cubic spline through the points of a stroke.

    Raises:
        InputError: a line that cannot be read, by its number.
    """
    layout = _layout(text)
    blocks: list[list[_Row]] = [[]]
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            blocks.append([])
        elif number != layout.header and not line.lstrip().startswith(_COMMENT):
            row = _row(number, layout, line, factor)
            if blocks[-1] and math.dist(blocks[-1][-1].point, row.point) <= _SAME:
                continue
            blocks[-1].append(row)
    strokes = tuple(_stroke(rows, curve) for rows in blocks if len(rows) > 1)
    single = sum(len(rows) == 1 for rows in blocks)
    return Sheet(strokes, {"single point": single} if single else {})


def with_speeds(text: str, change: Callable[[float], float]) -> str | None:
    """Return the text with every speed in it changed, None if it has none."""
    layout = _layout(text)
    if "speed" not in layout.columns:
        return None
    index = 2 * layout.columns.index("speed")  # of the cell: separators are at every second place
    lines = []
    has_speed = False
    for number, line in enumerate(text.splitlines(), 1):
        parts = re.split(f"({layout.separator})", line.strip())
        is_data = number != layout.header and not line.lstrip().startswith(_COMMENT) and len(parts) > index
        if is_data and parts[index].strip():
            speed = f"{change(_number(number, 'speed', parts[index], layout.comma)):.9g}"
            if layout.comma:
                speed = speed.replace(".", ",")
            parts[index] = parts[index].replace(parts[index].strip(), speed)
            has_speed = True
        lines.append("".join(parts))
    return "\n".join(lines) if has_speed else None


def _layout(text: str) -> _Layout:
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith(_COMMENT):
            continue
        separator, comma = next((pattern, comma) for sign, pattern, comma in _SEPARATORS if sign in line)
        layout = _Layout(separator, comma, COLUMNS, 0)
        cells = layout.cells(line)
        if all(_NUMBER.fullmatch(cell.replace(",", ".")) or cell.lower() in _SWITCH for cell in cells if cell):
            return layout
        return _Layout(separator, comma, _named(number, cells), number)
    raise InputError("drawing: has no points: must have lines of x, y[, z][, glue][, speed]")


def _named(number: int, cells: list[str]) -> tuple[str, ...]:
    names = tuple(_bare(cell.strip().strip('"')).lower() for cell in cells)
    for name in names:
        if name not in COLUMNS:
            raise InputError(f"line {number}: {name[:40]!r}: must be a number, or a column of {', '.join(COLUMNS)}")
    if len(set(names)) < len(names) or not {"x", "y"} <= set(names):
        raise InputError(f"line {number}: columns {', '.join(names)}: must have x and y, and each once")
    return names


def _bare(head: str) -> str:
    """The name in a column's head, without a unit in brackets."""
    name = head.partition("[")[0].partition("(")[0]
    return name if name == head else name.rstrip("_" + whitespace)


def _row(number: int, layout: _Layout, line: str, factor: float) -> _Row:
    cells = layout.cells(line)
    if len(cells) > len(layout.columns):
        raise InputError(
            f"line {number}: {len(cells)} values: must be at most {len(layout.columns)}, {', '.join(layout.columns)}"
        )
    values = dict(zip(layout.columns, cells, strict=False))
    for name in ("x", "y"):
        if not values.get(name):
            raise InputError(f"line {number}: has no {name}: must have x and y")
    place = [_number(number, name, values.get(name) or "0", layout.comma) for name in "xyz"]
    if not max(map(abs, place)) * factor <= LARGEST:
        raise InputError(
            f"line {number}: coordinate of {factor * max(place, key=abs):g} mm: must be at most {LARGEST:g} mm"
        )
    switch = (values.get("glue") or "1").lower()
    if switch not in _SWITCH:
        raise InputError(f"line {number}: glue = {switch[:40]!r}: must be 1 or 0")
    speed = math.nan
    if values.get("speed"):
        speed = _number(number, "speed", values["speed"], layout.comma)
        positive(f"line {number}: speed", speed, "mm/s", FASTEST)
    return _Row(number, factor * np.array(place), _SWITCH[switch], speed)


def _number(line: int, name: str, cell: str, comma: bool) -> float:
    plain = cell.strip().replace(",", ".") if comma else cell.strip()
    value = float(plain) if _NUMBER.fullmatch(plain) else math.nan
    if not math.isfinite(value):
        raise InputError(f"line {line}: {name} = {cell[:40]!r}: must be a finite number")
    return value


def _stroke(rows: list[_Row], curve: str) -> Stroke:
    glue = tuple(row.glue for row in rows[1:])
    speed = tuple(row.speed for row in rows[1:])
    shapes: list[Shape] = []
    first = 0
    for last in range(1, len(rows)):
        if last < len(rows) - 1 and glue[last] == glue[first]:
            continue
        points = np.array([row.point for row in rows[first : last + 1]])
        if curve == "spline" and len(points) > 2:
            shapes += _spline(points, rows[first].line)
        else:
            shapes += [Segment(a, b) for a, b in pairwise(points)]
        first = last
    return Stroke(tuple(shapes), f"line {rows[0].line}", glue=glue, speed=speed)


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
