"""A machine that is not quite the drawing's: payload, friction, stiffness, motor constants and zeros that are off.

The model's arrays are changed, not its MJCF, and no array changes its size; so the changed fields can just as well be
one simulation's of a batch.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass

import mujoco
import numpy as np

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, finite, positive
from gantrysim.machine.axis import PER_SI, Axis

PerAxis = float | tuple[float, ...]  # of all axes, or one per axis
FACTORS = ("friction", "viscous", "stiffness", "motor_constant")

# where MuJoCo keeps a dcmotor's numbers
_MOTOR_CONSTANT = 1  # in gainprm
_COGGING = 0  # in biasprm, the amplitude
_COULOMB, _STATIC = 3, 4  # in biasprm
_BRISTLE_STIFFNESS, _BRISTLE_DAMPING = 5, 6  # in dynprm

_NEXT_TO_NOTHING = 1e-30


@dataclass(frozen=True)
class Perturbation:
    """What of a machine differs from its MJCF; as it stands, nothing.

    A factor, or an offset, is one number for all axes, or one per axis in their order.

    Attributes:
        payload: mass added at the centre of mass of the body that bears the nozzle, or where the nozzle stands still,
            of the body `work`; a spring that carries the body (`gravcomp`) carries what it did before [kg].
        friction: of the LuGre law of the motors and of frictionloss of the axes' joints. With f all of
            F = sigma0 z + sigma1 dz/dt, dz/dt = v - sigma0 |v| z / g(v) is scaled, sigma0, sigma1 and g alike: the same
            motion meets f times the force.
        viscous: of the damping of the axes' joints and of the motors.
        stiffness: of the springs in joints that no axis drives, each with the axis above it in the tree.
        motor_constant: K of the motors. The drive does not know: it turns the torque demand into current by the
            nominal K, so the torque is the demand times the factor. Limits of current and voltage stay, and with
            them goes the peak torque.
        home_offset: from where the controller takes an axis to be to where it is [mm or deg].
    """

    payload: float = 0.0
    friction: PerAxis = 1.0
    viscous: PerAxis = 1.0
    stiffness: PerAxis = 1.0
    motor_constant: PerAxis = 1.0
    home_offset: PerAxis = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "payload", finite("payload", self.payload, "kg"))
        for name in FACTORS:
            self._check(name, f"factor of {name}", positive)
        self._check("home_offset", "home_offset", finite)

    def _check(self, name: str, called: str, check: Callable[[str, float], float]) -> None:
        value = getattr(self, name)
        several = isinstance(value, Iterable) and not isinstance(value, str)
        checked = tuple(check(called, item) for item in value) if several else check(called, value)
        object.__setattr__(self, name, checked)

    @property
    def nothing(self) -> bool:
        """Whether the machine is left as it is."""
        factors = all(np.all(np.equal(getattr(self, name), 1.0)) for name in FACTORS)
        return factors and not self.payload and not np.any(self.home_offset)

    def per_axis(self, name: str, axes: Sequence[str]) -> Floats:
        """Return a factor or an offset for each axis, (axes,).

        Args:
            name: of the attribute.
            axes: names of the machine's axes.

        Raises:
            InputError: it has one value per axis, of another number of axes.
        """
        value = getattr(self, name)
        if isinstance(value, tuple) and len(value) != len(axes):
            raise InputError(
                f"{name} has {len(value)} values: must be one or {len(axes)}, of the axes {', '.join(axes)}"
            )
        return np.broadcast_to(np.asarray(value, float), (len(axes),)).copy()

    def numbers(self) -> dict[str, float | list[float]]:
        """Return all values as plain numbers and lists."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}


def perturbed_model(
    model: mujoco.MjModel,
    perturbation: Perturbation,
    *,
    axes: Sequence[Axis],
    joints: Sequence[int],
    nozzle: int,
    work: int,
) -> mujoco.MjModel:
    """Return a copy of a compiled model with the perturbation in its arrays.

    Args:
        model: left as it is.
        perturbation: what differs.
        axes: of the machine, in the order of the actuators.
        joints: index of the joint of each axis.
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

    changed.actuator_biasprm[:, [_COULOMB, _STATIC]] *= friction[:, None] ** _dcmotors(model)
    changed.actuator_dynprm[:, [_BRISTLE_STIFFNESS, _BRISTLE_DAMPING]] *= friction[:, None] ** _dcmotors(model)
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

    changed.actuator_gainprm[:, [_MOTOR_CONSTANT]] *= constant[:, None] ** _dcmotors(model)
    changed.actuator_forcerange[:] *= constant[:, None]  # the limits of the current
    changed.actuator_ctrlrange[:] *= constant[:, None]

    if perturbation.payload:
        _load(changed, perturbation.payload, nozzle, work)
        mujoco.mj_setConst(changed, mujoco.MjData(changed))
    # a joint moves by its position less its reference: with this it is further on than its encoder tells
    offset = perturbation.per_axis("home_offset", names) / [PER_SI[axis.unit] for axis in axes]
    changed.qpos0[model.jnt_qposadr[list(joints)]] -= offset
    return changed


def smooth_model(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a compiled model with viscous friction alone: without LuGre friction, frictionloss and cogging.

    Args:
        model: left as it is.
    """
    changed = copy.copy(model)
    motors = _dcmotors(model)
    # not zero, for with that MuJoCo would look for an activation less than there is
    changed.actuator_dynprm[:, [_BRISTLE_STIFFNESS, _BRISTLE_DAMPING]] *= _NEXT_TO_NOTHING**motors
    changed.actuator_biasprm[:, [_COGGING]] *= 1 - motors
    changed.dof_frictionloss[:] = 0
    changed.tendon_frictionloss[:] = 0
    return changed


def springs_have_axes(model: mujoco.MjModel, joints: Sequence[int]) -> bool:
    """Return whether each axis can have a factor of stiffness of its own: a spring above all axes has none.

    Args:
        model: of the machine.
        joints: index of the joint of each axis.
    """
    return len(joints) == 1 or all(_axis_above(model, spring, joints) is not None for spring in _springs(model, joints))


def _dcmotors(model: mujoco.MjModel) -> Floats:
    """1 for a dcmotor, 0 for an ideal torque source, whose arrays mean something else, (actuators, 1)."""
    return (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR).astype(float)[:, None]


def _springs(model: mujoco.MjModel, driven: Sequence[int]) -> list[int]:
    return [joint for joint in range(model.njnt) if joint not in driven and model.jnt_stiffness[joint] > 0]


def _axis_above(model: mujoco.MjModel, joint: int, driven: Sequence[int]) -> int | None:
    """Index of the axis whose joint is next above another in the tree; None where there is none."""
    body = int(model.jnt_bodyid[joint])
    below = joint
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for other in reversed(range(first, first + count)):
            if other < below and other in driven:
                return list(driven).index(other)
        body = int(model.body_parentid[body])
        below = model.njnt
    return None


def _load(model: mujoco.MjModel, payload: float, nozzle: int, work: int) -> None:
    body = int(model.site_bodyid[nozzle])
    if not model.body_weldid[body]:  # the nozzle stands still: what moves is the work
        body = work
    mass = float(model.body_mass[body])
    if payload < 0 and not mass + payload > 0:
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body)
        raise InputError(f"payload = {payload:g} kg: must leave the body {name!r} a mass, which is {mass:g} kg")
    model.body_mass[body] += payload
    model.body_gravcomp[body] *= mass / (mass + payload)
