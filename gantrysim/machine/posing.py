"""Positions of the axes as positions of all joints, and of the nozzle of the rigid machine."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.axis import PER_SI, Axis, AxisAddress
from gantrysim.machine.chain import Chain
from gantrysim.machine.kinematics import Kinematics

_SMALL = 1e-3  # difference of positions for slopes [mm or deg]


class Posing:
    """Joints of a machine at positions of its axes.

    Args:
        physics: the compiled model without perturbations.
        axes: the axes in the order of the actuators.
        addresses: their indices in MuJoCo's arrays.
        kinematics: of the machine, for the joints that follow the axes through a closed chain.
        nozzle: index of the site.
        work: index of the body.

    Attributes:
        turns_work: whether a driven hinge turns the work.
    """

    def __init__(
        self,
        physics: mujoco.MjModel,
        axes: Sequence[Axis],
        addresses: Sequence[AxisAddress],
        kinematics: Kinematics,
        nozzle: int,
        work: int,
    ) -> None:
        self._kinematics = kinematics
        self._joints = [address.joint for address in addresses]
        self._followers: list[int] = physics.jnt_qposadr[np.array(kinematics.followers, int)].tolist()
        self._per_si = np.array([PER_SI[axis.unit] for axis in axes])
        self._reference: Floats = physics.qpos0.copy()
        # the kinematics give followers in SI units
        per_si = np.concatenate([self._per_si, np.ones(len(self._followers))])
        self._chain = Chain(physics, nozzle, work, [*self._joints, *self._followers], per_si)
        self.turns_work = self._chain.turns_body

    def qpos(self, reference: Floats, position: ArrayLike) -> Floats:
        """Return qpos at a position of the axes, (nq,); joints that neither move nor follow are at their reference.

        Args:
            reference: qpos0 of the model, which may have home offsets, (nq,).
            position: of the axes, (axes,) [mm or deg].
        """
        position = np.asarray(position, float)
        qpos = reference.copy()
        qpos[self._joints] = position / self._per_si
        # a home offset moves the reference: encoders read zero where the axis is not
        offset = (self._reference - reference)[self._joints] * self._per_si
        qpos[self._followers] = self._kinematics.follow((position + offset)[None])[0]
        return qpos

    def rates(self, physics: mujoco.MjModel) -> Floats:
        """Return the velocity of every degree of freedom per velocity of an axis at zero [SI], (nv, axes)."""
        kinematics = self._kinematics
        steps = _SMALL * np.eye(len(self._per_si))
        rates = np.zeros((physics.nv, len(steps)))
        driven = [int(joint) for joint in physics.actuator_trnid[:, 0]]
        rates[physics.jnt_dofadr[driven], np.arange(len(steps))] = 1.0
        slopes = (kinematics.follow(steps) - kinematics.follow(-steps)) / (2 * _SMALL)
        rates[physics.jnt_dofadr[np.array(kinematics.followers, int)]] = slopes.T * self._per_si
        return rates

    def tip(self, position: ArrayLike) -> Floats:
        """Return the nozzle in the work frame, (n, 3) [mm], at positions of the axes, (n, axes) [mm or deg]."""
        position = np.asarray(position, float)
        joints = np.atleast_2d(position)
        if self._followers:
            joints = np.concatenate([joints, self._kinematics.follow(joints)], axis=1)
        return self._chain(joints).reshape(*position.shape[:-1], 3)


def checked_position(axes: Sequence[Axis], position: ArrayLike | None) -> Floats:
    """Return a position as an array, (axes,), by default zero; raise InputError unless it is a number per axis."""
    if position is None:
        return np.zeros(len(axes))
    try:
        numbers = np.asarray(position, float)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    if numbers.shape != (len(axes),) or not np.isfinite(numbers).all():
        units = ", ".join(f"{axis.name} [{axis.unit}]" for axis in axes)
        text = " ".join(str(position).split())  # an array's text has line breaks
        raise InputError(f"position = {text}: must be {len(axes)} finite numbers, one per axis: {units}")
    return numbers
