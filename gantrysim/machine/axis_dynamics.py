"""Inertia and linear motion of the axes about a position."""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.axis import PER_SI, Axis, AxisAddress
from gantrysim.machine.motors import smooth_model
from gantrysim.machine.quiet import quiet
from gantrysim.servo.stability.motion import Motion, UnknownLoopError

# The linear motion of a compiled machine about a point of rest.

_STATE_STEP = 1e-6  # change of a state for finite differences; the model is almost linear [SI]


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
    small = _STATE_STEP * np.eye(size + len(controls))
    with quiet(), np.errstate(all="ignore"):
        slopes = np.array([rates(step) - rates(-step) for step in small]).T / (2 * _STATE_STEP)
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


_HEAVY_INERTIA = 1e6  # inertia of a motor that does not move [kg or kg·m²]


def with_dynamics(
    model: mujoco.MjModel, axes: Sequence[Axis], addresses: Sequence[AxisAddress], qpos: Floats, rates: Floats
) -> tuple[Axis, ...]:
    """Return the axes with their inertia and motion about a position.

    An axis moves all joints of a closed chain, at the rates N of the rigid machine. Its inertia is then its diagonal
    element of N^T M N, with M the mass matrix, and its motion is that with very heavy motors on the others, which
    MuJoCo solves.

    Args:
        model: the compiled model.
        axes: the axes.
        addresses: their indices.
        qpos: the position.
        rates: N, velocity of every degree of freedom per velocity of an axis [SI], (nv, axes).
    """
    data = mujoco.MjData(model)
    mass = np.zeros((model.nv, model.nv))
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    load_inertia = np.einsum("ia,ij,ja->a", rates, mass, rates)
    gears = model.actuator_gear[: len(axes), 0]
    with_inertia = []
    for axis, inertia, gear in zip(axes, load_inertia, gears, strict=True):
        with_inertia.append(replace(axis, inertia=float(inertia) / (float(gear) * PER_SI[axis.unit])))
    try:
        whole = motion_of(model, axes, addresses, qpos)
    except UnknownLoopError:
        return tuple(with_inertia)
    # in an open chain an axis moves its own joint alone
    closed = np.count_nonzero(rates) > len(axes)
    axes_with_motion = []
    coupled = {} if closed else _coupled_motions(whole)
    for a, axis in enumerate(with_inertia):
        if closed:
            motion = _others_held(model, axes, addresses, qpos, a).of_axis(a)
            axes_with_motion.append(replace(axis, motion=motion, chain=whole, coupled=whole))
        else:
            axes_with_motion.append(replace(axis, motion=whole.of_axis(a), coupled=coupled.get(a)))
    return tuple(axes_with_motion)


def _coupled_motions(whole: Motion) -> dict[int, Motion]:
    """Return the motion of the group of each axis that moves others, by the number of the axis."""
    coupled: dict[int, Motion] = {}
    for states, members in whole.groups():
        if len(members) > 1:
            coupled |= dict.fromkeys(members, whole.of_group(states, members))
    return coupled


def _others_held(
    model: mujoco.MjModel, axes: Sequence[Axis], addresses: Sequence[AxisAddress], qpos: Floats, axis: int
) -> Motion:
    """Return the motion of all axes when the motors of all but one are too heavy to move."""
    model = copy.copy(model)
    dofs = model.jnt_dofadr[model.actuator_trnid[: len(axes), 0]]
    model.dof_armature[np.delete(dofs, axis)] += _HEAVY_INERTIA
    return motion_of(model, axes, addresses, qpos)


def motion_of(model: mujoco.MjModel, axes: Sequence[Axis], addresses: Sequence[AxisAddress], qpos: Floats) -> Motion:
    """Return the linear motion of all axes about a point of rest, see `linear_motion`."""
    return linear_motion(
        model,
        qpos,
        [address.current for address in addresses],
        [address.control for address in addresses],
        [address.load for address in addresses],
        np.array([PER_SI[axis.unit] for axis in axes]),
    )
