"""Strokes and dots through the points of a table.

An empty line begins another stroke; so do the kinds "start", "move" and "dot" of a point, and the one after "end". Glue
and speed of a point hold on the way to it. The way through a point of the kind "arc" is the circular arc from the point
before through it to the point after, in space.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive, unknown
from gantrysim.base.quantity import counted
from gantrysim.controllers.drawings.shapes import (
    FASTEST_SPEED,
    LARGEST_COORDINATE,
    Ellipse,
    Segment,
    Shape,
    Sheet,
    Stroke,
    bezier,
)
from gantrysim.tables.text_table import BLANKS, GAPS, Dialect, TextTable
from gantrysim.tables.units import KINDS, LENGTH, TIME, factor, name_and_unit

# Points as a table: one in a row, with or without heads, in any dialect that a spreadsheet or a CAD program writes.
#
#     x, y, z, glue, speed
#     0, 0, 0
#     50, 0, 0, 1, 40
#
# Other programs name the columns in their own ways, and a teach pendant or a list of the parts of a board has more of
# them: what a point is, how long a dot is dispensed, z downwards. Columns that mean nothing here are left alone.

COLUMNS = ("x", "y", "z", "glue", "speed")  # of a table without heads

_EMPTY_CELLS = {"z": "0", "z_down": "0", "glue": "1"}  # what cells without a value stand for

DOT = "dot"
START = "start"
PASSING = "passing"
ARC = "arc"
END = "end"
MOVE = "move"
# what a point is, as users and the teach pendants of desktop dispensers write it
_KINDS = {
    DOT: ("dot", "point", "pointdispense", "dispensedot", "drill"),
    START: ("start", "linestart", "begin"),
    PASSING: ("passing", "linepassing", "line", "via", "linepoint"),
    ARC: ("arc", "arcpoint", "arcmiddle"),
    END: ("end", "lineend", "stop"),
    MOVE: ("move", "travel", "dummy", "dummypoint"),
}
# names of columns without blanks and signs, in lower case
_ROLES = {
    "x": ("x", "posx", "xpos", "xposition", "midx", "centerx", "centrex", "refx"),
    "y": ("y", "posy", "ypos", "yposition", "midy", "centery", "centrey", "refy"),
    "z": ("z", "posz", "zpos", "zposition", "height"),
    "z_down": ("zdown", "depth"),
    "glue": ("glue", "dispense", "valve"),
    "speed": ("speed", "feed", "feedrate", "linespeed"),
    "kind": ("kind", "type", "pointtype", "command"),
    "time": ("time", "dottime", "dwell", "dispensetime"),
}
_PART_HEADS = ("ref", "designator", "refdes", "reference", "part")  # heads of a list of parts, whose places are dots
_SWITCH = {"1": True, "true": True, "on": True, "yes": True, "0": False, "false": False, "off": False, "no": False}
_UNIT_REMARK = re.compile(r"unit\s*[=:]\s*(\w+)", re.IGNORECASE)
_LONGEST_DOT = 3600.0  # [s]
_SHOWN = 40  # characters of a wrong cell


@dataclass(frozen=True)
class PointRow:
    """A point of a table.

    Attributes:
        line: of the file, from 1.
        point: (3,) [mm].
        glue: whether glue is laid on the way to it.
        speed: on the way to it, nan where none is given [mm/s].
        kind: "dot", "start", "passing", "arc", "end" or "move"; "" where the table does not say.
        time: for which a dot is dispensed, nan where none is given [s].
    """

    line: int
    point: Floats
    glue: bool
    speed: float
    kind: str
    time: float


@dataclass(frozen=True)
class PointTable:
    """Points in the order of a table.

    Attributes:
        blocks: points between empty lines.
        unused: heads of the columns that mean nothing here.
    """

    blocks: tuple[tuple[PointRow, ...], ...]
    unused: tuple[str, ...]

    @classmethod
    def of(cls, text: str, unit: float | None) -> PointTable:
        """Return the points of a text.

        Args:
            text: the file's content.
            unit: length of a unit, which the table's own does not change [mm]; None for the table's own, or mm.

        Raises:
            InputError: no points, or a line that cannot be read, by its number.
        """
        table = TextTable.of(text)
        if not table.rows:
            raise InputError("drawing: has no points: must have lines of x, y[, z][, glue][, speed]")
        layout = _Layout.of(table, unit)
        rows = [layout.row(row.line, row.cells) for row in table.split()]
        blocks: list[list[PointRow]] = [[]]
        breaks = [number for number in table.breaks if number > rows[0].line]
        for row in rows:
            if breaks and breaks[0] < row.line:
                blocks.append([])
                breaks = [number for number in breaks if number > row.line]
            blocks[-1].append(row)
        return cls(tuple(map(tuple, blocks)), layout.unused)


@dataclass(frozen=True)
class _Layout:
    """Roles of the columns of a table.

    Attributes:
        dialect: of its cells.
        roles: of the columns, in their order; "" for one that means nothing here.
        factors: of x, y, z, z_down [mm] and of time [s].
        unused: heads without a role.
        parts: whether it is a list of parts.
        headless: whether it has no heads.
    """

    dialect: Dialect
    roles: tuple[str, ...]
    factors: Mapping[str, float]
    unused: tuple[str, ...]
    parts: bool
    headless: bool

    @classmethod
    def of(cls, table: TextTable, unit: float | None) -> _Layout:
        if not table.heads:
            lengths = dict.fromkeys(("x", "y", "z", "z_down"), unit or 1.0)
            return cls(table.dialect, COLUMNS, {**lengths, "time": 1.0}, (), False, True)
        names = [name_and_unit(head) for head in table.heads]
        stated_units = [table.units[k] if k < len(table.units) else of_name for k, (_, of_name) in enumerate(names)]
        roles = _roles([name for name, _ in names])
        if not {"x", "y"} <= set(roles):
            listed = ", ".join(head[:_SHOWN] for head in table.heads)
            raise InputError(f"line {table.rows[0][0] - 1}: columns {listed}: must have x and y")
        factors = {"time": 1.0, "x": 1.0, "y": 1.0, "z": 1.0, "z_down": 1.0}
        general = _unit_of_remarks(table.remarks)
        for role, stated in zip(roles, stated_units, strict=True):
            bare = stated.strip().strip("[]()")
            if role == "time" and bare:
                factors[role] = factor(bare, TIME, f"column {role}")
            elif role in ("x", "y", "z", "z_down"):
                of_head = factor(bare, LENGTH, f"column {role}") if bare else None
                factors[role] = unit or of_head or general or 1.0
        parts = any(_plain(name) in _PART_HEADS for name, _ in names) and "kind" not in roles
        unused = tuple(head for head, role in zip(table.heads, roles, strict=True) if not role)
        return cls(table.dialect, tuple(roles), factors, unused, parts, False)

    def row(self, line: int, cells: Sequence[str]) -> PointRow:
        """Return the point in the cells of a line."""
        if len(cells) > len(self.roles):
            names = ", ".join(role or "-" for role in self.roles)
            raise InputError(f"line {line}: {len(cells)} values: must be at most {len(self.roles)}, {names}")
        values = {role: cell for role, cell in zip(self.roles, cells, strict=False) if role}
        for name in ("x", "y"):
            if not values.get(name):
                raise InputError(f"line {line}: has no {name}: must have x and y")
        place = [self._length(line, name, values) for name in ("x", "y", "z")]
        if values.get("z_down"):
            place[2] = -self._length(line, "z_down", values)
        if not max(map(abs, place)) <= LARGEST_COORDINATE:
            raise InputError(
                f"line {line}: coordinate of {max(place, key=abs):.10g} mm: must be within ± {LARGEST_COORDINATE:g} mm"
            )
        switch = (values.get("glue") or "1").lower()
        if switch not in _SWITCH:
            raise InputError(f"line {line}: glue = {switch[:_SHOWN]!r}: must be 1 or 0")
        speed = math.nan
        if values.get("speed"):
            speed = self._number(line, "speed", values["speed"])
            positive(f"line {line}: speed", speed, "mm/s", FASTEST_SPEED)
        time = math.nan
        if values.get("time"):
            time = self.factors["time"] * self._number(line, "time", values["time"])
            if not 0 <= time <= _LONGEST_DOT:
                raise InputError(f"line {line}: time = {time:g} s: must be 0 to {_LONGEST_DOT:g} s")
        kind = DOT if self.parts else _kind(line, values.get("kind", ""))
        return PointRow(line, np.array(place), _SWITCH[switch], speed, kind, time)

    def _length(self, line: int, name: str, values: Mapping[str, str]) -> float:
        return self.factors[name] * self._number(line, name, values.get(name) or "0")

    def _number(self, line: int, name: str, cell: str) -> float:
        value = self.dialect.number(cell)
        if value is None or not math.isfinite(value):
            raise InputError(f"line {line}: {name} = {cell[:_SHOWN]!r}: must be a finite number")
        return value


def with_speeds(text: str, change: Callable[[float], float]) -> str | None:
    """Return the text with every speed in it changed, None if it has none."""
    table = TextTable.of(text)
    if not table.rows:
        return None
    layout = _Layout.of(table, 1.0)
    if "speed" not in layout.roles:
        return None
    index = layout.roles.index("speed")
    lines = text.splitlines()
    has_speed = False
    for row in table.split():
        if len(row.cells) <= index or row.cells[index].lower() in GAPS:
            continue
        speed = table.dialect.number(row.cells[index])
        if speed is None:
            continue
        changed = f"{change(speed):.9g}"
        row.cells[index] = changed.replace(".", ",") if table.dialect.decimal_comma else changed
        lines[row.line - 1] = _line(row.cells, table.dialect)
        has_speed = True
    return "\n".join(lines) if has_speed else None


def with_row_speeds(text: str, speeds: Mapping[int, float]) -> str:
    """Return the text with other speeds in some of its rows; without a column of speeds, one is added.

    Args:
        text: of the table.
        speeds: by the lines of the rows [mm/s].

    Raises:
        InputError: the column has no place, as the heads stand in no line of their own.
    """
    table = TextTable.of(text)
    lines = text.splitlines()
    if "speed" not in _Layout.of(table, 1.0).roles:
        head = next(
            (k for k in range(table.rows[0][0] - 1) if tuple(table.dialect.cells(lines[k])) == table.heads), None
        )
        if head is None:
            raise InputError("drawing: the table has no column speed, and no line of heads to which it could be added")
        lines[head] = _line([*table.heads, "speed"], table.dialect)
        return with_row_speeds("\n".join(lines), speeds)
    roles = _Layout.of(table, 1.0).roles
    index = roles.index("speed")
    for row in table.split():
        if row.line not in speeds:
            continue
        # cells that are missing at the end, as they are read
        cells = [*row.cells, *(_EMPTY_CELLS.get(role, "") for role in roles[len(row.cells) : index + 1])]
        written = f"{speeds[row.line]:.9g}"
        cells[index] = written.replace(".", ",") if table.dialect.decimal_comma else written
        lines[row.line - 1] = _line(cells, table.dialect)
    return "\n".join(lines)


def _line(cells: Sequence[str], dialect: Dialect) -> str:
    stream = io.StringIO()
    separator = " " if dialect.separator == BLANKS else dialect.separator
    csv.writer(stream, delimiter=separator, lineterminator="").writerow(cells)
    return stream.getvalue()


def _plain(head: str) -> str:
    return re.sub(r"[\W_]+", "", head).lower()


def _roles(names: Sequence[str]) -> list[str]:
    """Return the roles of columns by their names, each role once: the first column of a role has it."""
    roles: list[str] = []
    for name in names:
        plain = _plain(name)
        suffixless = re.sub(r"(mm|um|in|cm)$", "", plain) if plain not in ("x", "y", "z") else plain
        role = next((key for key, words in _ROLES.items() if plain in words or suffixless in words), "")
        roles.append("" if role in roles else role)
    return roles


def _unit_of_remarks(remarks: Sequence[str]) -> float | None:
    """Return the length of the unit that a remark states, as in KiCad's "Unit = mm" [mm]."""
    for remark in remarks:
        match = _UNIT_REMARK.search(remark)
        if match and match[1].lower().rstrip("es") in ("inch", "in"):
            return KINDS[LENGTH]["in"]
        if match and match[1].lower() in KINDS[LENGTH]:
            return KINDS[LENGTH][match[1].lower()]
    return None


def _kind(line: int, cell: str) -> str:
    plain = _plain(cell)
    if not plain:
        return ""
    for kind, words in _KINDS.items():
        if plain in words:
            return kind
    raise InputError(f"line {line}: {unknown('kind', cell[:_SHOWN], [words[0] for words in _KINDS.values()])}")


_SAME_POINT = 1e-6  # distance up to which two points are one [mm]
_STRAIGHT_SINE = 1e-9  # sine of the angle at a point of an arc, up to which its three points lie on a line


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
    timed = 0
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
            if row.kind == MOVE or (rows and math.dist(rows[-1].point, row.point) <= _SAME_POINT):
                continue
            timed += row.time > 0
            rows.append(row)
            if row.kind == END:
                collected.close(rows, curve)
        collected.close(rows, curve)
    moves = sum(row.kind == MOVE for block in table.blocks for row in block)
    ignored = {"single point": collected.single, "dot": ignored_dots, "point of kind move": moves}
    remarks = [f"columns that are not used: {', '.join(table.unused)}"] if table.unused else []
    if timed:
        remarks.append(f"time is not used at {counted(timed, 'point')} of strokes: a column kind with dot makes dots")
    return Sheet(tuple(collected.strokes), {kind: count for kind, count in ignored.items() if count}, tuple(remarks))


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
        lines = tuple(row.line for row in rows[1:])
        return Stroke(tuple(shapes), f"line {rows[0].line}", glue=tuple(glue), speed=tuple(speed), lines=lines)
    kept_glue = []
    kept_speed = []
    kept_lines = []
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
        kept_lines.append(rows[k].line)
        k += 1
    return Stroke(
        shapes=tuple(shapes),
        where=f"line {rows[0].line}",
        glue=tuple(kept_glue),
        speed=tuple(kept_speed),
        lines=tuple(kept_lines),
    )


def _arc(first: Floats, middle: Floats, last: Floats) -> Shape:
    """Return the circular arc through three points in space, or the line through those that lie on one.

    With a = middle - first and b = last - first, the centre is first + ((a.a) b - (b.b) a) x (a x b) / 2 |a x b|^2.
    """
    a = middle - first
    b = last - first
    normal = np.cross(a, b)
    if math.hypot(*normal) <= _STRAIGHT_SINE * math.hypot(*a) * math.hypot(*b):
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

    closed = len(points) > 3 and math.dist(points[0], points[-1]) <= _SAME_POINT
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
