"""Deviations of a machine from its MJCF: payload, friction, stiffness, motor constants and home offsets.

They are written to the compiled model's arrays, none of which changes its size: `mujoco.batch` can then vary the fields
between simulations.
"""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, finite, positive
from gantrysim.machine.axis import PER_SI, Axis
from gantrysim.machine.motors import BRISTLE_DAMPING, BRISTLE_STIFFNESS, COULOMB, MOTOR_CONSTANT, STATIC, dcmotors

PerAxis = float | tuple[float, ...]  # one value for all axes, or one per axis
_thread = threading.local()  # .data: a state of .model, slow to make
FACTORS = ("friction", "viscous", "stiffness", "motor_constant")


@dataclass(frozen=True)
class Perturbation:
    """Deviations of a machine from its MJCF; none by default.

    A factor or offset is one number for all axes, or one per axis in their order.

    Attributes:
        payload: mass added at the centre of mass of the body that carries the nozzle, or of the work if the nozzle is
            fixed. Gravity compensation (`gravcomp`) keeps its force [kg].
        friction: factor on the motors' LuGre friction and the axis joints' frictionloss. All of
            F = sigma0 z + sigma1 dz/dt, dz/dt = v - sigma0 |v| z / g(v) is scaled, that is sigma0, sigma1 and g: the
            same motion meets the scaled force.
        viscous: factor on the damping of axis joints and motors.
        stiffness: factor on the springs of joints that no axis drives, and on tendons that are springs; each takes
            that of the next axis above it, a tendon that of the axis that pulls it.
        motor_constant: factor on K of the motors. The drive converts torque demand to current by the nominal K, so the
            torque is the demand times the factor. Current and voltage limits stay, so the peak torque scales too.
        geometry: factors on errors of the machine's geometry, as (column, factor) with the names of
            `KinematicErrors.columns` and "warming"; nothing on a machine with an ideal geometry.
        home_offset: true axis position minus the position according to the encoder [mm or deg].
    """

    payload: float = 0.0
    friction: PerAxis = 1.0
    viscous: PerAxis = 1.0
    stiffness: PerAxis = 1.0
    motor_constant: PerAxis = 1.0
    home_offset: PerAxis = 0.0
    geometry: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "payload", finite("payload", self.payload, "kg"))
        for name in FACTORS:
            self._check(name, f"factor of {name}", positive)
        self._check("home_offset", "home_offset", finite)
        pairs = tuple((name, finite(f"factor of {name}", factor)) for name, factor in self.geometry)
        object.__setattr__(self, "geometry", pairs)

    def _check(self, name: str, label: str, check: Callable[[str, float], float]) -> None:
        value = getattr(self, name)
        several = isinstance(value, Iterable) and not isinstance(value, str)
        checked = tuple(check(label, item) for item in value) if several else check(label, value)
        object.__setattr__(self, name, checked)

    def per_axis(self, name: str, axes: Sequence[str]) -> Floats:
        """Return the attribute `name` for each of the named axes, (axes,).

        Raises:
            InputError: it has one value per axis, for another number of axes.
        """
        value = getattr(self, name)
        if isinstance(value, tuple) and len(value) != len(axes):
            raise InputError(
                f"{name} has {len(value)} values: must be one or {len(axes)}, of the axes {', '.join(axes)}"
            )
        return np.full(len(axes), value, float)


def perturbed_model(
    model: mujoco.MjModel,
    perturbation: Perturbation,
    *,
    axes: Sequence[Axis],
    joints: Sequence[int],
    nozzle: int,
    work: int,
) -> mujoco.MjModel:
    """Return a copy of a compiled model with a perturbation in its arrays.

    Args:
        model: the compiled model; it is not changed.
        perturbation: the deviations.
        axes: axes of the machine, in the order of the actuators.
        joints: index of each axis' joint.
        nozzle: index of the site.
        work: index of the body.

    Raises:
        InputError: a payload that leaves the body no mass, or factors for another number of axes.
    """
    changed = copy.copy(model)
    names = [axis.name for axis in axes]
    friction, viscous, constant, stiffness = (
        perturbation.per_axis(name, names) for name in ("friction", "viscous", "motor_constant", "stiffness")
    )
    dofs = model.jnt_dofadr[list(joints)]
    motors = dcmotors(model)

    changed.actuator_biasprm[:, [COULOMB, STATIC]] *= friction[:, None] ** motors
    changed.actuator_dynprm[:, [BRISTLE_STIFFNESS, BRISTLE_DAMPING]] *= friction[:, None] ** motors
    changed.dof_frictionloss[dofs] *= friction

    changed.dof_damping[dofs] *= viscous
    changed.dof_dampingpoly[dofs] *= viscous[:, None]
    changed.actuator_damping[:] *= viscous
    changed.actuator_dampingpoly[:] *= viscous[:, None]

    for joint in _springs(model, joints):
        axis = _axis_above(model, joint, joints)
        if axis is None and np.ptp(stiffness):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
            raise InputError(f"factors of stiffness per axis: no axis carries the spring {name!r}; give one for all")
        changed.jnt_stiffness[joint] *= stiffness[axis or 0]
        changed.jnt_stiffnesspoly[joint] *= stiffness[axis or 0]

    for tendon in _elastic_tendons(model):
        pulling = _axes_of(model, tendon, joints)
        if len(pulling) != 1 and np.ptp(stiffness):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon)
            raise InputError(
                f"factors of stiffness per axis: {len(pulling)} axes pull tendon {name!r}; give one for all"
            )
        changed.tendon_stiffness[tendon] *= stiffness[min(pulling, default=0)]
        changed.tendon_stiffnesspoly[tendon] *= stiffness[min(pulling, default=0)]

    changed.actuator_gainprm[:, [MOTOR_CONSTANT]] *= constant[:, None] ** motors
    changed.actuator_forcerange[:] *= constant[:, None]  # current limits
    changed.actuator_ctrlrange[:] *= constant[:, None]

    if perturbation.payload:
        _add_payload(changed, perturbation.payload, nozzle, work)
        mujoco.mj_setConst(changed, _scratch(model))
    # a joint's displacement is qpos - qpos0, its encoder reads qpos
    offset = perturbation.per_axis("home_offset", names) / [PER_SI[axis.unit] for axis in axes]
    changed.qpos0[model.jnt_qposadr[list(joints)]] -= offset
    for tendon in range(model.ntendon):  # the length of a fixed tendon is that of its encoders
        for wrap in _wraps(model, tendon):
            if model.wrap_type[wrap] == mujoco.mjtWrap.mjWRAP_JOINT and model.wrap_objid[wrap] in joints:
                pulled = model.wrap_prm[wrap] * offset[list(joints).index(model.wrap_objid[wrap])]
                changed.tendon_lengthspring[tendon] -= pulled
                changed.tendon_length0[tendon] -= pulled
    return changed


def _scratch(model: mujoco.MjModel) -> mujoco.MjData:
    """Return a state of this thread that fits a model and its copies, to be overwritten."""
    if getattr(_thread, "model", None) is not model:
        _thread.model = model
        _thread.data = mujoco.MjData(model)
    mujoco.mj_resetData(model, _thread.data)
    return _thread.data


def springs_have_axes(model: mujoco.MjModel, joints: Sequence[int]) -> bool:
    """Return whether each axis can have its own stiffness factor: there is one axis, or one for every spring."""
    above = all(_axis_above(model, spring, joints) is not None for spring in _springs(model, joints))
    pulled = all(len(_axes_of(model, tendon, joints)) == 1 for tendon in _elastic_tendons(model))
    return len(joints) == 1 or (above and pulled)


def spring_of(model: mujoco.MjModel, joints: Sequence[int], axis: int) -> str | None:
    """Return the name of the first spring joint that an axis carries with no other axis between, or None.

    Args:
        model: the compiled model.
        joints: index of each axis' joint.
        axis: index of the axis.
    """
    carried = [joint for joint in _springs(model, joints) if _axis_above(model, joint, joints) == axis]
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, carried[0]) if carried else None


def _elastic_tendons(model: mujoco.MjModel) -> list[int]:
    return [tendon for tendon in range(model.ntendon) if model.tendon_stiffness[tendon] > 0]


def _wraps(model: mujoco.MjModel, tendon: int) -> range:
    first = int(model.tendon_adr[tendon])
    return range(first, first + int(model.tendon_num[tendon]))


def _axes_of(model: mujoco.MjModel, tendon: int, driven: Sequence[int]) -> set[int]:
    """Return the axes whose joints a fixed tendon couples."""
    ends = [w for w in _wraps(model, tendon) if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT]
    return {list(driven).index(model.wrap_objid[w]) for w in ends if model.wrap_objid[w] in driven}


def _springs(model: mujoco.MjModel, driven: Sequence[int]) -> list[int]:
    return [joint for joint in range(model.njnt) if joint not in driven and model.jnt_stiffness[joint] > 0]


def _axis_above(model: mujoco.MjModel, joint: int, driven: Sequence[int]) -> int | None:
    """Return the index of the axis whose joint is next above a joint in the tree, or None."""
    body = int(model.jnt_bodyid[joint])
    below = joint
    while body:
        first = int(model.body_jntadr[body])
        count = int(model.body_jntnum[body])
        for other in reversed(range(first, first + count)):
            if other < below and other in driven:
                return list(driven).index(other)
        body = int(model.body_parentid[body])
        below = model.njnt
    return None


def _add_payload(model: mujoco.MjModel, payload: float, nozzle: int, work: int) -> None:
    body = int(model.site_bodyid[nozzle])
    if not model.body_weldid[body]:  # the nozzle is fixed: the work moves
        body = work
    mass = float(model.body_mass[body])
    if payload < 0 and not mass + payload > 0:
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body)
        raise InputError(f"payload = {payload:g} kg: must leave the body {name!r} a mass, which is {mass:g} kg")
    model.body_mass[body] += payload
    model.body_gravcomp[body] *= mass / (mass + payload)
