"""OpenGL that needs no display."""

from __future__ import annotations

import ctypes.util
import os
import subprocess
import sys
from functools import cache
from types import TracebackType
from typing import Any, Self

from gantrysim.errors import GantryError

_PACKAGES = "libegl1 (with libgl1-mesa-dri) or libosmesa6"
_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
_WITH_THEIR_OWN = ("darwin", "win32")
_OFF = ("off", "false", "0", "disable", "disabled")
_TRIAL = "from mujoco.egl import GLContext; GLContext(8, 8).make_current()"


class NoOpenGLError(GantryError, RuntimeError):
    """No OpenGL library that renders without a display."""


class Closing:
    """What holds OpenGL, and is closed at the end of the block that it is the context manager of."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free it."""
        raise NotImplementedError


def offscreen(width: int, height: int, platform: str = sys.platform) -> Any:
    """Return a context that is current.

    On Linux it is one of EGL, on a GPU where there is one, else of OSMesa, or what MUJOCO_GL asks for; on macOS and
    Windows it is MuJoCo's own choice, CGL or WGL.

    Args:
        width: of the pictures [pixels].
        height: of the pictures [pixels].
        platform: as `sys.platform` has it.

    Raises:
        NoOpenGLError: there is none, or MUJOCO_GL is off.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked in _OFF:
        raise NoOpenGLError(f"MUJOCO_GL is {asked}")
    if platform in _WITH_THEIR_OWN:
        return _systems_own(width, height)
    wanted = [asked] if asked in _LIBRARIES else list(_LIBRARIES)
    found = [name for name in wanted if ctypes.util.find_library(_LIBRARIES[name]) is not None]
    failures = ""
    # a process that has tried EGL in vain has its functions and cannot load OSMesa's any more
    if len(found) == 2 and (failure := _egl_failure()):
        failures += f" (egl: {failure})"
        found.remove("egl")
    for name in found:
        try:
            if name == "egl":
                from mujoco.egl import GLContext
            else:
                from mujoco.osmesa import GLContext
            context = GLContext(width, height)
            context.make_current()
            return context
        except (ImportError, RuntimeError, AttributeError) as error:
            failures += f" ({name}: {' '.join(str(error).split())})"
    raise NoOpenGLError(f"no OpenGL that needs no display{failures}: install Debian package {_PACKAGES}")


def _systems_own(width: int, height: int) -> Any:
    """Return a context of the system's own OpenGL, which needs no window that is seen."""
    try:
        from mujoco.gl_context import GLContext

        context = GLContext(width, height)
        context.make_current()
    except Exception as error:  # each system's library has errors of its own
        reason = " ".join(str(error).split()) or type(error).__name__
        raise NoOpenGLError(f"no OpenGL that draws without a window: {reason}") from None
    return context


@cache
def _egl_failure() -> str:
    """Return why a process of its own cannot open a context by EGL; nothing where it can."""
    done = subprocess.run([sys.executable, "-c", _TRIAL], capture_output=True, text=True)
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["no reason given"])[-1]
