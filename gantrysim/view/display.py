"""Whether there is a display that the viewer can open its window on."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Mapping

from gantrysim.errors import GantryError

_HINT = "`gantrysim render RUN_DIR` makes a video"


class NoDisplayError(GantryError, RuntimeError):
    """No display to open a window on.

    Args:
        reason: why.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(f"no display to open a window on: {reason}; {_HINT}")


def check_display(platform: str = sys.platform, environment: Mapping[str, str] = os.environ) -> None:
    """See that a window with OpenGL can be opened, by opening a hidden one.

    Args:
        platform: as `sys.platform` has it.
        environment: its variables.

    Raises:
        NoDisplayError: where not; on macOS where the interpreter is not MuJoCo's own.
    """
    if platform == "darwin":
        # there windows belong to the first thread, which mjpython keeps for them
        import mujoco.viewer

        if getattr(mujoco.viewer, "_MJPYTHON", None) is None:
            raise NoDisplayError("on macOS MuJoCo's viewer needs its own interpreter, mjpython -m gantrysim view")
        return
    if platform.startswith("linux") and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        raise NoDisplayError("neither DISPLAY nor WAYLAND_DISPLAY is set")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        opened = _opens_window()
    if not opened:
        raise NoDisplayError("; ".join(dict.fromkeys(_in_short(str(item.message)) for item in said)) or "GLFW has none")


def _opens_window() -> bool:
    """Open a hidden window of the kind that the viewer opens, and close it."""
    import glfw

    if not glfw.init():
        return False
    try:
        glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
        glfw.window_hint(glfw.SAMPLES, 4)
        window = glfw.create_window(16, 16, "gantrysim", None, None)
        if not window:
            return False
        glfw.destroy_window(window)
        return True
    finally:
        glfw.terminate()


def _in_short(warning: str) -> str:
    """Return what GLFW says, without its number and quotes: "(65550) b'X11: Failed to open display :9'"."""
    text = warning.partition(") ")[2] or warning
    return text.removeprefix("b").strip("'\"")
