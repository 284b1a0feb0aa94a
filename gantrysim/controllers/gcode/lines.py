"""Lines of a program as words, assignments and control words."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.expressions import Scanner, Store, Target, Value

Words = list[tuple[str, float]]

LONGEST = 1000  # characters of a line
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_PLAIN_WORD = re.compile(r"([A-Z@^$])([-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+))")
_PLAIN = re.compile(r"(?:[A-Z][-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+))+")
_KEYWORD = re.compile(r"SUB|ENDSUB|RETURN|CALL|IF|ELSEIF|ELSE|ENDIF|WHILE|ENDWHILE|DO|REPEAT|ENDREPEAT|BREAK|CONTINUE")
_LABEL = re.compile(r"O(<[^<>]*>|[0-9]+)")
_MACRO = re.compile(r"[A-Z_][A-Z_]+[A-Z0-9_]*")
_MESSAGE = re.compile(r"(?:N[0-9]+)?M[0-9]+")
CONDITIONS = {"IF", "ELSEIF", "WHILE", "REPEAT"}


@dataclass(frozen=True)
class Statement:
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
        found = [(letter, value(store)) for letter, value in self.words]
        for letter, number in found:
            if not math.isfinite(number):
                raise InputError(f"{letter} = {number:g}: must be finite")
        return found


def compact(line: str) -> str:
    """Return a line in capitals, without comments, spaces and control characters."""
    if len(line) > LONGEST:
        raise InputError(f"line of {len(line)} characters: must be at most {LONGEST}")
    if "(" in line or ";" in line:
        line = _COMMENT.sub("", line)
        if "(" in line or ")" in line:
            raise InputError("comment: must begin with ( and end with ), without another inside")
    return "".join(line.split()).upper()


def compact_firmware(line: str, ignored: Counter[str]) -> str:
    """Return a line as printers' firmware reads it: macros, messages and checksums do not count.

    Args:
        line: of the program.
        ignored: to which macros are added, by name.
    """
    text = line.split(";", 1)[0].strip().upper()
    if len(text) > LONGEST:
        raise InputError(f"line of {len(text)} characters: must be at most {LONGEST}")
    macro = _MACRO.match(text)
    if macro:
        ignored[macro[0]] += 1
        return ""
    plain = "".join(text.split("*", 1)[0].split())
    message = _MESSAGE.match(plain)
    return message[0] if message and not _PLAIN.fullmatch(plain) else plain


def plain_words(text: str) -> Words | None:
    """Return the words of a compact line of letters and numbers; None for any other line."""
    if not _PLAIN.fullmatch(text):
        return None
    return [(letter, float(number)) for letter, number in _PLAIN_WORD.findall(text)]


def statement(text: str) -> Statement:
    """Return a compact line as a statement.

    Raises:
        InputError: a line that is none.
    """
    scanner = Scanner(text)
    if text[:1] == "N":
        scanner.at = 1
        scanner.value("N")
    if scanner.rest[:1] == "O":
        return _control(scanner)
    words: list[tuple[str, Value]] = []
    settings: list[tuple[Target, Value]] = []
    while scanner.rest:
        if scanner.take("#"):
            target = scanner.target()
            if not scanner.take("="):
                raise InputError(f"{scanner.rest[:12]!r}: a parameter at the start of a word must be followed by =")
            settings.append((target, scanner.value("=")))
            continue
        letter = scanner.rest[0]
        if not ("A" <= letter <= "Z" or letter in "@^$"):
            raise InputError(f"{scanner.rest[:12]!r}: must begin with a letter or #")
        scanner.at += 1
        words.append((letter, scanner.value(letter)))
    return Statement(tuple(words), tuple(settings))


def label_of(text: str) -> tuple[str, str] | None:
    """Return the label and the keyword of a compact line that begins with an O word; None for any other."""
    found = _LABEL.search(text)
    if not found:
        return None
    keyword = _KEYWORD_LONGEST.match(text, found.end())
    return _key(found[1]), keyword[0] if keyword else ""


_KEYWORD_LONGEST = re.compile("|".join(sorted(_KEYWORD.pattern.split("|"), key=len, reverse=True)))


def _key(text: str) -> str:
    return text[1:-1].lower() if text.startswith("<") else text.lstrip("0") or "0"


def _control(scanner: Scanner) -> Statement:
    label: str | Value
    found = _LABEL.match(scanner.text, scanner.at)
    if found:
        label = _key(found[1])
        scanner.at = found.end()
    else:
        scanner.at += 1
        label = scanner.value("O")
    word = _KEYWORD_LONGEST.match(scanner.text, scanner.at)
    keyword = word[0] if word else ""
    scanner.at += len(keyword)
    arguments: list[Value] = []
    while scanner.rest.startswith("["):
        arguments.append(scanner.value(keyword))
    if scanner.rest:
        known = ", ".join(_KEYWORD.pattern.lower().split("|"))
        raise InputError(f"O word: {scanner.rest[:12]!r}: must be one of {known}, and then only values in brackets")
    if keyword in CONDITIONS and len(arguments) != 1:
        raise InputError(f"{keyword.lower()}: must have one condition or number in brackets")
    return Statement(label=label, keyword=keyword, arguments=tuple(arguments))
