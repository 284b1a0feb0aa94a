"""The statements that move the group, and those that record."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lark import Token, Tree

from gantrysim.base.errors import unknown, whole
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.expressions import child, element, expression, name_of, several, trees, word
from gantrysim.controllers.softmc.basic.recording import Column, Recording
from gantrysim.controllers.softmc.basic.syntax import Node
from gantrysim.controllers.softmc.basic.task import Expression, Frame, Statement
from gantrysim.controllers.softmc.basic.values import Element, Point, Value, number, text_of
from gantrysim.controllers.softmc.commands import Circle, Move, SoftMCError
from gantrysim.controllers.softmc.geometry import AXES

_CIRCLE = {
    "angle": "angle",
    "circlecenter": "centre",
    "circleplane": "plane",
    "circlepoint": "via",
    "targetpoint": "target",
}
_POINTS = ("centre", "via", "target")
_OPTIONS = ("gap", "recdata")
_FARTHEST = 1e6  # coordinate [mm]
_LONGEST_GAP = 1_000_000  # [ticks]
_MOST_COLUMNS = 64
_MOST_RECORDS = 100

Pairs = list[tuple[str, str, Expression]]  # name as written, canonical name, value


def _pairs(tree: Node, words: dict[str, str]) -> Pairs:
    pairs: Pairs = []
    for one in trees(tree):
        if one.data != "property":
            continue
        name = word(one)
        short = words.get(name.lower(), properties.canonical(name))
        if short not in words.values() and short not in properties.NODAL:
            raise unknown("word", name, [*words, *properties.NODAL])
        if any(short == other for _, other, _ in pairs):
            raise SoftMCError(f"{name}: is given twice, must be once")
        pairs.append((name, short, expression(child(one, 1))))
    return pairs


def _nodal(pairs: Pairs, group: Element, frame: Frame) -> dict[str, Any]:
    given = [(name, short, value) for name, short, value in pairs if short in properties.NODAL]
    return {short: properties.checked(group, name, value(frame))[1] for name, short, value in given}


def _point(name: str, value: Value, frame: Frame) -> tuple[float, ...]:
    if not isinstance(value, Point):
        raise SoftMCError(f"{name} = {text_of(value)}: must be a point in braces, as in {{0, 0, 5}}")
    if max(map(abs, value.values)) > _FARTHEST:
        raise SoftMCError(f"{name} = {value}: must be within {_FARTHEST:g} mm")
    task = frame.task
    if task.axes is None:
        task.axes = max(2, min(len(value.values), task.coordinates))
    return value.values


Aim = Callable[[Frame], tuple[Value | None, Value]]  # the group, or None where none is named; and the target


def _aim(first: Node, second: Node | None) -> Aim:
    """Return what finds the group and the target of a MOVE.

    `Move G1 {1, 2}` reads as a coordinate of G1, and `Move G1 (p)` as a call.
    """
    if second is not None:
        of = element(first)
        target = expression(second)
        return lambda frame: (of(frame), target(frame))
    name = name_of(child(first, 0)) if first.data == "component" else word(first) if first.data == "call" else None
    rest = first.children[1] if name is not None else None
    if name is None or not isinstance(rest, Tree):
        alone = expression(first)
        return lambda frame: (None, alone(frame))
    group = element(Tree("name", [Token("NAME", name)]))
    point = expression(Tree("joint", [rest])) if first.data == "component" else several(rest)[0]
    entire = None if first.data == "component" and len(rest.children) > 1 else expression(first)

    def either(frame: Frame) -> tuple[Value | None, Value]:
        variable = frame.find(name.lower())
        routine = frame.task.routines.get(name.lower())
        if (variable is None and routine is None) or (variable is not None and isinstance(variable.value, Element)):
            return group(frame), point(frame)
        if entire is None:
            raise SoftMCError(f"{name}: must be the group")
        return None, entire(frame)

    return either


def move(tree: Node) -> Statement:
    """MOVE [group] point, and MOVES."""
    second = tree.children[1]
    aim = _aim(child(tree, 0), second if isinstance(second, Tree) else None)
    pairs = _pairs(Tree("properties", tree.children[2:]), {})

    def do(frame: Frame) -> None:
        task = frame.task
        group, held = aim(frame)
        moved = task.only_group(group if isinstance(group, Element) else None)
        point = _point("target", held, frame)
        nodal = _nodal(pairs, moved, frame)
        if task.time.start is None:
            task.begin(point if nodal.get("abs", moved.properties["abs"]) else None)
        task.move(moved, nodal, Move(point), False)

    return do


def circle(tree: Node) -> Statement:
    """CIRCLE [group] with its words."""
    first = tree.children[0]
    of = element(child(first, 0)) if isinstance(first, Tree) and first.data == "element" else None
    pairs = _pairs(tree, _CIRCLE)

    def do(frame: Frame) -> None:
        found = None if of is None else of(frame)
        moved = frame.task.only_group(found if isinstance(found, Element) else None)
        arguments: dict[str, Any] = {}
        for name, short, value in pairs:
            if short in _POINTS:
                arguments[short] = _point(name, value(frame), frame)
            elif short in _CIRCLE.values():
                held = number(name, value(frame))
                arguments[short] = int(held) if short == "plane" and held.is_integer() else held
        nodal = _nodal(pairs, moved, frame)
        if frame.task.time.start is None:
            frame.task.begin(None)
        frame.task.move(moved, nodal, Circle(**arguments), True)

    return do


def delay(tree: Node) -> Statement:
    """DELAY [group] milliseconds: the program goes on when the group has rested that long."""
    first = child(tree, 0)
    second = tree.children[1]
    of = element(first) if isinstance(second, Tree) else None
    time = expression(second if isinstance(second, Tree) else first)

    def do(frame: Frame) -> None:
        if of is not None:
            found = of(frame)
            frame.task.only_group(found if isinstance(found, Element) else None)
        frame.task.time.wait()
        frame.task.sleep("delay", time(frame))

    return do


def sleep(tree: Node) -> Statement:
    """SLEEP milliseconds."""
    time = expression(child(tree, 0))
    return lambda frame: frame.task.sleep("sleep", time(frame))


def record(tree: Node) -> Statement:
    """RECORD file points [Gap = ticks] RecData = expressions."""
    file = word(tree).strip('"')
    points = expression(child(tree, 1))
    options = {word(one).lower(): trees(one) for one in trees(tree) if one.data == "option"}
    for name in options:
        if name not in _OPTIONS:
            raise unknown("word", name, _OPTIONS)
    if "recdata" not in options:
        raise SoftMCError("RecData is missing: must follow with expressions, as in RecData = pcmd{1}, sys.clock")
    gap = expression(options["gap"][0]) if "gap" in options else None
    if len(options.get("gap", [0])) != 1:
        raise SoftMCError("Gap: must be one number")
    sampled = [_sampled(one) for one in options["recdata"]]

    def do(frame: Frame) -> None:
        task = frame.task
        if task.records and not task.records[-1].closed:
            raise SoftMCError("a record is open: must be closed by RECORDCLOSE")
        if len(task.records) >= _MOST_RECORDS:
            raise SoftMCError(f"{_MOST_RECORDS} records: a program must have at most that many")
        columns = tuple(column for make in sampled for column in make(frame))
        if len(columns) > _MOST_COLUMNS:
            raise SoftMCError(f"RecData of {len(columns)} columns: must be at most {_MOST_COLUMNS}")
        most = whole("points", number("points", points(frame)), 1)
        every = 1 if gap is None else whole("Gap", number("Gap", gap(frame)), 1)
        if every > _LONGEST_GAP:
            raise SoftMCError(f"Gap = {every}: must be at most {_LONGEST_GAP}")
        task.records.append(Recording(file, most, every, columns))

    return do


def _sampled(tree: Node) -> Any:
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
    of = element(child(tree, 0)) if tree.data == "member" else None
    if what not in (*properties.RECORDED, "clock"):
        raise unknown("expression of RecData", name, [*properties.RECORDED, "sys.clock"])

    def columns(frame: Frame) -> list[Column]:
        task = frame.task
        if what == "clock":
            return [Column("sys.clock", what)]
        found = task.focus() if of is None else of(frame)
        if isinstance(found, Element) and found.kind == "axis":
            return [Column(f"{found.name}.{what}", what, task.index_of(found))]
        count = task.axes or len(AXES)
        if which is None:
            return [Column(f"{what}{{{k + 1}}}", what, k) for k in range(count)]
        k = number("coordinate's number", which(frame))
        if not 1 <= k <= len(AXES):
            raise SoftMCError(f"{what}{{{k:g}}}: must be 1 to {len(AXES)}")
        return [Column(f"{what}{{{k:g}}}", what, int(k) - 1)]

    return columns


def recordon(tree: Node) -> Statement:
    """RECORDON."""

    def do(frame: Frame) -> None:
        task = frame.task
        if not task.records or task.records[-1].closed:
            raise SoftMCError("no record is open: RECORD must come first")
        if not task.records[-1].running:
            task.records[-1].spans.append((task.mark(), None))

    return do


def recordoff(tree: Node) -> Statement:
    """RECORDOFF, and RECORDCLOSE."""
    closes = tree.data == "recordclose"

    def do(frame: Frame) -> None:
        if frame.task.records:
            frame.task.records[-1].stop(frame.task.mark())
            frame.task.records[-1].closed |= closes

    return do
