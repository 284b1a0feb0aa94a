"""Statements that only do something: what a process does at each, and the kind that its time is counted as."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.axis import Axis
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.expressions import Expression, Reference, unknown_word
from gantrysim.controllers.trio.basic.process import VR_SIZE, Process, index
from gantrysim.controllers.trio.basic.text import Raw

Act = Callable[[Process], int | None]
Leaf = tuple[Act, str]
Store = Callable[[Process, float], None]


def _wait_until(raw: Raw) -> Leaf:
    value = raw.data[0].value

    def act(p: Process) -> None:
        if not value(p):
            p.blocked = lambda: bool(value(p))
            p.polls = True

    return act, "wait"


def _wait_idle(raw: Raw) -> Leaf:
    return _waiting(raw, lambda axis: axis.idle)


def _wait_loaded(raw: Raw) -> Leaf:
    return _waiting(raw, lambda axis: not axis.queue)


def _waiting(raw: Raw, over: Callable[[Axis], bool]) -> Leaf:
    number = _axis_of(raw)

    def act(p: Process) -> None:
        axis = p.state.motion.axis(number(p))
        if not over(axis):
            p.blocked = lambda: over(axis)

    return act, "wait"


def _run(raw: Raw) -> Leaf:
    name = str(raw.data[0])[1:-1]
    number = raw.data[1]

    def act(p: Process) -> None:
        p.state.run(name, p.ready, None if number is None else number.value(p))

    return act, "statement"


def _stop(raw: Raw) -> Leaf:
    name = None if raw.data[0] is None else str(raw.data[0])[1:-1]

    def act(p: Process) -> None:
        if name is None:
            p.ended = True
        else:
            p.state.stop(name)

    return act, "statement"


def _halt(raw: Raw) -> Leaf:
    return lambda p: p.state.stop(None), "statement"


def _print(raw: Raw) -> Leaf:
    channel, *items = raw.data
    parts = [_printed(item) for item in items if item is not None]

    def act(p: Process) -> None:
        p.state.log(None if channel is None else channel.value(p), "".join(part(p) for part in parts))

    return act, "print"


def _command(raw: Raw) -> Leaf:
    ref: Reference = raw.data[0]
    command = COMMANDS.get(ref.name)
    if command is None:
        readable = ref.name in words.AXIS_VALUES or ref.name in words.SYSTEM_VALUES or ref.name in words.CONSTANTS
        if readable or ref.name in words.FUNCTIONS or ref.name in words.IGNORED or ref.name in ("VR", "IN"):
            raise InputError(f"{ref.name}: is a value, not a command")
        raise unknown_word(ref)
    given = [each.value for each in ref.count(command.least, command.most)]
    run = command.act
    line = raw.line

    def act(p: Process) -> None:
        values = [each(p) for each in given]
        for k, value in enumerate(values, 1):
            if not math.isfinite(value):
                raise InputError(f"{ref.spelled}: value {k} = {value:g}: must be finite")
        run(p, values, line)

    if ref.axis is None:
        return act, command.cost
    number = ref.axis.value

    def on_axis(p: Process) -> None:
        base = p.base
        p.base = (p.state.motion.axis(number(p)).number,)
        try:
            act(p)
        finally:
            p.base = base

    return on_axis, command.cost


def _assign(raw: Raw) -> Leaf:
    ref: Reference = raw.data[0]
    expression: Expression = raw.data[1]
    value = expression.value
    store = _store(ref)

    def act(p: Process) -> None:
        result = value(p)
        if not math.isfinite(result):
            raise InputError(f"{ref.spelled} = {result:g}: must be finite")
        store(p, result)

    return act, "statement"


def _store(ref: Reference) -> Store:
    name = ref.name
    if name in words.AXIS_SETTERS or name in words.IGNORED:
        ref.plain(0, axis=True)
        number = None if ref.axis is None else ref.axis.value
        setter = words.AXIS_SETTERS.get(name)

        def store(p: Process, value: float) -> None:
            axis = p.state.motion.axis(p.base[0] if number is None else number(p))
            if setter is None:
                axis.values[name] = value
                p.state.ignored.add(name)
            else:
                setter(axis, value)

        return store
    if name in words.SYSTEM_SETTERS:
        ref.plain(0)
        return words.SYSTEM_SETTERS[name]
    if name == "VR":
        at = ref.plain(1)[0].value
        return lambda p, value: p.state.vr.__setitem__(index("VR", at(p), VR_SIZE), value)
    if name == "TABLE":
        raise InputError("TABLE: is set by TABLE(first, value, ...), not by =")
    if ref.arguments is not None or ref.axis is not None:
        raise unknown_word(ref)
    cell = variable(name)
    return lambda p, value: p.variables.__setitem__(cell, value)


def variable(name: str) -> str:
    """Return the name of a variable that is assigned, in capitals, or raise InputError where it is a word."""
    word = name.upper()
    fixed = (words.CONSTANTS, words.FUNCTIONS, words.AXIS_VALUES, words.SYSTEM_VALUES, words.IGNORED, COMMANDS)
    if word in words.KEYWORDS or any(word in table for table in fixed) or word in ("IN", "READ_OP"):
        raise InputError(f"{name} = ...: is a word of the language that cannot be assigned")
    if word in words.NOT_EMULATED:
        raise InputError(f"{name}: a word of the controller that is not emulated")
    return word


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


LEAVES: dict[str, Callable[[Raw], Leaf]] = {
    "ASSIGN": _assign,
    "COMMAND": _command,
    "HALT": _halt,
    "PRINT": _print,
    "RUN": _run,
    "STOP": _stop,
    "WAIT IDLE": _wait_idle,
    "WAIT LOADED": _wait_loaded,
    "WAIT UNTIL": _wait_until,
}
