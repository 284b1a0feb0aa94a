"""The geoms of a model in an order in which a renderer without a GPU draws them soon."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

_SHOWN = 0  # group of the geoms that are added
_HIDDEN = 5  # group of all others meanwhile
_EVERYTHING = mujoco.mjtCatBit.mjCAT_ALL.value
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
        self._has_mirror = bool(np.any(model.mat_reflectance > 0))  # which may show what is outside the picture
        self._first = mujoco.MjvOption()
        self._drawn_groups = self._first.geomgroup.astype(bool)
        self._planes = mujoco.MjvOption()
        for option in (self._first, self._planes):
            option.geomgroup[:] = 0
            option.geomgroup[_SHOWN] = 1
        for kind in ("site", "joint", "tendon", "actuator", "flex", "skin"):  # the first call has added them
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
            model.geom_group[:] = np.where(drawn & ~self._is_plane, _SHOWN, _HIDDEN)
            mujoco.mjv_updateScene(model, data, self._first, None, view, _EVERYTHING, scene)
            model.geom_group[:] = np.where(drawn & self._is_plane, _SHOWN, _HIDDEN)
            mujoco.mjv_addGeoms(model, data, self._planes, self._push, _EVERYTHING, scene)
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
