"""Several programs in one text: each but the first after a line '$PROGRAM name, or from a file beside the program."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gantrysim.base.errors import InputError
from gantrysim.base.input_files import check_inside
from gantrysim.base.toml_files import read_text

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
        return text  # where the folder cannot be read, the programs are reported as missing
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
def located(text: str) -> Iterator[None]:
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
