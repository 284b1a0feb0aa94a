"""The controller that runs an MC-Basic program, and the parser of its text, with a table of its commands and blocks."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from lark import Lark
from lark.exceptions import UnexpectedInput, UnexpectedToken
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, finite, positive, whole_number
from gantrysim.base.quantity import counted
from gantrysim.controllers.basic.code import Code
from gantrysim.controllers.basic.statements import Statements, with_keywords
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.softmc.basic import commands, statements
from gantrysim.controllers.softmc.basic.execution import Execution, RoutineFrame, RunSettings
from gantrysim.controllers.softmc.basic.statements import routine
from gantrysim.controllers.softmc.basic.tree import LocatedError, Node, TreeAssembler, line_of, trees
from gantrysim.controllers.softmc.basic.values import Variable
from gantrysim.controllers.softmc.commands import SoftMCError
from gantrysim.controllers.softmc.group import Group
from gantrysim.controllers.softmc.stream import AXES, Leg, Stream, stream
from gantrysim.paths.chain import Chain
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints, periods

PROGRAM_LENGTH = 1_000_000  # characters of a program
# strings too, first, as an apostrophe within one begins no comment
_COMMENT = re.compile(r"\"[^\"\n]*\"|'[^\n]*|^[ \t]*rem\b[^\n]*", re.IGNORECASE | re.MULTILINE)
# all commands and blocks of MC-Basic
COMMANDS = Statements.of(statements.command, commands.command)
BLOCKS = statements.block

# what may stand first in a line besides commands and blocks: words of programs, and parts of blocks
_OF_PROGRAMS = {"end", "function", "next", "program", "sub"}
_OF_BLOCKS = ("else", "elseif", "loop")
_STATEMENTS = (*sorted(COMMANDS.first_words | BLOCKS.first_words | _OF_PROGRAMS), *_OF_BLOCKS)


@lru_cache(maxsize=32)
def parse(text: str) -> Node:
    """Return the tree of a program.

    Raises:
        SoftMCError: a text that is no program, with its line.
    """
    if len(text) > PROGRAM_LENGTH:
        raise SoftMCError(f"program of {len(text)} characters: must be at most {PROGRAM_LENGTH}")
    plain = without_comments(text)
    try:
        tree: Node = _parser().parse(plain)
        return tree
    except UnexpectedInput as error:
        raise SoftMCError(_message(plain, error)) from None


def without_comments(text: str) -> str:
    """Return a text without its comments, with the same lines."""
    plain = _COMMENT.sub(lambda match: match[0] if match[0].startswith('"') else "", text)
    return plain.replace("\r\n", "\n").replace("\r", "\n") + "\n"


@cache
def _parser() -> Lark:
    text = files(__package__).joinpath("mcbasic.lark").read_text(encoding="utf-8")
    grammar = with_keywords(text.replace("$commands", COMMANDS.rule).replace("$blocks", BLOCKS.rule))
    return Lark(grammar, parser="lalr", propagate_positions=True, maybe_placeholders=True)


def _message(text: str, error: UnexpectedInput) -> str:
    lines = text.split("\n")
    if isinstance(error, UnexpectedToken) and error.token.type == "$END":
        last = len(text.rstrip().splitlines())
        return f"line {last}: the text ends within a program, a sub, a function, a loop or a condition"
    number = text.count("\n", 0, error.pos_in_stream or 0) + 1
    words = lines[number - 1].split()
    where = f'line {number} "{" ".join(words)[:80]}"'
    unexpected = text[error.pos_in_stream or 0 :].split("\n")[0].split()[:1]
    before = lines[number - 1][: max(error.column - 1, 0)].split() if unexpected else words
    is_verb = words and re.fullmatch(r"[A-Za-z]\w*", words[0]) and words[0].lower() not in _STATEMENTS
    if is_verb and len(before) == 1 and "=" not in words:
        return f"{where}: unknown statement {words[0]!r}: known: {', '.join(_STATEMENTS)}, or an assignment with ="
    return f"{where}: {repr(unexpected[0][:40]) if unexpected else 'the end of the line'} does not fit there"


# From a text to code.


def code_of(statements: list[Node], line: int | None = None) -> Code[RoutineFrame]:
    """Return the code of statements, each at its own line or all at one."""
    assembler = TreeAssembler(COMMANDS.handlers, BLOCKS.handlers, line)
    for tree in statements:
        assembler.add(tree)
    return assembler.finish()


def interpreted_text(text: str, line: int) -> Code[RoutineFrame]:
    """Return the code of a text within the program's line."""
    return code_of(trees(parse(text.strip())), line)


@dataclass(frozen=True)
class Basic(Controller):
    """An MC-Basic program: variables, loops, subs and functions that move one group of axes.

    Attributes:
        text: text of the program; for a project, the texts of its files one after the other, whose programs run in that
            order.
        group: properties of the group before the program sets them; its `vrot` and `arot` limit the orientation.
        coordinates: names of the machine's axes in the order of a point's coordinates; a group of fewer axes uses the
            first ones.
        start: initial position, 2 to 4 numbers [mm, mm, mm, deg]; by default the target of the first MOVE.
        line_time: time that the interpreter takes per statement; an assumption [s].
        output: number n of the digital output `sys.dout.n` that switches the dispenser; in a program that never
            switches it, glue is laid during every motion command without `Dispense=0`.
        override: velocity override of the controller, applied to all speeds [%].
        max_statements: number of executed statements after which a program is refused.
        placement: placement of the program on the work.

    Raises:
        InputError: a program that cannot be run, with its line.
    """

    speed_scaling: ClassVar[str] = "the controller's velocity override, on all speeds of the program"
    loop_words: ClassVar[str] = r"^\s*(?:While|For|Do)\b"
    suffixes: ClassVar[tuple[str, ...]] = (".prg",)

    text: str
    group: Group = field(default_factory=Group)
    coordinates: tuple[str, ...] = ("x", "y", "z", "r")
    start: tuple[float, ...] | None = None
    line_time: float = 1e-5
    output: int = 1
    override: float = 100.0
    max_statements: int = 10_000_000
    placement: Placement = field(default_factory=Placement)

    def __post_init__(self) -> None:
        object.__setattr__(self, "coordinates", tuple(self.coordinates))
        if not 2 <= len(self.coordinates) <= len(AXES) or len(set(self.coordinates)) < len(self.coordinates):
            raise InputError(f"coordinates = {self.coordinates}: must be 2 to {len(AXES)} different names of axes")
        if self.start is not None:
            most = len(self.coordinates)
            is_listed = hasattr(self.start, "__iter__") and not isinstance(self.start, str)
            if not is_listed or not 2 <= len(self.start) <= most:
                names = ", ".join(self.coordinates)
                wanted = "2" if most == 2 else f"2 to {most}"
                raise InputError(f"start = {self.start!r}: must be {wanted} numbers, of {names}")
            named = zip(self.coordinates, self.start, strict=False)
            object.__setattr__(self, "start", tuple(finite(f"start {name}", value) for name, value in named))
        at_least("line_time", self.line_time, 0, "s")
        whole_number("output", self.output, 0)
        positive("override", self.override, "%")
        whole_number("max_statements", self.max_statements, 1)
        if all(leg.path.piece is None for leg in self._legs):
            raise SoftMCError("program moves none of x, y, z: must have at least one command that does")

    @property
    def task(self) -> Execution:
        """The program after it has run: its printed lines, records and motions."""
        settings = RunSettings(
            self.group,
            self.placement,
            self.start,
            len(self.coordinates),
            self.line_time,
            self.override,
            self.max_statements,
            self.output,
        )
        return _run(self.text, settings)

    @cached_property
    def _legs(self) -> tuple[Leg, ...]:
        return tuple(step for step in self.task.time.steps if isinstance(step, Leg))

    @property
    def axes(self) -> tuple[str, ...]:
        return self.coordinates[: self.task.axes or 2]

    @cached_property
    def requested(self) -> Chain:
        """The path of all commands."""
        return Chain(leg.path.piece for leg in self._legs if leg.path.piece is not None)

    @property
    def duration(self) -> float:
        """Duration of the motions and the rests between them, without waits for settling [s]."""
        return sum(step.duration for step in self.task.time.steps)

    @property
    def printed(self) -> tuple[str, ...]:
        """What the program prints, at most a thousand lines."""
        return tuple(self.task.printed)

    @property
    def notes(self) -> tuple[str, ...]:
        task = self.task
        notes = []
        if task.begins:
            notes.append(f"starts {task.begins}; `start` places it elsewhere")
        if task.idle:
            count = sum(task.idle.values())
            notes.append(f"{count} assignments without effect here, of {', '.join(sorted(task.idle))}")
        ahead, line = task.ahead
        if ahead:
            notes.append(
                f"sys.dout.{self.output} is switched in line {line}, {ahead:.3g} s before the motions above it end: "
                "statements do not wait for motions, a loop on IsMoving does"
            )
        if task.time.settled and task.time.supervised and task.time.supervised.settle_error == np.inf:
            notes.append("waits for settling have no effect without PositionErrorSettle")
        if task.prints:
            first = ", the first" if task.prints > 1 else ""
            notes.append(f"prints {counted(task.prints, 'line')}{first}: {task.printed[0]}")
        return tuple(notes)

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        """As VelocityOverride on the controller does; ramps and limits stay."""
        fastest = max(self.task.speeds)
        return {"override": self.override * change(fastest) / fastest}

    def line_at(self, time: float, period: float = 1e-3) -> int | None:
        """Return the line of the program that moves the group, or lets it rest, at a time [s]; None after its end."""
        return int(self.lines_at(np.array([time]), period)[0]) or None

    def lines_at(self, times: Floats, period: float = 1e-3) -> NDArray[np.intp]:
        """As `Controller.lines_at`."""
        steps = self.task.time.steps
        ends = np.cumsum([periods(step.duration, period) for step in steps]) * period
        lines = np.array([*(step.line or 0 for step in steps), 0], np.intp)
        return lines[np.searchsorted(ends, times - 1e-9 * period)]

    def setpoints(self, period: float) -> Setpoints:
        task = self.task
        streamed = self._stream(period)
        supervised = task.time.supervised
        assert supervised is not None
        gates = streamed.ends[[k - 1 for k in task.time.settled if k > 0]]
        gates = np.unique(gates[gates > 0]) if supervised.settle_error < np.inf else gates[:0]
        dispense = streamed.dispense.copy()
        # the dispenser stays as it is while the axes settle
        dispense[gates] = dispense[gates - 1]
        if task.switched:
            dispense[:] = False
            for mark, on in task.switched:
                dispense[mark.tick(streamed.ends, period) :] = on
        return Setpoints(
            period,
            self.axes,
            streamed.position[:, : len(self.axes)],
            dispense,
            self.requested,
            supervised.supervision,
            gates,
            progress=streamed.progress,
        )

    def _stream(self, period: float) -> Stream:
        return stream(self.task.time.steps, positive("period", period, "s"))

    def write_record(self, run: Run, file: str | os.PathLike[str]) -> bool:
        """Write what the program records; of several records the later ones to numbered files beside the first."""
        records = [record for record in self.task.records if record.spans]
        if not records:
            return False
        setpoints = self.setpoints(run.period)
        ends = self._stream(run.period).ends
        first = Path(file)
        for k, record in enumerate(records, 1):
            target = first if k == 1 else first.with_name(f"{first.stem}-{k}{first.suffix}")
            delay = setpoints.supervision.position_error_delay
            record.write(run, target, self.axes, setpoints, ends, delay)
        return True


@lru_cache(maxsize=8)
def _run(text: str, settings: RunSettings) -> Execution:
    """Return a program after it has run."""
    execution = Execution(settings, interpreted_text)
    try:
        _run_all(parse(text), execution)
    except LocatedError:
        raise
    except InputError as error:
        line = execution.clock.line
        raise SoftMCError(f"line {line}: {error}" if line else str(error)) from None
    except RecursionError:
        raise SoftMCError(f"line {execution.clock.line}: must be less deeply nested") from None
    return execution


def _run_all(tree: Node, execution: Execution) -> None:
    """Run the programs of a text, and the statements outside of them, in their order."""
    items = trees(tree)
    for item in items:
        if item.data in ("sub", "function"):
            declared = routine(item)
            if declared.name.lower() in execution.routines:
                raise LocatedError(f"line {line_of(item)}: {declared.name} is declared twice")
            execution.routines[declared.name.lower()] = declared
    parts: list[tuple[dict[str, Variable], Code[RoutineFrame]]] = []
    for item in items:
        if item.data in ("sub", "function"):
            execution.routines[str(item.children[0]).lower()].code = code_of(trees(trees(item)[-1]))
        elif item.data == "program":
            parts.append(({}, code_of(trees(trees(item)[-1]))))
        else:
            parts.append((execution.shared, code_of([item])))
    for variables, code in parts:
        execution.run(code, variables)
    execution.time.fill_rest(execution.clock.line)
