"""The parser of MC-Basic, its table of commands and blocks, and its errors."""

from __future__ import annotations

import re
from functools import cache, lru_cache
from importlib.resources import files

from lark import Lark
from lark.exceptions import UnexpectedInput, UnexpectedToken

from gantrysim.controllers.basic.statements import Statements, with_keywords
from gantrysim.controllers.softmc.basic import commands, statements
from gantrysim.controllers.softmc.basic.tree import Node
from gantrysim.controllers.softmc.commands import SoftMCError

LONGEST = 1_000_000  # characters of a program
# strings too, first, as an apostrophe within one begins no comment
_COMMENT = re.compile(r"\"[^\"\n]*\"|'[^\n]*|^[ \t]*rem\b[^\n]*", re.IGNORECASE | re.MULTILINE)
# all commands and blocks of MC-Basic
COMMANDS = Statements.of(statements.command, commands.command)
BLOCKS = statements.block

# what may stand first in a line besides commands and blocks: words of programs, and parts of blocks
_OF_PROGRAMS = {"end", "function", "next", "program", "sub"}
_OF_BLOCKS = ("else", "elseif", "loop")
_STATEMENTS = (*sorted(COMMANDS.first_words | BLOCKS.first_words | _OF_PROGRAMS), *_OF_BLOCKS)


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
        tree: Node = _parser().parse(plain)
        return tree
    except UnexpectedInput as error:
        raise SoftMCError(_message(plain, error)) from None


def without_comments(text: str) -> str:
    """Return a text without its comments, with the same lines."""
    plain = _COMMENT.sub(lambda match: match[0] if match[0].startswith('"') else "", text)
    return plain.replace("\r\n", "\n").replace("\r", "\n") + "\n"


@cache
def _parser() -> Lark:
    text = files(__package__).joinpath("mcbasic.lark").read_text(encoding="utf-8")
    grammar = with_keywords(text.replace("$commands", COMMANDS.rule).replace("$blocks", BLOCKS.rule))
    return Lark(grammar, parser="lalr", propagate_positions=True, maybe_placeholders=True)


def _message(text: str, error: UnexpectedInput) -> str:
    lines = text.split("\n")
    if isinstance(error, UnexpectedToken) and error.token.type == "$END":
        last = len(text.rstrip().splitlines())
        return f"line {last}: the text ends within a program, a sub, a function, a loop or a condition"
    number = text.count("\n", 0, error.pos_in_stream or 0) + 1
    words = lines[number - 1].split()
    where = f'line {number} "{" ".join(words)[:80]}"'
    unexpected = text[error.pos_in_stream or 0 :].split("\n")[0].split()[:1]
    before = lines[number - 1][: max(error.column - 1, 0)].split() if unexpected else words
    is_verb = words and re.fullmatch(r"[A-Za-z]\w*", words[0]) and words[0].lower() not in _STATEMENTS
    if is_verb and len(before) == 1 and "=" not in words:
        return f"{where}: unknown statement {words[0]!r}: known: {', '.join(_STATEMENTS)}, or an assignment with ="
    return f"{where}: {repr(unexpected[0][:40]) if unexpected else 'the end of the line'} does not fit there"
