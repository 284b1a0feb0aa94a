"""Statements that a process can execute: the lines of a program, with blocks and labels resolved to jumps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import chain

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.expressions import Expression
from gantrysim.controllers.trio.basic.process import MOST_RETURNS, Code, Process, Statement
from gantrysim.controllers.trio.basic.statements import LEAVES, Act, variable
from gantrysim.controllers.trio.basic.text import Raw, Source


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
        for raw in chain.from_iterable(source.lines):
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
        if raw.kind not in LEAVES:
            getattr(self, "_" + raw.kind.lower().replace(" ", "_"))(raw)
            return
        act, cost = LEAVES[raw.kind](raw)
        self._emit(raw.line, act, cost)
        if raw.kind == "ASSIGN":
            self._assigned.add(raw.data[0].name)

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
        name = variable(name)
        key = self._here
        self._assigned.add(name)
        begin = first.value
        end = last.value
        by = None if step is None else step.value

        def act(p: Process) -> int | None:
            p.variables[name] = begin(p)
            p.loops[key] = end(p), 1.0 if by is None else by(p)
            return None if _inside(p.variables[name], *p.loops[key]) else statement.target

        statement = self._emit(raw.line, act)
        self._blocks.append(_Block("FOR", raw.line, key, statement, variable=name))

    def _next(self, raw: Raw) -> None:
        block = self._close(raw, "FOR")
        name = block.variable
        key = block.first
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
        value = raw.data[0].value
        names = raw.data[1:]
        after = self._here + 1
        targets: dict[int, int] = {}

        def act(p: Process) -> int | None:
            chosen = targets.get(int(value(p)))
            return None if chosen is None else jump(p, after, chosen)

        self._emit(raw.line, act)
        for k, name in enumerate(names, 1):
            self._to(name, raw.line, lambda at, k=k: targets.__setitem__(k, at))  # type: ignore[misc]

    def _to(self, label: str, line: int, jump: Callable[[int], None]) -> None:
        self._jumps.append((label.upper(), line, jump))


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
