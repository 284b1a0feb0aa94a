"""Pictures of a run, offscreen."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.bead import BeadSettings
from gantrysim.errors import InputError, whole
from gantrysim.machine.machine import Machine
from gantrysim.render.closeup import CloseUp
from gantrysim.render.colours import Scale
from gantrysim.render.opengl import Closing, NoOpenGLError, offscreen
from gantrysim.render.scene import Scene
from gantrysim.run import Run

Image = NDArray[np.uint8]

_FRAMED = 4 / 3  # width over height, for which the machines' cameras are framed
_MOST_GEOMS = 2000
_LARGEST = 8192  # side of a picture [pixels]; a square one takes some GB to be drawn


def checked_size(what: str, size: tuple[int, int]) -> tuple[int, int]:
    """Return the width and height of a picture [pixels].

    Args:
        what: how an error calls the picture.
        size: width and height.

    Raises:
        InputError: no whole numbers from 1 to 8192.
    """
    for side, pixels in zip(("width", "height"), size, strict=True):
        if whole(f"{side} of the {what}", pixels, 1) > _LARGEST:
            raise InputError(f"{side} of the {what} = {pixels:g} pixels: must be at most {_LARGEST} pixels")
    return int(size[0]), int(size[1])


class Renderer(Closing):
    """Draws a run at any of its ticks. Use it as a context manager.

    A picture that is narrower than 4:3 is as wide as one of 4:3, so that nothing is cut off.

    Args:
        machine: the machine that ran.
        run: the record.
        camera: name of a camera of the machine; by default "overview", or a view of everything where there is none.
        size: width and height of the pictures [pixels].
        bead: how the glue lies.
        colour: what the bead's colour tells, one of `gantrysim.render.colours.COLOURS`.
        scale: of the colours; by default one that fits the run.

    Attributes:
        size: width and height of the pictures [pixels].
        scene: what is drawn.
        view: the camera.

    Raises:
        InputError: no such camera or colour, or a side that is not from 1 to 8192 pixels.
        NoOpenGLError: no OpenGL that needs no display, or one that draws no pictures of the size.
    """

    def __init__(
        self,
        machine: Machine,
        run: Run,
        camera: str | None = None,
        size: tuple[int, int] = (640, 480),
        bead: BeadSettings | None = None,
        colour: str = "plain",
        scale: Scale | None = None,
    ) -> None:
        self.size = width, height = checked_size("picture", size)
        self.scene = Scene(machine, run, bead, colour=colour, scale=scale)
        self.view = self.scene.camera(camera)
        model = self.scene.model
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        if width < _FRAMED * height:
            for fields, name in ((model, "cam_fovy"), (model.vis.global_, "fovy")):
                half = np.tan(0.5 * np.radians(getattr(fields, name))) * _FRAMED * height / width
                setattr(fields, name, 2 * np.degrees(np.arctan(half)))
        self._closeup = CloseUp(model, self.scene.data, self.view)
        self._gl = offscreen(width, height)
        try:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        except mujoco.FatalError as error:
            self._gl.free()
            raise NoOpenGLError(f"OpenGL draws no pictures of {width} x {height} pixels here: {error}") from None
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._drawn = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._option = mujoco.MjvOption()

    @property
    def model(self) -> mujoco.MjModel:
        """The machine with the bead."""
        return self.scene.model

    @property
    def data(self) -> mujoco.MjData:
        """Where it stands."""
        return self.scene.data

    @property
    def scale(self) -> Scale | None:
        """Of the bead's colours, None where it is plain."""
        return self.scene.scale

    def close(self) -> None:
        """Free the OpenGL context."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def show(self, run: Run) -> None:
        """Draw another run of the machine from now on, with as many rings of the bead.

        Raises:
            TooFewRingsError: they are too few for the ends of all its stretches.
        """
        self.scene.show(run)

    def frame(self, tick: int) -> Image:
        """Return the picture at a tick, (height, width, 3)."""
        scene = self.scene
        scene.pose(tick)
        self._closeup.aim()
        self._gl.make_current()
        mujoco.mjr_uploadMesh(scene.model, self._context, scene.mesh)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(scene.model, scene.data, self._option, None, self.view, everything, self._drawn)
        scene.decorate(self._drawn)
        width, height = self.size
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._drawn, self._context)
        image = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        return image[::-1]
