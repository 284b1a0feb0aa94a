"""The first lines of the command: how it ends while its modules are still being imported, which takes a second."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import TracebackType

_BAD_INPUT, _INTERRUPTED = 2, 130  # as in gantrysim.cli.terminal, which imports too much


def main() -> None:
    """Run the command."""
    sys.excepthook = last_words
    from gantrysim.cli.main import main

    main()


def last_words(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print in one line what ended the process, as `sys.excepthook`: Ctrl-C, or a MUJOCO_GL that MuJoCo does not know.

    Raises:
        SystemExit: with the command's exit status; everything else is left to Python's own hook.
    """
    # an import that an interrupt ends may raise an error of its own
    if any(isinstance(each, KeyboardInterrupt) for each in _causes(error)):
        print("interrupted: nothing is written", file=sys.stderr)
        raise SystemExit(_INTERRUPTED)
    if isinstance(error, RuntimeError) and "MUJOCO_GL" in str(error):
        name = str(error).rpartition(": ")[2]
        print(f"error: MUJOCO_GL = {name}: must be egl, osmesa or off, or not be set", file=sys.stderr)
        raise SystemExit(_BAD_INPUT)
    sys.__excepthook__(kind, error, trace)


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
