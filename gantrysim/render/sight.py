"""Lines of sight from a camera to a bead: from which side the machine hides least of it, and which parts hide it."""

from __future__ import annotations

import copy
from collections.abc import Sequence, Set

import mujoco
import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.machine.machine import NEEDLE, NOZZLE, Machine
from gantrysim.machine.quiet import quiet
from gantrysim.record.run import Run
from gantrysim.render.framing import Framing

_AZIMUTHS = np.arange(20.0, 380.0, 30.0)  # that are tried; none looks straight along an axis of the work [deg]
_POSES = 12  # of a run, in which what hides the bead is looked for
_TARGETS = 12  # points of the bead to which is looked in each pose
_ABOVE = 5e-4  # of these points above the nozzle's path, so that lines end before the work [m]
_IN_LINE = 0.012  # distance from the needle's axis in plan view up to which a part belongs to the needle [m]
_NEARER = 0.25  # share of the bead that may be hidden for half the distance


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
        self._model.geom_matid[:] = -1  # colours are written to the geoms: lines pass what is transparent
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
            return self.hidden_share(framing) / _NEARER + float(np.log2(framing.distance(self._shape)))

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
        targets = data.xpos[work] + np.add(points, [0.0, 0.0, _ABOVE]) @ frame.T
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
