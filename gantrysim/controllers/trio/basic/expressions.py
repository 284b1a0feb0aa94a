"""Expressions: each becomes a function of the process that evaluates it."""

from __future__ import annotations

import operator
from collections.abc import Callable
from difflib import get_close_matches

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.operators import (
    ARITHMETIC,
    COMPARISONS,
    Evaluate,
    Operators,
    RankedOperator,
    of_values,
)
from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.axis_parameters import AXIS_PARAMETERS
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.process import Process
from gantrysim.controllers.trio.basic.raw import Expression, Reference, Source

NESTED_EXPRESSIONS = 60  # nesting of an expression
MOST_BITS = 32  # of a value


def _bits(operation: Callable[[int, int], int]) -> Callable[[float, float], float]:
    return lambda a, b: float(operation(int(a), int(b)))


def _truth(comparison: Callable[[float, float], bool]) -> Callable[[float, float], float]:
    """True is -1, of which all bits are set: NOT, AND and OR act on bits."""
    return lambda a, b: -1.0 if comparison(a, b) else 0.0


def _remainder(a: float, b: float) -> float:
    return a - b * int(a / b)


def _power(a: float, b: float) -> float:
    result: float | complex = a**b
    if isinstance(result, complex):
        raise InputError("root of a negative number")
    return result


OPERATORS = Operators(
    before={
        "NOT": RankedOperator(3, of_values(lambda a: float(~int(a)))),
        "+": RankedOperator(7, of_values(operator.pos)),
        "-": RankedOperator(7, of_values(operator.neg)),
    },
    between={
        "OR": RankedOperator(1, of_values(_bits(operator.or_))),
        "XOR": RankedOperator(1, of_values(_bits(operator.xor))),
        "AND": RankedOperator(2, of_values(_bits(operator.and_))),
        **{sign: RankedOperator(4, of_values(_truth(comparison))) for sign, comparison in COMPARISONS.items()},
        "+": RankedOperator(5, of_values(ARITHMETIC["+"])),
        "-": RankedOperator(5, of_values(ARITHMETIC["-"])),
        "*": RankedOperator(6, of_values(ARITHMETIC["*"])),
        "/": RankedOperator(6, of_values(ARITHMETIC["/"])),
        "MOD": RankedOperator(6, of_values(_remainder)),
        "^": RankedOperator(8, of_values(_power), from_right=True),
    },
)


def operation(sign: str, made_by: RankedOperator, operands: list[Expression]) -> Expression:
    """Return what an operator makes of its operands."""
    return _nested_expression(made_by.join(sign, *[operand.value for operand in operands]), *operands)


def constant(value: float) -> Expression:
    """Return a number."""
    return Expression(lambda process: value)


def value_of(ref: Reference, source: Source) -> Expression:
    """Return what a word stands for in an expression; variables are entered into `source` with their line."""
    bit = ref.bit
    if bit is None:
        return _value_of(ref, source)
    word = _value_of(ref._replace(bit=None), source)
    value = word.value
    if bit >= MOST_BITS:
        raise InputError(f"{ref.spelled}.{bit}: must be a bit from 0 to {MOST_BITS - 1}")
    return _nested_expression(lambda process: float(int(value(process)) >> bit & 1), word)


def _value_of(ref: Reference, source: Source) -> Expression:
    name = ref.name
    is_plain = ref.arguments is None and ref.axis is None and ref.process is None
    if is_plain and name in source.variables:
        return source.variables[name]
    if name in _READERS:
        return _READERS[name](ref)
    if name in COMMANDS or name in words.KEYWORDS:
        raise InputError(f"{name}: is a command, it has no value")
    if name in source.arrays and ref.arguments is not None:
        places = [argument.value for argument in ref.plain(len(ref.arguments))]
        return _nested_expression(
            lambda process: process.element(name, [place(process) for place in places]), *ref.arguments
        )
    if not is_plain:
        raise unknown_word(ref)
    _check_emulated(ref)
    source.read[name] = ref.line
    source.variables[name] = _variable(name)
    return source.variables[name]


def _variable(name: str) -> Expression:
    def value(process: Process) -> float:
        variable: float | None = process.variables.get(name)
        return process.state.shared_value(name) if variable is None else variable

    return Expression(value)


def _constant(ref: Reference) -> Expression:
    ref.plain(0)
    return constant(words.CONSTANTS[ref.name])


def _function(ref: Reference) -> Expression:
    function = words.FUNCTIONS[ref.name]
    arguments = ref.plain(function.arguments)
    value = function.value
    values = [argument.value for argument in arguments]
    return _nested_expression(lambda process: value(*[argument(process) for argument in values]), *arguments)


def _axis_parameter(ref: Reference) -> Expression:
    read = AXIS_PARAMETERS[ref.name].read
    return _of_axis(ref, lambda process, number: read(process.state, process.state.motion.axis(number)))


def _ignored_parameter(ref: Reference) -> Expression:
    name = ref.name
    return _of_axis(ref, lambda process, number: process.state.motion.axis(number).values.get(name, 0.0))


def _of_axis(ref: Reference, value: Callable[[Process, float], float]) -> Expression:
    ref.plain(0, axis=True)
    if ref.axis is None:
        return Expression(lambda process: value(process, process.base[0]))
    number = ref.axis.value
    return _nested_expression(lambda process: value(process, number(process)), ref.axis)


def _system_parameter(ref: Reference) -> Expression:
    read = words.SYSTEM_PARAMETERS[ref.name].read
    if ref.process is None or ref.name not in words.OF_PROCESS:
        ref.plain(0)
        return Expression(read)
    ref._replace(process=None).plain(0)
    number = ref.process.value

    def value(process: Process) -> float:
        other = process.state.latest.get(number(process))
        return 0.0 if other is None else read(other)

    return _nested_expression(value, ref.process)


def _memory(ref: Reference) -> Expression:
    if ref.name in words.WHOLE_LINES and ref.arguments is None:
        ref.plain(0)
        lines = words.MEMORY[ref.name]
        return Expression(lambda process: lines(process, 0, words.MOST_BITS - 1))
    places = ref.plain(2) if ref.name in words.RANGES and len(ref.arguments or ()) == 2 else ref.plain(1)
    cells = words.MEMORY[ref.name]
    values = [place.value for place in places]
    return _nested_expression(lambda process: cells(process, *[value(process) for value in values]), *places)


_TABLES: tuple[tuple[dict[str, object], Callable[[Reference], Expression]], ...] = (
    ({**words.CONSTANTS}, _constant),
    ({**words.FUNCTIONS}, _function),
    ({**words.IGNORED_WORDS}, _ignored_parameter),
    ({**AXIS_PARAMETERS}, _axis_parameter),
    ({**words.SYSTEM_PARAMETERS}, _system_parameter),
    ({**words.MEMORY}, _memory),
)
_READERS = {name: read for table, read in _TABLES for name in table}


def _nested_expression(value: Evaluate, *parts: Expression) -> Expression:
    depth = 1 + max([part.depth for part in parts], default=0)
    if depth > NESTED_EXPRESSIONS:
        raise InputError(f"expression nested more than {NESTED_EXPRESSIONS} deep: use a variable for a part of it")
    return Expression(value, depth)


def known_words() -> list[str]:
    """Return all words that programs may use, in their order."""
    return sorted({*COMMANDS, *words.KEYWORDS, *_READERS})


def _check_emulated(ref: Reference) -> None:
    if ref.name in words.NOT_EMULATED:
        raise InputError(f"{ref.spelled}: a word of the controller that is not emulated")


def unknown_word(ref: Reference) -> InputError:
    """Return the error for a word that is none of the language."""
    _check_emulated(ref)
    near = get_close_matches(ref.name, known_words(), n=1, cutoff=0.6)
    return InputError(f"unknown word {ref.spelled!r}" + (f": did you mean {near[0]}?" if near else ""))
