"""Blocks, jumps, and statements that declare names, a function each: `cmd_goto` is GOTO."""

from __future__ import annotations

import math
from functools import partial

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import ForLoop
from gantrysim.controllers.basic.statements import Statements
from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.axis_parameters import AXIS_PARAMETERS
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.process import VR_SIZE, Process, index
from gantrysim.controllers.trio.basic.raw import Evaluate, Expression, Handler, ProcessAssembler, Raw, Reference

statement: Statements[Handler] = Statements()


@statement('IF expr "THEN"i [statement]')
def cmd_if(assembler: ProcessAssembler, raw: Raw) -> None:
    """IF condition THEN, with or without a branch in its line."""
    assembler.begin_if(raw.line, raw.data[0].value)


@statement('ELSEIF expr "THEN"i [statement]')
def cmd_elseif(assembler: ProcessAssembler, raw: Raw) -> None:
    """ELSEIF condition THEN."""
    assembler.begin_elseif(raw.line, raw.data[0].value)


@statement("ENDIF")
def cmd_endif(assembler: ProcessAssembler, raw: Raw) -> None:
    """ENDIF; a branch in the line of its IF ends with the line."""
    assembler.end_if()


@statement("WHILE expr")
def cmd_while(assembler: ProcessAssembler, raw: Raw) -> None:
    """WHILE condition: a loop tested before each pass."""
    assembler.begin_while(raw.line, raw.data[0].value)


@statement("WEND")
def cmd_wend(assembler: ProcessAssembler, raw: Raw) -> None:
    """WEND: the end of a WHILE."""
    assembler.end_while(raw.line)


@statement("REPEAT")
def cmd_repeat(assembler: ProcessAssembler, raw: Raw) -> None:
    """REPEAT: a loop tested after each pass."""
    assembler.begin_repeat(raw.line)


@statement("UNTIL expr")
def cmd_until(assembler: ProcessAssembler, raw: Raw) -> None:
    """UNTIL condition: the end of a REPEAT."""
    assembler.end_repeat(raw.line, raw.data[0].value)


@statement("DO")
def cmd_do(assembler: ProcessAssembler, raw: Raw) -> None:
    """DO: a loop to LOOP, which may have a condition."""
    assembler.begin_do(raw.line)


@statement('DO "WHILE"i expr')
def cmd_do_while(assembler: ProcessAssembler, raw: Raw) -> None:
    """DO WHILE condition: a loop to LOOP, tested before each pass."""
    assembler.begin_do(raw.line, raw.data[0].value)


@statement('DO "UNTIL"i expr')
def cmd_do_until(assembler: ProcessAssembler, raw: Raw) -> None:
    """DO UNTIL condition: a loop to LOOP, tested before each pass."""
    assembler.begin_do(raw.line, _not(raw.data[0].value))


@statement("LOOP")
def cmd_loop(assembler: ProcessAssembler, raw: Raw) -> None:
    """LOOP: the end of a DO."""
    assembler.end_do(raw.line)


@statement('LOOP "WHILE"i expr')
def cmd_loop_while(assembler: ProcessAssembler, raw: Raw) -> None:
    """LOOP WHILE condition: the end of a DO that goes on while the condition holds."""
    assembler.end_do(raw.line, _not(raw.data[0].value))


@statement('LOOP "UNTIL"i expr')
def cmd_loop_until(assembler: ProcessAssembler, raw: Raw) -> None:
    """LOOP UNTIL condition: the end of a DO that goes on until the condition holds."""
    assembler.end_do(raw.line, raw.data[0].value)


def _not(value: Evaluate) -> Evaluate:
    return lambda process: 0.0 if value(process) else 1.0


@statement('FOR NAME "=" expr "TO"i expr ["STEP"i expr]')
def cmd_for(assembler: ProcessAssembler, raw: Raw) -> None:
    """FOR variable = first TO last [STEP step]."""
    name, first, last, step = raw.data
    cell = variable(name)
    assembler.assigned.add(cell)

    def start(process: Process) -> ForLoop:
        variables: dict[str, float] = process.variables
        process.assign(cell, first.value(process))
        end = last.value(process)
        stride = 1.0 if step is None else step.value(process)
        if stride == 0:
            raise InputError("STEP 0: must not be 0")
        return ForLoop(partial(variables.__getitem__, cell), partial(variables.__setitem__, cell), end, stride)

    assembler.begin_for(raw.line, cell, start)


@statement("NEXT [NAME]")
def cmd_next(assembler: ProcessAssembler, raw: Raw) -> None:
    """NEXT [variable]: the end of a FOR."""
    block = assembler.close("NEXT", "FOR")
    name = raw.data[0]
    if name is not None and name.upper() != block.variable:
        raise InputError(f"NEXT {name}: must be NEXT {block.variable.lower()}, of the FOR of line {block.line}")
    assembler.end_for(raw.line, block)


# jumps


def cmd_label(assembler: ProcessAssembler, raw: Raw) -> None:
    """label: at the start of a line."""
    assembler.label(raw.data[0])


def cmd_else(assembler: ProcessAssembler, raw: Raw) -> None:
    """ELSE."""
    assembler.begin_else(raw.line)


def cmd_loop_or_label(assembler: ProcessAssembler, raw: Raw) -> None:
    """LOOP before a colon: the end of a DO, or where none is open a label, as programs from before DO have it."""
    if assembler.is_inside("DO"):
        assembler.end_do(raw.line)
    else:
        assembler.label("LOOP")


# read from the colon after a word, and from the ELSE between statements
statement.handlers |= {"label": cmd_label, "loop_or_label": cmd_loop_or_label, "else": cmd_else}


@statement("GOTO NAME")
def cmd_goto(assembler: ProcessAssembler, raw: Raw) -> None:
    """GOTO label."""
    assembler.goto(raw.line, raw.data[0])


@statement("GOSUB NAME")
def cmd_gosub(assembler: ProcessAssembler, raw: Raw) -> None:
    """GOSUB label: call a subroutine."""
    assembler.gosub(raw.line, raw.data[0])


@statement("RETURN")
def cmd_return(assembler: ProcessAssembler, raw: Raw) -> None:
    """RETURN from a subroutine."""
    assembler.leave(raw.line)


@statement('ON "BASICERROR"i "GOTO"i NAME')
def cmd_on_error(assembler: ProcessAssembler, raw: Raw) -> None:
    """ON BASICERROR GOTO label: where the process goes on after an error."""
    assembler.on_error(raw.line, raw.data[0])


@statement('ON expr "GOTO"i NAME ("," NAME)*')
def cmd_on_goto(assembler: ProcessAssembler, raw: Raw) -> None:
    """ON number GOTO label, ..."""
    expression, *labels = raw.data
    assembler.goto_one_of(raw.line, lambda process: int(expression.value(process)), labels)


@statement('ON expr "GOSUB"i NAME ("," NAME)*')
def cmd_on_gosub(assembler: ProcessAssembler, raw: Raw) -> None:
    """ON number GOSUB label, ..."""
    expression, *labels = raw.data
    assembler.gosub_one_of(raw.line, lambda process: int(expression.value(process)), labels)


# Names that a program may give to its variables.


def variable(name: str) -> str:
    """Return the name of a variable that is assigned, in capitals, or raise InputError where it is a word."""
    word = name.upper()
    tables = (words.CONSTANTS, words.FUNCTIONS, AXIS_PARAMETERS, words.SYSTEM_PARAMETERS, words.IGNORED_WORDS, COMMANDS)
    if word in words.KEYWORDS or any(word in table for table in tables) or word in ("IN", "READ_OP"):
        raise InputError(f"{name} = ...: is a word of the language that cannot be assigned")
    if word in words.NOT_EMULATED:
        raise InputError(f"{name}: a word of the controller that is not emulated")
    return word


KINDS = ("BOOLEAN", "FLOAT", "INTEGER")
MOST_DIMENSIONS = 3
MOST_ELEMENTS = 1_000_000


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
