"""Pictures of a running episode, for `render`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError, whole_number
from gantrysim.env.episode_batch import EpisodeBatch

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
        width = whole_number("width of the picture", size[0], 1)
        height = whole_number("height of the picture", size[1], 1)
        self._size = (width, height)
        self._renderer: Renderer | None = None

    def picture(self, episodes: EpisodeBatch, place: int) -> NDArray[np.uint8]:
        """Return a picture of the episode at a place, (height, width, 3).

        Raises:
            NoOpenGLError: OpenGL cannot draw without a display.
        """
        from gantrysim.glue.bead.sweep import TooFewRingsError
        from gantrysim.render import Renderer

        machine, run, tick = episodes.scene(place)
        if self._renderer is not None:
            try:
                self._renderer.show(run)
            except TooFewRingsError:
                self.close()
        # built for the whole episode: its work piece and all of its bead
        if self._renderer is None:
            self._renderer = Renderer(machine, episodes.follower(place), size=self._size)
            self._renderer.show(run)
        return np.ascontiguousarray(self._renderer.frame(tick))

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = None
