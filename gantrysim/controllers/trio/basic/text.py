"""Parser of Trio BASIC: a text becomes programs, and each of them lines of statements, not yet joined to blocks.

`read` cuts the text at its lines '$PROGRAM, and reads one program after the other. The grammar gives the brackets of a
PRINT(...) another meaning than people do who write them, so they are taken out first. Then lark's parser hands what it
recognises to `_Builder`, from the words upwards, which makes statements and expressions of it.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property, partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple, cast

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

# all statements of Trio BASIC with a syntax of their own
STATEMENTS = Statements.of(statements.statement, flow.statement)

# largest numbers of characters: of a text, a line, a word
TEXT_LENGTH = 1_000_000
LONGEST_LINE = 4096
LONGEST_WORD = 64

# the line before each program of a text but the first
SECTION = re.compile(r"^[ \t]*'\$PROGRAM[ \t]+\"?(\w+)\"?[ \t]*$", re.IGNORECASE | re.MULTILINE)
MOST_SECTIONS = 64
# name of the program before the first such line
MAIN = "MAIN"
# of files with programs
SUFFIXES = (".bas", ".inc")

# the first word of a line, followed by what no variable can be followed by: a blank, and an operand
_VERB = re.compile(r"\s*([A-Z_]\w{0,63})[^\S\n]+(?!AXIS\b)[\w\"#(]", re.IGNORECASE)


def read(text: str) -> list[Source]:
    """Return the programs of a text; each but the first begins with a line '$PROGRAM name.

    Raises:
        InputError: the text breaks the grammar, or uses a word that is unknown.
    """
    _check_size(text)
    sources: list[Source] = []
    for name, start, end in _sections(text):
        source = _source(name, text[start:end], text.count("\n", 0, start))
        # the text may begin with a line '$PROGRAM, so that nothing is before it
        if source.lines or name != MAIN:
            sources.append(source)
    if len({source.name for source in sources}) < len(sources):
        raise InputError("two programs have one name: every '$PROGRAM must have its own")
    if not sources:
        raise InputError("program without a statement: must have at least one")
    return sources


def _check_size(text: str) -> None:
    if len(text) > TEXT_LENGTH:
        raise InputError(f"program of {len(text)} characters: must have at most {TEXT_LENGTH}")
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > LONGEST_LINE:
            raise InputError(f"line {number}: {len(line)} characters: must have at most {LONGEST_LINE}")
    count = len(SECTION.findall(text))
    if count > MOST_SECTIONS:
        raise InputError(f"{count} programs: must be at most {MOST_SECTIONS}")


def _sections(text: str) -> Iterator[tuple[str, int, int]]:
    """Yield name, begin and end of each program of a text."""
    name = MAIN
    begin = 0
    for head in SECTION.finditer(text):
        yield name, begin, head.start()
        name = head[1].upper()
        begin = head.end()
    yield name, begin, len(text)


def _source(name: str, text: str, before: int) -> Source:
    """Return a program, given its text and the number of lines before it."""
    source = Source(name)
    try:
        source.lines = _parser.parse(without_print_brackets(text.replace("\r", "")) + "\n", source, before)
    except UnexpectedToken as error:
        line = before + (error.line if isinstance(error.line, int) and error.line > 0 else 1)
        raise _misspelt(text, before, line) or _syntax_error(error.token, line) from None
    except UnexpectedCharacters as error:
        raise InputError(f"line {before + error.line}: syntax error, {error.char!r} unexpected") from None
    except UnexpectedEOF:
        raise InputError("syntax error: the text ends too early") from None
    return source


def _syntax_error(token: Token, line: int) -> InputError:
    if token.type in ("_NL", "$END"):
        return InputError(f"line {line}: syntax error, the line ends too early")
    return InputError(f"line {line}: syntax error, {str(token)[:LONGEST_WORD]!r} unexpected")


def _misspelt(text: str, before: int, line: int) -> InputError | None:
    """Return the error for a line whose first word is a command that nobody knows; None for another line."""
    lines = text.split("\n")
    number = line - before
    if not 0 < number <= len(lines):
        return None
    verb = _VERB.match(lines[number - 1])
    if verb is None or verb[1].upper() in known_words():
        return None
    return InputError(f"line {line}: {unknown_word(Reference(verb[1].upper(), None, None, line, verb[1]))}")


# Lines of an error. An error names the line of the whole text; where the text has several programs, people count from
# the beginning of the one in which it lies.

_LINE = re.compile(r"line (\d+): ")


@contextmanager
def located_errors(text: str) -> Iterator[None]:
    """Add to the line of an error its line in the section where it lies."""
    try:
        yield
    except InputError as error:
        message = str(error)
        prefix = _LINE.match(message)
        section = None if prefix is None else _section_before(text, int(prefix[1]))
        if prefix is None or section is None:
            raise
        name, head_line = section
        line = int(prefix[1])
        place = f"line {line} (line {line - head_line} of {name}): "
        raise InputError(place + message[prefix.end() :]) from None


def _section_before(text: str, line: int) -> tuple[str, int] | None:
    """Return the name of the section in which a line lies and the line of its head, None before the first."""
    section = None
    for head in SECTION.finditer(text):
        head_line = text.count("\n", 0, head.start()) + 1
        if head_line >= line:
            break
        section = (head[1].upper(), head_line)
    return section


# Programs in files beside the text: INCLUDE and RUN name them, and they become its last sections.

# a comment, or a statement that names a program
_NAMED_PROGRAM = re.compile(r"'[^\n]*|\b(?:INCLUDE|RUN)[ \t]*\"(\w+)\"", re.IGNORECASE)


def with_files(text: str, folder: Path) -> str:
    """Return a text with the programs that INCLUDE and RUN name, and that are files beside it, as its last sections.

    Raises:
        InputError: a file that cannot be read or is a link that leaves the folder, or too many of them.
    """
    try:
        beside = {path.stem.upper(): path for path in sorted(folder.iterdir()) if path.suffix.lower() in SUFFIXES}
    except OSError:
        # where the folder cannot be read, the programs are reported as missing
        return text
    present = {head[1].upper() for head in SECTION.finditer(text)}
    waiting = _named_programs(text)
    while waiting:
        name = waiting.pop(0)
        if name in present or name not in beside:
            continue
        present.add(name)
        if len(present) >= MOST_SECTIONS:
            raise InputError(f"{len(present)} programs: must be at most {MOST_SECTIONS}")
        check_inside(beside[name], folder)
        try:
            added = read_text(beside[name], errors="replace")
        except OSError as error:
            raise InputError(f"{beside[name]}: cannot be read: {error.strerror}") from None
        text = f"{text.rstrip()}\n'$PROGRAM {name}\n{added}"
        # an included program may name others
        waiting += _named_programs(added)
    return text


def _named_programs(text: str) -> list[str]:
    return [match[1].upper() for match in _NAMED_PROGRAM.finditer(text) if match[1]]


# PRINT(...) as people write it: brackets about all that a PRINT shows, which mean nothing.

# whether a text has any, which most have not
_PRINT_BRACKET = re.compile(r"PRINT[ \t]*\(", re.IGNORECASE)
# a string or a comment, within which PRINT( is text, or the bracket after a PRINT
_STRING_OR_COMMENT_OR_PRINT = re.compile(
    r"\"[^\"\n]*\"|'[^\n]*|\bREM\b[^\n]*|(?P<print>\bPRINT[ \t]*)\(", re.IGNORECASE
)
# a string, a bracket, or what ends the part of a line in which brackets count
_STRING_OR_BRACKET_OR_END = re.compile(r"\"[^\"\n]*\"|[()\n']")
_END_OF_STATEMENT = re.compile(r"[ \t]*(?:$|[:\n']|REM\b|ELSE\b)", re.IGNORECASE)


def without_print_brackets(text: str) -> str:
    """Return a text in which blanks replace the brackets about everything that a PRINT shows."""
    if not _PRINT_BRACKET.search(text):
        return text
    characters = list(text)
    for match in _STRING_OR_COMMENT_OR_PRINT.finditer(text):
        if match["print"] is None:
            continue
        opening = match.end() - 1
        closing = _closing_bracket(text, opening)
        # PRINT (a) + b has brackets about a part alone, which mean what they mean elsewhere
        if closing is not None and _END_OF_STATEMENT.match(text, closing + 1):
            characters[opening] = " "
            characters[closing] = " "
    return "".join(characters)


def _closing_bracket(text: str, opening: int) -> int | None:
    """Return where a bracket closes that opens at a place, None where it does not in its line."""
    depth = 0
    for match in _STRING_OR_BRACKET_OR_END.finditer(text, opening):
        if match[0] == "(":
            depth += 1
        elif match[0] == ")":
            depth -= 1
            if depth == 0:
                return match.start()
        elif match[0] in ("\n", "'"):
            return None
    return None


# The parser.


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


class _OfProcess(NamedTuple):
    """PROC() behind a word."""

    process: Expression


class _PlaceAndBit(NamedTuple):
    """AXIS() or PROC() behind a word, and the bit behind that."""

    place: Expression | _OfProcess
    bit: Token


class _Builder(Transformer):  # type: ignore[type-arg]
    """Builds statements and expressions from the bottom up.

    lark calls the method named like a rule of grammar.lark, or like one of its alternatives, with what was made of the
    parts of the rule: tokens of the text, what other methods have returned, and None for a part that is left out.

    Attributes:
        source: the program that is read.
        before: lines before the text.
    """

    source: Source
    before: int

    def __init__(self) -> None:
        super().__init__()
        # most statements are kept as they stand
        for kind in STATEMENTS.handlers:
            if not hasattr(self, kind):
                setattr(self, kind, partial(self._statement, kind))
        # no method can have this name, a word of Python
        setattr(self, "if", partial(self._branch, "if"))

    def line_of(self, token: Token) -> int:
        """Line of the whole text in which a token stands."""
        return (token.line or 1) + self.before

    # lines

    def start(self, children: list[Any]) -> list[list[Raw]]:
        return [line for line in children if isinstance(line, list)]

    def line(self, children: list[Any]) -> list[Raw]:
        """The statements of a line; IFs with a branch in it end with it."""
        if len(children) > 1 and isinstance(children[0], Raw) and getattr(children[1], "type", None) == "COLON":
            children[0] = _label_in(children[0])
        in_line: list[Raw] = []
        open_ifs = 0
        for child in children:
            if isinstance(child, Token):
                if child.type == "ELSE":
                    in_line.append(Raw("else", self.line_of(child), (), open_ifs > 0))
            elif isinstance(child, Raw):
                in_line.append(child)
            else:
                # an IF or ELSEIF, followed by its branch
                in_line += child
                open_ifs += sum(statement.inline for statement in child)
        if open_ifs:
            in_line += [Raw("endif", in_line[-1].line)] * open_ifs
        return in_line

    # statements

    def _statement(self, kind: str, children: list[Any]) -> Raw:
        """A statement without its keyword, which has the line."""
        return Raw(kind, self.line_of(children[0]), tuple(children[1:]))

    def elseif(self, children: list[Any]) -> list[Raw]:
        return self._branch("elseif", children)

    def _branch(self, kind: str, children: list[Any]) -> list[Raw]:
        """An IF or ELSEIF, and the statements after it in its line."""
        keyword, condition, then = children
        if then is None:
            branch: list[Raw] = []
        elif isinstance(then, list):
            # another IF in the line of this one
            branch = then
        else:
            branch = [then]
        is_inline = kind == "if" and bool(branch)
        return [Raw(kind, self.line_of(keyword), (condition,), is_inline), *branch]

    def command(self, children: list[Any]) -> Raw:
        return Raw("command", children[0].line, tuple(children))

    def assign(self, children: list[Any]) -> Raw:
        return Raw("assign", children[0].line, tuple(children))

    def assign_text(self, children: list[Any]) -> Raw:
        return Raw("assign_text", children[0].line)

    def dim(self, children: list[Any]) -> Raw:
        """DIM: its arrays are known to the expressions that follow."""
        *declared, kind, _ = children[1:]
        for ref in declared:
            if ref.arguments is not None or kind.arguments is not None:
                self.source.arrays.add(ref.name)
        return self._statement("dim", children)

    # what a PRINT shows

    def text(self, children: list[Any]) -> str:
        """A string, without its quotation marks."""
        return str(children[0])[1:-1]

    def number(self, children: list[Any]) -> tuple[Expression, ...]:
        """A number, and the width and digits with which it is printed, as far as they are given."""
        return tuple(children)

    def character(self, children: list[Any]) -> Spelt:
        return Spelt("CHR", children[0])

    def hexadecimal_item(self, children: list[Any]) -> Spelt:
        return Spelt("HEX", children[1])

    # words, with what belongs to them

    def ref(self, children: list[Any]) -> Reference:
        name, arguments, bit, place = children
        line = self.line_of(name)
        if len(name) > LONGEST_WORD:
            raise InputError(f"line {line}: word of {len(name)} characters: must have at most {LONGEST_WORD}")
        if isinstance(place, _PlaceAndBit):
            bit = place.bit
            place = place.place
        return Reference(
            name=self.source.corrected_word(name.upper(), line),
            arguments=arguments,
            axis=place if isinstance(place, Expression) else None,
            line=line,
            spelled=str(name),
            process=place.process if isinstance(place, _OfProcess) else None,
            # behind its point
            bit=None if bit is None else int(bit[1:]),
        )

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

    def process(self, children: list[Any]) -> _OfProcess:
        return _OfProcess(children[0])

    def place_and_bit(self, children: list[Any]) -> _PlaceAndBit:
        return _PlaceAndBit(*children)

    # expressions

    def joined(self, children: list[Any]) -> Expression:
        """Values with operators between them, which the grammar does not rank."""
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
        # a number that stands in a program many times is one expression
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
        # LOOP ends a DO, or is the name of a label: what is open tells
        return Raw("loop_or_label", raw.line)
    return Raw("label", raw.line, (raw.data[0].name,)) if _is_label(raw) else raw


def _is_label(raw: Raw) -> bool:
    """Return whether a statement is a name alone that is no word of the language."""
    if raw.kind != "command":
        return False
    ref: Reference = raw.data[0]
    is_word = ref.name in COMMANDS or ref.name in words.KEYWORDS or ref.name in words.NOT_EMULATED
    return ref.arguments is None and ref.axis is None and not is_word
