"""Linear motion of axes, in continuous time and sampled by a servo: torque demands in, motor positions out."""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Complexes, Floats
from gantrysim.base.errors import InputError
from gantrysim.servo.stability.linear_system import transfer

MODES = ("torque", "velocity", "position", "stepper")  # command modes of a drive
_NO_EFFECT = 1e-9  # effect of one state on another that is rounding, relative to the largest
_NO_COUPLING = 1e-6  # coupling by inertia, of 1 for axes that move as one, which moves no margin by more


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
        return transfer(z, self.F, (self.G0, self.G1), self.H)


class Drives(NamedTuple):
    """Drive dynamics inside the loops of axes; empty where no drive adds any to the motion.

    Attributes:
        load: whether the position fed back is that of the load, (axes,).
        bandwidth: of the current loop, 0 for none, (axes,) [Hz].
        mode: command mode of the drive, one of `MODES`; a stepper runs in open loop, (axes,).
        velocity: of a velocity loop in the drive, gain K and rate 1 / Ti, (axes,) of [N·m·s/u] and [1/s].
        period: of the loops in the drives, 0 where there are none [s].
    """

    load: tuple[bool, ...] = ()
    bandwidth: tuple[float, ...] = ()
    mode: tuple[str, ...] = ()
    velocity: tuple[tuple[float, float], ...] = ()
    period: float = 0.0

    def of_axes(self, axes: Sequence[int]) -> Drives:
        """Return the drives of some axes."""
        return Drives(
            tuple(self.load[a] for a in axes if self.load),
            tuple(self.bandwidth[a] for a in axes if self.bandwidth),
            tuple(self.mode[a] for a in axes if self.mode),
            tuple(self.velocity[a] for a in axes if self.velocity),
            self.period,
        )

    def mode_of(self, axis: int) -> str:
        """Return the mode of an axis."""
        return self.mode[axis] if self.mode else "torque"


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of all axes about a point of rest.

        dx/dt = A x + B u,        y = C x

    Attributes:
        A: (states, states) [1/s].
        B: effect of the torque demands, (states, axes) [per N·m·s].
        C: positions fed back, those of the motors, (axes, states) [mm or deg].
        L: positions of the loads, 0 for an axis without one of its own, (axes, states) [mm or deg]; None if unknown.
        currents: state that is the current of each axis' winding, -1 where it has none; empty if unknown.
    """

    A: Floats
    B: Floats
    C: Floats
    L: Floats | None = None
    currents: tuple[int, ...] = ()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Motion) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @property
    def _content(self) -> tuple[tuple[bytes, ...], tuple[int, ...]]:
        arrays = (self.A, self.B, self.C, self.L)
        return tuple(array.tobytes() for array in arrays if array is not None), self.currents

    def of_axis(self, axis: int) -> Motion:
        """Return the motion of one axis while the motors of the others are held."""
        held = np.flatnonzero(np.delete(self.C, axis, axis=0).any(axis=0))
        # the rate of a position is its velocity, a state
        fixed = [*held, *self.A[held].argmax(axis=1)]
        free = np.setdiff1d(np.arange(len(self.A)), fixed)
        A = self.A[np.ix_(free, free)]
        C = self.C[[axis]][:, free]
        (states,) = (group for group in _coupled_groups(A) if np.any(C[:, group]))
        L = None if self.L is None else self.L[[axis]][:, free][:, states]
        # of the remaining states in this motion
        numbers = free[states].tolist()
        currents = tuple(
            numbers.index(current) if current in numbers else -1 for current in self.currents[axis : axis + 1]
        )
        return Motion(A[np.ix_(states, states)], self.B[free][states][:, [axis]], C[:, states], L, currents)

    def driven(self, drives: Drives) -> Motion:
        """Return the motion with the current loops of drives, and the positions that are fed back in place of C.

        A loop of bandwidth f makes the torque follow its demand as dT/dt = 2 pi f (u - T). It takes the place of the
        winding's own lag, whose back-EMF the drive compensates.

        Raises:
            InputError: a position of a load, or a winding, that the motion does not have.
        """
        A = self.A.copy()
        B = self.B.copy()
        C = self.C.copy()
        for a, width in enumerate(drives.bandwidth):
            row = self.currents[a] if self.currents else -1
            if width and row < 0:
                raise InputError(
                    f"current_bandwidth of axis {a + 1} = {width:g} Hz: its motor has no inductance, so that its "
                    "torque follows at once; use 0"
                )
            if width:
                rate = 2 * np.pi * width
                B[row] *= -rate / A[row, row]
                A[row] = 0.0
                A[row, row] = -rate
        for a, load in enumerate(drives.load):
            if load and (self.L is None or not self.L[a].any()):
                raise InputError(
                    f"servo feedback of axis {a + 1} = 'load': the machine has no single spring between this "
                    "axis and its load; use 'motor'"
                )
            if load and self.L is not None:
                C[a] = self.L[a]
        return replace(self, A=A, B=B, C=C, L=None)

    def resonances(self) -> Floats:
        """Return the natural frequencies of the modes that swing, rising, (n,) [Hz]."""
        roots = np.linalg.eigvals(self.A)
        swings: Floats = np.sort(np.abs(roots[roots.imag > 0])) / (2 * np.pi)
        return swings

    def of_group(self, states: Sequence[int], axes: Sequence[int]) -> Motion:
        """Return the motion of one of the groups, with its axes numbered from 0 on."""
        L = None if self.L is None else self.L[np.ix_(axes, states)]
        row_of = {state: row for row, state in enumerate(states)}
        currents = tuple(row_of.get(self.currents[a], -1) for a in axes) if self.currents else ()
        return Motion(
            self.A[np.ix_(states, states)], self.B[np.ix_(states, axes)], self.C[np.ix_(axes, states)], L, currents
        )

    def groups(self) -> list[tuple[list[int], list[int]]]:
        """Return the groups of axes that move each other: states and axes of each."""
        groups = _coupled_groups(self.A)
        for first, second in zip(*np.nonzero(np.triu(self._coupled_by_inertia(), 1)), strict=True):
            moved = set(np.flatnonzero(self.C[[first, second]].any(axis=0)).tolist())
            joined = sorted(state for group in groups if moved & set(group) for state in group)
            groups = [group for group in groups if not moved & set(group)] + [joined]
        with_axes = []
        for states in groups:
            axes = [a for a in range(len(self.C)) if np.any(self.C[a, states])]
            if axes:
                with_axes.append((states, axes))
        return with_axes

    def _coupled_by_inertia(self) -> NDArray[np.bool_]:
        """Return which axes the torques of which others accelerate at once, (axes, axes).

        Without springs, damping and windings A holds no trace of it: the inverse of the mass matrix is in B alone. With
        the acceleration D = C A B of axis i by the torque of axis j, the coupling squared is D_ij D_ji / (D_ii D_jj).
        """
        D = self.C @ self.A @ self.B
        # a load on a spring does not move at once: the accelerations of motor and spring cancel but for rounding
        D[np.abs(D) < _NO_EFFECT * (np.abs(self.C) @ np.abs(self.A) @ np.abs(self.B))] = 0.0
        alone = np.abs(np.diag(D))
        coupled: NDArray[np.bool_] = np.abs(D * D.T) > _NO_COUPLING**2 * np.outer(alone, alone)
        return coupled

    def sampled(self, period: float, delay: float = 0.0) -> list[LinearSystem]:
        """Return the exact motion from tick to tick, of each group of axes that move each other.

        The demand is held for a period; the matrix exponential of [[A, B], [0, 0]] t integrates its effect (Van Loan,
        IEEE Transactions on Automatic Control 23, 1978).

        Args:
            period: servo period [s].
            delay: from the sample to the change of the demand, at most the period [s].

        Raises:
            InputError: a motion so fast that its numbers are not finite.
        """
        return [self.sampled_group(states, axes, period, delay) for states, axes in self.groups()]

    def sampled_group(
        self, states: Sequence[int], axes: Sequence[int], period: float, delay: float = 0.0
    ) -> LinearSystem:
        """Return the motion of one of the groups, see `sampled`."""
        A = self.A[np.ix_(states, states)]
        B = self.B[np.ix_(states, axes)]
        _, G1 = _held_effect(A, B, period - delay)
        F, G = _held_effect(A, B, period)
        if not (np.isfinite(F).all() and np.isfinite(G).all()):
            raise InputError(f"the machine's motion over a period of {period:g} s has no finite numbers")
        return LinearSystem(tuple(axes), F, G - G1, G1, self.C[np.ix_(axes, states)])


def _held_effect(A: Floats, B: Floats, time: float) -> tuple[Floats, Floats]:
    """Return the effect of the state and of a constant input on the state after a time."""
    n, m = B.shape
    joint = np.zeros((n + m, n + m))
    joint[:n, :n] = A
    joint[:n, n:] = B
    # the caller checks for numbers that are not finite
    with np.errstate(over="ignore", invalid="ignore"):
        effect = _exponential((joint * time).tobytes(), n + m).copy()
    return effect[:n, :n], effect[:n, n:]


@lru_cache(maxsize=256)  # a machine's motion is sampled again for every set of gains
def _exponential(matrix: bytes, size: int) -> Floats:
    """Return the exponential of a square matrix, given by its memory."""
    from scipy.linalg import expm  # slow to import

    exponential: Floats = expm(np.frombuffer(matrix).reshape(size, size))
    return exponential


def _coupled_groups(A: Floats) -> list[list[int]]:
    """Return the states in groups that have no effect on each other."""
    size = np.abs(A)
    linked = size > _NO_EFFECT * size.max(axis=1, keepdims=True)
    linked |= linked.T
    remaining = set(range(len(A)))
    groups = []
    while remaining:
        group = set[int]()
        new = {min(remaining)}
        while new:
            group |= new
            new = {int(k) for k in np.flatnonzero(linked[sorted(new)].any(axis=0))} - group
        groups.append(sorted(group))
        remaining -= group
    return groups
