"""Entry point of the command; handles signals while its modules are still being imported."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from types import TracebackType
from typing import Any, TextIO

from gantrysim.base import signals

# Standard output and error whose reader may go away, which may be closed, or lead to a full disk.

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
            # takes the lowest number that is free
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _guarded_stream(1, sys.stdout)
    sys.stderr = _guarded_stream(_ERRORS, sys.stderr)


def _guarded_stream(number: int, stream: TextIO | None) -> TextIO:
    """Return a guarded stream; one of a terminal stays as it is."""
    if stream is not None and stream.isatty():
        return stream
    raw = _Stream(number, "w", closefd=False)
    encoding = "utf-8" if stream is None else stream.encoding
    errors = None if stream is None else stream.errors
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, errors, line_buffering=number == _ERRORS)


_left = ": nothing is written"  # as long as modules are being imported
_BAD_INPUT = 2  # as in gantrysim.cli.terminal, which is slow to import


def main() -> None:
    """Run the command."""
    sys.excepthook = last_words
    # the matrices are small: threads would only wait for one another, a thousand times as long on busy cores
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # of processes that this one starts, such as a study's workers: they import nothing from the working folder either
    os.environ["PYTHONSAFEPATH"] = "1"
    with signals.ending_at_once():
        open_streams()
        from gantrysim.cli.main import main
    signals.heed()

    global _left
    _left = ""
    try:
        main()
    finally:
        signals.leave()


def last_words(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Report an interrupt or an invalid MUJOCO_GL in one line, as `sys.excepthook`; leave the rest to Python's own.

    Raises:
        SystemExit: with the exit status of the command.
    """
    # an interrupted import may raise an error of its own
    if any(isinstance(cause, KeyboardInterrupt) for cause in _causes(error)):
        print(f"interrupted{_left}", file=sys.stderr)
        raise SystemExit(signals.status())
    if isinstance(error, RuntimeError) and "MUJOCO_GL" in str(error):
        name = str(error).rpartition(": ")[2]
        print(f"error: MUJOCO_GL = {name}: must be egl, osmesa, off or unset", file=sys.stderr)
        raise SystemExit(_BAD_INPUT)
    sys.__excepthook__(kind, error, trace)


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
