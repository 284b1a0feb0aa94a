"""Inertia and linear motion of the axes about a position."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.machine.axis import PER_SI, Axis, AxisAddress
from gantrysim.machine.linear_motion import linear_motion
from gantrysim.servo.stability.motion import Motion, UnknownLoopError

_HEAVY = 1e6  # inertia of a motor that does not move [kg or kg·m²]


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
    model.dof_armature[np.delete(dofs, axis)] += _HEAVY
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
