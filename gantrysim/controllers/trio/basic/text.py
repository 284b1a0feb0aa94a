"""Parser of Trio BASIC: a text becomes lines of statements, not yet joined to blocks."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property, partial
from importlib.resources import files
from pathlib import Path
from typing import Any, cast

from lark import Lark, Token, Transformer, UnexpectedCharacters, UnexpectedEOF, UnexpectedToken

from gantrysim.base.errors import InputError
from gantrysim.base.input_files import check_inside, read_text
from gantrysim.controllers.basic.operators import RankedOperator, number_of
from gantrysim.controllers.basic.statements import Statements, with_keywords
from gantrysim.controllers.trio.basic import flow, statements, words
from gantrysim.controllers.trio.basic.commands import COMMANDS
from gantrysim.controllers.trio.basic.expressions import (
    OPERATORS,
    constant,
    known_words,
    operation,
    unknown_word,
    value_of,
)
from gantrysim.controllers.trio.basic.raw import Expression, Raw, Reference, Source, Spelt

# PRINT(...) as people write it: brackets about all that a PRINT shows, which mean nothing.

_BRACKETED = re.compile(r"PRINT[ \t]*\(", re.IGNORECASE)
_PLACES = re.compile(r"\"[^\"\n]*\"|'[^\n]*|\bREM\b[^\n]*|(?P<print>\bPRINT[ \t]*)\(", re.IGNORECASE)
_INSIDE = re.compile(r"\"[^\"\n]*\"|[()\n']")
_END = re.compile(r"[ \t]*(?:$|[:\n']|REM\b|ELSE\b)", re.IGNORECASE)

# all statements of Trio BASIC with a syntax of their own
STATEMENTS = Statements.of(statements.statement, flow.statement)


def without_print_brackets(text: str) -> str:
    """Return a text in which blanks replace the brackets about everything that a PRINT shows."""
    if not _BRACKETED.search(text):
        return text
    characters = list(text)
    for place in _PLACES.finditer(text):
        if place["print"] is None:
            continue
        begin = place.end() - 1
        end = _closing(text, begin)
        if end is not None and _END.match(text, end + 1):
            characters[begin] = " "
            characters[end] = " "
    return "".join(characters)


def _closing(text: str, begin: int) -> int | None:
    """Return where the bracket that opens at `begin` closes, None where it does not in its line."""
    depth = 0
    for part in _INSIDE.finditer(text, begin):
        if part[0] == "(":
            depth += 1
        elif part[0] == ")":
            depth -= 1
            if depth == 0:
                return part.start()
        elif part[0] in ("\n", "'"):
            return None
    return None


# Several programs in one text: each but the first after a line '$PROGRAM name, or from a file beside the program.

SECTION = re.compile(r"^[ \t]*'\$PROGRAM[ \t]+\"?(\w+)\"?[ \t]*$", re.IGNORECASE | re.MULTILINE)
SUFFIXES = (".bas", ".inc")
MOST_SECTIONS = 64
_NAMED = re.compile(r"'[^\n]*|\b(?:INCLUDE|RUN)[ \t]*\"(\w+)\"", re.IGNORECASE)
_LINE = re.compile(r"line (\d+): ")


def with_files(text: str, folder: Path) -> str:
    """Return a text with the programs that INCLUDE and RUN name, and that are files beside it, as its last sections.

    Raises:
        InputError: a file that cannot be read or is a link that leaves the folder, or too many of them.
    """
    try:
        files = {path.stem.upper(): path for path in sorted(folder.iterdir()) if path.suffix.lower() in SUFFIXES}
    except OSError:
        # where the folder cannot be read, the programs are reported as missing
        return text
    present = {head[1].upper() for head in SECTION.finditer(text)}
    waiting = _names(text)
    while waiting:
        name = waiting.pop(0)
        if name in present or name not in files:
            continue
        present.add(name)
        if len(present) >= MOST_SECTIONS:
            raise InputError(f"{len(present)} programs: must be at most {MOST_SECTIONS}")
        check_inside(files[name], folder)
        try:
            added = read_text(files[name], errors="replace")
        except OSError as error:
            raise InputError(f"{files[name]}: cannot be read: {error.strerror}") from None
        text = f"{text.rstrip()}\n'$PROGRAM {name}\n{added}"
        waiting += _names(added)
    return text


def _names(text: str) -> list[str]:
    return [place[1].upper() for place in _NAMED.finditer(text) if place[1]]


@contextmanager
def located_errors(text: str) -> Iterator[None]:
    """Add to the line of an error its line in the section where it lies."""
    try:
        yield
    except InputError as error:
        message = str(error)
        line_match = _LINE.match(message)
        heads = [(text.count("\n", 0, head.start()) + 1, head[1].upper()) for head in SECTION.finditer(text)]
        before = [(line, name) for line, name in heads if line_match and line < int(line_match[1])]
        if line_match is None or not before:
            raise
        line, name = before[-1]
        place = f"line {line_match[1]} (line {int(line_match[1]) - line} of {name}): "
        raise InputError(place + message[line_match.end() :]) from None


# characters of a text, a line, a word
LONGEST = 1_000_000
LONGEST_LINE = 4096
LONGEST_WORD = 64
_VERB = re.compile(r"\s*([A-Z_]\w{0,63})[^\S\n]+(?!AXIS\b)[\w\"#(]", re.IGNORECASE)
MAIN = "MAIN"  # name of a program without one


class _Parser(threading.local):
    """The parser of a thread, built when it is first used; it hands what it reads to its builder, without a tree."""

    @cached_property
    def builder(self) -> _Builder:
        return _Builder()

    @cached_property
    def lark(self) -> Lark:
        text = files("gantrysim.controllers.trio.basic").joinpath("grammar.lark").read_text(encoding="utf-8")
        grammar = with_keywords(text.replace("$statements", STATEMENTS.rule))
        return Lark(grammar, parser="lalr", maybe_placeholders=True, transformer=self.builder)

    def parse(self, text: str, source: Source, before: int) -> list[list[Raw]]:
        """Return the statements of a text, line by line, after so many lines; add the variables that it reads."""
        self.builder.source = source
        self.builder.before = before
        try:
            return cast(list[list[Raw]], self.lark.parse(text))
        finally:
            # its statements would be kept in memory until the next text is read
            del self.builder.source


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
    heads = list(SECTION.finditer(text))
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
        source.lines = _parser.parse(without_print_brackets(text.replace("\r", "")) + "\n", source, before)
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
    verb = _VERB.match(lines[line - before - 1]) if 0 < line - before <= len(lines) else None
    if verb is None or verb[1].upper() in known_words():
        return None
    return InputError(f"line {line}: {unknown_word(Reference(verb[1].upper(), None, None, line, verb[1]))}")


class _Builder(Transformer):  # type: ignore[type-arg]
    """Builds statements and expressions from the bottom up.

    Attributes:
        source: the program that is read.
        before: lines before the text.
    """

    source: Source
    before: int

    def __init__(self) -> None:
        super().__init__()
        for kind in STATEMENTS.handlers:
            if not hasattr(self, kind):
                setattr(self, kind, partial(self._statement, kind))
        setattr(self, "if", partial(self._branch, "if"))  # a word of Python

    def _statement(self, kind: str, children: list[Any]) -> Raw:
        """A statement without its keyword, which has the line."""
        return Raw(kind, self.line_of(children[0]), tuple(children[1:]))

    def line_of(self, token: Token) -> int:
        """Line of the whole text in which a token stands."""
        return (token.line or 1) + self.before

    def start(self, children: list[Any]) -> list[list[Raw]]:
        return [line for line in children if isinstance(line, list)]

    def line(self, children: list[Any]) -> list[Raw]:
        """The statements of a line; IFs with a branch in it end with it."""
        if len(children) > 1 and isinstance(children[0], Raw) and getattr(children[1], "type", None) == "COLON":
            children[0] = _label_in(children[0])
        flat: list[Raw] = []
        inline = 0
        for child in children:
            if isinstance(child, Token):
                if child.type == "ELSE":
                    flat.append(Raw("else", self.line_of(child), (), inline > 0))
            elif isinstance(child, Raw):
                flat.append(child)
            else:  # an IF with its branch
                flat += child
                inline += sum(part.inline for part in child)
        return flat + [Raw("endif", flat[-1].line)] * inline if flat else flat

    def elseif(self, children: list[Any]) -> list[Raw]:
        return self._branch("elseif", children)

    def _branch(self, kind: str, children: list[Any]) -> list[Raw]:
        """An IF or ELSEIF, and the statements after it in its line."""
        word, condition, then = children
        branch: list[Raw] = [] if then is None else [then]
        # an IF in the line of this one
        if isinstance(then, list):
            branch = then
        is_inline = kind == "if" and bool(branch)
        return [Raw(kind, self.line_of(word), (condition,), is_inline), *branch]

    def command(self, children: list[Any]) -> Raw:
        return Raw("command", children[0].line, tuple(children))

    def assign_text(self, children: list[Any]) -> Raw:
        return Raw("assign_text", children[0].line)

    def assign(self, children: list[Any]) -> Raw:
        return Raw("assign", children[0].line, tuple(children))

    def text(self, children: list[Any]) -> str:
        return str(children[0])[1:-1]

    def number(self, children: list[Any]) -> tuple[Expression, ...]:
        return tuple(children)

    def character(self, children: list[Any]) -> Spelt:
        return Spelt("CHR", children[0])

    def hexadecimal_item(self, children: list[Any]) -> Spelt:
        return Spelt("HEX", children[1])

    def dim(self, children: list[Any]) -> Raw:
        """DIM: its arrays are known to the expressions that follow."""
        *declared, kind, _ = children[1:]
        for ref in declared:
            if ref.arguments is not None or kind.arguments is not None:
                self.source.arrays.add(ref.name)
        return self._statement("dim", children)

    def ref(self, children: list[Any]) -> Reference:
        name, arguments, bit, place = children
        if len(name) > LONGEST_WORD:
            raise InputError(
                f"line {self.line_of(name)}: word of {len(name)} characters: must have at most {LONGEST_WORD}"
            )
        if isinstance(place, list):
            place, bit = place
        axis = place if isinstance(place, Expression) else None
        process = None if place is None or axis is not None else place[0]
        number = None if bit is None else int(bit[1:])
        word = self.source.corrected_word(name.upper(), self.line_of(name))
        return Reference(word, arguments, axis, self.line_of(name), str(name), process, number)

    def arguments(self, children: list[Any]) -> tuple[Expression, ...]:
        comma = children[-1]
        if comma is not None:
            self.source.remarks.append(
                f"line {self.line_of(comma)}: a comma before a closing bracket, as AN-225 prints it, is a syntax error "
                "on the controller; it is ignored"
            )
        return tuple(child for child in children[:-1] if child is not None)

    def axis(self, children: list[Any]) -> Expression:
        expression: Expression = children[0]
        return expression

    def place_and_bit(self, children: list[Any]) -> list[Any]:
        return children

    def process(self, children: list[Any]) -> tuple[Expression]:
        return (children[0],)

    def joined(self, children: list[Any]) -> Expression:
        return OPERATORS.read(children, self._operation)

    def _operation(self, sign: str, operator: RankedOperator, operands: list[Expression]) -> Expression:
        try:
            return operation(sign, operator, operands)
        except InputError as error:
            raise _located_error(error, self.line_of(cast(Token, sign))) from None

    def decimal(self, children: list[Any]) -> Expression:
        token: Token = children[0]
        value = float(token)
        if math.isinf(value):
            raise InputError(f"line {self.line_of(token)}: number {token[:LONGEST_WORD]}: too large")
        numbers = self.source.numbers
        if value not in numbers:
            numbers[value] = constant(value)
        return numbers[value]

    def hexadecimal(self, children: list[Any]) -> Expression:
        token: Token = children[0]
        try:
            return constant(number_of(str(token), "$"))
        except OverflowError:
            raise InputError(f"line {self.line_of(token)}: number too large") from None

    def value(self, children: list[Any]) -> Expression:
        ref: Reference = children[0]
        try:
            return value_of(ref, self.source)
        except InputError as error:
            raise _located_error(error, ref.line) from None


def _located_error(error: InputError, line: int) -> InputError:
    return InputError(f"line {line}: {error}")


def _label_in(raw: Raw) -> Raw:
    """Return the label that a statement before a colon, at the start of a line, is; or else the statement."""
    if raw.kind == "loop":
        return Raw("loop_or_label", raw.line)
    return Raw("label", raw.line, (raw.data[0].name,)) if _is_label(raw) else raw


def _is_label(raw: Raw) -> bool:
    if raw.kind != "command":
        return False
    ref: Reference = raw.data[0]
    is_word = ref.name in COMMANDS or ref.name in words.KEYWORDS or ref.name in words.NOT_EMULATED
    return ref.arguments is None and ref.axis is None and not is_word
