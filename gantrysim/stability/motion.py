"""Linear motion of axes, in continuous time and sampled by a servo: torque demands in, motor positions out."""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from gantrysim.arrays import Complexes, Floats
from gantrysim.errors import InputError

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


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of all axes about a point of rest.

        dx/dt = A x + B u,        y = C x

    Attributes:
        A: (states, states) [1/s].
        B: effect of the torque demands, (states, axes) [per N·m·s].
        C: motor positions, (axes, states) [mm or deg].
    """

    A: Floats
    B: Floats
    C: Floats

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Motion) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @property
    def _content(self) -> tuple[bytes, ...]:
        return tuple(array.tobytes() for array in (self.A, self.B, self.C))

    def of_axis(self, axis: int) -> Motion:
        """Return the motion of one axis while the motors of the others are held."""
        held = np.flatnonzero(np.delete(self.C, axis, axis=0).any(axis=0))
        fixed = [*held, *self.A[held].argmax(axis=1)]  # the rate of a position is its velocity, a state
        free = np.setdiff1d(np.arange(len(self.A)), fixed)
        A, C = self.A[np.ix_(free, free)], self.C[[axis]][:, free]
        (states,) = (group for group in _coupled(A) if np.any(C[:, group]))
        return Motion(A[np.ix_(states, states)], self.B[free][states][:, [axis]], C[:, states])

    def resonances(self) -> Floats:
        """Return the natural frequencies of the modes that swing, rising, (n,) [Hz]."""
        roots = np.linalg.eigvals(self.A)
        swings: Floats = np.sort(np.abs(roots[roots.imag > 0])) / (2 * np.pi)
        return swings

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
        systems = []
        for states in _coupled(self.A):
            axes = [a for a in range(len(self.C)) if np.any(self.C[a, states])]
            if axes:
                A, B = self.A[np.ix_(states, states)], self.B[np.ix_(states, axes)]
                _, G1 = _held(A, B, period - delay)
                F, G = _held(A, B, period)
                if not (np.isfinite(F).all() and np.isfinite(G).all()):
                    raise InputError(f"the machine's motion over a period of {period:g} s has no finite numbers")
                systems.append(LinearSystem(tuple(axes), F, G - G1, G1, self.C[np.ix_(axes, states)]))
        return systems


def _held(A: Floats, B: Floats, time: float) -> tuple[Floats, Floats]:
    """Return the effect of the state and of a constant input on the state after a time."""
    n, m = B.shape
    joint = np.zeros((n + m, n + m))
    joint[:n, :n], joint[:n, n:] = A, B
    effect = expm(joint * time)
    return effect[:n, :n], effect[:n, n:]


def _coupled(A: Floats) -> list[list[int]]:
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
