"""Shadows seen from near.

A machine's light spreads its shadow map over the whole machine, half a millimetre a pixel, and a shadow's edge is as
coarse as that. For a camera near the needle it is aimed at the tip, and its map spent on what lies around it.
"""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.machine.machine import NOZZLE

_NEAR = 0.25  # of a camera to the tip [m]
_AROUND = 0.11  # radius of what has shadows [m]


class CloseUp:
    """The lights that throw shadows, aimed at the nozzle where a camera looks at it from near.

    Args:
        model: the machine; how wide its shadows are spread is changed, so make its OpenGL context afterwards.
        data: of the machine, posed.
        view: the camera.

    Attributes:
        lights: numbers of those that are aimed; none where the camera is further away or free.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, view: mujoco.MjvCamera) -> None:
        self._model, self._data = model, data
        self._site = int(model.site(NOZZLE).id)
        self.lights: list[int] = []
        if view.type != mujoco.mjtCamera.mjCAMERA_FIXED:
            return
        tip = data.site_xpos[self._site]
        if np.linalg.norm(data.cam_xpos[view.fixedcamid] - tip) > _NEAR:
            return
        spot = mujoco.mjtLightType.mjLIGHT_SPOT
        shadows = np.flatnonzero(model.light_active & model.light_castshadow & (model.light_type == spot))
        for light in shadows.tolist():
            distance = float(np.linalg.norm(tip - data.light_xpos[light]))
            half = np.degrees(np.arctan2(_AROUND, distance))
            if half < model.vis.map.shadowscale * model.light_cutoff[light]:
                model.vis.map.shadowscale = half / model.light_cutoff[light]
                self.lights.append(light)

    def aim(self) -> None:
        """Turn the lights to where the nozzle is now."""
        for light in self.lights:
            way = self._data.site_xpos[self._site] - self._data.light_xpos[light]
            self._data.light_xdir[light] = way / np.linalg.norm(way)
