"""Parameters of MuJoCo's dcmotors in a compiled model, and copies of it with some of them changed."""

from __future__ import annotations

import copy

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

_NEGLIGIBLE = 1e-30


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
    smooth.actuator_dynprm[:, [BRISTLE_STIFFNESS, BRISTLE_DAMPING]] *= _NEGLIGIBLE**motors
    smooth.actuator_biasprm[:, [COGGING]] *= 1 - motors
    smooth.dof_frictionloss[:] = 0
    smooth.tendon_frictionloss[:] = 0
    return smooth
