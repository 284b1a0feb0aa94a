"""The camera of a film: the whole machine first, then a flight to the bead, which it holds from then on.

It holds the whole bead from the side where least of the machine hides it.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence, Set
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import by_blocks
from gantrysim.glue.bead.trace import LEVEL_CLIMB, climb
from gantrysim.machine.machine import NEEDLE, NOZZLE, Machine
from gantrysim.machine.quiet import quiet
from gantrysim.record.run import Run
from gantrysim.render.scene import Scene

# Lines of sight from a camera to a bead: from which side the machine hides least of it, and which parts hide it.

_AZIMUTHS = np.arange(20.0, 380.0, 30.0)  # that are tried; none looks straight along an axis of the work [deg]
_POSES = 12  # of a run, in which what hides the bead is looked for
_TARGETS = 12  # points of the bead to which is looked in each pose
_ABOVE_PATH = 5e-4  # of these points above the nozzle's path, so that lines end before the work [m]
_IN_LINE = 0.012  # distance from the needle's axis in plan view up to which a part belongs to the needle [m]
_HIDDEN_SHARE = 0.25  # share of the bead that may be hidden for half the distance

FIELD_OF_VIEW = 35.0  # vertical [deg]
PICTURE_MARGIN = 1.2  # half width and height of the picture over those of the bead
_FLAT_ELEVATION = -35.0  # of the camera's axis, for beads in a level plane [deg]
_STEEP_ELEVATION = -50.0  # for bowls and cones, whose far side a flatter view hides [deg]
_NEAREST_CAMERA = 0.08  # from the camera to the middle of a bead: nearer, the needle would leave the picture [m]
_MOST_POINTS = 2000  # of a bead that are looked at


class Sight:
    """Lines of sight to the bead of a run, past the parts of a machine that move against the work.

    Parts that stand still against the work do not hide the bead for long, and the needle with what is above it
    belongs in the picture: lines pass both.

    Args:
        model: compiled machine, also with further geoms; its copy is looked at.
        machine: the same machine.
        run: of which some poses are looked at.
        width_over_height: of the picture.
    """

    def __init__(self, model: mujoco.MjModel, machine: Machine, run: Run, width_over_height: float) -> None:
        self._model = copy.copy(model)
        # colours are written to the geoms: lines pass what is transparent
        self._model.geom_matid[:] = -1
        self._data = mujoco.MjData(self._model)
        self._machine = machine
        self._run = run
        self._shape = width_over_height
        ticks = np.linspace(0, len(run.time) - 1, _POSES).astype(int)
        self._poses = [machine.to_qpos(run.encoder[tick]) for tick in ticks]
        self._pose(self._poses[0])
        self._opaque = self._moving() & ~self._in_line()

    def framing(self, others: Sequence[Run] = ()) -> Framing:
        """Return the framing of the bead from the side from which it is seen best.

        It is the one with the least distance, where half the distance outweighs a quarter of the bead that is hidden.

        Args:
            others: further runs, whose beads are to be in the picture too.
        """
        framings = [Framing.of([self._run, *others], float(azimuth)) for azimuth in _AZIMUTHS]

        def merit(framing: Framing) -> float:
            return self.hidden_share(framing) / _HIDDEN_SHARE + float(np.log2(framing.distance(self._shape)))

        return min(framings, key=merit)

    def hidden_share(self, framing: Framing) -> float:
        """Return the share of the lines, over poses and points of the bead, that something before them ends."""
        return float(np.mean([self._hits(framing, pose).size for pose in self._poses])) / _TARGETS

    def hiding(self, framing: Framing) -> NDArray[np.intp]:
        """Return the geoms that hide a point of the bead in some pose, also those behind others."""
        hiding: set[int] = set()
        for pose in self._poses:
            while (hits := self._hits(framing, pose, hiding)).size:
                hiding |= set(hits.tolist())
        return np.array(sorted(hiding), np.intp)

    def _hits(self, framing: Framing, pose: Floats, passed: Set[int] = frozenset()) -> NDArray[np.intp]:
        """Return the first geom on each line that ends before the bead, but for those that are passed."""
        model = self._model
        data = self._data
        self._pose(pose)
        model.geom_rgba[:, 3] = self._opaque
        model.geom_rgba[list(passed), 3] = 0.0
        work = self._machine.work
        frame = data.xmat[work].reshape(3, 3)
        camera = data.xpos[work] + frame @ framing.position(self._shape)
        points = framing.points[np.linspace(0, len(framing.points) - 1, _TARGETS).astype(int)]
        targets = data.xpos[work] + np.add(points, [0.0, 0.0, _ABOVE_PATH]) @ frame.T
        geom = np.zeros(1, np.int32)
        hits = []
        for target in targets:
            share = mujoco.mj_ray(model, data, camera, target - camera, None, 1, -1, geom, None)
            if 0 <= share < 1:
                hits.append(int(geom[0]))
        return np.array(hits, np.intp)

    def _pose(self, pose: Floats) -> None:
        self._data.qpos[:] = pose
        with quiet():
            mujoco.mj_kinematics(self._model, self._data)

    def _moving(self) -> NDArray[np.bool_]:
        """Return which geoms move against the work."""
        welded = self._model.body_weldid
        return np.asarray(welded[self._model.geom_bodyid] != welded[self._machine.work])

    def _in_line(self) -> NDArray[np.bool_]:
        """Return which geoms are the needle or lie in line with it, such as a syringe."""
        model = self._model
        tip = self._data.site_xpos[model.site(NOZZLE).id]
        aside = np.linalg.norm(self._data.geom_xpos[:, :2] - tip[:2], axis=1)
        names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) for geom in range(model.ngeom)]
        return (aside < _IN_LINE) | np.array([name == NEEDLE for name in names])


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
            # a free camera cannot roll
            if abs(axes[2, 0]) < _UPRIGHT:
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


@dataclass(frozen=True, eq=False)
class Framing:
    """Axis of a camera in the frame of the work, whose distance holds all points of a bead.

    Attributes:
        points: places of the nozzle with glue, (n, 3) [m].
        azimuth: direction in which the camera looks, from the work's x axis about z [deg].
        elevation: above the work's xy plane, negative for a camera that looks down [deg].
    """

    points: Floats
    azimuth: float
    elevation: float

    @classmethod
    def of(cls, runs: Sequence[Run], azimuth: float) -> Framing:
        """Return the framing of the beads of some runs; of one that lays none, of the whole path of its nozzle."""
        shown = [np.flatnonzero(run.dispense) if run.dispense.any() else np.arange(len(run.time)) for run in runs]
        sizes = [ticks.size for ticks in shown]
        every = max(1, sum(sizes) // _MOST_POINTS)
        points: list[Floats] = []
        heights: list[Floats] = []
        for run, ticks, before in zip(runs, shown, np.cumsum([0, *sizes[:-1]]).tolist(), strict=True):
            # evenly from all runs together
            points.append(run.nozzle[ticks[-before % every :: every]])
            heights.append(_heights(run, ticks))
        elevation = _FLAT_ELEVATION if climb(np.concatenate(heights)) <= LEVEL_CLIMB else _STEEP_ELEVATION
        return cls(1e-3 * np.concatenate(points), azimuth, elevation)

    @cached_property
    def centre(self) -> Floats:
        """Centre of the box around the points, at which the camera looks, (3,) [m]."""
        return 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))

    @property
    def axes(self) -> tuple[Floats, Floats, Floats]:
        """The camera's axes in the work's frame: forward, right and up, (3,) each."""
        azimuth = np.radians(self.azimuth)
        elevation = np.radians(self.elevation)
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        forward = np.cos(elevation) * level + [0.0, 0.0, np.sin(elevation)]
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        return forward, right, np.cross(right, forward)

    def distance(self, width_over_height: float, margin: float = PICTURE_MARGIN) -> float:
        """Return the least distance of the camera from the centre at which every point is in the picture [m].

        A point p, relative to the centre, lies d + p.f before a camera at the distance d, and p.r beside its axis. It
        is inside the margin m of a picture with the half angle a where

            m |p.r| <= (d + p.f) tan(a),

        which holds for all points from the largest m |p.r| / tan(a) - p.f; the same in height.

        Args:
            width_over_height: of the picture.
            margin: half width and half height of the picture over those of the bead.
        """
        forward, right, up = self.axes
        relative = self.points - self.centre
        half_height = np.tan(np.radians(0.5 * FIELD_OF_VIEW))
        half_width = half_height * width_over_height
        beside = margin * np.abs(relative @ right) / half_width
        above = margin * np.abs(relative @ up) / half_height
        return max(float((np.maximum(beside, above) - relative @ forward).max()), _NEAREST_CAMERA)

    def in_picture(self, width_over_height: float) -> Floats:
        """Return the places of the points in the picture, (n, 2): -1 to 1 from left to right and from bottom to top."""
        forward, right, up = self.axes
        relative = self.points - self.centre
        half_height = np.tan(np.radians(0.5 * FIELD_OF_VIEW))
        depth = self.distance(width_over_height) + relative @ forward
        across = (relative @ right) / (depth * half_height * width_over_height)
        return np.stack([across, (relative @ up) / (depth * half_height)], axis=1)

    def position(self, width_over_height: float) -> Floats:
        """Return the place of the camera in the frame of the work, (3,) [m]."""
        return self.centre - self.distance(width_over_height) * self.axes[0]


def _heights(run: Run, ticks: NDArray[np.intp]) -> Floats:
    """Return the height of the nozzle at ticks, (n,) [mm]; block by block, as a long run does not fit in memory."""
    return by_blocks(lambda block: run.nozzle[ticks[block], 2], ticks.size)
