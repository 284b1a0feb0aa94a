"""Commands that record, a function each: `cmd_recordon` is RECORDON."""

from __future__ import annotations

from collections.abc import Callable

from gantrysim.base.errors import unknown, whole_number
from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.softmc.basic import properties
from gantrysim.controllers.softmc.basic.execution import Action, RoutineFrame
from gantrysim.controllers.softmc.basic.expressions import element, expression
from gantrysim.controllers.softmc.basic.recording import Column, Recording
from gantrysim.controllers.softmc.basic.tree import CommandHandler, Node, child, name_of, trees, word
from gantrysim.controllers.softmc.basic.values import number
from gantrysim.controllers.softmc.commands import SoftMCError
from gantrysim.controllers.softmc.stream import AXES

command: Statements[CommandHandler] = Statements()

_OPTIONS = ("gap", "recdata")
_LONGEST_GAP = 1_000_000  # [ticks]
_MOST_COLUMNS = 64
_MOST_RECORDS = 100


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
        if not 1 <= k <= len(AXES):
            raise SoftMCError(f"{what}{{{k:g}}}: must be 1 to {len(AXES)}")
        return [Column(f"{what}{{{k:g}}}", what, int(k) - 1)]

    return columns


@command("_RECORDON")
def cmd_recordon(tree: Node) -> Action:
    """RECORDON: samples from now on."""

    def act(scope: RoutineFrame) -> None:
        records = scope.execution.records
        if not records or records[-1].closed:
            raise SoftMCError("no record is open: RECORD must come first")
        if not records[-1].running:
            records[-1].spans.append((scope.execution.mark(), None))

    return act


@command("_RECORDOFF")
def cmd_recordoff(tree: Node) -> Action:
    """RECORDOFF: no samples from now on."""
    return _stop_record


@command("_RECORDCLOSE")
def cmd_recordclose(tree: Node) -> Action:
    """RECORDCLOSE: the end of the record."""

    def act(scope: RoutineFrame) -> None:
        _stop_record(scope)
        if scope.execution.records:
            scope.execution.records[-1].closed = True

    return act


def _stop_record(scope: RoutineFrame) -> None:
    execution = scope.execution
    if execution.records:
        execution.records[-1].stop(execution.mark())
