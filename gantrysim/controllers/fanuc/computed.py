"""Blocks of letters with variables and expressions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from gantrysim.base.errors import InputError
from gantrysim.controllers.fanuc.alarm import BlockSource
from gantrysim.controllers.fanuc.block_words import CORNERS, LETTERS, Words
from gantrysim.controllers.macro.grammar import FUNCTIONS, OPERATORS, Grammar, rounded_from_zero, rounded_to_zero
from gantrysim.controllers.macro.scanner import Scanner
from gantrysim.controllers.macro.variables import Parameters

GRAMMAR = Grammar(OPERATORS, {**FUNCTIONS, "FIX": rounded_to_zero, "FUP": rounded_from_zero}, shortened=True)
_ARGUMENT_LETTERS = "EUVW"  # which only a call has, for its arguments
_VARIABLE = re.compile(r"#([0-9]+)")


def computed_words(text: str, source: BlockSource, variables: Parameters) -> Words:
    """Return the words of a block without spaces, with the values that they have now.

    Raises:
        Alarm: an invalid word.
        InputError: an invalid value.
    """
    codes: list[float] = []
    auxiliary: list[float] = []
    values: dict[str, float] = {}
    for letter, number in list(_numbers(text, source, variables)):
        if letter == "G":
            codes.append(number)
        elif letter == "M":
            auxiliary.append(number)
        elif letter in values:
            raise source.fail(9, f"address {letter} is given twice in the block")
        else:
            values[letter] = number
    for letter in "NO":
        values.pop(letter, None)
    return Words(source.name, source.line, tuple(codes), tuple(auxiliary), values)


def _numbers(text: str, source: BlockSource, variables: Parameters) -> Iterator[tuple[str, float]]:
    """The letters of a block and their values, without those of variables that were never set."""
    scanner = Scanner(text, GRAMMAR)
    while scanner.remaining:
        comma = "," if scanner.take(",") else ""
        letter = scanner.remaining[:1]
        if comma and comma + letter not in CORNERS:
            raise source.fail(9, f"',{letter}': a comma must stand before R or C")
        if letter not in LETTERS + _ARGUMENT_LETTERS:
            raise source.fail(9, f"address {letter!r}: must be one of {', '.join(LETTERS)}")
        scanner.take(letter)
        start = scanner.position
        value = scanner.value(letter)
        variable = _VARIABLE.fullmatch(text, start, scanner.position)
        if variable and variables.vacant(float(variable[1])):
            continue
        number = value(variables)
        if not math.isfinite(number):
            raise InputError(f"{letter} = {number:g}: must be finite")
        yield comma + letter, number
