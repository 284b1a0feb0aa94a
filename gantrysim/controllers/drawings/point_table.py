"""Points as a table: one in a row, with or without heads, in any dialect that a spreadsheet or a CAD program writes.

    x, y, z, glue, speed
    0, 0, 0
    50, 0, 0, 1, 40

Other programs name the columns in their own ways, and a teach pendant or a list of the parts of a board has more of
them: what a point is, how long a dot is dispensed, z downwards. Columns that mean nothing here are left alone.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive, unknown
from gantrysim.base.heads import name_and_unit
from gantrysim.controllers.drawings.shapes import FASTEST, LARGEST
from gantrysim.tables.dialect import BLANKS, GAPS, Dialect
from gantrysim.tables.text_table import TextTable
from gantrysim.tables.units import KINDS, LENGTH, TIME, factor

COLUMNS = ("x", "y", "z", "glue", "speed")  # of a table without heads

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
_PARTS = ("ref", "designator", "refdes", "reference", "part")  # heads of a list of parts, whose places are dots
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
        parts = any(_plain(name) in _PARTS for name, _ in names) and "kind" not in roles
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
        if not max(map(abs, place)) <= LARGEST:
            raise InputError(f"line {line}: coordinate of {max(place, key=abs):g} mm: must be at most {LARGEST:g} mm")
        switch = (values.get("glue") or "1").lower()
        if switch not in _SWITCH:
            raise InputError(f"line {line}: glue = {switch[:_SHOWN]!r}: must be 1 or 0")
        speed = math.nan
        if values.get("speed"):
            speed = self._number(line, "speed", values["speed"])
            positive(f"line {line}: speed", speed, "mm/s", FASTEST)
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
