"""Undamped modes of a compiled model."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
from scipy.linalg import eigh, null_space

from gantrysim.base.arrays import Floats

_STEP = 1e-7  # of a joint for the stiffness [m or rad]
_SWINGS = 1.0  # squared frequency below which a mode is free motion [rad²/s²]


def modes(model: mujoco.MjModel, qpos: Floats | None = None, locked: Sequence[int] = ()) -> tuple[Floats, Floats]:
    """Return the frequencies of the oscillating modes, rising, (n,) [Hz], and their shapes, (nv, n).

        K v = w² M v    for v = N a,    J N = 0

    with the mass matrix M, the stiffness K of springs and tendons by central differences, and the Jacobian J of the
    equality constraints.

    Args:
        model: the compiled model.
        qpos: position, by default the model's reference.
        locked: degrees of freedom that are held.
    """
    model = copy.copy(model)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    nv = model.nv
    equilibrium = model.qpos0 if qpos is None else qpos
    mass = np.zeros((nv, nv))
    stiffness = np.zeros((nv, nv))

    def force(step: Floats) -> Floats:
        data.qpos[:] = equilibrium
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        mujoco.mj_forward(model, data)
        return data.qfrc_spring.copy()

    for k, step in enumerate(_STEP * np.eye(nv)):
        stiffness[:, k] = (force(-step) - force(step)) / (2 * _STEP)
    force(np.zeros(nv))
    mujoco.mj_fullM(model, data, mass)
    equal = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    free = null_space(np.concatenate([data.efc_J.reshape(-1, nv)[equal], np.eye(nv)[list(locked)]]))
    if not free.size:
        return np.zeros(0), np.zeros((nv, 0))
    square, shapes = eigh(free.T @ (0.5 * (stiffness + stiffness.T)) @ free, free.T @ mass @ free)
    swings = square > max(_SWINGS, 1e-9 * square.max())
    return np.sqrt(square[swings]) / (2 * np.pi), free @ shapes[:, swings]
