"""Commands that move the group, let time pass or record, a function each: `cmd_move` is MOVE."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from lark import Token, Tree

from gantrysim.base.errors import unknown, whole_number
from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.execution import Action, Expression, RoutineFrame
from gantrysim.controllers.softmc.basic.expressions import element, expression, several
from gantrysim.controllers.softmc.basic.recording import Column, Recording
from gantrysim.controllers.softmc.basic.tree import CommandHandler, Node, child, name_of, optional, trees, word
from gantrysim.controllers.softmc.basic.values import Element, Point, Value, number, text_of
from gantrysim.controllers.softmc.commands import Circle, Move, SoftMCError
from gantrysim.controllers.softmc.stream import AXES

command: Statements[CommandHandler] = Statements()

_CIRCLE = {
    "angle": "angle",
    "circlecenter": "centre",
    "circleplane": "plane",
    "circlepoint": "via",
    "targetpoint": "target",
}
_POINT_WORDS = ("centre", "via", "target")
_FARTHEST_COORDINATE = 1e6  # coordinate [mm]

_OPTIONS = ("gap", "recdata")
_LONGEST_GAP = 1_000_000  # [ticks]
_MOST_COLUMNS = 64
_MOST_RECORDS = 100


class Setting(NamedTuple):
    """A property or word of a command.

    Attributes:
        name: as written.
        short: canonical name.
        value: its evaluation.
    """

    name: str
    short: str
    value: Expression


def _settings(tree: Node, words: dict[str, str]) -> list[Setting]:
    """Return the words of a command, and the properties of the motion that it gives.

    Raises:
        SoftMCError: an unknown word, or one given twice.
    """
    settings: list[Setting] = []
    for part in trees(tree):
        if part.data != "property":
            continue
        name = word(part)
        short = words.get(name.lower(), properties.canonical(name))
        if short not in words.values() and short not in properties.NODAL:
            raise unknown("word", name, [*words, *properties.NODAL])
        if any(short == other.short for other in settings):
            raise SoftMCError(f"{name}: is given twice, must be once")
        settings.append(Setting(name, short, expression(child(part, 1))))
    return settings


def _nodal(settings: list[Setting], group: Element, scope: RoutineFrame) -> dict[str, Any]:
    """Return the properties of this motion alone."""
    nodal = {}
    for name, short, value in settings:
        if short in properties.NODAL:
            nodal[short] = properties.checked_property(group, name, value(scope))[1]
    return nodal


def _point(name: str, value: Value, scope: RoutineFrame) -> tuple[float, ...]:
    if not isinstance(value, Point):
        raise SoftMCError(f"{name} = {text_of(value)}: must be a point in braces, as in {{0, 0, 5}}")
    if max(map(abs, value.values)) > _FARTHEST_COORDINATE:
        raise SoftMCError(f"{name} = {value}: must be within {_FARTHEST_COORDINATE:g} mm")
    elements = scope.execution.elements
    if elements.axes is None:
        elements.axes = max(2, min(len(value.values), elements.coordinates))
    return value.values


class Aim(NamedTuple):
    """Group and target of a MOVE; no group where none is named."""

    group: Element | None
    target: Value


def _aim(first: Node, second: Node | None) -> Callable[[RoutineFrame], Aim]:
    """Return what finds the group and the target of a MOVE.

    `Move G1 {1, 2}` reads as a coordinate of G1, and `Move G1 (p)` as a call: only the run tells whether the name is
    that of a group.
    """
    if second is not None:
        group = element(first)
        target = expression(second)
        return lambda scope: Aim(group(scope), target(scope))
    name = _name_before(first)
    brackets = first.children[1] if name is not None else None
    if name is None or not isinstance(brackets, Tree):
        alone = expression(first)
        return lambda scope: Aim(None, alone(scope))
    return _either(first, name, brackets)


def _name_before(tree: Node) -> str | None:
    """Return the name before brackets or braces, None where there is none."""
    if tree.data == "component":
        return name_of(child(tree, 0))
    return word(tree) if tree.data == "call" else None


def _either(first: Node, name: str, brackets: Node) -> Callable[[RoutineFrame], Aim]:
    is_component = first.data == "component"
    group = element(Tree("name", [Token("NAME", name)]))
    point = expression(Tree("joint", [brackets])) if is_component else several(brackets)[0]
    # a point of several numbers is no coordinate
    entire = None if is_component and len(brackets.children) > 1 else expression(first)

    def either(scope: RoutineFrame) -> Aim:
        variable = scope.find(name.lower())
        routine = scope.execution.routines.get(name.lower())
        if (variable is None and routine is None) or (variable is not None and isinstance(variable.value, Element)):
            return Aim(group(scope), point(scope))
        if entire is None:
            raise SoftMCError(f"{name}: must be the group")
        return Aim(None, entire(scope))

    return either


@command("(_MOVE | _MOVES) sum [postfix] property*")
def cmd_move(tree: Node) -> Action:
    """MOVE [group] point, and MOVES."""
    aim = _aim(child(tree, 0), optional(tree, 1))
    settings = _settings(Tree("properties", tree.children[2:]), {})

    def act(scope: RoutineFrame) -> None:
        execution = scope.execution
        named, target = aim(scope)
        group = execution.elements.only_group(named)
        point = _point("target", target, scope)
        nodal = _nodal(settings, group, scope)
        if execution.time.start is None:
            execution.begin(point if nodal.get("abs", group.properties["abs"]) else None)
        execution.move(group, nodal, Move(point), False)

    return act


@command("_CIRCLE [element] property+")
def cmd_circle(tree: Node) -> Action:
    """CIRCLE [group] with its words."""
    first = optional(tree, 0)
    named = element(child(first, 0)) if first is not None and first.data == "element" else None
    settings = _settings(tree, _CIRCLE)

    def act(scope: RoutineFrame) -> None:
        execution = scope.execution
        group = execution.elements.only_group(None if named is None else named(scope))
        arguments: dict[str, Any] = {}
        for name, short, value in settings:
            if short in _POINT_WORDS:
                arguments[short] = _point(name, value(scope), scope)
            elif short in _CIRCLE.values():
                stated = number(name, value(scope))
                arguments[short] = int(stated) if short == "plane" and stated.is_integer() else stated
        nodal = _nodal(settings, group, scope)
        if execution.time.start is None:
            execution.begin(None)
        execution.move(group, nodal, Circle(**arguments), True)

    return act


@command("_DELAY sum [postfix]")
def cmd_delay(tree: Node) -> Action:
    """DELAY [group] milliseconds: the program goes on when the group has rested that long."""
    first = child(tree, 0)
    second = optional(tree, 1)
    named = None if second is None else element(first)
    duration = expression(first if second is None else second)

    def act(scope: RoutineFrame) -> None:
        execution = scope.execution
        if named is not None:
            execution.elements.only_group(named(scope))
        execution.time.wait()
        execution.sleep("delay", duration(scope))

    return act


@command("_SLEEP sum")
def cmd_sleep(tree: Node) -> Action:
    """SLEEP milliseconds."""
    duration = expression(child(tree, 0))
    return lambda scope: scope.execution.sleep("sleep", duration(scope))


@command("_RECORD (FILE | STRING) sum option*")
def cmd_record(tree: Node) -> Action:
    """RECORD file points [Gap = ticks] RecData = expressions."""
    file = word(tree).strip('"')
    points = expression(child(tree, 1))
    options = {word(part).lower(): trees(part) for part in trees(tree) if part.data == "option"}
    for name in options:
        if name not in _OPTIONS:
            raise unknown("word", name, _OPTIONS)
    if "recdata" not in options:
        raise SoftMCError("RecData is missing: must follow with expressions, as in RecData = pcmd{1}, sys.clock")
    gap = expression(options["gap"][0]) if "gap" in options else None
    if len(options.get("gap", [None])) != 1:
        raise SoftMCError("Gap: must be one number")
    sampled = [_sampled_columns(part) for part in options["recdata"]]

    def act(scope: RoutineFrame) -> None:
        records = scope.execution.records
        if records and not records[-1].closed:
            raise SoftMCError("a record is open: must be closed by RECORDCLOSE")
        if len(records) >= _MOST_RECORDS:
            raise SoftMCError(f"{_MOST_RECORDS} records: a program must have at most that many")
        columns = tuple(column for columns_of in sampled for column in columns_of(scope))
        if len(columns) > _MOST_COLUMNS:
            raise SoftMCError(f"RecData of {len(columns)} columns: must be at most {_MOST_COLUMNS}")
        most = whole_number("points", number("points", points(scope)), 1)
        every = 1 if gap is None else whole_number("Gap", number("Gap", gap(scope)), 1)
        if every > _LONGEST_GAP:
            raise SoftMCError(f"Gap = {every}: must be at most {_LONGEST_GAP}")
        records.append(Recording(file, most, every, columns))

    return act


def _sampled_columns(tree: Node) -> Callable[[RoutineFrame], list[Column]]:
    """Return the function that makes the columns of an expression of RecData."""
    which = None
    if tree.data == "component":
        braces = child(tree, 1)
        if len(braces.children) != 1:
            raise SoftMCError("a coordinate's number in { }: must be one number")
        which = expression(child(braces, 0))
        tree = child(tree, 0)
    name = word(tree, 1) if tree.data == "member" else name_of(tree)
    if name is None:
        raise SoftMCError("RecData: must be names, as in pcmd{1}, pfb, sys.clock; no operators")
    what = properties.canonical(name)
    owner = element(child(tree, 0)) if tree.data == "member" else None
    if what not in (*properties.RECORDED, "clock"):
        raise unknown("expression of RecData", name, [*properties.RECORDED, "sys.clock"])

    def columns(scope: RoutineFrame) -> list[Column]:
        elements = scope.execution.elements
        if what == "clock":
            return [Column("sys.clock", what)]
        sampled = elements.focus() if owner is None else owner(scope)
        if sampled.kind == "axis":
            return [Column(f"{sampled.name}.{what}", what, elements.index_of(sampled))]
        count = elements.axes or len(AXES)
        if which is None:
            return [Column(f"{what}{{{k + 1}}}", what, k) for k in range(count)]
        k = number("coordinate's number", which(scope))
        if not 1 <= k <= len(AXES) or k != int(k):
            raise SoftMCError(f"{what}{{{k:g}}}: must be 1 to {len(AXES)}")
        return [Column(f"{what}{{{k:g}}}", what, int(k) - 1)]

    return columns


@command("_RECORDON")
def cmd_recordon(tree: Node) -> Action:
    """RECORDON: samples from now on."""

    def act(scope: RoutineFrame) -> None:
        record = _open_record(scope)
        if not record.running:
            record.spans.append((scope.execution.mark(), None))

    return act


@command("_RECORDOFF")
def cmd_recordoff(tree: Node) -> Action:
    """RECORDOFF: no samples from now on."""

    def act(scope: RoutineFrame) -> None:
        _open_record(scope).stop(scope.execution.mark())

    return act


def _open_record(scope: RoutineFrame) -> Recording:
    records = scope.execution.records
    if not records or records[-1].closed:
        raise SoftMCError("no record is open: RECORD must come first")
    return records[-1]


@command("_RECORDCLOSE")
def cmd_recordclose(tree: Node) -> Action:
    """RECORDCLOSE: the end of the record."""

    def act(scope: RoutineFrame) -> None:
        # a program may close at its begin what one before it has left open
        if scope.execution.records:
            record = scope.execution.records[-1]
            record.stop(scope.execution.mark())
            record.closed = True

    return act
