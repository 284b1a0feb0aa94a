"""Statements and words as they stand in the text, before they are assembled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import Assembler
from gantrysim.controllers.trio.basic.process import Process

Evaluate = Callable[[Process], float]

MISPRINTS = {"MHELIX": "MHELICAL"}  # words of published programs for those of the language


class Expression(NamedTuple):
    """An expression.

    Attributes:
        value: evaluates it.
        depth: of its nesting.
    """

    value: Evaluate
    depth: int = 1


class Reference(NamedTuple):
    """A word with what belongs to it: a variable, a parameter, a function or a command.

    Attributes:
        name: in capitals.
        arguments: None without brackets.
        axis: of AXIS(), None without.
        line: of the text.
        spelled: as in the text.
        process: of PROC(), None without.
        bit: of its value that it stands for, None for all.
    """

    name: str
    arguments: tuple[Expression, ...] | None
    axis: Expression | None
    line: int
    spelled: str
    process: Expression | None = None
    bit: int | None = None

    def between(self, least: int, most: int) -> tuple[Expression, ...]:
        """Return the arguments, or raise InputError where their number is out of bounds."""
        arguments = self.arguments or ()
        if not least <= len(arguments) <= most:
            wanted = str(least) if least == most else f"{least} to {most}"
            raise InputError(f"{self.name} with {len(arguments)} values: must have {wanted}")
        return arguments

    def plain(self, arguments: int, axis: bool = False) -> tuple[Expression, ...]:
        """Return the arguments of a word that takes so many, and AXIS() if `axis`."""
        if self.axis is not None and not axis:
            raise InputError(f"{self.name} AXIS(): {self.name} does not belong to an axis")
        if self.process is not None:
            raise InputError(f"{self.name} PROC(): {self.name} does not belong to a process")
        return self.between(arguments, arguments)


class Spelt(NamedTuple):
    """A number that PRINT writes as CHR() or HEX() say.

    Attributes:
        word: CHR or HEX.
        value: the number.
    """

    word: str
    value: Expression


class Raw(NamedTuple):
    """A statement as it stands in the text.

    Attributes:
        kind: name of its function in `flow` or `statements`, without the prefix.
        line: of the text.
        data: its parts.
        inline: of IF: whether its branch stands in the same line.
    """

    kind: str
    line: int
    data: tuple[Any, ...] = ()
    inline: bool = False


@dataclass
class Source:
    """One program of a text.

    Attributes:
        name: in capitals.
        lines: its statements, line by line.
        read: variables that it reads, with the line of the first time.
        arrays: names that DIM gives to arrays.
        variables: values of the variables that it reads, by name.
        numbers: values of the numbers that stand in it.
        remarks: on what it writes otherwise than the controller reads it.
    """

    name: str
    lines: list[list[Raw]] = field(default_factory=list)
    read: dict[str, int] = field(default_factory=dict)
    arrays: set[str] = field(default_factory=set)
    variables: dict[str, Expression] = field(default_factory=dict)
    numbers: dict[float, Expression] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def corrected_word(self, word: str, line: int) -> str:
        """Return the word of the language that a published misprint stands for, with a remark; others as they are."""
        meant = MISPRINTS.get(word)
        if meant is None:
            return word
        self.remarks.append(
            f"line {line}: {word}, as AN-225 prints it, is not a command of the controller; {meant} is used instead"
        )
        return meant


# The assembler of a program, to which its statements add themselves.


class ProcessAssembler(Assembler[Process]):
    """Assembles a program.

    Attributes:
        assigned: variables that a statement assigns.
        arrays: names that DIM has given to arrays.
        include: assembles the statements of an included program, by its name.
    """

    def __init__(self, include: Callable[[ProcessAssembler, str], None]) -> None:
        super().__init__()
        self.assigned: set[str] = set()
        self.arrays: set[str] = set()
        self.include = include


Handler = Callable[[ProcessAssembler, Raw], None]
