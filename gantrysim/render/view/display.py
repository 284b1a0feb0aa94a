"""Windows with OpenGL, by GLFW, or the reason why there is none."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Mapping
from typing import Any

from gantrysim.base.errors import GantryError

_HINT = "`gantrysim render RUN_DIR` makes a video"
_SAMPLES = 4  # of a pixel, for smooth edges


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
        NoDisplayError: no display.
    """
    import glfw

    if platform.startswith("linux") and not (environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")):
        raise NoDisplayError("neither DISPLAY nor WAYLAND_DISPLAY is set")
    open_window(16, 16, visible=False)
    glfw.terminate()


def open_window(width: int, height: int, *, visible: bool = True) -> Any:
    """Return a new window of GLFW with an OpenGL context; `glfw.terminate` closes it.

    Args:
        width: of the window [pixels of the screen].
        height: of the window [pixels of the screen].
        visible: whether it is shown.

    Raises:
        NoDisplayError: no display, or one without OpenGL.
    """
    import glfw

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if glfw.init():
            glfw.window_hint(glfw.VISIBLE, visible)
            glfw.window_hint(glfw.SAMPLES, _SAMPLES)
            window = glfw.create_window(width, height, "gantrysim", None, None)
            if window:
                return window
            glfw.terminate()
    reasons = dict.fromkeys(_message(str(warning.message)) for warning in caught)
    raise NoDisplayError("; ".join(reasons) or "GLFW finds no display")


def _message(warning: str) -> str:
    """Return the message of a GLFW warning such as "(65550) b'X11: Failed to open display :9'"."""
    text = warning.partition(") ")[2] or warning
    return text.removeprefix("b").strip("'\"")
