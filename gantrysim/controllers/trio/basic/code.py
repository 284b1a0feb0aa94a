"""Statements that a process can execute: the lines of a program, with blocks and labels resolved to jumps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.expressions import Expression, Reference, unknown_word
from gantrysim.controllers.trio.basic.process import MOST_RETURNS, VR_SIZE, Process, index
from gantrysim.controllers.trio.basic.text import Raw, Source
from gantrysim.errors import InputError

Act = Callable[[Process], "int | None"]


@dataclass
class Statement:
    """A statement.

    Attributes:
        line: of the text.
        act: executes it and returns the index of the next statement, None for the following one.
        cost: kind of statement that its time is counted as.
        pure: whether it only tests and jumps.
        target: index of the statement that it jumps to.
    """

    line: int
    act: Act
    cost: str = "statement"
    pure: bool = False
    target: int = -1


@dataclass
class Code:
    """A program.

    Attributes:
        name: in capitals.
        statements: in their order.
    """

    name: str
    statements: list[Statement] = field(default_factory=list)


@dataclass
class _Block:
    """An open block: its keyword, its line, and the statements whose jumps it will fill in."""

    kind: str
    line: int
    first: int
    branch: Statement | None = None
    ends: list[Statement] = field(default_factory=list)
    variable: str = ""


def assemble(source: Source, strict: bool) -> Code:
    """Return a program that can be executed.

    Args:
        source: the program.
        strict: whether a variable that no statement assigns is an error; else it reads as 0.

    Raises:
        InputError: a block without its end, an unknown label or word, a number of values that a word does not take.
    """
    return _Assembler(source, strict).code


class _Assembler:
    def __init__(self, source: Source, strict: bool) -> None:
        self.code = Code(source.name)
        self._blocks: list[_Block] = []
        self._labels: dict[str, int] = {}
        self._jumps: list[tuple[str, int, Callable[[int], None]]] = []
        self._assigned: set[str] = set()
        for line in source.lines:
            for raw in line:
                try:
                    self._add(raw)
                except InputError as error:
                    raise InputError(f"line {raw.line}: {error}") from None
        if self._blocks:
            block = self._blocks[-1]
            raise InputError(f"line {block.line}: {block.kind} without its {_ENDS[block.kind]}")
        for name, line, jump in self._jumps:
            if name not in self._labels:
                raise InputError(f"line {line}: label {name}: must stand before a colon at the start of a line")
            jump(self._labels[name])
        if strict:
            for name, line in source.read.items():
                if name not in self._assigned:
                    raise InputError(
                        f"line {line}: variable {name.lower()} is assigned nowhere: it must be, or unassigned_zero = "
                        "true, with which it reads as 0 as on the controller"
                    )

    @property
    def _here(self) -> int:
        return len(self.code.statements)

    def _emit(self, line: int, act: Act, cost: str = "statement", pure: bool = False) -> Statement:
        statement = Statement(line, act, cost, pure)
        self.code.statements.append(statement)
        return statement

    def _jump(self, line: int) -> Statement:
        statement = self._emit(line, lambda p: None, pure=True)
        statement.act = lambda p: statement.target
        return statement

    def _test(self, line: int, condition: Expression) -> Statement:
        """A statement that jumps where a condition is false."""
        value = condition.value
        statement = self._emit(line, lambda p: None, pure=True)
        statement.act = lambda p: None if value(p) else statement.target
        return statement

    def _close(self, raw: Raw, *kinds: str) -> _Block:
        if not self._blocks or self._blocks[-1].kind not in kinds:
            inside = f" inside the {self._blocks[-1].kind} of line {self._blocks[-1].line}" if self._blocks else ""
            raise InputError(f"{raw.kind} without {' or '.join(kinds)}{inside}")
        return self._blocks.pop()

    def _add(self, raw: Raw) -> None:
        getattr(self, "_" + raw.kind.lower().replace(" ", "_"))(raw)

    def _label(self, raw: Raw) -> None:
        name = raw.data[0]
        if name in self._labels:
            raise InputError(f"label {name}: stands in two places, must be in one")
        self._labels[name] = self._here

    def _if(self, raw: Raw) -> None:
        block = _Block("IF", raw.line, self._here)
        block.branch = self._test(raw.line, raw.data[0])
        self._blocks.append(block)

    def _else(self, raw: Raw) -> None:
        block = self._close(raw, "IF")
        self._end_branch(block, raw)
        block.branch = None
        self._blocks.append(block)

    def _elseif(self, raw: Raw) -> None:
        block = self._close(raw, "IF")
        self._end_branch(block, raw)
        block.branch = self._test(raw.line, raw.data[0])
        self._blocks.append(block)

    def _end_branch(self, block: _Block, raw: Raw) -> None:
        if block.branch is None:
            raise InputError(f"{raw.kind} after the ELSE of the IF of line {block.line}")
        block.ends.append(self._jump(raw.line))
        block.ends[-1].cost = "none"
        block.branch.target = self._here

    def _endif(self, raw: Raw) -> None:
        block = self._close(raw, "IF")
        for statement in (*block.ends, block.branch):
            if statement is not None:
                statement.target = self._here

    def _while(self, raw: Raw) -> None:
        self._blocks.append(_Block("WHILE", raw.line, self._here, self._test(raw.line, raw.data[0])))

    def _wend(self, raw: Raw) -> None:
        block = self._close(raw, "WHILE")
        self._jump(raw.line).target = block.first
        if block.branch is not None:
            block.branch.target = self._here

    def _repeat(self, raw: Raw) -> None:
        self._blocks.append(_Block("REPEAT", raw.line, self._here))

    def _until(self, raw: Raw) -> None:
        self._test(raw.line, raw.data[0]).target = self._close(raw, "REPEAT").first

    def _for(self, raw: Raw) -> None:
        name, first, last, step = raw.data
        name, key = self._variable(name), self._here
        begin, end, by = first.value, last.value, None if step is None else step.value

        def act(p: Process) -> int | None:
            p.variables[name] = begin(p)
            p.loops[key] = end(p), 1.0 if by is None else by(p)
            return None if _inside(p.variables[name], *p.loops[key]) else statement.target

        statement = self._emit(raw.line, act)
        self._blocks.append(_Block("FOR", raw.line, key, statement, variable=name))

    def _next(self, raw: Raw) -> None:
        block = self._close(raw, "FOR")
        name, key = block.variable, block.first
        if raw.data[0] is not None and raw.data[0].upper() != name:
            raise InputError(f"NEXT {raw.data[0]}: must be NEXT {name.lower()}, of the FOR of line {block.line}")

        def act(p: Process) -> int | None:
            if key not in p.loops:
                raise InputError(f"NEXT without having run the FOR of line {block.line}")
            end, step = p.loops[key]
            p.variables[name] = p.variables.get(name, 0.0) + step
            return key + 1 if _inside(p.variables[name], end, step) else None

        self._emit(raw.line, act)
        if block.branch is not None:
            block.branch.target = self._here

    def _goto(self, raw: Raw) -> None:
        statement = self._jump(raw.line)
        self._to(raw.data[0], raw.line, lambda at: setattr(statement, "target", at))

    def _gosub(self, raw: Raw) -> None:
        after = self._here + 1
        statement = self._emit(raw.line, lambda p: _call(p, after, statement.target))
        self._to(raw.data[0], raw.line, lambda at: setattr(statement, "target", at))

    def _return(self, raw: Raw) -> None:
        def act(p: Process) -> int:
            if not p.returns:
                raise InputError("RETURN without GOSUB")
            return p.returns.pop()

        self._emit(raw.line, act)

    def _on_goto(self, raw: Raw) -> None:
        self._choice(raw, lambda p, after, target: target)

    def _on_gosub(self, raw: Raw) -> None:
        self._choice(raw, _call)

    def _choice(self, raw: Raw, jump: Callable[[Process, int, int], int]) -> None:
        value, names, after = raw.data[0].value, raw.data[1:], self._here + 1
        targets: dict[int, int] = {}

        def act(p: Process) -> int | None:
            chosen = targets.get(int(value(p)))
            return None if chosen is None else jump(p, after, chosen)

        self._emit(raw.line, act)
        for k, name in enumerate(names, 1):
            self._to(name, raw.line, lambda at, k=k: targets.__setitem__(k, at))  # type: ignore[misc]

    def _to(self, label: str, line: int, jump: Callable[[int], None]) -> None:
        self._jumps.append((label.upper(), line, jump))

    def _wait_until(self, raw: Raw) -> None:
        value = raw.data[0].value
        self._waiting(raw, lambda p: bool(value(p)))

    def _wait_idle(self, raw: Raw) -> None:
        axis = _axis_of(raw)
        self._waiting(raw, lambda p: p.controller.motion.axis(axis(p)).idle)

    def _wait_loaded(self, raw: Raw) -> None:
        axis = _axis_of(raw)
        self._waiting(raw, lambda p: not p.controller.motion.axis(axis(p)).queue)

    def _waiting(self, raw: Raw, over: Callable[[Process], bool]) -> None:
        def act(p: Process) -> None:
            if not over(p):
                p.blocked = lambda: over(p)

        self._emit(raw.line, act, "wait")

    def _run(self, raw: Raw) -> None:
        name, number = str(raw.data[0])[1:-1], raw.data[1]

        def act(p: Process) -> None:
            p.controller.run(name, p.ready, None if number is None else number.value(p))

        self._emit(raw.line, act)

    def _stop(self, raw: Raw) -> None:
        name = None if raw.data[0] is None else str(raw.data[0])[1:-1]

        def act(p: Process) -> None:
            if name is None:
                p.ended = True
            else:
                p.controller.stop(name)

        self._emit(raw.line, act)

    def _halt(self, raw: Raw) -> None:
        self._emit(raw.line, lambda p: p.controller.stop(None))

    def _print(self, raw: Raw) -> None:
        channel, *items = raw.data
        parts = [_printed(item) for item in items if item is not None]

        def act(p: Process) -> None:
            p.controller.log(None if channel is None else channel.value(p), "".join(part(p) for part in parts))

        self._emit(raw.line, act, "print")

    def _command(self, raw: Raw) -> None:
        ref: Reference = raw.data[0]
        command = COMMANDS.get(ref.name)
        if command is None:
            readable = ref.name in words.AXIS_VALUES or ref.name in words.SYSTEM_VALUES or ref.name in words.CONSTANTS
            if readable or ref.name in words.FUNCTIONS or ref.name in words.IGNORED or ref.name in ("VR", "IN"):
                raise InputError(f"{ref.name}: is a value, not a command")
            raise unknown_word(ref)
        values = [each.value for each in ref.count(command.least, command.most)]
        run, line = command.act, raw.line
        if ref.axis is None:
            self._emit(line, lambda p: run(p, [value(p) for value in values], line), command.cost)  # type: ignore[func-returns-value]
            return
        number = ref.axis.value

        def act(p: Process) -> None:
            base, p.base = p.base, (p.controller.motion.axis(number(p)).number,)
            try:
                run(p, [value(p) for value in values], line)
            finally:
                p.base = base

        self._emit(line, act, command.cost)

    def _assign(self, raw: Raw) -> None:
        ref: Reference = raw.data[0]
        expression: Expression = raw.data[1]
        value, store = expression.value, self._store(ref)

        def act(p: Process) -> None:
            result = value(p)
            if not math.isfinite(result):
                raise InputError(f"{ref.spelled} = {result:g}: must be finite")
            store(p, result)

        self._emit(raw.line, act)

    def _store(self, ref: Reference) -> Callable[[Process, float], None]:
        name = ref.name
        if name in words.AXIS_SETTERS or name in words.IGNORED:
            ref.plain(0, axis=True)
            number = None if ref.axis is None else ref.axis.value
            setter = words.AXIS_SETTERS.get(name)

            def store(p: Process, value: float) -> None:
                axis = p.controller.motion.axis(p.base[0] if number is None else number(p))
                if setter is None:
                    axis.values[name] = value
                    p.controller.ignored.add(name)
                else:
                    setter(axis, value)

            return store
        if name in words.SYSTEM_SETTERS:
            ref.plain(0)
            return words.SYSTEM_SETTERS[name]
        if name == "VR":
            at = ref.plain(1)[0].value
            return lambda p, value: p.controller.vr.__setitem__(index("VR", at(p), VR_SIZE), value)
        if name == "TABLE":
            raise InputError("TABLE: is set by TABLE(first, value, ...), not by =")
        if ref.arguments is not None or ref.axis is not None:
            raise unknown_word(ref)
        variable = self._variable(name)
        return lambda p, value: p.variables.__setitem__(variable, value)

    def _variable(self, name: str) -> str:
        word = name.upper()
        fixed = (words.CONSTANTS, words.FUNCTIONS, words.AXIS_VALUES, words.SYSTEM_VALUES, words.IGNORED, COMMANDS)
        if word in words.KEYWORDS or any(word in table for table in fixed) or word in ("IN", "READ_OP"):
            raise InputError(f"{name} = ...: is a word of the language that cannot be assigned")
        if word in words.NOT_EMULATED:
            raise InputError(f"{name}: a word of the controller that is not emulated")
        self._assigned.add(word)
        return word


_ENDS = {"IF": "ENDIF", "WHILE": "WEND", "REPEAT": "UNTIL", "FOR": "NEXT"}


def _inside(value: float, end: float, step: float) -> bool:
    if step == 0:
        raise InputError("STEP 0: must not be 0")
    return value <= end if step > 0 else value >= end


def _call(p: Process, after: int, target: int) -> int:
    if len(p.returns) >= MOST_RETURNS:
        raise InputError(f"GOSUB nested more than {MOST_RETURNS} deep: must return before")
    p.returns.append(after)
    return target


def _axis_of(raw: Raw) -> Callable[[Process], float]:
    if not raw.data or raw.data[0] is None:
        return lambda p: p.base[0]
    value: Callable[[Process], float] = raw.data[0].value
    return value


def _printed(item: Any) -> Callable[[Process], str]:
    if isinstance(item, str):
        return lambda p: item
    if isinstance(item, list):  # CHR()
        code = item[0].value
        return lambda p: chr(index("CHR", code(p), 256))
    value, *form = item
    width = form[0].value if len(form) == 2 else None
    digits = form[-1].value if form else None

    def number(p: Process) -> str:
        places = 4 if digits is None else index("digits", digits(p), 16)
        text = f"{value.value(p):.{places}f}"
        return text if width is None else text.rjust(index("width", width(p), 64))

    return number
