"""Check for a display on which the viewer can open its window."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Mapping

from gantrysim.base.errors import GantryError

_HINT = "`gantrysim render RUN_DIR` makes a video"


class NoDisplayError(GantryError, RuntimeError):
    """No display to open a window on, with the reason."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"cannot open a window: {reason}; {_HINT}")


def check_display(platform: str = sys.platform, environment: Mapping[str, str] = os.environ) -> None:
    """Check that a window with OpenGL can be opened, by opening a hidden one.

    Args:
        platform: as `sys.platform`.
        environment: environment variables.

    Raises:
        NoDisplayError: no display, or on macOS another interpreter than MuJoCo's.
    """
    if platform == "darwin":
        # macOS reserves windows for the first thread, which mjpython keeps free
        import mujoco.viewer

        if getattr(mujoco.viewer, "_MJPYTHON", None) is None:
            raise NoDisplayError("on macOS MuJoCo's viewer needs its own interpreter, mjpython -m gantrysim view")
        return
    if platform.startswith("linux") and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        raise NoDisplayError("neither DISPLAY nor WAYLAND_DISPLAY is set")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        opened = _opens_window()
    if not opened:
        reasons = dict.fromkeys(_message(str(warning.message)) for warning in caught)
        raise NoDisplayError("; ".join(reasons) or "GLFW finds no display")


def _opens_window() -> bool:
    """Open a hidden window of the viewer's kind and close it."""
    import glfw

    if not glfw.init():
        return False
    try:
        glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
        glfw.window_hint(glfw.SAMPLES, 4)
        return bool(glfw.create_window(16, 16, "gantrysim", None, None))
    finally:
        glfw.terminate()


def _message(warning: str) -> str:
    """Return the message of a GLFW warning such as "(65550) b'X11: Failed to open display :9'"."""
    text = warning.partition(") ")[2] or warning
    return text.removeprefix("b").strip("'\"")
