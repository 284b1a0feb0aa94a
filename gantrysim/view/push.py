"""Hands the forces that a mouse puts on what is shown to the machine that is stepped."""

from __future__ import annotations

import mujoco
import numpy as np

from gantrysim.arrays import Floats
from gantrysim.errors import InputError

STIFFNESS = 300.0  # of the mouse's spring per mass; MuJoCo's own 100 moves free bodies, and no servo [N/(m·kg)]


class Bodies:
    """Which body of the model that is stepped each body of the one that is shown is, by name.

    A body that is only shown hands its force to the nearest one above it that is stepped too:

        tau' = tau + (c - c') x f

    with c and c' the centres of mass, for a force f and a torque tau about the centre of mass.

    Args:
        shown: the model in the viewer.
        stepped: the model that the simulation steps.

    Raises:
        InputError: none of the shown bodies that joints move is stepped.
    """

    def __init__(self, shown: mujoco.MjModel, stepped: mujoco.MjModel) -> None:
        self._bodies = stepped.nbody
        self._own = np.zeros(shown.nbody, np.intp)  # of every shown body, the shown one that takes its force
        self._target = np.zeros(shown.nbody, np.intp)  # the same in the stepped model
        # without names a body is known by its number, where all the numbers before it agree
        same = True
        for body in range(1, shown.nbody):
            name, parent = shown.body(body).name, int(shown.body_parentid[body])
            same = same and body < stepped.nbody and name == stepped.body(body).name
            found = mujoco.mj_name2id(stepped, mujoco.mjtObj.mjOBJ_BODY, name) if name else (body if same else -1)
            self._own[body], self._target[body] = (
                (body, found) if found > 0 else (self._own[parent], self._target[parent])
            )
        if shown.nbody > 1 and stepped.nbody > 1 and not self._target.any():
            raise InputError("the model that is shown has no body of the one that is stepped")

    def handed_on(self, wrench: Floats, centre: Floats) -> Floats:
        """Return forces and torques on the stepped bodies, as `xfrc_applied` has them, (bodies, 6) [N, N·m].

        Args:
            wrench: force and torque on the shown bodies, (shown bodies, 6) [N, N·m].
            centre: their centres of mass, `xipos`, (shown bodies, 3) [m].
        """
        result = np.zeros((self._bodies, 6))
        for body in np.flatnonzero(wrench.any(axis=1)):
            target, own = int(self._target[body]), int(self._own[body])
            if target == 0:
                continue  # the world does not yield
            force, torque = wrench[body, :3], wrench[body, 3:]
            result[target, :3] += force
            result[target, 3:] += torque + np.cross(centre[body] - centre[own], force)
        return result
