"""A run and all that is needed to play it in a window."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.render.scene import Scene
from gantrysim.render.view.source import Source

# Forces of the mouse on the displayed model, transferred to the simulated one.

STIFFNESS = 300.0  # of the mouse's spring per mass; MuJoCo's 100 is too weak against a servo [N/(m·kg)]


class Bodies:
    """Map from bodies of the displayed model to bodies of the simulated one, by name.

    A body that exists only in the displayed model passes its force to its nearest ancestor that is simulated:

        tau' = tau + (c - c') x f

    with c and c' the centres of mass, for a force f and a torque tau about the centre of mass.

    Args:
        shown: the displayed model.
        simulated: the simulated model.

    Raises:
        InputError: no displayed body is simulated.
    """

    def __init__(self, shown: mujoco.MjModel, simulated: mujoco.MjModel) -> None:
        self._count = simulated.nbody
        # displayed body that takes the force of each displayed one
        self._source = np.zeros(shown.nbody, np.intp)
        # the same body in the simulated model
        self._target = np.zeros(shown.nbody, np.intp)
        # unnamed bodies are matched by number as long as all before them agree
        same = True
        for body in range(1, shown.nbody):
            name = shown.body(body).name
            parent = int(shown.body_parentid[body])
            same = same and body < simulated.nbody and name == simulated.body(body).name
            simulated_body = body if same else -1
            if name:
                simulated_body = mujoco.mj_name2id(simulated, mujoco.mjtObj.mjOBJ_BODY, name)
            # a body that is displayed alone passes its force on to the nearest one above it that is simulated
            self._source[body] = body if simulated_body > 0 else self._source[parent]
            self._target[body] = simulated_body if simulated_body > 0 else self._target[parent]
        if shown.nbody > 1 and simulated.nbody > 1 and not self._target.any():
            raise InputError("the displayed model has no body of the simulated one")

    def transferred(self, wrench: Floats, centre: Floats) -> Floats:
        """Return forces and torques on the simulated bodies, as `xfrc_applied` has them, (bodies, 6) [N, N·m].

        Args:
            wrench: force and torque on the displayed bodies, (displayed bodies, 6) [N, N·m].
            centre: their centres of mass, `xipos`, (displayed bodies, 3) [m].
        """
        result = np.zeros((self._count, 6))
        for body in np.flatnonzero(wrench.any(axis=1)):
            target = int(self._target[body])
            source = int(self._source[body])
            if target == 0:
                continue  # the world is fixed
            force = wrench[body, :3]
            torque = wrench[body, 3:]
            result[target, :3] += force
            result[target, 3:] += torque + np.cross(centre[body] - centre[source], force)
        return result


class Playback(NamedTuple):
    """A run to be played.

    Attributes:
        name: of the job.
        scene: of the source's machine.
        source: of the run.
        bodies: that the mouse may push; None for a replay.
    """

    name: str
    scene: Scene
    source: Source
    bodies: Bodies | None = None
