"""OpenGL without a display."""

from __future__ import annotations

import ctypes.util
import importlib
import os
import subprocess
import sys
from functools import cache
from typing import Any, Self

from gantrysim.base.errors import GantryError

_PACKAGES = "libegl1 (with libgl1-mesa-dri) or libosmesa6"
_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
_BUILT_IN = ("darwin", "win32")  # platforms with an OpenGL of their own
_OFF_WORDS = ("off", "false", "0", "disable", "disabled")
_TRIAL = "from mujoco.egl import GLContext; GLContext(8, 8).make_current()"


class NoOpenGLError(GantryError, RuntimeError):
    """No OpenGL library that renders without a display."""


class Closing:
    """Base of context managers that close themselves at the end of the block."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the OpenGL contexts."""
        raise NotImplementedError


def offscreen_context(width: int, height: int, platform: str = sys.platform) -> Any:
    """Return a current OpenGL context for pictures of a size [pixels].

    On Linux it is EGL's, on a GPU where there is one, else OSMesa's, or the one that MUJOCO_GL names; on macOS and
    Windows it is MuJoCo's choice, CGL or WGL.

    Raises:
        NoOpenGLError: there is none, or MUJOCO_GL is off.
    """
    requested = os.environ.get("MUJOCO_GL", "").lower().strip()
    if requested in _OFF_WORDS:
        raise NoOpenGLError(f"MUJOCO_GL is {requested}")
    if platform in _BUILT_IN:
        try:
            return _context("gl_context", width, height)
        except Exception as error:  # each system's library has errors of its own
            raise NoOpenGLError(f"no offscreen OpenGL: {_one_line(error)}") from None
    libraries = [requested] if requested in _LIBRARIES else list(_LIBRARIES)
    installed = [name for name in libraries if ctypes.util.find_library(_LIBRARIES[name]) is not None]
    failures = ""
    # a process in which EGL has failed keeps its functions and can no longer load OSMesa's
    egl_failure = _egl_failure() if len(installed) == 2 else ""
    if egl_failure:
        failures += f" (egl: {egl_failure})"
        installed.remove("egl")
    for name in installed:
        try:
            return _context(name, width, height)
        except (ImportError, RuntimeError, AttributeError) as error:
            failures += f" ({name}: {_one_line(error)})"
    raise NoOpenGLError(f"no offscreen OpenGL{failures}: install Debian package {_PACKAGES}")


def _context(module: str, width: int, height: int) -> Any:
    context = importlib.import_module(f"mujoco.{module}").GLContext(width, height)
    context.make_current()
    return context


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


@cache
def _egl_failure() -> str:
    """Return why a separate process cannot open an EGL context; empty if it can."""
    trial = subprocess.run([sys.executable, "-c", _TRIAL], capture_output=True, text=True)
    if trial.returncode == 0:
        return ""
    messages = trial.stderr.strip().splitlines()
    return messages[-1] if messages else "no reason given"
