"""Offscreen pictures of a run."""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.base.errors import InputError, whole
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.machine.machine import NOZZLE, Machine
from gantrysim.record.run import Run
from gantrysim.render.antialiasing import smoothed
from gantrysim.render.colours import Scale
from gantrysim.render.encoding import Picture
from gantrysim.render.flight import Flight
from gantrysim.render.framing import Framing
from gantrysim.render.geoms import Geoms
from gantrysim.render.inset import Inset
from gantrysim.render.opengl import Closing, NoOpenGLError, offscreen
from gantrysim.render.scene import Scene

BEAD = "bead"  # camera that is fitted to the bead

_FRAMED = 4 / 3  # width over height for which the machines' cameras are framed
_MOST_GEOMS = 2000
_LARGEST = 8192  # side of a picture [pixels]; a square one takes some GB to draw
_NEAR = 0.25  # distance of a camera to the tip, below which shadows are refined [m]
_SHADOW_TEXELS = 1.28  # side of the finest shadow map that a picture of the whole machine shows, over its larger side
_SHADOWED = 0.11  # radius around the tip that then has shadows [m]


def checked_size(name: str, size: tuple[int, int]) -> tuple[int, int]:
    """Return the width and height of a picture [pixels]; errors call it by the name.

    Raises:
        InputError: not whole numbers from 1 to 8192.
    """
    for side, pixels in zip(("width", "height"), size, strict=True):
        if whole(f"{side} of the {name}", pixels, 1) > _LARGEST:
            raise InputError(f"{side} of the {name} = {pixels:g} pixels: must be at most {_LARGEST} pixels")
    return int(size[0]), int(size[1])


class Renderer(Closing):
    """Draws a run at any of its ticks. Use it as a context manager.

    A picture that is narrower than 4:3 shows the same width as one of 4:3, so that nothing is cut off.

    Args:
        machine, run, bead, colour, scale: as for `Scene`.
        camera: name of a camera of the machine, or "bead" or a framing for one that holds the bead, with the nozzle
            from near in a corner; by default "overview", or a view of everything without one.
        size: width and height of the pictures [pixels].

    Attributes:
        scene: the machine with its bead.
        view: the camera.
        framing: of the bead by a camera that is fitted to it, None for another.

    Raises:
        InputError: no such camera or colour, or a side that is not from 1 to 8192 pixels.
        NoOpenGLError: no OpenGL without a display, or one that cannot draw pictures of the size.
    """

    def __init__(
        self,
        machine: Machine,
        run: Run,
        camera: str | Framing | None = None,
        size: tuple[int, int] = (640, 480),
        bead: BeadSettings | BeadTrace | None = None,
        colour: str = "plain",
        scale: Scale | None = None,
    ) -> None:
        self.size = checked_size("picture", size)
        width, height = self.size
        is_fitted = camera == BEAD or isinstance(camera, Framing)
        beads = 2 if is_fitted else 1  # a second one for the inset
        self.scene = Scene(machine, run, bead, colour=colour, scale=scale, beads_in_pieces=beads)
        self.view = self.scene.camera(camera if isinstance(camera, str) and not is_fitted else None)
        model = self.scene.model
        model.vis.global_.offwidth = width
        model.vis.global_.offheight = height
        if width < _FRAMED * height:  # MuJoCo's field of view is vertical: widened, so that the horizontal one stays
            for fields, name in ((model, "cam_fovy"), (model.vis.global_, "fovy")):
                half = np.tan(0.5 * np.radians(getattr(fields, name))) * _FRAMED * height / width
                setattr(fields, name, 2 * np.degrees(np.arctan(half)))
        framing = camera if isinstance(camera, Framing) else None
        self._flight = Flight(self.scene, machine, width / height, framing) if is_fitted else None
        if is_fitted:
            model.vis.quality.offsamples = 0  # edges are smoothed afterwards, see `smoothed`
            finest = round(_SHADOW_TEXELS * max(size))  # shadows are seen in views of the whole machine alone
            model.vis.quality.shadowsize = min(model.vis.quality.shadowsize, finest)
        self.framing = None if self._flight is None else self._flight.framing
        self._inset = None if self.framing is None else Inset.of(self.scene, self.framing, self.size)
        self._tip = int(model.site(NOZZLE).id)
        self._lights = self._refined_lights()
        self._gl = offscreen(width, height)
        try:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        except mujoco.FatalError as error:
            self._gl.free()
            raise NoOpenGLError(f"OpenGL cannot draw pictures of {width} x {height} pixels: {error}") from None
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._drawn = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        self._geoms = Geoms(model, self.scene.bead_geoms)

    def _refined_lights(self) -> list[int]:
        """Narrow the shadow maps of the lights for a fixed camera near the tip; return the lights to be aimed at it.

        Spread over the whole machine a shadow map resolves half a millimetre, too coarse to be seen from near. The
        OpenGL context reads the shadow scale when it is created.
        """
        model = self.model
        data = self.data
        tip = data.site_xpos[self._tip]
        if self.view.type != mujoco.mjtCamera.mjCAMERA_FIXED:
            return []
        if np.linalg.norm(data.cam_xpos[self.view.fixedcamid] - tip) > _NEAR:
            return []
        spot = mujoco.mjtLightType.mjLIGHT_SPOT
        shadows = np.flatnonzero(model.light_active & model.light_castshadow & (model.light_type == spot))
        refined = []
        for light in shadows.tolist():
            distance = float(np.linalg.norm(tip - data.light_xpos[light]))
            half = np.degrees(np.arctan2(_SHADOWED, distance))
            if half < model.vis.map.shadowscale * model.light_cutoff[light]:
                model.vis.map.shadowscale = half / model.light_cutoff[light]
                refined.append(light)
        return refined

    @property
    def model(self) -> mujoco.MjModel:
        """The machine with the bead."""
        return self.scene.model

    @property
    def data(self) -> mujoco.MjData:
        """Its pose."""
        return self.scene.data

    def close(self) -> None:
        """Free the OpenGL context."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def show(self, run: Run) -> None:
        """Draw another run of the machine from now on, with the same number of bead rings.

        Raises:
            TooFewRingsError: too few rings for the ends of its stretches.
        """
        self.scene.show(run)

    def frame(self, tick: int, share: float = 1.0) -> Picture:
        """Return the picture at a tick, (height, width, 3).

        Args:
            tick: of the run.
            share: of the flight of a camera that is fitted to the bead, from 0, the whole machine, to 1.
        """
        scene = self.scene
        scene.pose(tick)
        if self._flight is not None:
            self._flight.view(share).set(self.view, scene.model)
        for light in self._lights:
            offset = self.data.site_xpos[self._tip] - self.data.light_xpos[light]
            self.data.light_xdir[light] = offset / np.linalg.norm(offset)
        self._gl.make_current()
        self._upload(scene.draw_bead(scene.widening))
        width, height = self.size
        # a shadow map doubles the time of a picture, and its teeth show from near: there the bead is lit without
        shadows = self._flight is None or share == 0
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._geoms.update(self.data, self.view, self._drawn, width / height, shadows=shadows)
        scene.decorate(self._drawn)
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._drawn, self._context)
        inset = self._inset if share == 1 else None
        if inset is not None:
            if scene.widening != 1:  # from near the bead is seen as it is
                self._upload(scene.draw_bead(1.0, near=True))
            inset.render(scene, self._geoms, self._drawn, self._context)
        image = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        if self._flight is None:
            return image[::-1]
        image = smoothed(image)
        if inset is not None:
            inset.frame(image)
        return image[::-1]

    def _upload(self, meshes: list[int]) -> None:
        for mesh in meshes:
            mujoco.mjr_uploadMesh(self.model, self._context, mesh)
