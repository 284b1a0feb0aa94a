"""Linear sampled model of a machine: torque demands in, motor positions out, at the servo's ticks."""

# ruff: noqa: N803, N806 - matrices bear the letters of the law

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

_DIFFERENCE = 1e-6  # change of a state for finite differences; the model is almost linear [SI]
_NO_EFFECT = 1e-9  # effect of one state on another that is rounding, relative to the largest


class UnknownLoopError(InputError):
    """A machine that cannot be linearised."""


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """Sampled dynamics of axes that move each other, and no others.

        x[k+1] = F x[k] + G0 u[k-1] + G1 u[k],        y[k] = H x[k]

    u[k] is the torque demand computed from the sample y[k]. It takes effect after the servo's delay; until then u[k-1]
    is held.

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
        """Return P(z) = H (z - F)^-1 (G1 + G0/z) at every z, (n, axes, axes) [mm/N·m or deg/N·m]."""
        shifted = z[:, None, None] * np.eye(len(self.F)) - self.F
        return self.H @ np.linalg.solve(shifted, self.G1 + self.G0 / z[:, None, None])


def linearise(
    machine: Machine, period: float, substeps: int, delay: int, position: ArrayLike | None = None
) -> list[LinearSystem]:
    """Return the machine's linear systems, one per group of axes that move each other.

    They are finite differences of MuJoCo's step at rest. Friction is viscous only: to a moving axis, Coulomb friction
    is a constant force.

    Args:
        machine: the machine.
        period: servo period [s].
        substeps: physics steps per period.
        delay: physics steps before a demand takes effect.
        position: position of the axes, by default zero, (axes,) [mm or deg].

    Raises:
        UnknownLoopError: an actuator has a delay in the MJCF.
        InputError: a position that is not one finite number per axis.
    """
    at = np.zeros(len(machine.axes)) if position is None else _checked_position(machine, position)
    model = smooth_model(machine.stepping(period / substeps))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    for axis, samples in zip(machine.axes, model.actuator_history[:, 0], strict=True):
        if samples:
            raise UnknownLoopError(f"actuator {axis.name!r} has a delay in its MJCF: it cannot be linearised")
    data = mujoco.MjData(model)
    data.qpos[:] = machine.to_qpos(at)
    size = 2 * model.nv + model.na
    A, B = np.zeros((size, size)), np.zeros((size, model.nu))
    mujoco.mjd_transitionFD(model, data, _DIFFERENCE, True, A, B, None, None)

    # the only activations that matter are currents: without friction nothing depends on the bristles
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
    # the effect of a step passes through the remaining steps of the period
    effects = [powers[substeps - 1 - step] @ B for step in range(substeps)]
    none = np.zeros_like(B)
    G0, G1 = sum(effects[:delay], none), sum(effects[delay:], none)
    systems = []
    for states in _coupled_states(A):
        axes = [a for a in range(len(machine.axes)) if np.any(H[a, states])]
        if axes:
            F = powers[-1][np.ix_(states, states)]
            G = np.ix_(states, axes)
            systems.append(LinearSystem(tuple(axes), F, G0[G], G1[G], H[np.ix_(axes, states)]))
    return systems


def _checked_position(machine: Machine, position: ArrayLike) -> Floats:
    """Return the position as an array, or raise InputError unless it is one finite number per axis."""
    try:
        at = np.asarray(position, float)
    except (TypeError, ValueError):
        at = np.array(np.nan)
    if at.shape != (len(machine.axes),) or not np.isfinite(at).all():
        units = ", ".join(f"{axis.name} [{axis.unit}]" for axis in machine.axes)
        text = " ".join(str(position).split())  # an array's text has line breaks
        raise InputError(f"position = {text}: must be {len(machine.axes)} finite numbers, one per axis: {units}")
    return at


def _coupled_states(A: Floats) -> list[list[int]]:
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
