"""The camera of a film: the whole machine first, then a flight to the bead, which it holds from then on."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.machine.machine import Machine
from gantrysim.render.framing import FIELD_OF_VIEW, Framing
from gantrysim.render.scene import Scene
from gantrysim.render.sight import Sight

FADED = 0.12  # opacity of parts that hide the bead
_UPRIGHT = 1e-6  # of the cosine between a camera's right side and the vertical


@dataclass(frozen=True, eq=False)
class View:
    """A free camera.

    Attributes:
        centre: point at which it looks, (3,) [m].
        distance: to that point [m].
        azimuth, elevation: of its axis [deg].
        field: vertical field of view [deg].
    """

    centre: Floats
    distance: float
    azimuth: float
    elevation: float
    field: float

    def towards(self, other: View, share: float) -> View:
        """Return the view at a share of a flight to another one, 0 to 1; the distance changes by equal factors."""
        turn = (other.azimuth - self.azimuth + 180.0) % 360.0 - 180.0
        return View(
            centre=(1 - share) * self.centre + share * other.centre,
            distance=self.distance ** (1 - share) * other.distance**share,
            azimuth=self.azimuth + share * turn,
            elevation=(1 - share) * self.elevation + share * other.elevation,
            field=(1 - share) * self.field + share * other.field,
        )

    def set(self, camera: mujoco.MjvCamera, model: mujoco.MjModel) -> None:
        """Set a camera, and the model's field of view, to the view."""
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = self.centre
        camera.distance = self.distance
        camera.azimuth = self.azimuth
        camera.elevation = self.elevation
        model.vis.global_.fovy = self.field


class Flight:
    """Views of a scene on the way from the whole machine to its bead; parts that hide the bead fade on the way.

    A bead on moving work is looked at in the frame of the work.

    Args:
        scene: the machine with its bead.
        machine: the machine.
        width_over_height: of the picture.
        framing: of the bead; by default the best one.
    """

    def __init__(
        self, scene: Scene, machine: Machine, width_over_height: float, framing: Framing | None = None
    ) -> None:
        self._scene = scene
        self._work = machine.work
        self._shape = width_over_height
        sight = Sight(scene.model, machine, scene.run, width_over_height)
        self.framing = sight.framing() if framing is None else framing
        self._fading = sight.hiding(self.framing)
        self._colours = self._looks()
        self._overview = self._whole_machine()

    def view(self, share: float) -> View:
        """Return the view in the scene's present pose, and fade what hides the bead.

        Args:
            share: of the flight: 0 shows the machine, 1 the bead.
        """
        model = self._scene.model
        model.geom_rgba[self._fading] = self._colours
        model.geom_rgba[self._fading, 3] *= 1 - (1 - FADED) * share
        bead = self._bead_view()
        return bead if share >= 1 else self._overview.towards(bead, share)

    def _bead_view(self) -> View:
        data = self._scene.data
        frame = data.xmat[self._work].reshape(3, 3)
        framing = self.framing
        forward = frame @ framing.axes[0]
        return View(
            centre=data.xpos[self._work] + frame @ framing.centre,
            distance=framing.distance(self._shape),
            azimuth=float(np.degrees(np.arctan2(forward[1], forward[0]))),
            elevation=float(np.degrees(np.arcsin(forward[2]))),
            field=FIELD_OF_VIEW,
        )

    def _whole_machine(self) -> View:
        """Return the machine's overview as a free camera, or MuJoCo's view of everything where there is none."""
        model = self._scene.model
        camera = self._scene.camera()
        if camera.type == mujoco.mjtCamera.mjCAMERA_FIXED:
            number = camera.fixedcamid
            axes = self._scene.data.cam_xmat[number].reshape(3, 3)
            if abs(axes[2, 0]) < _UPRIGHT:  # a free camera cannot roll
                place = self._scene.data.cam_xpos[number]
                forward = -axes[:, 2]
                distance = float((self._bead_view().centre - place) @ forward)
                return View(
                    centre=place + distance * forward,
                    distance=distance,
                    azimuth=float(np.degrees(np.arctan2(forward[1], forward[0]))),
                    elevation=float(np.degrees(np.arcsin(forward[2]))),
                    field=float(model.cam_fovy[number]),
                )
            mujoco.mjv_defaultFreeCamera(model, camera)
        field = float(model.vis.global_.fovy)
        return View(camera.lookat.copy(), camera.distance, camera.azimuth, camera.elevation, field)

    def _looks(self) -> Floats:
        """Return the colours of the fading geoms, (k, 4): their materials' where they have any.

        A geom's own colour, where it is not MuJoCo's default one, has precedence over its material's.
        """
        model = self._scene.model
        colours = model.geom_rgba[self._fading].copy()
        materials = model.geom_matid[self._fading]
        default = np.all(colours == [0.5, 0.5, 0.5, 1.0], axis=1)
        from_material = default & (materials >= 0)
        colours[from_material] = model.mat_rgba[materials[from_material]]
        return colours
