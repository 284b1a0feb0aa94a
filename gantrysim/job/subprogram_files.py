"""Subprograms of a G-code program in files beside it."""

from __future__ import annotations

import re
from pathlib import Path

from gantrysim.base.input_files import check_inside
from gantrysim.base.toml_files import read_text

_CALL = re.compile(r"\bO\s*(?:<([^<>\n]+)>|(\d+))\s*CALL|(?:\bM\s*98|\bG\s*65)[^\n;(]*?P\s*(\d+)", re.IGNORECASE)
_LONGEST_NUMBER = 4  # digits of a program's number; those before are repetitions
_COMMENT = re.compile(r"\([^()\n]*\)|;.*")
_SUFFIXES = (".ngc", ".nc", ".tap", ".cnc", ".eia", ".txt", ".mpf", "")
_MOST = 200  # files


def subprogram_files(text: str, folder: Path) -> dict[str, str]:
    """Return the texts of the subprograms that a program calls and that lie in files beside it, by their names.

    Args:
        text: of the program.
        folder: of its file. A name is never looked for in another folder.

    Raises:
        InputError: a file that is too long, or a link that leaves the folder.
    """
    texts: dict[str, str] = {}
    missing = _called(text)
    looked_for: set[str] = set()
    while missing and len(texts) < _MOST:
        name = missing.pop()
        looked_for.add(name)
        file = _file(name, folder)
        if file is None:
            continue
        texts[name] = read_text(file, errors="replace")
        missing |= _called(texts[name]) - looked_for
    return dict(sorted(texts.items()))


def _called(text: str) -> set[str]:
    """Return the names that O words call and the numbers that M98 and G65 do."""
    if "98" not in text and "65" not in text and "call" not in text.lower():
        return set()
    names = {"".join(match).strip().lower() for match in _CALL.findall(_COMMENT.sub("", text))}
    # FANUC puts the repetitions before the number
    return names | {name[-_LONGEST_NUMBER:].lstrip("0") or "0" for name in names if name.isdigit()}


def _file(name: str, folder: Path) -> Path | None:
    if Path(name).name != name:
        return None
    # a number is written as a file's name with or without its zeros
    names = (name, str(int(name)), f"{int(name):04}", f"O{int(name):04}") if name.isdigit() else (name,)
    for file_name in names:
        for suffix in _SUFFIXES:
            file = folder / f"{file_name}{suffix}"
            if file.is_file():
                check_inside(file, folder)
                return file
    return None
