"""Offscreen pictures of a run."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError, whole_number
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.machine.machine import NOZZLE, Machine
from gantrysim.record.run import Run
from gantrysim.render.antialiasing import smoothed_picture
from gantrysim.render.camera import FIELD_OF_VIEW, Flight, Framing, View
from gantrysim.render.colours import Scale
from gantrysim.render.encoding import Picture
from gantrysim.render.opengl import Closing, NoOpenGLError, offscreen_context
from gantrysim.render.scene import GLOSS, Scene

# The geoms of a model in an order in which a renderer without a GPU draws them soon.

_SHOWN = 0  # group of the geoms that are added
_HIDDEN_GROUP = 5  # group of all others meanwhile
_ALL_CATEGORIES = mujoco.mjtCatBit.mjCAT_ALL.value
_PLANE = mujoco.mjtGeom.mjGEOM_PLANE


class Geoms:
    """Puts the geoms of a model into a MuJoCo scene: those in the picture, planes last.

    A pixel of a geom is coloured unless something nearer has been drawn there. A floor comes first in most models: it
    would be coloured all over the picture, and then hidden. The picture is the same in any order.

    Args:
        model: of the geoms; those in its groups 0, 1 and 2 are drawn.
        unbounded: geoms whose shape is not the one that the model was compiled with.
    """

    def __init__(self, model: mujoco.MjModel, unbounded: list[int]) -> None:
        self._model = model
        self._is_plane = model.geom_type == _PLANE
        self._radius = model.geom_rbound.copy()
        self._radius[self._is_plane] = np.inf
        self._radius[unbounded] = np.inf
        # which may show what is outside the picture
        self._has_mirror = bool(np.any(model.mat_reflectance > 0))
        self._first = mujoco.MjvOption()
        self._drawn_groups = self._first.geomgroup.astype(bool)
        self._planes = mujoco.MjvOption()
        for option in (self._first, self._planes):
            option.geomgroup[:] = 0
            option.geomgroup[_SHOWN] = 1
        # the first call has added them
        for kind in ("site", "joint", "tendon", "actuator", "flex", "skin"):
            getattr(self._planes, f"{kind}group")[:] = 0
        self._push = mujoco.MjvPerturb()

    def update(
        self, data: mujoco.MjData, view: mujoco.MjvCamera, scene: mujoco.MjvScene, shape: float, *, shadows: bool
    ) -> None:
        """Fill a scene with the model in its pose.

        Args:
            data: the pose.
            view: the camera.
            scene: to be filled.
            shape: width over height of the picture.
            shadows: whether what is outside the picture may cast a shadow into it.
        """
        model = self._model
        groups = model.geom_group.copy()
        drawn = self._drawn_groups[groups]
        if not shadows and not self._has_mirror:
            mujoco.mjv_updateCamera(model, data, view, scene)
            drawn &= self._inside(data, scene.camera, shape)
        try:
            model.geom_group[:] = np.where(drawn & ~self._is_plane, _SHOWN, _HIDDEN_GROUP)
            mujoco.mjv_updateScene(model, data, self._first, None, view, _ALL_CATEGORIES, scene)
            model.geom_group[:] = np.where(drawn & self._is_plane, _SHOWN, _HIDDEN_GROUP)
            mujoco.mjv_addGeoms(model, data, self._planes, self._push, _ALL_CATEGORIES, scene)
        finally:
            model.geom_group[:] = groups

    def _inside(
        self, data: mujoco.MjData, eyes: tuple[mujoco.MjvGLCamera, mujoco.MjvGLCamera], shape: float
    ) -> NDArray[np.bool_]:
        """Return which geoms may be in the picture, by the spheres around them.

        A sphere of radius r is beside a picture with half width w at distance 1 along its axis z where

            |x| - w z > r sqrt(1 + w²).
        """
        eye = eyes[0]
        if eye.orthographic or eye.frustum_width:
            return np.ones(self._radius.size, np.bool_)
        forward = np.array(eye.forward)
        up = np.array(eye.up)
        # the two eyes are beside each other for pictures in stereo; others are drawn from between them
        place = data.geom_xpos - 0.5 * (np.array(eye.pos) + np.array(eyes[1].pos))
        half_height = eye.frustum_top / eye.frustum_near
        half_width = half_height * shape
        z = place @ forward
        x = np.abs(place @ np.cross(forward, up))
        y = np.abs(place @ up)
        inside = z + self._radius > 0
        inside &= x - half_width * z <= self._radius * np.hypot(1, half_width)
        inside &= y - half_height * z <= self._radius * np.hypot(1, half_height)
        return inside


# The needle and the wet bead from near, in the corner of a picture that the bead leaves free.

_SIDES = (0.34, 0.28, 0.22)  # width and height, relative to the picture's: the largest that hides no bead
_BELOW_VERDICT = 0.08  # distance from the upper edge, where the verdict stands, relative to the picture's height
_LEAST_INSET = 120  # width [pixels]: in a smaller picture there is none
_BESIDE_BEAD = 0.06  # from its edges to the middle of the bead, relative to half the picture
_FRAME = 2  # [pixels]
_SHADE = 230  # grey of the frame, 0 to 255
# corners in the order of preference: the needle comes from above
_CORNERS = ((1, -1), (-1, -1), (1, 1), (-1, 1))
_SEEN_WIDTHS = 3.5  # height of what it shows, in widths of the bead
_LEAST_SEEN = 3.0  # the same [mm]
_ELEVATION = -24.0  # of its camera [deg]
_WET = 0.05  # of the largest flow, above which glue comes out
_NEAR_PLANE = 0.25  # distance of the clipping plane, relative to the camera's


class Inset:
    """A second view of a scene in a corner of its picture: the nozzle, or the end of the bead that it has left, near.

    Args:
        scene: the machine with its bead.
        corner: signs of the corner's place in the picture, to the right and up.
        size: width and height of the picture [pixels].
        side: width and height, relative to the picture's.

    Attributes:
        viewport: place in the picture.
    """

    def __init__(self, scene: Scene, corner: tuple[int, int], size: tuple[int, int], side: float) -> None:
        width, height = (round(side * pixels) for pixels in size)
        right, up = corner
        column = size[0] - width if right > 0 else 0
        bottom = size[1] - height - round(_BELOW_VERDICT * size[1]) if up > 0 else 0
        self.viewport = mujoco.MjrRect(column, bottom, width, height)
        trace = scene.sweep.bead_trace
        wide = max(float(trace.nominal_section.width[0]) if trace.nominal > 0 else 0.0, trace.run.face)
        self._distance = 0.5e-3 * max(_SEEN_WIDTHS * wide, _LEAST_SEEN) / np.tan(np.radians(0.5 * FIELD_OF_VIEW))
        is_wet = trace.run.flow > _WET * trace.run.flow.max()
        # last tick with glue, up to each; the first one before it
        self._wet = np.maximum.accumulate(np.where(is_wet, np.arange(is_wet.size), int(is_wet.argmax())))

    @classmethod
    def of(cls, scene: Scene, framing: Framing, size: tuple[int, int]) -> Inset | None:
        """Return the inset of a bead's picture, or None without room for it."""
        places = framing.in_picture(size[0] / size[1])
        fitting = [side for side in _SIDES if side * size[0] >= _LEAST_INSET]

        def covered_share(side: float, corner: tuple[int, int]) -> float:
            # from the middle of the picture to the inset's edges, and to the bead beside them
            aside = 1 - 2 * side - _BESIDE_BEAD
            edges = (aside, aside - 2 * _BELOW_VERDICT * (corner[1] > 0))
            return float(np.all(places * corner > edges, axis=1).mean())

        covered = {(side, corner): covered_share(side, corner) for side in fitting for corner in _CORNERS}
        if not covered:
            return None
        side, corner = min(covered, key=lambda choice: covered[choice])
        return cls(scene, corner, size, side)

    def render(
        self, scene: Scene, tick: int, geoms: Geoms, drawn: mujoco.MjvScene, context: mujoco.MjrContext, azimuth: float
    ) -> None:
        """Draw the inset at a tick over the picture in the present buffer, seen from an azimuth [deg], no shadows."""
        model = scene.model
        view = mujoco.MjvCamera()
        work = scene.machine.work
        point = 1e-3 * scene.run.nozzle[self._wet[tick]]
        centre = scene.data.xpos[work] + scene.data.xmat[work].reshape(3, 3) @ point
        View(centre, self._distance, azimuth, _ELEVATION, FIELD_OF_VIEW).set(view, model)
        near = model.vis.map.znear
        try:
            model.vis.map.znear = _NEAR_PLANE * self._distance / model.stat.extent
            geoms.update(scene.data, view, drawn, self.viewport.width / self.viewport.height, shadows=False)
        finally:
            model.vis.map.znear = near
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


BEAD = "bead"  # camera that is fitted to the bead

_FRAMED = 4 / 3  # width over height for which the machines' cameras are framed
_MOST_GEOMS = 2000
_LARGEST_SIDE = 8192  # side of a picture [pixels]; a square one takes some GB to draw
_NEAR_CAMERA = 0.25  # distance of a camera to the tip, below which shadows are refined [m]
_SHADOW_TEXELS = 1.28  # side of the finest shadow map that a picture of the whole machine shows, over its larger side
_SHADOWED_RADIUS = 0.11  # radius around the tip that then has shadows [m]


def checked_size(name: str, size: tuple[int, int]) -> tuple[int, int]:
    """Return the width and height of a picture [pixels]; errors call it by the name.

    Raises:
        InputError: not whole numbers from 1 to 8192.
    """
    for side, pixels in zip(("width", "height"), size, strict=True):
        if whole_number(f"{side} of the {name}", pixels, 1) > _LARGEST_SIDE:
            raise InputError(f"{side} of the {name} = {pixels:g} pixels: must be at most {_LARGEST_SIDE} pixels")
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
        self.scene = Scene(machine, run, bead, colour=colour, scale=scale, in_pieces=True)
        self.view = self.scene.camera(camera if isinstance(camera, str) and not is_fitted else None)
        model = self.scene.model
        model.vis.global_.offwidth = width
        model.vis.global_.offheight = height
        # MuJoCo's field of view is vertical: widened, so that the horizontal one stays
        if width < _FRAMED * height:
            for fields, name in ((model, "cam_fovy"), (model.vis.global_, "fovy")):
                half = np.tan(0.5 * np.radians(getattr(fields, name))) * _FRAMED * height / width
                setattr(fields, name, 2 * np.degrees(np.arctan(half)))
        framing = camera if isinstance(camera, Framing) else None
        self._flight = Flight(self.scene, machine, width / height, framing) if is_fitted else None
        if is_fitted:
            self.scene.make_wet()
            # edges are smoothed afterwards, see `smoothed`
            model.vis.quality.offsamples = 0
            # shadows are seen in views of the whole machine alone
            finest = round(_SHADOW_TEXELS * max(size))
            model.vis.quality.shadowsize = min(model.vis.quality.shadowsize, finest)
        self.framing = None if self._flight is None else self._flight.framing
        self._inset = None if self.framing is None else Inset.of(self.scene, self.framing, self.size)
        self._tip = int(model.site(NOZZLE).id)
        self._lights = self._refined_lights()
        self._gl = offscreen_context(width, height)
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
        if np.linalg.norm(data.cam_xpos[self.view.fixedcamid] - tip) > _NEAR_CAMERA:
            return []
        spot = mujoco.mjtLightType.mjLIGHT_SPOT
        shadows = np.flatnonzero(model.light_active & model.light_castshadow & (model.light_type == spot))
        refined = []
        for light in shadows.tolist():
            distance = float(np.linalg.norm(tip - data.light_xpos[light]))
            half = np.degrees(np.arctan2(_SHADOWED_RADIUS, distance))
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
        if self._flight is not None:
            self._aim_gloss()
        self._gl.make_current()
        self._upload(scene.draw_bead())
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
            inset.render(scene, tick, self._geoms, self._drawn, self._context, self.view.azimuth)
        image = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        if self._flight is None:
            return image[::-1]
        image = smoothed_picture(image)
        if inset is not None:
            inset.frame(image)
        return image[::-1]

    def pixel_of(self, point: tuple[float, float, float]) -> tuple[float, float] | None:
        """Return column and row of a point in the work frame [mm] in the last picture, or None outside of it."""
        data = self.data
        work = self.scene.machine.work
        place = data.xpos[work] + data.xmat[work].reshape(3, 3) @ (1e-3 * np.array(point))
        mujoco.mjv_updateCamera(self.model, data, self.view, self._drawn)
        eye, other_eye = self._drawn.camera
        forward = np.array(eye.forward)
        up = np.array(eye.up)
        # in the middle between the eyes
        away = place - 0.5 * (np.array(eye.pos) + np.array(other_eye.pos))
        depth = float(away @ forward) * eye.frustum_top / eye.frustum_near
        if depth <= 0:
            return None
        width, height = self.size
        column = 0.5 * width + 0.5 * height * float(away @ np.cross(forward, up)) / depth
        row = 0.5 * height - 0.5 * height * float(away @ up) / depth
        return (column, row) if 0 <= column < width and 0 <= row < height else None

    def _aim_gloss(self) -> None:
        """Send the light of the gloss so that what is level reflects it into the camera."""
        scene = self.scene
        mujoco.mjv_updateCamera(scene.model, scene.data, self.view, self._drawn)
        forward = self._drawn.camera[0].forward
        scene.data.light_xdir[scene.model.light(GLOSS).id] = (-forward[0], -forward[1], min(forward[2], -0.1))

    def _upload(self, meshes: list[int]) -> None:
        for mesh in meshes:
            mujoco.mjr_uploadMesh(self.model, self._context, mesh)
