"""The nozzle from near, in the corner of a picture that the bead leaves free."""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.render.encoding import Picture
from gantrysim.render.framing import Framing
from gantrysim.render.geoms import Geoms
from gantrysim.render.scene import Scene

_CAMERA = "nozzle"
_SIDE = 0.3  # width and height, relative to the picture's
_BELOW = 0.08  # distance from the upper edge, where the verdict stands, relative to the picture's height
_LEAST = 120  # width [pixels]: in a smaller picture there is none
_FRAME = 2  # [pixels]
_SHADE = 96  # grey of the frame, 0 to 255
# corners in the order of preference: the needle comes from above
_CORNERS = ((1, -1), (-1, -1), (1, 1), (-1, 1))


class Inset:
    """A second view of a scene in a corner of its picture.

    Args:
        scene: the machine with its bead.
        corner: signs of the corner's place in the picture, to the right and up.
        size: width and height of the picture [pixels].

    Attributes:
        viewport: place in the picture.
    """

    def __init__(self, scene: Scene, corner: tuple[int, int], size: tuple[int, int]) -> None:
        self._view = scene.camera(_CAMERA)
        width, height = (round(_SIDE * side) for side in size)
        right, up = corner
        column = size[0] - width if right > 0 else 0
        bottom = size[1] - height - round(_BELOW * size[1]) if up > 0 else 0
        self.viewport = mujoco.MjrRect(column, bottom, width, height)

    @classmethod
    def of(cls, scene: Scene, framing: Framing, size: tuple[int, int]) -> Inset | None:
        """Return the inset of a bead's picture, or None without room for it or without a camera at the nozzle."""
        if _SIDE * size[0] < _LEAST or not scene.has_camera(_CAMERA):
            return None
        places = framing.in_picture(size[0] / size[1])
        free = 1 - 2 * _SIDE  # from the middle to the inset's edges
        covered = [int(np.count_nonzero(np.all(places * corner > free, axis=1))) for corner in _CORNERS]
        return cls(scene, _CORNERS[int(np.argmin(covered))], size)

    def render(self, scene: Scene, geoms: Geoms, drawn: mujoco.MjvScene, context: mujoco.MjrContext) -> None:
        """Draw the inset over the picture in the present buffer, without shadows."""
        geoms.update(scene.data, self._view, drawn, self.viewport.width / self.viewport.height, shadows=False)
        scene.decorate(drawn)
        mujoco.mjr_render(self.viewport, drawn, context)

    def frame(self, picture: Picture) -> None:
        """Draw the inset's frame on a picture, whose first row is its lowest, (height, width, 3)."""
        place = self.viewport
        rows = slice(place.bottom, place.bottom + place.height)
        columns = slice(place.left, place.left + place.width)
        part = picture[rows, columns]
        for edge in (slice(None, _FRAME), slice(-_FRAME, None)):
            part[edge] = _SHADE
            part[:, edge] = _SHADE
