"""Entry point of the command; handles signals while its modules are still being imported."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from types import TracebackType

from gantrysim.base import signals
from gantrysim.cli.streams import open_streams

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
