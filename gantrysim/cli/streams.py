"""Standard output and error whose reader may go away, which may be closed, or lead to a full disk."""

from __future__ import annotations

import io
import os
import sys
from typing import Any, TextIO

_ERRORS = 2  # number of the standard error


class _Stream(io.FileIO):
    """A standard stream: once it cannot be written, what follows goes nowhere, and the command goes on.

    A reader that has read enough, such as `head`, is no failure; and nobody could read that the standard error fails.
    """

    def write(self, content: Any) -> int | None:  # type: ignore[override]
        """Write bytes, as FileIO does.

        Raises:
            GantryError: the standard output cannot be written, as on a full disk.
        """
        try:
            return super().write(content)
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if isinstance(error, BrokenPipeError) or self.fileno() == _ERRORS:
                return len(content)
            from gantrysim.base.errors import GantryError  # slow to import

            raise GantryError(f"standard output: cannot be written: {error.strerror}") from None


def open_streams() -> None:
    """Open standard streams that are closed, so that no file takes their numbers, and guard output and error."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    sys.stdout = _guarded(1, sys.stdout)
    sys.stderr = _guarded(_ERRORS, sys.stderr)


def _guarded(number: int, stream: TextIO | None) -> TextIO:
    """Return a guarded stream; one of a terminal stays as it is."""
    if stream is not None and stream.isatty():
        return stream
    raw = _Stream(number, "w", closefd=False)
    encoding = "utf-8" if stream is None else stream.encoding
    errors = None if stream is None else stream.errors
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, errors, line_buffering=number == _ERRORS)
