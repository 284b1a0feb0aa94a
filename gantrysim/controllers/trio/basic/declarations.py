"""Statements that declare names, a function each: `cmd_dim` is DIM."""

from __future__ import annotations

import math

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.axis_parameters import AXIS_PARAMETERS
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.process import VR_SIZE, Process, index
from gantrysim.controllers.trio.basic.raw import Expression, Handler, ProcessAssembler, Raw, Reference

# Names that a program may give to its variables.


def variable(name: str) -> str:
    """Return the name of a variable that is assigned, in capitals, or raise InputError where it is a word."""
    word = name.upper()
    tables = (words.CONSTANTS, words.FUNCTIONS, AXIS_PARAMETERS, words.SYSTEM_PARAMETERS, words.IGNORED, COMMANDS)
    if word in words.KEYWORDS or any(word in table for table in tables) or word in ("IN", "READ_OP"):
        raise InputError(f"{name} = ...: is a word of the language that cannot be assigned")
    if word in words.NOT_EMULATED:
        raise InputError(f"{name}: a word of the controller that is not emulated")
    return word


KINDS = ("BOOLEAN", "FLOAT", "INTEGER")
MOST_DIMENSIONS = 3
MOST_ELEMENTS = 1_000_000

statement: Statements[Handler] = Statements()


@statement("INCLUDE STRING")
def cmd_include(assembler: ProcessAssembler, raw: Raw) -> None:
    """INCLUDE "program": its statements, which define names, stand here."""
    assembler.include(assembler, _text(raw.data[0]).upper())


@statement("CONSTANT")
def cmd_clear_constants(assembler: ProcessAssembler, raw: Raw) -> None:
    """CONSTANT: forget the names that CONSTANT has given."""
    assembler.emit(raw.line, lambda process: process.state.constants.clear())


@statement('CONSTANT STRING "," expr')
def cmd_constant(assembler: ProcessAssembler, raw: Raw) -> None:
    """CONSTANT "name", value: a name for a value, in all programs."""
    name = variable(_text(raw.data[0]))
    value = raw.data[1].value

    def act(process: Process) -> None:
        result = value(process)
        if not math.isfinite(result):
            raise InputError(f"CONSTANT {name.lower()} = {result:g}: must be finite")
        if process.state.constants.get(name, result) != result:
            raise InputError(
                f"CONSTANT {name.lower()} = {result:g}: must be {process.state.constants[name]:g}, as it is already"
            )
        process.state.constants[name] = result

    assembler.emit(raw.line, act)


@statement('GLOBAL STRING "," expr')
def cmd_global(assembler: ProcessAssembler, raw: Raw) -> None:
    """GLOBAL "name", number: a name for the cell VR(number), in all programs."""
    name = variable(_text(raw.data[0]))
    place = raw.data[1].value

    def act(process: Process) -> None:
        process.state.globals[name] = index("VR", place(process), VR_SIZE)

    assembler.emit(raw.line, act)


@statement('DIM ref ("," ref)* "AS"i ref ["=" expr]')
def cmd_dim(assembler: ProcessAssembler, raw: Raw) -> None:
    """DIM name, ... AS type[(size, ...)] [= value]: variables of a type, or arrays."""
    *declared, kind, first = raw.data
    for ref in declared:
        if kind.name not in KINDS:
            raise InputError(f"DIM {ref.spelled} AS {kind.spelled}: is not emulated, must be {', '.join(KINDS)}")
        sizes = kind.arguments if ref.arguments is None else ref.arguments
        if sizes is None:
            _declare_variable(assembler, ref, kind.name, first)
        elif first is not None:
            raise InputError(f"DIM {ref.spelled} = ...: an array has no value, its elements are 0")
        else:
            _declare_array(assembler, ref, kind.name, sizes)


def _declare_variable(assembler: ProcessAssembler, ref: Reference, kind: str, first: Expression | None) -> None:
    name = variable(ref.spelled)
    assembler.assigned.add(name)

    def act(process: Process) -> None:
        value = 0.0 if first is None else first.value(process)
        if not math.isfinite(value):
            raise InputError(f"{ref.spelled} = {value:g}: must be finite")
        process.kinds[name] = kind
        process.variables[name] = 0.0
        process.assign(name, value)

    assembler.emit(ref.line, act)


def _declare_array(assembler: ProcessAssembler, ref: Reference, kind: str, given: tuple[Expression, ...]) -> None:
    name = variable(ref.spelled)
    if not 1 <= len(given) <= MOST_DIMENSIONS:
        raise InputError(f"DIM {ref.spelled}: {len(given)} sizes, must be 1 to {MOST_DIMENSIONS}")
    sizes = [size.value for size in given]
    assembler.arrays.add(name)

    def make(process: Process) -> None:
        values = tuple(index(f"size of {name.lower()}", size(process), MOST_ELEMENTS + 1) for size in sizes)
        if not 1 <= math.prod(values) <= MOST_ELEMENTS:
            raise InputError(f"DIM {ref.spelled}: {math.prod(values)} elements, must be 1 to {MOST_ELEMENTS}")
        process.kinds[name] = kind
        process.arrays[name] = (values, {})

    assembler.emit(ref.line, make)


@statement('ref "=" STRING')
def cmd_assign_text(assembler: ProcessAssembler, raw: Raw) -> None:
    """name = "text": refused."""
    raise InputError("text in a variable is not emulated: a variable must be a number")


def _text(token: object) -> str:
    return str(token)[1:-1]
