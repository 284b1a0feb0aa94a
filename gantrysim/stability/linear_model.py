"""A machine as a linear sampled system: torque demands in, motor positions out, at its servo's ticks."""

# ruff: noqa: N803, N806 - matrices have the letters of the law

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats
from gantrysim.errors import InputError
from gantrysim.machine.axis import PER_SI
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import smooth_model

Complexes = NDArray[np.complex128]

_SMALL = 1e-6  # change of a state by which derivatives are taken [SI]; the model is all but linear
_NO_EFFECT = 1e-9  # of one state on another, of the largest on it: rounding


class UnknownLoopError(InputError):
    """A machine with a part of which the linear system is not known."""


@dataclass(frozen=True, eq=False)
class Linear:
    """What some axes do that move each other, and no others, from one servo tick to the next.

        x[k+1] = F x[k] + G0 u[k-1] + G1 u[k],        y[k] = H x[k]

    u[k] is the torque demand that the sample y[k] leads to. It comes into force a delay later; until then the one
    before is held.

    Attributes:
        axes: index of each axis.
        F: (states, states).
        G0, G1: (states, axes) [per N·m].
        H: (axes, states) [mm or deg].
    """

    axes: tuple[int, ...]
    F: Floats
    G0: Floats
    G1: Floats
    H: Floats

    def response(self, z: Complexes) -> Complexes:
        """Return P(z) = H (z - F)^-1 (G1 + G0/z), (n, axes, axes) [mm/N·m or deg/N·m].

        Args:
            z: (n,).
        """
        between = z[:, None, None] * np.eye(len(self.F)) - self.F
        return self.H @ np.linalg.solve(between, self.G1 + self.G0 / z[:, None, None])


def linearised(
    machine: Machine, period: float, substeps: int, delay: int, position: ArrayLike | None = None
) -> list[Linear]:
    """Return the machine's linear systems, one for the axes that move each other.

    The derivatives are of MuJoCo's own step, at rest. Friction is viscous alone: an axis that moves feels Coulomb
    friction as a constant force.

    Args:
        machine: the machine.
        period: servo period [s].
        substeps: physics steps in it.
        delay: of these, those before a demand comes into force.
        position: of the axes, home by default, (axes,) [mm or deg].

    Raises:
        UnknownLoopError: an actuator that has a delay of its own.
        InputError: a position that is not one finite number per axis.
    """
    at = np.zeros(len(machine.axes)) if position is None else _position(machine, position)
    model = smooth_model(machine.stepping(period / substeps))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    for axis, samples in zip(machine.axes, model.actuator_history[:, 0], strict=True):
        if samples:
            raise UnknownLoopError(f"actuator {axis.name!r} has a delay in its MJCF: its linear loop is not known")
    data = mujoco.MjData(model)
    data.qpos[:] = machine.to_qpos(at)
    size = 2 * model.nv + model.na
    A, B = np.zeros((size, size)), np.zeros((size, model.nu))
    mujoco.mjd_transitionFD(model, data, _SMALL, True, A, B, None, None)

    # of the activations the currents alone count: with friction off nothing depends on the bristles
    currents = [2 * model.nv + address.current for address in machine.addresses if address.current >= 0]
    kept = [*range(2 * model.nv), *currents]
    A, B = A[np.ix_(kept, kept)], B[np.ix_(kept, [address.control for address in machine.addresses])]
    B = B * machine.drive_gain
    H = np.zeros((len(machine.axes), len(kept)))
    for a, axis in enumerate(machine.axes):
        H[a, model.jnt_dofadr[model.actuator_trnid[a, 0]]] = PER_SI[axis.unit]

    powers = [np.eye(len(kept))]
    for _ in range(substeps):
        powers.append(A @ powers[-1])
    # a step's effect passes through those that are left in the period
    effects = [powers[substeps - 1 - step] @ B for step in range(substeps)]
    none = np.zeros_like(B)
    G0, G1 = sum(effects[:delay], none), sum(effects[delay:], none)
    systems = []
    for states in _together(A):
        axes = [a for a in range(len(machine.axes)) if np.any(H[a, states])]
        if axes:
            own = np.ix_(states, states), np.ix_(states, axes), np.ix_(axes, states)
            systems.append(Linear(tuple(axes), powers[-1][own[0]], G0[own[1]], G1[own[1]], H[own[2]]))
    return systems


def _position(machine: Machine, position: ArrayLike) -> Floats:
    """Return the position of the axes, or raise InputError where it is not one finite number per axis."""
    try:
        at = np.asarray(position, float)
    except (TypeError, ValueError):
        at = np.array(np.nan)
    if at.shape != (len(machine.axes),) or not np.isfinite(at).all():
        units = ", ".join(f"{axis.name} [{axis.unit}]" for axis in machine.axes)
        said = " ".join(str(position).split())  # an array's rows are lines
        raise InputError(f"position = {said}: must be {len(machine.axes)} finite numbers, one per axis: {units}")
    return at


def _together(A: Floats) -> list[list[int]]:
    """Return the states in groups that have no effect on each other."""
    size = np.abs(A)
    linked = size > _NO_EFFECT * size.max(axis=1, keepdims=True)
    linked |= linked.T
    left, groups = set(range(len(A))), []
    while left:
        group, new = set[int](), {min(left)}
        while new:
            group |= new
            new = {int(k) for k in np.flatnonzero(linked[sorted(new)].any(axis=0))} - group
        groups.append(sorted(group))
        left -= group
    return groups
