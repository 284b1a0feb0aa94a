"""What the command says where it ends while its modules are still imported: a second in which `cli.main` has not begun.

In programs of others that import gantrysim nothing is changed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType

__all__ = ["is_command", "last_words"]

_BAD_INPUT, _INTERRUPTED = 2, 130  # as in gantrysim.terminal, which imports too much


def is_command(arguments: Sequence[str], original: Sequence[str]) -> bool:
    """Return whether this process is the command, given its `sys.argv` and `sys.orig_argv`."""
    if not arguments:
        return False
    return Path(arguments[0]).stem == "gantrysim" or (arguments[0] == "-m" and "gantrysim" in original)


def last_words(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Say in one line what ended the process, as `sys.excepthook`: Ctrl-C, or a MUJOCO_GL that MuJoCo does not know.

    Raises:
        SystemExit: with the command's exit status; everything else is left to Python's own hook.
    """
    # an import that fails by an interrupt may have become an error of its own
    if any(isinstance(each, KeyboardInterrupt) for each in _chain(error)):
        print("interrupted: nothing is written", file=sys.stderr)
        raise SystemExit(_INTERRUPTED)
    if isinstance(error, RuntimeError) and "MUJOCO_GL" in str(error):
        name = str(error).rpartition(": ")[2]
        print(f"error: MUJOCO_GL = {name}: must be egl, osmesa or off, or not be set", file=sys.stderr)
        raise SystemExit(_BAD_INPUT)
    sys.__excepthook__(kind, error, trace)


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


if is_command(sys.argv, sys.orig_argv):
    sys.excepthook = last_words
