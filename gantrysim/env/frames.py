"""Pictures of a running episode, for `render`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gantrysim.errors import InputError, whole
from gantrysim.machine.machine import Machine
from gantrysim.run import Run

if TYPE_CHECKING:
    from gantrysim.render import Renderer


class Frames:
    """Pictures of episodes, with one renderer that is made for the first picture.

    Args:
        mode: "rgb_array", or None for no pictures.
        size: width and height [pixels].

    Raises:
        InputError: another mode, or an invalid size.
    """

    def __init__(self, mode: str | None, size: tuple[int, int]) -> None:
        if mode not in (None, "rgb_array"):
            raise InputError(f"render_mode = {mode!r}: must be None or 'rgb_array'")
        if not isinstance(size, tuple | list) or len(size) != 2:
            raise InputError(f"size = {size!r}: must be width and height [pixels]")
        self._mode = mode
        self._size = whole("width of the picture", size[0], 1), whole("height of the picture", size[1], 1)
        self._renderer: Renderer | None = None

    def picture(
        self, scene: Callable[[], tuple[Machine, Run, int]], episode: Callable[[], Run]
    ) -> NDArray[np.uint8] | None:
        """Return a picture, (height, width, 3), or None without a mode.

        Args:
            scene: returns the machine, its record and the tick to draw.
            episode: returns a record of the whole episode, from which the work piece and the bead's mesh are built.

        Raises:
            NoOpenGLError: OpenGL cannot draw without a display.
        """
        if self._mode is None:
            return None
        from gantrysim.bead.sweep import TooFewRingsError
        from gantrysim.render import Renderer

        machine, run, tick = scene()
        if self._renderer is not None:
            try:
                self._renderer.show(run)
            except TooFewRingsError:
                self.close()
        if self._renderer is None:
            self._renderer = Renderer(machine, episode(), size=self._size)
            self._renderer.show(run)
        return np.ascontiguousarray(self._renderer.frame(tick))

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = None
