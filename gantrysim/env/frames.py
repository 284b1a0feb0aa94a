"""Pictures of an episode under way, for `render`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gantrysim.machine import Machine
from gantrysim.run import Run

if TYPE_CHECKING:
    from gantrysim.render import Renderer

__all__ = ["Frames"]


class Frames:
    """Draws episodes, one after the other, with one renderer, made for the first picture.

    Args:
        size: width and height [pixels].
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._renderer: Renderer | None = None

    def picture(self, machine: Machine, run: Run, tick: int) -> NDArray[np.uint8]:
        """Return the picture at a tick of a record, (height, width, 3).

        Raises:
            NoOpenGLError: no OpenGL that needs no display.
        """
        from gantrysim.render import Renderer

        if self._renderer is None:
            self._renderer = Renderer(machine, run, size=self._size)
        else:
            self._renderer.show(run)
        return np.ascontiguousarray(self._renderer.frame(tick))

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = None
