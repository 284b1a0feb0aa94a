"""OpenGL contexts that renderers take over from those that are closed: for a new one Mesa compiles its shaders anew."""

import ctypes.util
import os
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from gantrysim.render.opengl import offscreen_context


class Lent:
    """A context that is put to the idle ones once its renderer is closed."""

    def __init__(self, context, idle):
        self._context = context
        self._idle = idle

    def make_current(self):
        self._context.make_current()

    def free(self):
        self._idle.append(self._context)


@contextmanager
def shared_opengl() -> Iterator[None]:
    """Let a renderer inside the block take over the context of one that was closed, in the same thread and process."""
    find_library = ctypes.util.find_library
    idle_contexts: dict[tuple, list] = defaultdict(list)

    def context_of(width, height):
        # a test lets OpenGL be missing
        if ctypes.util.find_library is not find_library:
            return offscreen_context(width, height)
        idle = idle_contexts[os.getpid(), threading.get_ident(), os.environ.get("MUJOCO_GL")]
        context = idle.pop() if idle else offscreen_context(width, height)
        context.make_current()
        return Lent(context, idle)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gantrysim.render.renderer.offscreen_context", context_of)
        yield
