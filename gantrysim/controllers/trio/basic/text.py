"""Parser of Trio BASIC: a text becomes lines of statements, not yet joined to blocks."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from typing import Any, cast

from lark import Lark, Token, Transformer, UnexpectedCharacters, UnexpectedEOF, UnexpectedToken

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.expressions import (
    Expression,
    Reference,
    constant,
    joined,
    known_words,
    unknown_word,
    value_of,
)

# characters of a text, a line, a word
LONGEST = 1_000_000
LONGEST_LINE = 4096
LONGEST_WORD = 64
_SECTION = re.compile(r"^[ \t]*'\$PROGRAM[ \t]+\"?(\w+)\"?[ \t]*$", re.IGNORECASE | re.MULTILINE)
_VERB = re.compile(r"\s*([A-Z_]\w{0,63})[^\S\n]+(?!AXIS\b)[\w\"#(]", re.IGNORECASE)
MAIN = "MAIN"  # name of a program without one
MOST_SECTIONS = 64


@dataclass(frozen=True)
class Raw:
    """A statement as it stands in the text.

    Attributes:
        kind: its keyword, or COMMAND, ASSIGN, LABEL.
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
    """

    name: str
    lines: list[list[Raw]] = field(default_factory=list)
    read: dict[str, int] = field(default_factory=dict)


class _Parser(threading.local):
    """The parser of a thread, built when it is first used; it hands what it reads to its builder, without a tree."""

    @cached_property
    def builder(self) -> _Builder:
        return _Builder()

    @cached_property
    def lark(self) -> Lark:
        grammar = files("gantrysim.controllers.trio.basic").joinpath("grammar.lark").read_text(encoding="utf-8")
        return Lark(grammar, parser="lalr", maybe_placeholders=True, transformer=self.builder)

    def parse(self, text: str, read: dict[str, int], before: int) -> list[list[Raw]]:
        """Return the statements of a text, line by line, after so many lines; add the variables that it reads."""
        self.builder.names, self.builder.before = read, before
        return cast(list[list[Raw]], self.lark.parse(text))


_parser = _Parser()


def read(text: str) -> list[Source]:
    """Return the programs of a text; each but the first begins with a line '$PROGRAM name.

    Raises:
        InputError: the text breaks the grammar, or uses a word that is unknown.
    """
    if len(text) > LONGEST:
        raise InputError(f"program of {len(text)} characters: must have at most {LONGEST}")
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > LONGEST_LINE:
            raise InputError(f"line {number}: {len(line)} characters: must have at most {LONGEST_LINE}")
    heads = list(_SECTION.finditer(text))
    if len(heads) > MOST_SECTIONS:
        raise InputError(f"{len(heads)} programs: must be at most {MOST_SECTIONS}")
    starts = [0, *(head.end() for head in heads)]
    ends = [*(head.start() for head in heads), len(text)]
    names = [MAIN, *(head[1].upper() for head in heads)]
    sources = []
    for name, start, end in zip(names, starts, ends, strict=True):
        source = _source(name, text[start:end], text.count("\n", 0, start))
        if source.lines or name != MAIN:
            sources.append(source)
    double = [source.name for k, source in enumerate(sources) if source.name in names[: names.index(source.name)]]
    if double or len({source.name for source in sources}) < len(sources):
        raise InputError("two programs have one name: every '$PROGRAM must have its own")
    if not sources:
        raise InputError("program without a statement: must have at least one")
    return sources


def _source(name: str, text: str, before: int) -> Source:
    source = Source(name)
    try:
        source.lines = _parser.parse(text.replace("\r", "") + "\n", source.read, before)
    except UnexpectedToken as error:
        shown = (
            "the line ends too early"
            if error.token.type in ("_NL", "$END")
            else f"{str(error.token)[:LONGEST_WORD]!r} unexpected"
        )
        line = before + (error.line if isinstance(error.line, int) and error.line > 0 else 1)
        raise _misspelt(text, before, line) or InputError(f"line {line}: syntax error, {shown}") from None
    except UnexpectedCharacters as error:
        raise InputError(f"line {before + error.line}: syntax error, {error.char!r} unexpected") from None
    except UnexpectedEOF:
        raise InputError("syntax error: the text ends too early") from None
    return source


def _misspelt(text: str, before: int, line: int) -> InputError | None:
    """The error for a line whose first word is unknown and is followed by what no variable can be."""
    lines = text.split("\n")
    found = _VERB.match(lines[line - before - 1]) if 0 < line - before <= len(lines) else None
    if found is None or found[1].upper() in known_words():
        return None
    return InputError(f"line {line}: {unknown_word(Reference(found[1].upper(), None, None, line, found[1]))}")


def _number(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise InputError(f"number {text[:LONGEST_WORD]}: too large")
    return value


def _statement(kind: str) -> Callable[..., Raw]:
    def build(self: _Builder, children: list[Any]) -> Raw:
        return Raw(kind, self.line_of(children[0]), tuple(children[1:]))

    return build


class _Builder(Transformer):  # type: ignore[type-arg]
    """Builds statements and expressions from the bottom up.

    Attributes:
        names: variables that the text reads, with the line of the first time.
        before: lines before the text.
    """

    names: dict[str, int]
    before: int

    def line_of(self, token: Token) -> int:
        """Line of the whole text in which a token stands."""
        return (token.line or 1) + self.before

    def start(self, children: list[Any]) -> list[list[Raw]]:
        return [line for line in children if isinstance(line, list)]

    def line(self, children: list[Any]) -> list[Raw]:
        """The statements of a line; IFs with a branch in it end with it."""
        flat: list[Raw] = []
        inline = 0
        for k, child in enumerate(children):
            if isinstance(child, Token):
                if child.type == "ELSE":
                    flat.append(Raw("ELSE", self.line_of(child), (), inline > 0))
                continue
            parts = child if isinstance(child, list) else [child]
            colon = k + 1 < len(children) and getattr(children[k + 1], "type", None) == "COLON"
            if k == 0 and colon and _is_label(parts[0]):
                parts = [Raw("LABEL", parts[0].line, (parts[0].data[0].name,))]
            inline += sum(part.inline for part in parts)
            flat += parts
        return flat + [Raw("ENDIF", flat[-1].line)] * inline if flat else flat

    def if_(self, children: list[Any]) -> list[Raw]:
        return self._branch("IF", children)

    def elseif(self, children: list[Any]) -> list[Raw]:
        return self._branch("ELSEIF", children)

    def _branch(self, kind: str, children: list[Any]) -> list[Raw]:
        word, condition, then = children
        own = [] if then is None else then if isinstance(then, list) else [then]
        return [Raw(kind, self.line_of(word), (condition,), kind == "IF" and bool(own)), *own]

    def command(self, children: list[Any]) -> Raw:
        return Raw("COMMAND", children[0].line, tuple(children))

    def assign(self, children: list[Any]) -> Raw:
        return Raw("ASSIGN", children[0].line, tuple(children))

    endif = _statement("ENDIF")
    while_ = _statement("WHILE")
    wend = _statement("WEND")
    repeat = _statement("REPEAT")
    until = _statement("UNTIL")
    for_ = _statement("FOR")
    next_ = _statement("NEXT")
    goto = _statement("GOTO")
    gosub = _statement("GOSUB")
    return_ = _statement("RETURN")
    on_goto = _statement("ON GOTO")
    on_gosub = _statement("ON GOSUB")
    wait_until = _statement("WAIT UNTIL")
    wait_idle = _statement("WAIT IDLE")
    wait_loaded = _statement("WAIT LOADED")
    run = _statement("RUN")
    stop = _statement("STOP")
    halt = _statement("HALT")
    print_ = _statement("PRINT")

    def text(self, children: list[Any]) -> str:
        return str(children[0])[1:-1]

    def number(self, children: list[Any]) -> tuple[Expression, ...]:
        return tuple(children)

    def character(self, children: list[Any]) -> list[Expression]:
        return children

    def ref(self, children: list[Any]) -> Reference:
        name, arguments, axis = children
        if len(name) > LONGEST_WORD:
            raise InputError(
                f"line {self.line_of(name)}: word of {len(name)} characters: must have at most {LONGEST_WORD}"
            )
        return Reference(name.upper(), arguments, axis, self.line_of(name), str(name))

    def arguments(self, children: list[Any]) -> tuple[Expression, ...]:
        return tuple(child for child in children if child is not None)

    def axis(self, children: list[Any]) -> Expression:
        expression: Expression = children[0]
        return expression

    def joined(self, children: list[Any]) -> Expression:
        return joined(children, self._at)

    def constant(self, children: list[Any]) -> Expression:
        return self._at(children[0], lambda: constant(_number(str(children[0]))))

    def hexadecimal(self, children: list[Any]) -> Expression:
        return self._at(children[0], lambda: constant(float(int(str(children[0])[1:], 16))))

    def value(self, children: list[Any]) -> Expression:
        return self._at(children[0], lambda: value_of(children[0], self.names))

    def _at(self, place: Token | Reference, build: Callable[[], Expression]) -> Expression:
        """Build an expression; an error names the line of a token or word of it."""
        try:
            return build()
        except (OverflowError, InputError) as error:
            line = place.line if isinstance(place, Reference) else self.line_of(place)
            said = "number too large" if isinstance(error, OverflowError) else error
            raise InputError(f"line {line}: {said}") from None


def _is_label(raw: Raw) -> bool:
    if raw.kind != "COMMAND":
        return False
    ref: Reference = raw.data[0]
    known = ref.name in COMMANDS or ref.name in words.KEYWORDS or ref.name in words.NOT_EMULATED
    return ref.arguments is None and ref.axis is None and not known
