"""A code of G-code: one function, named after it, with its meaning in the docstring.

`g92_1` is G92.1, `m104` is M104, and any other name is a command of printers' firmware, as `set_velocity_limit`. The
decorator says when the function is called, and enters it in the table of each of its dialects.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.dialects import LINUXCNC, SLICER, GCodeDialect
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock

Handler = Callable[[ProgramState, WordBlock], None]
Decorator = Callable[[Handler], Handler]
Dialects = Iterable[GCodeDialect]

ALL_DIALECTS = (LINUXCNC, SLICER)
_NAME = re.compile(r"([gm])([0-9]+)(?:_([0-9]))?")


class Kind(Enum):
    """When a code is applied."""

    AUXILIARY = "an M code: before the G codes of its block"
    SETTING = "where it stands among the G codes of its block"
    ACTION = "after the settings and F of its block, which has one action"
    MOTION = "at last, with the axis words of its block and of those that follow"
    COMMAND = "a command of firmware: alone in its line"


@dataclass(frozen=True)
class Code:
    """A code.

    Attributes:
        name: as in a program, "G92.1".
        kind: when it is applied.
        meaning: the first line of its docstring.
        handler: applies it; None for a code without an effect on the path, which is counted.
        group: modal group of a setting or motion, which is in force until another code of the group.
        takes: letters whose words belong to a code without an effect.
        moved_by: letters that begin a motion.
        straight: whether a motion is along a line, as G53 needs.
        is_cycle: whether a motion is a canned cycle.
        shares_words: whether the words that an action leaves are those of a motion beside it.
        halts: whether an M code is carried out at rest, after the moves before it.
    """

    name: str
    kind: Kind
    meaning: str
    handler: Handler | None
    group: str = ""
    takes: str = ""
    moved_by: str = ""
    straight: bool = False
    is_cycle: bool = False
    shares_words: bool = False
    halts: bool = False


CODES: dict[str, dict[str, Code]] = {dialect.name: {} for dialect in ALL_DIALECTS}  # by dialect and name


def motion(
    moved_by: str = "", straight: bool = False, dialects: Dialects = ALL_DIALECTS, is_cycle: bool = False
) -> Decorator:
    """Add a code of motion, which axis words and the given letters begin."""

    def add(handler: Handler) -> Handler:
        letters = f"XYZ@^{moved_by}"
        name, meaning = _described_code(handler)
        code = Code(
            name, Kind.MOTION, meaning, handler, "motion", moved_by=letters, straight=straight, is_cycle=is_cycle
        )
        return _added_code(dialects, code)

    return add


def setting(group: str, dialects: Dialects = ALL_DIALECTS) -> Decorator:
    """Add a code that sets a mode."""

    def add(handler: Handler) -> Handler:
        name, meaning = _described_code(handler)
        return _added_code(dialects, Code(name, Kind.SETTING, meaning, handler, group))

    return add


def action(dialects: Dialects = ALL_DIALECTS, shares_words: bool = False) -> Decorator:
    """Add a code that is carried out once, with the words of its block."""

    def add(handler: Handler) -> Handler:
        name, meaning = _described_code(handler)
        return _added_code(dialects, Code(name, Kind.ACTION, meaning, handler, shares_words=shares_words))

    return add


def auxiliary(dialects: Dialects = ALL_DIALECTS, halts: bool = False) -> Decorator:
    """Add an M code, which is carried out at rest or not."""

    def add(handler: Handler) -> Handler:
        name, meaning = _described_code(handler)
        return _added_code(dialects, Code(name, Kind.AUXILIARY, meaning, handler, halts=halts))

    return add


def command(dialects: Dialects = (SLICER,)) -> Decorator:
    """Add a command of printers' firmware."""

    def add(handler: Handler) -> Handler:
        name, meaning = _described_code(handler)
        return _added_code(dialects, Code(name, Kind.COMMAND, meaning, handler))

    return add


def without_effect(
    dialects: Dialects = ALL_DIALECTS, takes: str = "", names: Iterable[str] = (), halts: bool = False
) -> Decorator:
    """Add a code without an effect on the path, which is counted; the function is not called.

    Args:
        dialects: that have the code.
        takes: letters whose words belong to it.
        names: of a family of codes; by default that of the function.
        halts: whether it is carried out at rest.
    """

    def add(handler: Handler) -> Handler:
        function_name, meaning = _described_code(handler)
        for name in names or (function_name,):
            _added_code(dialects, Code(name, _kind(name), meaning, None, takes=takes, halts=halts))
        return handler

    return add


def refused_code(
    subject: str, advice: str = "", dialects: Dialects = ALL_DIALECTS, names: Iterable[str] = ()
) -> Decorator:
    """Add a code that is refused; the function is not called.

    Args:
        subject: that is not simulated, for the message.
        advice: what to do instead.
        dialects: that have the code.
        names: of a family of codes; by default that of the function.
    """

    def refusal(name: str) -> Handler:
        def refuse(state: ProgramState, block: WordBlock) -> None:
            raise InputError(f"{name}: {subject} is not simulated{advice}")

        return refuse

    def add(handler: Handler) -> Handler:
        function_name, meaning = _described_code(handler)
        for name in names or (function_name,):
            _added_code(dialects, Code(name, _kind(name), meaning, refusal(name)))
        return handler

    return add


def _described_code(handler: Handler) -> tuple[str, str]:
    """The name in a program, and the meaning, of a function."""
    match = _NAME.fullmatch(handler.__name__)
    meaning = (handler.__doc__ or "").partition("\n")[0]
    if not match:
        return handler.__name__.upper(), meaning
    letter, whole, tenth = match.groups()
    return f"{letter.upper()}{whole}" + (f".{tenth}" if tenth else ""), meaning


def _kind(name: str) -> Kind:
    if not _NAME.fullmatch(name.lower().replace(".", "_")):
        return Kind.COMMAND
    return Kind.AUXILIARY if name.startswith("M") else Kind.SETTING


def _added_code(dialects: Dialects, code: Code) -> Handler:
    for dialect in dialects:
        table = CODES[dialect.name]
        assert code.name not in table, f"{dialect.name} has two functions for {code.name}"
        table[code.name] = code
    return code.handler or _nothing


def _nothing(state: ProgramState, block: WordBlock) -> None:
    """No effect."""
