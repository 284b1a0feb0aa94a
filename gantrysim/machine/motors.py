"""Motors of a compiled model, MuJoCo's dcmotors, with copies of it that change some, and their springs to the loads."""

from __future__ import annotations

import copy
from functools import lru_cache

import mujoco

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import positive

# indices of a dcmotor's parameters in MuJoCo's arrays
# gainprm
RESISTANCE = 0
MOTOR_CONSTANT = 1
BUS_VOLTAGE = 7
# biasprm
COGGING = 0
COULOMB = 3
STATIC = 4
STRIBECK = 5
# dynprm
TIME_CONSTANT = 0
CURRENT_RATE = 1
BRISTLE_STIFFNESS = 5
BRISTLE_DAMPING = 6

_NEGLIGIBLE_FACTOR = 1e-30
_REMEMBERED_MODELS = 16  # models of which it is remembered whether each spring has an axis


def set_for_steps(model: mujoco.MjModel, timestep: float, voltage: bool, stops: bool) -> None:
    """Set a compiled model for steps of a length; arguments as of `Machine.stepping`."""
    model.opt.timestep = positive("physics step", timestep, "s")
    damp_bristles(model)
    # a plugin may act on what it senses
    if not model.nplugin:
        # the servo reads positions and currents itself
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    if not stops:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    if voltage:
        model.actuator_ctrllimited[dcmotors(model)[:, 0] > 0] = False


def damp_bristles(model: mujoco.MjModel) -> None:
    """Give the bristles of LuGre friction the damping that steps of this length take from them.

    The force of a step sees the bristle of the step before. A spring that is late by h acts as a damper of -h times
    its stiffness: a standing axis would swing on its bristles with a fifth less damping at 0.25 ms.
    """
    parameters = model.actuator_dynprm
    parameters[:, BRISTLE_DAMPING] += dcmotors(model)[:, 0] * parameters[:, BRISTLE_STIFFNESS] * model.opt.timestep


def dcmotors(model: mujoco.MjModel) -> Floats:
    """Return 1 for a dcmotor, 0 for an ideal torque source, whose parameters have other meanings, (actuators, 1)."""
    return (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR).astype(float)[:, None]


def activation_slots(model: mujoco.MjModel, a: int) -> tuple[int, int]:
    """Return where an actuator's bristle and its current are among the activations, -1 for none."""
    if model.actuator_gaintype[a] != mujoco.mjtGain.mjGAIN_DCMOTOR:
        return -1, -1
    first = int(model.actuator_actadr[a])
    bristle = model.actuator_dynprm[a, BRISTLE_STIFFNESS] > 0
    wound = model.actuator_dynprm[a, TIME_CONSTANT] > 0
    return (first if bristle else -1), (first + int(bristle) if wound else -1)


def smooth_model(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a compiled model without LuGre friction, frictionloss and cogging; viscous friction stays."""
    smooth = copy.copy(model)
    motors = dcmotors(model)
    # not zero: MuJoCo would then expect no bristle activation
    smooth.actuator_dynprm[:, [BRISTLE_STIFFNESS, BRISTLE_DAMPING]] *= _NEGLIGIBLE_FACTOR**motors
    smooth.actuator_biasprm[:, [COGGING]] *= 1 - motors
    smooth.dof_frictionloss[:] = 0
    smooth.tendon_frictionloss[:] = 0
    return smooth


def driven_joints(model: mujoco.MjModel) -> list[int]:
    """Return the index of each axis' joint, in the order of the actuators."""
    joints: list[int] = model.actuator_trnid[:, 0].tolist()
    return joints


@lru_cache(_REMEMBERED_MODELS)
def springs_have_axes(model: mujoco.MjModel) -> bool:
    """Return whether each axis can have its own stiffness factor: there is one axis, or one for every spring."""
    if model.nactuator == 1:
        return True
    joints_have = all(axis_above(model, spring) is not None for spring in spring_joints(model))
    return joints_have and all(len(axes_of_tendon(model, tendon)) == 1 for tendon in elastic_tendons(model))


def spring_of(model: mujoco.MjModel, axis: int) -> str | None:
    """Return the name of the first spring joint that an axis carries with no other axis between, or None.

    Args:
        model: the compiled model.
        axis: index of the axis.
    """
    for spring in spring_joints(model):
        if axis_above(model, spring) == axis:
            return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, spring)
    return None


def elastic_tendons(model: mujoco.MjModel) -> list[int]:
    """Return the tendons that are springs."""
    return [tendon for tendon in range(model.ntendon) if model.tendon_stiffness[tendon] > 0]


def wraps_of(model: mujoco.MjModel, tendon: int) -> range:
    """Return the indices of a tendon's path elements."""
    first = int(model.tendon_adr[tendon])
    return range(first, first + int(model.tendon_num[tendon]))


def axes_of_tendon(model: mujoco.MjModel, tendon: int) -> set[int]:
    """Return the axes whose joints a fixed tendon couples."""
    driven = driven_joints(model)
    axes = set()
    for wrap in wraps_of(model, tendon):
        joint = int(model.wrap_objid[wrap])
        if model.wrap_type[wrap] == mujoco.mjtWrap.mjWRAP_JOINT and joint in driven:
            axes.add(driven.index(joint))
    return axes


def spring_joints(model: mujoco.MjModel) -> list[int]:
    """Return the joints with stiffness that no axis drives."""
    driven = driven_joints(model)
    return [joint for joint in range(model.njnt) if joint not in driven and model.jnt_stiffness[joint] > 0]


def axis_above(model: mujoco.MjModel, joint: int) -> int | None:
    """Return the index of the axis whose joint is next above a joint in the tree, or None."""
    driven = driven_joints(model)
    body = int(model.jnt_bodyid[joint])
    below = joint
    while body:
        first = int(model.body_jntadr[body])
        count = int(model.body_jntnum[body])
        # of the joints of one body, each carries those that follow it
        for other in reversed(range(first, first + count)):
            if other < below and other in driven:
                return driven.index(other)
        body = int(model.body_parentid[body])
        below = model.njnt
    return None
