"""Opening the files of a user for reading: only regular ones, as others may have no end, or never begin."""

from __future__ import annotations

import os
import stat
from io import BufferedReader
from pathlib import Path

from gantrysim.base.errors import InputError

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def check_regular(file: Path, label: str = "") -> None:
    """Raise InputError where a file exists and is no regular one; a missing file passes.

    Args:
        file: to be read.
        label: of the file in the error; its path by default.
    """
    try:
        mode = file.stat().st_mode
    except OSError:  # opening it reports the reason
        return
    _check_mode(mode, label or str(file))


def check_inside(file: Path, folder: Path) -> None:
    """Raise InputError where a file in a folder is a link that leaves it: results that are sent on hold its text."""
    target = file.resolve()
    if not target.is_relative_to(folder.resolve()):
        raise InputError(f"{file}: is a link to {target}, outside the folder: put a copy of the file in its place")


def opened_file(file: Path, label: str = "") -> BufferedReader:
    """Return a regular file, open for reading.

    Args:
        file: to be read.
        label: of the file in the error; its path by default.

    Raises:
        InputError: a folder, a pipe, a socket or a device.
        OSError: a file that cannot be opened.
    """
    # without O_NONBLOCK the call would wait for a writer of a named pipe; regular files ignore it
    number = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        _check_mode(os.fstat(number).st_mode, label or str(file))
    except InputError:
        os.close(number)
        raise
    return os.fdopen(number, "rb")


def _check_mode(mode: int, label: str) -> None:
    for is_kind, name in _KINDS:
        if is_kind(mode):
            raise InputError(f"{label}: is {name}: must be a regular file")
