"""The model that is fitted to an axis: two masses on a spring, LuGre friction, backlash, a late torque.

With the motor at q, the load at p, d = q - p [u] and w the motor's speed, torques being at the motor shaft:

    Jm q'' = T(t - delay) + offset - F - b q' - k slack(d) - c d'
    Jl p'' =                                    k slack(d) + c d'
    F = s0 z + s1 z',    z' = w - s0 |w| z / g,    g = Fc + (Fs - Fc) exp(-(w / ws)²)

slack(d) is d without the half gap of the backlash on its side. The one-step predictor corrects its state by the Kalman
gain of the linear part, with white torque noise and white position noise: its innovations are white where the model
holds (L. Ljung, System Identification, 2nd ed., section 7.2).
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import inner_jit, jit
from gantrysim.identify.small import kalman_gain, sampled
from gantrysim.machine.axis import PER_SI, Axis
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import BRISTLE_DAMPING, BRISTLE_STIFFNESS, COULOMB, STATIC

_STRIBECK = 5  # biasprm of a dcmotor
_SUBSTEP = 1.25e-4  # longest step of the friction [s]
_MOST_SUBSTEPS = 16
_BRISTLE = 0.01  # deflection of the bristles of a machine without LuGre friction [rad]
_LEAST_TORQUE = 1e-9  # of a friction, so that nothing divides by zero [N·m]


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
        scale: travel per motor angle [u/rad].
        stribeck: ws [rad/s].
        deflection: Fc / s0: of the bristles in sliding, at slow speed [rad].
        bristle_time: s1 / s0 [s].
        lag: electrical time constant between torque demand and torque; 0 for a log of the torque itself [s].
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
    scale: float
    stribeck: float
    deflection: float
    bristle_time: float
    lag: float

    @property
    def static(self) -> float:
        """Fs [N·m]."""
        return self.coulomb + self.excess

    @property
    def reduced(self) -> float:
        """Jm Jl / (Jm + Jl), what swings in the mode [N·m·s²/u]."""
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
    """Return the model of an axis of a machine; its mode is the one that shows most in the motor's position.

    In modal form the motor's position per torque is 1/(J s²) + sum of r_i / (s² + w_i²), whose first term and one of
    the sum are two masses with Jl / Jm = J r_i.

    Raises:
        InputError: an axis that cannot be linearised.
    """
    own = machine.axes[axis]
    physics = machine.physics
    if own.motion is None:
        raise InputError(f"axis {own.name}: its actuator has a delay in the MJCF, so its mode is not known")
    share, stiffness, damping = _mode(own)
    bristles = physics.actuator_dynprm[axis]
    friction = physics.actuator_biasprm[axis]
    lugre = math.isfinite(own.motor_constant) and bristles[BRISTLE_STIFFNESS] > 0
    joint = int(physics.actuator_trnid[axis, 0])
    loss = float(physics.dof_frictionloss[physics.jnt_dofadr[joint]]) * own.scale / PER_SI[own.unit]
    coulomb = float(friction[COULOMB]) + loss if lugre else loss
    return AxisModel(
        inertia=own.inertia,
        share=share,
        stiffness=stiffness,
        damping=damping,
        viscous=own.viscous,
        coulomb=coulomb,
        excess=max(float(friction[STATIC] - friction[COULOMB]), 0.0) if lugre else 0.0,
        offset=0.0,
        delay=0.0,
        gap=0.0,
        scale=own.scale,
        stribeck=max(float(friction[_STRIBECK]), 1e-3) if lugre else 1.0,
        deflection=float(friction[COULOMB] / bristles[BRISTLE_STIFFNESS]) if lugre else _BRISTLE,
        bristle_time=float(bristles[BRISTLE_DAMPING] / bristles[BRISTLE_STIFFNESS]) if lugre else 0.0,
        lag=own.lag,
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
    strength = np.real(2 * poles * residues * (1 + poles * axis.lag))
    first = int(np.argmax(np.where(swings, strength / np.where(swings, np.abs(poles), 1.0) ** 2, -np.inf)))
    ratio = axis.inertia * float(strength[first])
    if not ratio > 0:
        return 0.0, 0.0, 0.0
    share = ratio / (1 + ratio)
    reduced = axis.inertia * share * (1 - share)
    return share, reduced * abs(poles[first]) ** 2, -2 * float(poles[first].real) * reduced


def substeps(period: float) -> int:
    """Return the number of steps of the friction per sample of a log."""
    return min(max(math.ceil(period / _SUBSTEP - 1e-9), 2), _MOST_SUBSTEPS)


def innovations(model: AxisModel, noise: float, period: float, position: Floats, torque: Floats, held: bool) -> Floats:
    """Return the differences between the measured positions and their prediction from all samples before, (n,) [u].

    Args:
        model: parameters of the axis.
        noise: standard deviation of the torque noise per standard deviation of the position noise [N·m/u].
        period: of the samples [s].
        position: measured, (n,) [u].
        torque: (n,) [N·m].
        held: whether a torque is held until the next sample, as a demand is; else it is linear in between.
    """
    count = substeps(period)
    A, B, E = model.matrices()
    inputs = np.ascontiguousarray(np.stack([B, E], axis=1))
    F, G = sampled(A, inputs, period / count)
    gain = free = kalman_gain(*sampled(A, inputs, period), noise)
    if model.gap > 0 and model.share:  # a motor that is free of its load tells nothing of it
        alone = replace(
            model, inertia=model.inertia * (1 - model.share), share=0.0, viscous=model.viscous + model.damping
        )
        A, B, E = alone.matrices()
        inputs = np.ascontiguousarray(np.stack([B, E], axis=1))
        free = np.concatenate([kalman_gain(*sampled(A, inputs, period), noise), np.zeros(2)])
    friction = (model.coulomb, model.excess, model.stribeck, model.deflection, model.bristle_time)
    means = effective_torque(model, period, torque, count, held)
    return _predict(
        position, means, F, G, gain, free, friction, model.scale, model.stiffness, model.gap,
        period / count,
    )  # fmt: skip


def effective_torque(model: AxisModel, period: float, torque: Floats, count: int, held: bool) -> Floats:
    """Return the mean of the late and lagged torque over each step between samples, (n, count) [N·m]."""
    step = period / count
    n = torque.size
    following = torque if held else np.append(torque[1:], torque[-1])
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (torque + following) * period)])
    at = np.arange(n * count + 1) * step - model.delay
    tick = np.clip(np.floor(at / period), 0, n - 1).astype(np.int64)
    into = np.clip(at - tick * period, 0, period)
    area = whole[tick] + torque[tick] * into + (following - torque)[tick] * into**2 / (2 * period)
    means = np.diff(area + np.minimum(at, 0) * torque[0]) / step
    if model.lag > 0:
        means = _lagged(means, math.exp(-step / model.lag), step / model.lag)
    means += model.offset
    return means.reshape(n, count)


@jit
def _lagged(means: Floats, kept: float, steps: float) -> Floats:
    """Return the means over steps of a first-order lag of an input that is constant in each."""
    state = means[0]
    out = np.empty_like(means)
    for i in range(means.size):
        out[i] = means[i] + (state - means[i]) * (1.0 - kept) / steps
        state = means[i] + (state - means[i]) * kept
    return out


@jit
def _predict(
    position: Floats,
    torque: Floats,
    F: Floats,
    G: Floats,
    gain: Floats,
    free: Floats,
    friction: tuple[float, float, float, float, float],
    scale: float,
    stiffness: float,
    gap: float,
    step: float,
) -> Floats:
    """Return the innovations, see above; bristles and linear motion take turns, the bristles half a step ahead."""
    coulomb, excess, stribeck, deflection, bristle_time = friction
    coulomb = max(coulomb, 1e-9)
    n = F.shape[0]
    out = np.empty(position.size)
    x = np.zeros(n)
    y = np.zeros(n)
    free_motion = np.zeros(n)
    spring = coulomb / deflection
    z = 0.0
    most = (coulomb + excess) / spring  # stretch of the bristles that breaks away from rest
    for i in range(0, n, 2):
        x[i] = position[0]
    for tick in range(position.size):
        error = position[tick] - x[0]
        out[tick] = error
        own = free if n == 4 and abs(x[0] - x[2]) < 0.5 * gap else gain
        for i in range(n):
            x[i] += own[i] * error
        z = min(max(z + own[0] * error / scale, -most), most)
        for j in range(torque.shape[1]):
            w = x[1] / scale
            end, rate = _bristles(w, coulomb, excess, stribeck, spring)
            z = end + (z - end) * math.exp(-step * rate)  # from the middle of the last step to that of this one
            back = 0.0
            if gap > 0.0 and n == 4:
                back = stiffness * min(max(x[0] - x[2], -0.5 * gap), 0.5 * gap)
            # speed and stretch in the middle of the step, from the force at its begin: bristle damping is strong
            force = torque[tick, j] - spring * (z + bristle_time * (w - rate * z))
            for i in range(n):
                free_motion[i] = 0.0
                for k in range(n):
                    free_motion[i] += F[i, k] * x[k]
                y[i] = free_motion[i] + G[i, 0] * force + G[i, 1] * back
            w = 0.5 * (w + y[1] / scale)
            if gap > 0.0 and n == 4:
                back = stiffness * min(max(0.5 * (x[0] - x[2] + y[0] - y[2]), -0.5 * gap), 0.5 * gap)
            _, rate = _bristles(w, coulomb, excess, stribeck, spring)
            force = torque[tick, j] - spring * (z + bristle_time * (w - rate * z))
            for i in range(n):
                x[i] = free_motion[i] + G[i, 0] * force + G[i, 1] * back
    return out


@inner_jit
def _bristles(w: float, coulomb: float, excess: float, stribeck: float, spring: float) -> tuple[float, float]:
    """Return where the bristles' deflection tends to at a speed, and at which rate."""
    level = coulomb
    if abs(w) < 5.0 * stribeck:
        level += excess * math.exp(-((w / stribeck) ** 2))
    return level / spring * (1.0 if w > 0 else -1.0), spring * abs(w) / level
