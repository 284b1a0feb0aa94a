"""A program that can be executed, from its statements as they stand in the text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from itertools import chain

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.expressions import known_words
from gantrysim.controllers.trio.basic.process import ProgramCode
from gantrysim.controllers.trio.basic.process_assembler import ProcessAssembler
from gantrysim.controllers.trio.basic.raw import Source
from gantrysim.controllers.trio.basic.statement_table import STATEMENTS

_DEEPEST = 8  # programs included by one another


def assemble_all(sources: Sequence[Source], strict: bool) -> list[ProgramCode]:
    """Return programs that can be executed.

    Args:
        sources: the programs.
        strict: whether a variable that no statement assigns is an error; else it reads as 0.

    Raises:
        InputError: a block without its end, an unknown label or word, a number of values that a word does not take.
    """
    by_name = {source.name: source for source in sources}
    shared = {
        str(raw.data[0])[1:-1].upper()
        for source in sources
        for raw in chain.from_iterable(source.lines)
        if raw.kind in ("constant", "global")
    }
    included = {
        str(raw.data[0])[1:-1].upper()
        for source in sources
        for raw in chain.from_iterable(source.lines)
        if raw.kind == "include"
    }
    codes = []
    for source in sources:
        assembler = ProcessAssembler(lambda target, name: _include(target, name, by_name, 1))
        _add(assembler, source)
        statements = assembler.finish()
        if strict and source.name not in included:
            _check_assigned(source, assembler.assigned | shared)
        codes.append(ProgramCode(source.name, statements, tuple(source.remarks)))
    return codes


def _include(assembler: ProcessAssembler, name: str, sources: Mapping[str, Source], depth: int) -> None:
    """Add the statements of an included program."""
    if name not in sources:
        raise InputError(
            f'INCLUDE "{name}": must be one of the programs {", ".join(sources)}, or a file {name.lower()}.bas beside '
            "the program"
        )
    if depth > _DEEPEST:
        raise InputError(f'INCLUDE "{name}": programs include each other more than {_DEEPEST} deep')
    outer = assembler.include
    assembler.include = lambda target, inner: _include(target, inner, sources, depth + 1)
    _add(assembler, sources[name])
    assembler.include = outer


def _add(assembler: ProcessAssembler, source: Source) -> None:
    for raw in chain.from_iterable(source.lines):
        try:
            STATEMENTS.handlers[raw.kind](assembler, raw)
        except InputError as error:
            text = str(error)
            raise InputError(text if text.startswith("line ") else f"line {raw.line}: {text}") from None


def _check_assigned(source: Source, assigned: set[str]) -> None:
    for name, line in source.read.items():
        if name not in assigned:
            near = get_close_matches(name, sorted(assigned.difference(known_words())), n=1, cutoff=0.6)
            hint = f", did you mean {near[0].lower()}?" if near else ""
            raise InputError(
                f"line {line}: variable {name.lower()} is assigned nowhere{hint}: it must be, or unassigned_zero = "
                "true, with which it reads as 0 as on the controller"
            )
