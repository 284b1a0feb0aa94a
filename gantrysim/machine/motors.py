"""MuJoCo's dcmotors in a compiled model."""

from __future__ import annotations

import copy

import mujoco

from gantrysim.arrays import Floats

# indices of a dcmotor's parameters in MuJoCo's arrays
MOTOR_CONSTANT = 1  # gainprm
COGGING, COULOMB, STATIC = 0, 3, 4  # biasprm
BRISTLE_STIFFNESS, BRISTLE_DAMPING = 5, 6  # dynprm

_NEGLIGIBLE = 1e-30


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
