"""Positions of the axes as positions of all joints, and of the nozzle of the rigid machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats, read_only_view
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.machine.axis import PER_SI, Axis, AxisAddress
from gantrysim.machine.kinematics import Kinematics

# The nozzle in the work frame through a tree of bodies, for many positions of its joints at once.
#
# Bodies form a tree. From the nearest common ancestor, bodies 1 to n lead to the nozzle and bodies 1 to m to the work.
# With T_i the pose of a body in its parent and J_i(q) the motion of its joints, a point p fixed to the nozzle's body is
# in the work frame at
#
#     J_m(q)^-1 T_m^-1 ... J_1(q)^-1 T_1^-1   T_1 J_1(q) ... T_n J_n(q)  p
#     (down to the work)                      (up from the nozzle)
#
# Its parts are in SI units, as in the compiled model.

_MM = 1e3  # per m


@dataclass(frozen=True)
class _Rigid:
    """p -> R p + t."""

    rotation: Floats
    offset: Floats

    def move(self, points: Floats, _: Floats) -> Floats:
        return points @ self.rotation.T + self.offset

    def then(self, other: _Rigid) -> _Rigid:
        return _Rigid(other.rotation @ self.rotation, other.rotation @ self.offset + other.offset)


@dataclass(frozen=True)
class _Slide:
    """p -> p + (q - q0) a."""

    column: int
    reference: float
    axis: Floats

    def move(self, points: Floats, q: Floats) -> Floats:
        return points + (q[:, self.column] - self.reference)[:, None] * self.axis


@dataclass(frozen=True)
class _Hinge:
    """p -> o + R(a, q - q0) (p - o), with R(a, w) v = a a.v + cos(w) (v - a a.v) + sin(w) a x v."""

    column: int
    reference: float
    axis: Floats
    anchor: Floats

    def move(self, points: Floats, q: Floats) -> Floats:
        angle = (q[:, self.column] - self.reference)[:, None]
        v = points - self.anchor
        along = (v @ self.axis)[:, None] * self.axis
        return along + np.cos(angle) * (v - along) + np.sin(angle) * np.cross(self.axis, v) + self.anchor


class Chain:
    """Position of a site in the frame of a body; other joints than those given stay at their reference.

    Args:
        model: the compiled model.
        site: index of the nozzle.
        body: index of the work.
        moving: address in qpos of each joint that moves, a slide or a hinge.
        per_si: unit of these joints' positions per m or rad, (joints,).

    Attributes:
        turns_body: whether one of these joints is a hinge that turns the body.
    """

    def __init__(self, model: mujoco.MjModel, site: int, body: int, moving: Sequence[int], per_si: Floats) -> None:
        self._per_si = per_si
        columns = {address: column for column, address in enumerate(moving)}
        up = _to_world(model, int(model.site_bodyid[site]))
        down = _to_world(model, body)
        # ancestors of both move them alike
        while up and down and up[-1] == down[-1]:
            up.pop()
            down.pop()
        self._site: Floats = model.site_pos[site].copy()
        self._steps: list[_Rigid | _Slide | _Hinge] = []
        for b in up:
            # MuJoCo moves a body by its joints in their order, so a point is moved by the last one first
            for joint in reversed(_joints(model, b, columns)):
                self._append(_joint(model, joint, columns, 1.0))
            self._append(_Rigid(_rotation(model, b), model.body_pos[b].copy()))
        upward_steps = len(self._steps)
        for b in reversed(down):
            back = _rotation(model, b).T
            self._append(_Rigid(back, -back @ model.body_pos[b]))
            for joint in _joints(model, b, columns):
                self._append(_joint(model, joint, columns, -1.0))
        self.turns_body = any(isinstance(step, _Hinge) for step in self._steps[upward_steps:])
        # without hinges the position is linear: origin + q . directions
        self._linear: tuple[Floats, Floats] | None = None
        if not any(isinstance(step, _Hinge) for step in self._steps):
            origin = self(np.zeros((1, len(columns))))
            self._linear = origin[0], (self(np.diag(per_si)) - origin) / per_si[:, None]

    def _append(self, step: _Rigid | _Slide | _Hinge) -> None:
        last = self._steps[-1] if self._steps else None
        # two rigid motions are one
        if isinstance(step, _Rigid) and isinstance(last, _Rigid):
            self._steps[-1] = last.then(step)
        else:
            self._steps.append(step)

    def __call__(self, positions: Floats) -> Floats:
        """Return positions of the site in the frame of the body, (n, 3) [mm].

        Args:
            positions: of these joints, (n, joints), in the units of `per_si`.
        """
        if self._linear is not None:
            points = np.empty((len(positions), 3))
            # a record's columns lie one behind the other: numba would compile a second function for them
            _fill(points, read_only_view(np.ascontiguousarray(positions)), *self._linear)
            return points
        q = positions / self._per_si
        points = np.broadcast_to(self._site, (len(q), 3))
        for step in self._steps:
            points = step.move(points, q)
        return _MM * points


@jit
def _fill(points: Floats, positions: Floats, origin: Floats, directions: Floats) -> None:
    """Fill in points = origin + positions . directions: in one pass, faster than a product of such thin matrices."""
    n, joints = positions.shape
    for k in range(n):
        for i in range(3):
            point = origin[i]
            for j in range(joints):
                point += positions[k, j] * directions[j, i]
            points[k, i] = point


def _to_world(model: mujoco.MjModel, body: int) -> list[int]:
    """Return a body and its ancestors up to the world."""
    bodies = [body]
    while bodies[-1]:
        bodies.append(int(model.body_parentid[bodies[-1]]))
    return bodies


def _joints(model: mujoco.MjModel, body: int, columns: dict[int, int]) -> list[int]:
    """Return the moving joints of a body in their order."""
    first = int(model.body_jntadr[body])
    count = int(model.body_jntnum[body])
    return [joint for joint in range(first, first + count) if int(model.jnt_qposadr[joint]) in columns]


def _joint(model: mujoco.MjModel, joint: int, columns: dict[int, int], sense: float) -> _Slide | _Hinge:
    """Return the motion of a joint, or with sense -1 its inverse."""
    address = int(model.jnt_qposadr[joint])
    reference = float(model.qpos0[address])
    axis = sense * model.jnt_axis[joint]
    if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
        return _Slide(columns[address], reference, axis)
    return _Hinge(columns[address], reference, axis, model.jnt_pos[joint].copy())


def _rotation(model: mujoco.MjModel, body: int) -> Floats:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, model.body_quat[body])
    return matrix.reshape(3, 3)


_SLOPE_STEP = 1e-3  # difference of positions for slopes [mm or deg]


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
        """Return qpos at positions of the axes, (..., nq); joints that neither move nor follow are at their reference.

        Args:
            reference: qpos0 of the model, which may have home offsets, (nq,).
            position: of the axes, (..., axes) [mm or deg].
        """
        position = np.asarray(position, float)
        positions = np.atleast_2d(position)
        qpos = np.tile(reference, (len(positions), 1))
        qpos[:, self._joints] = positions / self._per_si
        # a home offset moves the reference: encoders read zero where the axis is not
        offset = (self._reference - reference)[self._joints] * self._per_si
        qpos[:, self._followers] = self._kinematics.follow(positions + offset)
        return qpos.reshape(*position.shape[:-1], -1)

    def rates(self, physics: mujoco.MjModel) -> Floats:
        """Return the velocity of every degree of freedom per velocity of an axis at zero [SI], (nv, axes)."""
        kinematics = self._kinematics
        steps = _SLOPE_STEP * np.eye(len(self._per_si))
        rates = np.zeros((physics.nv, len(steps)))
        driven = [int(joint) for joint in physics.actuator_trnid[:, 0]]
        rates[physics.jnt_dofadr[driven], np.arange(len(steps))] = 1.0
        slopes = (kinematics.follow(steps) - kinematics.follow(-steps)) / (2 * _SLOPE_STEP)
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
        # an array's text has line breaks
        text = " ".join(str(position).split())
        raise InputError(f"position = {text}: must be {len(axes)} finite numbers, one per axis: {units}")
    return numbers
