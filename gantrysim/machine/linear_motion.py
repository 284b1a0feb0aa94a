"""The linear motion of a compiled machine about a point of rest."""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.motors import smooth_model
from gantrysim.machine.quiet import quiet
from gantrysim.servo.stability.motion import Motion, UnknownLoopError

_DIFFERENCE = 1e-6  # change of a state for finite differences; the model is almost linear [SI]


def linear_motion(
    model: mujoco.MjModel,
    qpos: Floats,
    currents: Sequence[int],
    controls: Sequence[int],
    loads: Sequence[int],
    per_si: Floats,
) -> Motion:
    """Return the motion of all axes, by central differences of MuJoCo's accelerations and current rates.

    Friction is viscous only: to a moving axis, Coulomb friction is a constant force.

    Args:
        model: the compiled model.
        qpos: the point of rest, (nq,).
        currents: index of each axis' winding current in act, -1 where it has none.
        controls: index of each axis' torque demand in ctrl.
        loads: joint that carries each axis' load on its compliance, -1 where there is none.
        per_si: mm per metre or deg per radian, (axes,).

    Raises:
        UnknownLoopError: an actuator has a delay in the MJCF.
    """
    for actuator, samples in enumerate(model.actuator_history[:, 0]):
        if samples:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator)
            raise UnknownLoopError(f"actuator {name!r} has a delay in its MJCF: it cannot be linearised")
    model = smooth_model(model)
    # stops and contacts act on one side only: at rest on one of them the slopes would be averages of two machines
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    nv = model.nv
    # the only activations that matter are currents: without friction nothing depends on the bristles
    wound = [current for current in currents if current >= 0]
    size = 2 * nv + len(wound)

    def rates(deviation: Floats) -> Floats:
        """Rates of the velocities and currents at a deviation of the state and the demands."""
        data.qpos[:] = qpos
        mujoco.mj_integratePos(model, data.qpos, deviation[:nv], 1.0)
        data.qvel[:] = deviation[nv : 2 * nv]
        data.act[wound] = deviation[2 * nv : size]
        data.ctrl[controls] = deviation[size:]
        mujoco.mj_forward(model, data)
        return np.concatenate([data.qacc, data.act_dot[wound]])

    # a column of A or B per state or demand
    small = _DIFFERENCE * np.eye(size + len(controls))
    with quiet(), np.errstate(all="ignore"):
        slopes = np.array([rates(step) - rates(-step) for step in small]).T / (2 * _DIFFERENCE)
    if not np.isfinite(slopes).all():
        raise InputError("its accelerations about a state of rest are not finite")
    A = np.zeros((size, size))
    C = np.zeros((len(controls), size))
    A[:nv, nv : 2 * nv] = np.eye(nv)
    A[nv:] = slopes[:, :size]
    B = np.concatenate([np.zeros((nv, len(controls))), slopes[:, size:]])
    C[np.arange(len(controls)), model.jnt_dofadr[model.actuator_trnid[: len(controls), 0]]] = per_si
    L = np.zeros_like(C)
    for a, joint in enumerate(loads):
        if joint >= 0:
            L[a] = C[a]
            L[a, model.jnt_dofadr[joint]] = per_si[a]
    rows = [2 * nv + wound.index(current) if current >= 0 else -1 for current in currents]
    return Motion(A, B, C, L, tuple(rows))
