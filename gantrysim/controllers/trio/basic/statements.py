"""Statements that act, a function each: `cmd_print` is PRINT."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from lark import Token

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import Act
from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.axis_parameters import AXIS_PARAMETERS
from gantrysim.controllers.trio.basic.buffers import Axis
from gantrysim.controllers.trio.basic.commands import COMMANDS, WAIT
from gantrysim.controllers.trio.basic.expressions import unknown_word
from gantrysim.controllers.trio.basic.flow import variable
from gantrysim.controllers.trio.basic.process import VR_SIZE, Process, index
from gantrysim.controllers.trio.basic.raw import Evaluate, Expression, Handler, ProcessAssembler, Raw, Reference, Spelt

PRINT = "print"  # kind of statement, by which its time is counted
TAB = 8  # characters from one column of PRINT to the next

Store = Callable[[Process, float], None]
statement: Statements[Handler] = Statements()


@statement("ref")
def cmd_command(assembler: ProcessAssembler, raw: Raw) -> None:
    """A command by its name, see `commands`."""
    ref: Reference = raw.data[0]
    command = COMMANDS.get(ref.name)
    if command is None:
        tables = (AXIS_PARAMETERS, words.SYSTEM_PARAMETERS, words.CONSTANTS, words.FUNCTIONS, words.IGNORED_WORDS)
        if any(ref.name in table for table in tables) or ref.name in ("VR", "IN"):
            raise InputError(f"{ref.name}: is a value, not a command")
        raise unknown_word(ref)
    arguments = [argument.value for argument in ref.between(command.least, command.most)]
    run = command.act
    line = raw.line
    # so that the command does not hold its words
    spelled = ref.spelled

    def act(process: Process) -> None:
        values = [argument(process) for argument in arguments]
        if not all(map(math.isfinite, values)):
            k, value = next((k, value) for k, value in enumerate(values, 1) if not math.isfinite(value))
            raise InputError(f"{spelled}: value {k} = {value:g}: must be finite")
        run(process, values, line)

    assembler.emit(line, act if ref.axis is None else _on_axis(ref.axis, act), command.cost)


def _on_axis(axis: Expression, act: Act[Process]) -> Act[Process]:
    """Return what acts with another axis in place of BASE's."""
    number = axis.value

    def on_axis(process: Process) -> None:
        base = process.base
        process.base = (process.state.motion.axis(number(process)).number,)
        try:
            act(process)
        finally:
            process.base = base

    return on_axis


@statement('ref "=" expr')
def cmd_assign(assembler: ProcessAssembler, raw: Raw) -> None:
    """word = value: set a variable, a parameter or a cell of memory."""
    ref: Reference = raw.data[0]
    expression: Expression = raw.data[1]
    value = expression.value
    store = _store(ref, assembler.arrays)
    spelled = ref.spelled

    def act(process: Process) -> None:
        result = value(process)
        if not math.isfinite(result):
            raise InputError(f"{spelled} = {result:g}: must be finite")
        store(process, result)

    assembler.emit(raw.line, act)
    assembler.assigned.add(ref.name)


def _store(ref: Reference, arrays: set[str]) -> Store:
    """Return what sets a variable, an element of an array, a parameter or a cell of memory."""
    name = ref.name
    if ref.bit is not None:
        raise InputError(f"{ref.spelled}.{ref.bit} = ...: a bit can be read, not set")
    if name in arrays and ref.arguments is not None:
        places = [argument.value for argument in ref.plain(len(ref.arguments))]
        return lambda process, value: process.set_element(name, [place(process) for place in places], value)
    parameter = AXIS_PARAMETERS.get(name)
    if name in words.IGNORED_WORDS or (parameter is not None and parameter.write is not None):
        return _store_of_axis(ref)
    system = words.SYSTEM_PARAMETERS.get(name)
    if system is not None and system.write is not None:
        ref.plain(0)
        return system.write
    if name == "VR":
        k = ref.plain(1)[0].value
        return lambda process, value: process.state.vr.__setitem__(index("VR", k(process), VR_SIZE), value)
    if name == "AOUT":
        output = ref.plain(1)[0].value
        return lambda process, value: process.state.set_analogue(output(process), value)
    if name == "TABLE":
        raise InputError("TABLE: is set by TABLE(first, value, ...), not by =")
    if ref.arguments is not None or ref.axis is not None or ref.process is not None:
        raise unknown_word(ref)
    cell = variable(name)
    return lambda process, value: process.assign(cell, value)


def _store_of_axis(ref: Reference) -> Store:
    ref.plain(0, axis=True)
    name = ref.name
    number = None if ref.axis is None else ref.axis.value
    parameter = AXIS_PARAMETERS.get(name)
    write = None if parameter is None else parameter.write

    def store(process: Process, value: float) -> None:
        axis = process.state.motion.axis(process.base[0] if number is None else number(process))
        # accepted without effect: noted, and read again as it was set
        if write is None:
            axis.values[name] = value
            process.state.ignored.add(name)
        else:
            write(axis, value)

    return store


@statement('WAIT "UNTIL"i expr')
def cmd_wait_until(assembler: ProcessAssembler, raw: Raw) -> None:
    """WAIT UNTIL condition."""
    value = raw.data[0].value

    def act(process: Process) -> None:
        if not value(process):
            process.blocked = lambda: bool(value(process))
            process.polls = True

    assembler.emit(raw.line, act, WAIT)


@statement('WAIT "IDLE"i axis?')
def cmd_wait_idle(assembler: ProcessAssembler, raw: Raw) -> None:
    """WAIT IDLE [AXIS(n)]: until the axis has no move."""
    assembler.emit(raw.line, _waiting(raw, lambda axis: axis.idle), WAIT)


@statement('WAIT "LOADED"i axis?')
def cmd_wait_loaded(assembler: ProcessAssembler, raw: Raw) -> None:
    """WAIT LOADED [AXIS(n)]: until the axis' buffer is empty."""
    assembler.emit(raw.line, _waiting(raw, lambda axis: not axis.queue), WAIT)


def _waiting(raw: Raw, is_over: Callable[[Axis], bool]) -> Act[Process]:
    number: Evaluate = raw.data[0].value if raw.data and raw.data[0] is not None else _first_of_base

    def act(process: Process) -> None:
        axis = process.state.motion.axis(number(process))
        if not is_over(axis):
            process.blocked = lambda: is_over(axis)

    return act


def _first_of_base(process: Process) -> float:
    return process.base[0]


@statement('RUN STRING ["," expr]')
def cmd_run(assembler: ProcessAssembler, raw: Raw) -> None:
    """RUN "program"[, process]: start a program."""
    name = str(raw.data[0])[1:-1]
    number = raw.data[1]

    def act(process: Process) -> None:
        process.state.run(name, process.ready, None if number is None else number.value(process))

    assembler.emit(raw.line, act)


@statement("STOP [STRING]")
def cmd_stop(assembler: ProcessAssembler, raw: Raw) -> None:
    """STOP ["program"]: end this process, or those of a program."""
    name = None if raw.data[0] is None else str(raw.data[0])[1:-1]

    def act(process: Process) -> None:
        if name is None:
            process.ended = True
        else:
            process.state.stop(name)

    assembler.emit(raw.line, act)


@statement("HALT")
def cmd_halt(assembler: ProcessAssembler, raw: Raw) -> None:
    """HALT: end all processes."""
    assembler.emit(raw.line, lambda process: process.state.stop(None))


@statement('PRINT ["#" expr ","] [_items]')
def cmd_print(assembler: ProcessAssembler, raw: Raw) -> None:
    """PRINT [#channel,] item, ..."""
    channel, *items = raw.data
    items = [item for item in items if item is not None]
    continues = bool(items) and isinstance(items[-1], Token) and items[-1] == ";"
    parts = [_printed_item(item) for item in items]

    def act(process: Process) -> None:
        number = None if channel is None else channel.value(process)
        text = ""
        for part in parts:
            text = part(process, text)
        process.state.log(number, text, continues)

    assembler.emit(raw.line, act, PRINT)


def _printed_item(item: Any) -> Callable[[Process, str], str]:
    """Return what adds to a line: a string, CHR(), HEX(), a number with its width and digits, or a separator."""
    if isinstance(item, Token):
        return lambda process, text: text if item == ";" else text.ljust((len(text) // TAB + 1) * TAB)
    show = _shown_value(item)
    return lambda process, text: text + show(process)


def _shown_value(item: Any) -> Callable[[Process], str]:
    if isinstance(item, str):
        return lambda process: item
    if isinstance(item, Spelt):
        value = item.value.value
        if item.word == "HEX":
            return lambda process: f"{int(value(process)) & 0xFFFFFFFF:X}"
        return lambda process: chr(index("CHR", value(process), 256))
    value, *form = item
    width = form[0].value if len(form) == 2 else None
    digits = form[-1].value if form else None

    def number(process: Process) -> str:
        places = 4 if digits is None else index("digits", digits(process), 16)
        text = f"{value.value(process):.{places}f}"
        return text if width is None else text.rjust(index("width", width(process), 64))

    return number
