"""OpenGL that needs no display."""

from __future__ import annotations

import ctypes.util
import os
from typing import Any

from gantrysim.errors import GantryError

__all__ = ["NoOpenGLError", "offscreen"]

_PACKAGES = "libegl1 (with libgl1-mesa-dri) or libosmesa6"
_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
_OFF = ("off", "false", "0", "disable", "disabled")


class NoOpenGLError(GantryError, RuntimeError):
    """No OpenGL library that renders without a display."""


def offscreen(width: int, height: int) -> Any:
    """Return a context that is current: EGL, on a GPU where there is one, else OSMesa; or what MUJOCO_GL asks for.

    Args:
        width: of the pictures [pixels].
        height: of the pictures [pixels].

    Raises:
        NoOpenGLError: there is neither, or MUJOCO_GL is off.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower()
    if asked in _OFF:
        raise NoOpenGLError(f"MUJOCO_GL is {asked}")
    failures = ""
    for backend in [asked] if asked in _LIBRARIES else _LIBRARIES:
        if ctypes.util.find_library(_LIBRARIES[backend]) is None:
            continue
        try:
            if backend == "egl":
                from mujoco.egl import GLContext
            else:
                from mujoco.osmesa import GLContext
            context = GLContext(width, height)
            context.make_current()
            return context
        except (ImportError, RuntimeError, AttributeError) as error:
            failures += f" ({backend}: {' '.join(str(error).split())})"
    raise NoOpenGLError(f"no OpenGL that needs no display{failures}: install Debian package {_PACKAGES}")
