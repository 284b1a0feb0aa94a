"""Lines of a program as words, assignments and control words."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from gantrysim.base.errors import InputError
from gantrysim.controllers.macro.scanner import (
    FUNCTIONS,
    OPERATORS,
    Grammar,
    Scanner,
    Store,
    Target,
    Value,
    rounded_down,
    rounded_up,
)

Words = list[tuple[str, float]]

LINE_LENGTH = 1000  # characters of a line, which bounds the time and the depth of its expressions
GRAMMAR = Grammar(OPERATORS, {**FUNCTIONS, "FIX": rounded_down, "FUP": rounded_up})
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_PLAIN_WORD = re.compile(r"([A-Z@^$])([-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+))")
_PLAIN_WORDS = re.compile(r"(?:[A-Z][-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+))+")
# most lines of long programs; M and O may order lines
_PLAIN_LINE = re.compile(r"(?:[A-LNP-Z][-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[ \t]*)+")
_LABEL = re.compile(r"O(<[^<>]*>|[0-9]+)")
_COMMAND = re.compile(r"[A-Z_][A-Z_]+[A-Z0-9_]*")
_MESSAGE = re.compile(r"(?:N[0-9]+)?M[0-9]+")
_FLAGS = re.compile(r"(?!(?:N[0-9]+)?G0*[0-3](?![0-9.]))(?:[A-Z](?:[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+))?)+")
_BARE_LETTER = re.compile(r"[A-Z](?![-+.0-9])")
# commands to a sender or to grbl: $H, $X, $30=1000, ?, !, ~; elsewhere $ and a number are a word of a spindle
_SENDER = re.compile(r"\$(?:[A-Z$#]|[0-9]+=|$)|[?!~]")


class FirmwareCommand(NamedTuple):
    """A command of printers' firmware that has a name, as SET_VELOCITY_LIMIT, and its arguments as written."""

    name: str
    arguments: str


@dataclass(frozen=True)
class Keywords:
    """The words that may follow the label of an O word.

    Attributes:
        names: in the order in which a message lists them.
        conditions: those with exactly one value in brackets.
    """

    names: tuple[str, ...]
    conditions: frozenset[str]

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """Regular expression of a keyword, the longest first: ELSEIF is not read as ELSE."""
        return re.compile("|".join(sorted(self.names, key=len, reverse=True)))


@dataclass(frozen=True)
class ParsedLine:
    """A line with parameters or control words.

    Attributes:
        words: letters and values.
        settings: parameters that the line sets after its values are taken.
        label: of an O word, a name or number, or the value that computes it; None without.
        keyword: of the O word; empty for a label alone.
        arguments: of the keyword.
    """

    words: tuple[tuple[str, Value], ...] = ()
    settings: tuple[tuple[Target, Value], ...] = ()
    label: str | Value | None = None
    keyword: str = ""
    arguments: tuple[Value, ...] = field(default=())

    def evaluated(self, store: Store) -> Words:
        """Return the words with their values."""
        words = [(letter, value(store)) for letter, value in self.words]
        for letter, number in words:
            if not math.isfinite(number):
                raise InputError(f"{letter} = {number:g}: must be finite")
        return words


def compact(line: str) -> str:
    """Return a line in capitals, without comments, spaces and control characters."""
    if len(line) > LINE_LENGTH:
        raise InputError(f"line of {len(line)} characters: must be at most {LINE_LENGTH}")
    if "(" in line or ";" in line:
        line = _COMMENT.sub("", line)
        if "(" in line or ")" in line:
            raise InputError("comment: must begin with ( and end with ), without another inside")
    return "".join(line.split()).upper()


def sender_command(text: str) -> FirmwareCommand | None:
    """Return a line that is for a sender or for grbl's settings, which does not move; None for any other line."""
    match = _SENDER.match(text)
    return FirmwareCommand(match[0].rstrip("="), text[match.end() :]) if match else None


def read_firmware(line: str) -> str | FirmwareCommand:
    """Return a line as printers' firmware reads it: a command with a name, or compact as `compact` does.

    Messages and checksums do not count, nor do letters without a number, as the axes of G28 X Y. Comments are in
    parentheses or follow a semicolon; one that is not closed ends with its line.
    """
    text = _COMMENT.sub("", line).strip().upper()
    if len(text) > LINE_LENGTH:
        raise InputError(f"line of {len(text)} characters: must be at most {LINE_LENGTH}")
    command = sender_command(text)
    if command is not None:
        return command
    name = _COMMAND.match(text)
    if name:
        return FirmwareCommand(name[0], text[name.end() :].strip())
    if "(" in text or ")" in text:
        text = text.split("(", 1)[0].replace(")", "")
    plain = "".join(text.split("*", 1)[0].split())
    if _PLAIN_WORDS.fullmatch(plain):
        return plain
    message = _MESSAGE.match(plain)
    if message:
        return message[0]
    return _BARE_LETTER.sub("", plain) if _FLAGS.fullmatch(plain) else plain


def plain_line(line: str) -> Words | None:
    """Return the words of a line of nothing but words and spaces between them, none of them M or O; None for any other.

    They are those that `plain_words` finds after `compact` or `read_firmware`.
    """
    if len(line) > LINE_LENGTH or not _PLAIN_LINE.fullmatch(line):
        return None
    return [(letter, float(number)) for letter, number in _PLAIN_WORD.findall(line)]


def plain_words(text: str) -> Words | None:
    """Return the words of a compact line of letters and numbers; None for any other line."""
    if not _PLAIN_WORDS.fullmatch(text):
        return None
    return [(letter, float(number)) for letter, number in _PLAIN_WORD.findall(text)]


def statement(text: str, keywords: Keywords) -> ParsedLine:
    """Return a compact line as a statement.

    Raises:
        InputError: a line that is none.
    """
    scanner = Scanner(text, GRAMMAR)
    if scanner.take("N"):
        scanner.value("N")
    if scanner.remaining[:1] == "O":
        return _control(scanner, keywords)
    words: list[tuple[str, Value]] = []
    settings: list[tuple[Target, Value]] = []
    while scanner.remaining:
        if scanner.take("#"):
            target = scanner.target()
            if not scanner.take("="):
                raise InputError(f"{scanner.quoted_rest}: a parameter at the start of a word must be followed by =")
            settings.append((target, scanner.value("=")))
            continue
        letter = scanner.remaining[0]
        if not ("A" <= letter <= "Z" or letter in "@^$"):
            expressions = "; expressions stand in brackets, as [1+2]" if letter in "+-*/]" else ""
            raise InputError(f"{scanner.quoted_rest}: must begin with a letter or #{expressions}")
        scanner.position += 1
        words.append((letter, scanner.value(letter)))
    return ParsedLine(tuple(words), tuple(settings))


def label_of(text: str, keywords: Keywords) -> tuple[str, str] | None:
    """Return the label and the keyword of a compact line that begins with an O word; None for any other."""
    label = _LABEL.search(text)
    if not label:
        return None
    keyword = keywords.pattern.match(text, label.end())
    return _key(label[1]), keyword[0] if keyword else ""


def _key(text: str) -> str:
    return text[1:-1].lower() if text.startswith("<") else text.lstrip("0") or "0"


def _control(scanner: Scanner, keywords: Keywords) -> ParsedLine:
    written = scanner.match(_LABEL)
    if written:
        label: str | Value = _key(written[1])
    else:
        scanner.take("O")
        label = scanner.value("O")
    match = scanner.match(keywords.pattern)
    keyword = match[0] if match else ""
    arguments: list[Value] = []
    while scanner.remaining.startswith("["):
        arguments.append(scanner.value(keyword))
    if scanner.remaining:
        known = ", ".join(keywords.names).lower()
        raise InputError(f"O word: {scanner.quoted_rest}: must be one of {known}, and then only values in brackets")
    if keyword in keywords.conditions and len(arguments) != 1:
        raise InputError(f"{keyword.lower()}: must have one condition or number in brackets")
    return ParsedLine(label=label, keyword=keyword, arguments=tuple(arguments))
