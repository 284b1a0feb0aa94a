"""Parser of Trio BASIC: a text becomes lines of statements, not yet joined to blocks."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

from lark import Lark, Token, Transformer_NonRecursive, UnexpectedCharacters, UnexpectedEOF, UnexpectedToken, v_args
from lark.exceptions import VisitError

from gantrysim.controllers.trio.basic import words
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.expressions import (
    Expression,
    Reference,
    binary,
    constant,
    inverted,
    known_words,
    negative,
    power,
    unknown_word,
    value_of,
)
from gantrysim.errors import InputError

LONGEST, LONGEST_LINE, LONGEST_WORD = 1_000_000, 4096, 64  # characters of a text, a line, a word
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


@cache
def parser() -> Lark:
    """Return the parser, built once."""
    grammar = files("gantrysim.controllers.trio.basic").joinpath("grammar.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", propagate_positions=True, maybe_placeholders=True)


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
        tree = parser().parse(text.replace("\r", "") + "\n")
        source.lines = _Builder(source.read, before).transform(tree)
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
    except VisitError as error:
        if isinstance(error.orig_exc, InputError):
            raise error.orig_exc from None
        raise
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
    @v_args(meta=True)
    def build(self: _Builder, meta: Any, children: list[Any]) -> Raw:
        return Raw(kind, meta.line + self.before, tuple(children))

    return build


class _Builder(Transformer_NonRecursive):  # type: ignore[type-arg]
    """Builds statements and expressions from the bottom up."""

    def __init__(self, read: dict[str, int], before: int) -> None:
        super().__init__(visit_tokens=False)
        self.names, self.before = read, before

    def start(self, children: list[Any]) -> list[list[Raw]]:
        return [line for line in children if isinstance(line, list)]

    def line(self, children: list[Any]) -> list[Raw]:
        """The statements of a line; IFs with a branch in it end with it."""
        flat: list[Raw] = []
        inline = 0
        for k, child in enumerate(children):
            if isinstance(child, Token):
                if child.type == "ELSE":
                    flat.append(Raw("ELSE", (child.line or 1) + self.before, (), inline > 0))
                continue
            parts = child if isinstance(child, list) else [child]
            colon = k + 1 < len(children) and getattr(children[k + 1], "type", None) == "COLON"
            if k == 0 and colon and _is_label(parts[0]):
                parts = [Raw("LABEL", parts[0].line, (parts[0].data[0].name,))]
            inline += sum(part.inline for part in parts)
            flat += parts
        return flat + [Raw("ENDIF", flat[-1].line)] * inline if flat else flat

    @v_args(meta=True)
    def if_(self, meta: Any, children: list[Any]) -> list[Raw]:
        return self._branch("IF", meta, children)

    @v_args(meta=True)
    def elseif(self, meta: Any, children: list[Any]) -> list[Raw]:
        return self._branch("ELSEIF", meta, children)

    def _branch(self, kind: str, meta: Any, children: list[Any]) -> list[Raw]:
        condition, then = children
        own = [] if then is None else then if isinstance(then, list) else [then]
        return [Raw(kind, meta.line + self.before, (condition,), kind == "IF" and bool(own)), *own]

    command, assign = _statement("COMMAND"), _statement("ASSIGN")
    endif, while_, wend = _statement("ENDIF"), _statement("WHILE"), _statement("WEND")
    repeat, until, for_, next_ = _statement("REPEAT"), _statement("UNTIL"), _statement("FOR"), _statement("NEXT")
    goto, gosub, return_ = _statement("GOTO"), _statement("GOSUB"), _statement("RETURN")
    on_goto, on_gosub = _statement("ON GOTO"), _statement("ON GOSUB")
    wait_until, wait_idle = _statement("WAIT UNTIL"), _statement("WAIT IDLE")
    wait_loaded, run, stop, halt = _statement("WAIT LOADED"), _statement("RUN"), _statement("STOP"), _statement("HALT")
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
                f"line {name.line + self.before}: word of {len(name)} characters: must have at most {LONGEST_WORD}"
            )
        return Reference(name.upper(), arguments, axis, (name.line or 1) + self.before, str(name))

    def arguments(self, children: list[Any]) -> tuple[Expression, ...]:
        return tuple(child for child in children if child is not None)

    def axis(self, children: list[Any]) -> Expression:
        expression: Expression = children[0]
        return expression

    @v_args(meta=True)
    def binary(self, meta: Any, children: list[Any]) -> Expression:
        return self._at(meta, lambda: binary(children[0], str(children[1]), children[2]))

    @v_args(meta=True)
    def power(self, meta: Any, children: list[Any]) -> Expression:
        return self._at(meta, lambda: power(children[0], children[1]))

    @v_args(meta=True)
    def sign(self, meta: Any, children: list[Any]) -> Expression:
        return self._at(meta, lambda: negative(children[1]) if children[0] == "-" else children[1])

    @v_args(meta=True)
    def not_(self, meta: Any, children: list[Any]) -> Expression:
        return self._at(meta, lambda: inverted(children[0]))

    @v_args(meta=True)
    def constant(self, meta: Any, children: list[Any]) -> Expression:
        return self._at(meta, lambda: constant(_number(str(children[0]))))

    @v_args(meta=True)
    def hexadecimal(self, meta: Any, children: list[Any]) -> Expression:
        return self._at(meta, lambda: constant(float(int(str(children[0])[1:], 16))))

    @v_args(meta=True)
    def value(self, meta: Any, children: list[Any]) -> Expression:
        return self._at(meta, lambda: value_of(children[0], self.names))

    def _at(self, meta: Any, build: Callable[[], Expression]) -> Expression:
        """Build an expression; an error names its line."""
        try:
            return build()
        except OverflowError:
            raise InputError(f"line {meta.line + self.before}: number too large") from None
        except InputError as error:
            raise InputError(f"line {meta.line + self.before}: {error}") from None


def _is_label(raw: Raw) -> bool:
    if raw.kind != "COMMAND":
        return False
    ref: Reference = raw.data[0]
    known = ref.name in COMMANDS or ref.name in words.KEYWORDS or ref.name in words.NOT_EMULATED
    return ref.arguments is None and ref.axis is None and not known
