"""The model that is fitted to an axis: two masses on a spring, LuGre friction, backlash, a late torque.

With the motor at q, the load at p, d = q - p [u] and w the motor's speed, torques being at the motor shaft:

    Jm q'' = T(t - delay) + offset - F - b q' - k slack(d) - c slack'(d)
    Jl p'' =                                    k slack(d) + c slack'(d)
    F = s0 z + s1 z',    z' = w - s0 |w| z / g,    g = Fc + (Fs - Fc) exp(-(w / ws)²)

slack(d) is d without the half gap of the backlash on its side: within the gap neither spring nor damper acts. In a gap
that is filled the damper does, by c d'.
"""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.axis import PER_SI, Axis
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import BRISTLE_DAMPING, BRISTLE_STIFFNESS, COULOMB, STATIC

_STRIBECK = 5  # biasprm of a dcmotor
_BRISTLE = 0.01  # deflection of the bristles of a machine without LuGre friction [rad]


@dataclass(frozen=True)
class AxisModel:
    """Parameters of the model of an axis; u is mm or deg, torques are at the motor shaft.

    Attributes:
        inertia: Jm + Jl [N·m·s²/u].
        share: Jl / (Jm + Jl); 0 for a rigid axis.
        stiffness: k [N·m/u].
        damping: c [N·m·s/u].
        viscous: b [N·m·s/u].
        coulomb: Fc [N·m].
        excess: Fs - Fc, of friction at rest over that in motion [N·m].
        offset: constant torque, such as an uncompensated weight [N·m].
        delay: from the torque in the log to its effect [s].
        gap: backlash between motor and load [u].
        filled: whether the damper acts within the gap too, as grease does.
        scale: travel per motor angle [u/rad].
        stribeck: ws [rad/s].
        deflection: Fc / s0: of the bristles in sliding, at slow speed [rad].
        bristle_time: s1 / s0 [s].
        lag: electrical time constant between torque demand and torque; 0 for a log of the torque itself [s].
        difference: half the difference of viscous friction, forwards less back, of which b is the mean; no part of the
            prediction, which has it as a `Course` [N·m·s/u].
    """

    inertia: float
    share: float
    stiffness: float
    damping: float
    viscous: float
    coulomb: float
    excess: float
    offset: float
    delay: float
    gap: float
    filled: bool
    scale: float
    stribeck: float
    deflection: float
    bristle_time: float
    lag: float
    difference: float = 0.0

    @property
    def viscous_forward(self) -> float:
        """Viscous friction in forward motion [N·m·s/u]."""
        return self.viscous + self.difference

    @property
    def viscous_back(self) -> float:
        """Viscous friction in backward motion [N·m·s/u]."""
        return self.viscous - self.difference

    @property
    def static(self) -> float:
        """Fs [N·m]."""
        return self.coulomb + self.excess

    @property
    def reduced(self) -> float:
        """Jm Jl / (Jm + Jl), the reduced inertia of the mode [N·m·s²/u]."""
        return self.inertia * self.share * (1 - self.share)

    @property
    def resonance(self) -> float:
        """Natural frequency of the mode, nan for a rigid axis [Hz]."""
        return math.sqrt(self.stiffness / self.reduced) / (2 * math.pi) if self.share else math.nan

    @property
    def damping_ratio(self) -> float:
        """Damping ratio of the mode, nan for a rigid axis."""
        return self.damping / (2 * math.sqrt(self.stiffness * self.reduced)) if self.share else math.nan

    def matrices(self) -> tuple[Floats, Floats, Floats]:
        """Return A (n, n), effect of a torque on the motor (n,), and of one on the load against it (n,).

        The state is q, q' of a rigid axis, q, q', p, p' of one with a mode.
        """
        if not self.share:
            J = self.inertia
            return np.array([[0.0, 1.0], [0.0, -self.viscous / J]], float), np.array([0, 1 / J]), np.zeros(2)
        load = self.inertia * self.share
        motor = self.inertia - load
        k = self.stiffness
        c = self.damping
        A = np.array(
            [
                [0, 1, 0, 0],
                [-k / motor, -(c + self.viscous) / motor, k / motor, c / motor],
                [0, 0, 0, 1],
                [k / load, c / load, -k / load, -c / load],
            ]
        )
        return A, np.array([0, 1 / motor, 0, 0]), np.array([0, 1 / motor, 0, -1 / load])

    def response(self, frequency: Floats) -> Floats:
        """Return |acceleration / torque| of the motor without friction, (n,) [u/(N·m·s²)].

        Args:
            frequency: (n,) [Hz].
        """
        A, B, _ = self.matrices()
        s = 2j * np.pi * frequency
        state = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, B[:, None].astype(complex))
        return np.asarray(np.abs(s**2 * state[:, 0, 0] / (1 + s * self.lag)))


def model_of(machine: Machine, axis: int) -> AxisModel:
    """Return the model of an axis of a machine, with the mode that shows most in the motor's position.

    In modal form the motor's position per torque is 1/(J s²) + sum of r_i / (s² + w_i²), whose first term and one of
    the sum are two masses with Jl / Jm = J r_i.

    Raises:
        InputError: an axis that cannot be linearised.
    """
    driven = machine.axes[axis]
    physics = machine.physics
    if driven.motion is None:
        raise InputError(f"axis {driven.name}: its actuator has a delay in the MJCF, so its mode is not known")
    share, stiffness, damping = _mode(driven)
    bristles = physics.actuator_dynprm[axis]
    friction = physics.actuator_biasprm[axis]
    lugre = math.isfinite(driven.motor_constant) and bristles[BRISTLE_STIFFNESS] > 0
    joint = int(physics.actuator_trnid[axis, 0])
    loss = float(physics.dof_frictionloss[physics.jnt_dofadr[joint]]) * driven.scale / PER_SI[driven.unit]
    if lugre:
        coulomb = float(friction[COULOMB]) + loss
        excess = max(float(friction[STATIC] - friction[COULOMB]), 0.0)
        stribeck = max(float(friction[_STRIBECK]), 1e-3)
        deflection = float(friction[COULOMB] / bristles[BRISTLE_STIFFNESS])
        bristle_time = float(bristles[BRISTLE_DAMPING] / bristles[BRISTLE_STIFFNESS])
    else:
        coulomb = loss
        excess = 0.0
        stribeck = 1.0
        deflection = _BRISTLE
        bristle_time = 0.0
    return AxisModel(
        inertia=driven.inertia,
        share=share,
        stiffness=stiffness,
        damping=damping,
        viscous=driven.viscous,
        coulomb=coulomb,
        excess=excess,
        offset=driven.constant_torque,
        delay=0.0,
        gap=0.0,
        filled=False,
        scale=driven.scale,
        stribeck=stribeck,
        deflection=deflection,
        bristle_time=bristle_time,
        lag=driven.lag,
        difference=driven.viscous_difference,
    )


def _mode(axis: Axis) -> tuple[float, float, float]:
    """Return the load's share of the inertia, stiffness and damping of an axis' strongest mode; 0 where it has none."""
    assert axis.motion is not None
    A = axis.motion.A
    B = axis.motion.B[:, 0]
    C = axis.motion.C[0]
    poles, right = np.linalg.eig(A)
    residues = (C @ right) * np.linalg.solve(right, B.astype(complex))
    swings = poles.imag > 1e-3 * np.abs(poles).max()
    if not swings.any():
        return 0.0, 0.0, 0.0
    # the linear motion has the winding's lag before it; (1 + s lag) at the pole takes it out of the residue
    strength = np.real(2 * poles * residues * (1 + poles * axis.lag))
    first = int(np.argmax(np.where(swings, strength / np.where(swings, np.abs(poles), 1.0) ** 2, -np.inf)))
    ratio = axis.inertia * float(strength[first])
    if not ratio > 0:
        return 0.0, 0.0, 0.0
    share = ratio / (1 + ratio)
    reduced = axis.inertia * share * (1 - share)
    return share, reduced * abs(poles[first]) ** 2, -2 * float(poles[first].real) * reduced
