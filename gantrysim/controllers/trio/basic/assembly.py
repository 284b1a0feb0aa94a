"""A program that can be executed, from its statements as they stand in the text."""

from __future__ import annotations

from itertools import chain

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.process import ProgramCode
from gantrysim.controllers.trio.basic.process_assembler import ProcessAssembler
from gantrysim.controllers.trio.basic.raw import Source
from gantrysim.controllers.trio.basic.statement_table import STATEMENTS


def assemble(source: Source, strict: bool) -> ProgramCode:
    """Return a program that can be executed.

    Args:
        source: the program.
        strict: whether a variable that no statement assigns is an error; else it reads as 0.

    Raises:
        InputError: a block without its end, an unknown label or word, a number of values that a word does not take.
    """
    assembler = ProcessAssembler()
    for raw in chain.from_iterable(source.lines):
        try:
            STATEMENTS.handlers[raw.kind](assembler, raw)
        except InputError as error:
            raise InputError(f"line {raw.line}: {error}") from None
    statements = assembler.finish()
    if strict:
        _check_assigned(source, assembler.assigned)
    return ProgramCode(source.name, statements)


def _check_assigned(source: Source, assigned: set[str]) -> None:
    for name, line in source.read.items():
        if name not in assigned:
            raise InputError(
                f"line {line}: variable {name.lower()} is assigned nowhere: it must be, or unassigned_zero = "
                "true, with which it reads as 0 as on the controller"
            )
