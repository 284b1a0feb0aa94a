"""Entry point of the command; handles an interrupt while its modules are still being imported."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import TracebackType

_BAD_INPUT, _INTERRUPTED = 2, 130  # as in gantrysim.cli.terminal, which is slow to import


def main() -> None:
    """Run the command."""
    sys.excepthook = last_words
    from gantrysim.cli.main import main

    main()


def last_words(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Report Ctrl-C and an invalid MUJOCO_GL in one line, as `sys.excepthook`; leave the rest to Python's own hook.

    Raises:
        SystemExit: with the exit status of the command.
    """
    # an interrupted import may raise an error of its own
    if any(isinstance(each, KeyboardInterrupt) for each in _causes(error)):
        print("interrupted: nothing is written", file=sys.stderr)
        raise SystemExit(_INTERRUPTED)
    if isinstance(error, RuntimeError) and "MUJOCO_GL" in str(error):
        name = str(error).rpartition(": ")[2]
        print(f"error: MUJOCO_GL = {name}: must be egl, osmesa, off or unset", file=sys.stderr)
        raise SystemExit(_BAD_INPUT)
    sys.__excepthook__(kind, error, trace)


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
