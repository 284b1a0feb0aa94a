"""The parser of MC-Basic, and its errors."""

from __future__ import annotations

import re
from functools import cache, lru_cache
from importlib.resources import files

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from gantrysim.controllers.softmc.commands import SoftMCError

LONGEST = 1_000_000  # characters of a program
_COMMENT = re.compile(r"\"[^\"\n]*\"|'[^\n]*|^[ \t]*rem\b[^\n]*", re.IGNORECASE | re.MULTILINE)
_STATEMENTS = (
    "attach, call, circle, common, configgroup, delay, detach, dim, do, end, for, function, if, move, moves, next, "
    "print, program, record, recordclose, recordoff, recordon, select, sleep, sub, while, with, else, elseif, loop"
)

Node = Tree[Token]


@lru_cache(maxsize=32)
def parse(text: str) -> Node:
    """Return the tree of a program.

    Raises:
        SoftMCError: a text that is no program, with its line.
    """
    if len(text) > LONGEST:
        raise SoftMCError(f"program of {len(text)} characters: must be at most {LONGEST}")
    plain = without_comments(text)
    try:
        return _parser().parse(plain)
    except UnexpectedInput as error:
        raise SoftMCError(_message(plain, error)) from None


def without_comments(text: str) -> str:
    """Return a text without its comments, with the same lines."""
    plain = _COMMENT.sub(lambda found: found[0] if found[0].startswith('"') else "", text)
    return plain.replace("\r\n", "\n").replace("\r", "\n") + "\n"


@cache
def _parser() -> Lark:
    grammar = files(__package__).joinpath("mcbasic.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", propagate_positions=True, maybe_placeholders=True)


def _message(text: str, error: UnexpectedInput) -> str:
    if isinstance(error, UnexpectedToken) and error.token.type == "$END":
        return f"line {len(text.rstrip().splitlines())}: the text ends within a program, a sub, a function, a loop or a condition"
    lines = text.split("\n")
    number = min(max(int(error.line), 1), len(lines))
    line, column = lines[number - 1].strip(), error.column
    where = f'line {number} "{line[:80]}"'
    if isinstance(error, UnexpectedToken):
        found = "the end of the line" if error.token.type == "_NL" else repr(str(error.token)[:40])
        if error.token.type == "_NL":
            number = text.count("\n", 0, error.token.start_pos or 0) + 1
            where = f'line {number} "{lines[number - 1].strip()[:80]}"'
        before = lines[number - 1][: max(column - 1, 0)].split()
        first = lines[number - 1].split()[:1]
        if (
            first
            and first[0].lower() not in _STATEMENTS.split(", ")
            and len(before) == 1
            and re.fullmatch(r"[A-Za-z]\w*", first[0])
            and "=" not in lines[number - 1]
        ):
            return f"{where}: unknown statement {first[0]!r}: known: {_STATEMENTS}, or an assignment with ="
        return f"{where}: {found} does not fit there"
    assert isinstance(error, UnexpectedCharacters)
    return f"{where}: {error.char!r} does not fit there"
