"""MuJoCo's dcmotors in a compiled model."""

from __future__ import annotations

import copy

import mujoco

from gantrysim.base.arrays import Floats

# indices of a dcmotor's parameters in MuJoCo's arrays
MOTOR_CONSTANT = 1  # gainprm
# biasprm
COGGING = 0
COULOMB = 3
STATIC = 4
# dynprm
BRISTLE_STIFFNESS = 5
BRISTLE_DAMPING = 6

_NEGLIGIBLE = 1e-30


def damp_bristles(model: mujoco.MjModel) -> None:
    """Give the bristles of LuGre friction the damping that steps of this length take from them.

    The force of a step sees the bristle of the step before. A spring that is late by h acts as a damper of -h times
    its stiffness: a standing axis would swing on its bristles with a fifth less damping at 0.25 ms.
    """
    prm = model.actuator_dynprm
    prm[:, BRISTLE_DAMPING] += dcmotors(model)[:, 0] * prm[:, BRISTLE_STIFFNESS] * model.opt.timestep


def dcmotors(model: mujoco.MjModel) -> Floats:
    """Return 1 for a dcmotor, 0 for an ideal torque source, whose parameters have other meanings, (actuators, 1)."""
    return (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR).astype(float)[:, None]


def smooth_model(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a compiled model without LuGre friction, frictionloss and cogging; viscous friction stays."""
    changed = copy.copy(model)
    motors = dcmotors(model)
    # not zero: MuJoCo would then expect no bristle activation
    changed.actuator_dynprm[:, [BRISTLE_STIFFNESS, BRISTLE_DAMPING]] *= _NEGLIGIBLE**motors
    changed.actuator_biasprm[:, [COGGING]] *= 1 - motors
    changed.dof_frictionloss[:] = 0
    changed.tendon_frictionloss[:] = 0
    return changed
