"""One-step prediction of an axis' position by its model: a Kalman predictor, compiled.

The predictor corrects its state by the stationary Kalman gain of the linear part, with white torque noise and white
position noise. Its errors, the innovations, are white where the model holds (L. Ljung, System Identification, 2nd ed.,
section 7.2). Its matrices have a few rows, for which a library's threads cost more than they save: their algebra is
compiled too.
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.identify.model import AxisModel
from gantrysim.identify.pieces import WHOLE_LOG, Starts, by_piece

_TERMS = 14  # of the exponential's series, for a norm of at most 1/2
_DOUBLINGS = 60
_SETTLED_CHANGE = 1e-12
_SUBSTEP = 1.25e-4  # longest step of the friction [s]
_MOST_SUBSTEPS = 16
_LEAST_TORQUE = 1e-9  # of a friction, so that nothing divides by zero [N·m]
_START_TIME = 0.008  # time at the start of a piece from which its first speed is found [s]
_STROKE_SAMPLES = 6  # samples of it
_LEAST_SHARE = 0.05  # of Coulomb friction that a varying level leaves: no friction drives an axis


@jit
def _product(A: Floats, B: Floats) -> Floats:
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                out[i, j] += A[i, k] * B[k, j]
    return out


@jit
def _solved_system(A: Floats, B: Floats) -> Floats:
    """Return A^-1 B by elimination with pivots."""
    n = A.shape[0]
    a = A.copy()
    b = B.copy()
    for i in range(n):
        pivot = i
        for k in range(i + 1, n):
            if abs(a[k, i]) > abs(a[pivot, i]):
                pivot = k
        for j in range(n):
            a[i, j], a[pivot, j] = a[pivot, j], a[i, j]
        for j in range(b.shape[1]):
            b[i, j], b[pivot, j] = b[pivot, j], b[i, j]
        for k in range(n):
            if k != i:
                factor = a[k, i] / a[i, i]
                for j in range(n):
                    a[k, j] -= factor * a[i, j]
                for j in range(b.shape[1]):
                    b[k, j] -= factor * b[i, j]
    for i in range(n):
        for j in range(b.shape[1]):
            b[i, j] /= a[i, i]
    return b


@jit
def sampled_system(A: Floats, B: Floats, time: float) -> tuple[Floats, Floats]:
    """Return the effect of the state, (n, n), and of constant inputs, (n, m), on the state of x' = A x + B u."""
    n, m = B.shape
    joint = np.zeros((n + m, n + m))
    # exp of [[A, B], [0, 0]] holds both effects (C. Van Loan, IEEE Transactions on Automatic Control 23, 1978)
    joint[:n, :n] = A * time
    joint[:n, n:] = B * time
    halvings = 0
    norm = 0.0
    for i in range(n):
        norm = max(norm, np.abs(joint[i]).sum())
    # scaling and squaring: the series converges fast only for small matrices
    while norm > 0.5:
        norm *= 0.5
        halvings += 1
    joint *= 0.5**halvings
    total = np.eye(n + m)
    term = np.eye(n + m)
    for k in range(1, _TERMS):
        term = _product(term, joint) / k
        total += term
    for _ in range(halvings):
        total = _product(total, total)
    return total[:n, :n].copy(), total[:n, n:].copy()


@jit
def kalman_gain(F: Floats, G: Floats, noise: float) -> Floats:
    """Return the stationary gain of the correction by the first state, measured with white noise of variance 1, (n,).

    The Riccati equation is solved by doubling (E. K.-W. Chu et al., International Journal of Control 77, 2004).

    Args:
        F: state transition, (n, n).
        G: effect of the inputs; the first has white noise, (n, m).
        noise: its standard deviation.
    """
    n = F.shape[0]
    A = np.ascontiguousarray(F.T)
    P = np.zeros((n, n))
    S = np.zeros((n, n))
    S[0, 0] = 1.0
    for i in range(n):
        for j in range(n):
            P[i, j] = noise * noise * G[i, 0] * G[j, 0]
    for _ in range(_DOUBLINGS):
        W = np.eye(n) + _product(S, P)
        V1 = _solved_system(W, A)
        V2 = _solved_system(W, np.ascontiguousarray(S))
        AT = np.ascontiguousarray(A.T)
        change = _product(_product(AT, P), V1)
        S = S + _product(_product(A, V2), AT)
        A = _product(A, V1)
        P = P + change
        P = 0.5 * (P + P.T)
        if np.abs(change).max() <= _SETTLED_CHANGE * np.abs(P).max():
            break
    return P[:, 0] / (P[0, 0] + 1.0)


class Predictor(NamedTuple):
    """Linear motion between two samples, and its correction.

    Attributes:
        step: time of a step of the friction [s].
        F: effect of the state over a step, (n, n).
        G: effect of the torques on motor and load over a step, (n, 2).
        gain: of the correction by a measured position, (n,).
        free_gain: the same while the motor moves within the backlash, free of its load, (n,).
    """

    step: float
    F: Floats
    G: Floats
    gain: Floats
    free_gain: Floats


class Friction(NamedTuple):
    """LuGre friction at the motor shaft, as in `AxisModel`."""

    coulomb: float
    excess: float
    stribeck: float
    deflection: float
    bristle_time: float
    scale: float


class Course(NamedTuple):
    """Friction that varies in the course of a log, at each sample (n,) [N·m].

    Attributes:
        level: added to Coulomb friction, whatever the direction.
        ripple: torque against the motor, such as cogging.
    """

    level: Floats
    ripple: Floats


class Spring(NamedTuple):
    """Spring and damper between motor and load.

    Attributes:
        stiffness: [N·m/u].
        lost_damping: what does not act within the gap [N·m·s/u].
        gap: backlash [u].
    """

    stiffness: float
    lost_damping: float
    gap: float


def substeps(period: float) -> int:
    """Return the number of steps of the friction per sample of a log."""
    return min(max(math.ceil(period / _SUBSTEP - 1e-9), 2), _MOST_SUBSTEPS)


class Record(NamedTuple):
    """What a log tells the predictor.

    Attributes:
        position: measured, (n,) [u].
        torque: means over the steps between samples, (n, steps) [N·m].
        level: of friction added to Coulomb friction, (n,) [N·m].
        rows: at which pieces begin, (k,).
        speeds: there, of motor and load, (k,) [u/s].
    """

    position: Floats
    torque: Floats
    level: Floats
    rows: NDArray[np.int64]
    speeds: Floats


class Prediction(NamedTuple):
    """Prediction of a log by a model.

    Attributes:
        innovations: differences between the measured positions and their prediction from all samples before, (n,) [u].
        directions: mean sign of the motor's speed from each sample to the next, (n,), from -1 to 1.
    """

    innovations: Floats
    directions: Floats


class Samples(NamedTuple):
    """The samples of a log.

    Attributes:
        period: of the samples [s].
        position: measured, (n,) [u].
        torque: (n,) [N·m].
        held: whether a torque is held until the next sample, as a demand is; else it is linear in between.
        course: of friction beside the model's; None without.
        starts: of the pieces.
        speeds: at the start of each [u/s].
    """

    period: float
    position: Floats
    torque: Floats
    held: bool
    course: Course | None = None
    starts: Starts = WHOLE_LOG
    speeds: tuple[float, ...] = (0.0,)


def first_speed(piece: Floats, period: float) -> float:
    """Return the speed at the start of a piece that begins in motion, by a parabola through its first samples [u/s]."""
    first = piece[: max(round(_START_TIME / period), _STROKE_SAMPLES)]
    course = np.polynomial.Polynomial.fit(np.arange(first.size), first, 2)
    return float(course.deriv()(0.0)) / period


def prediction(model: AxisModel, noise: float, samples: Samples) -> Prediction:
    """Return the prediction of each sample of a log from all samples before.

    Args:
        model: parameters of the axis.
        noise: standard deviation of the torque noise per standard deviation of the position noise [N·m/u].
        samples: of the log.
    """
    period = samples.period
    position = samples.position
    course = samples.course
    count = substeps(period)
    A, inputs = _linear(model)
    F, G = sampled_system(A, inputs, period / count)
    gain = kalman_gain(*sampled_system(A, inputs, period), noise)
    free_gain = gain
    if model.gap > 0 and model.share:
        # within the backlash the encoder on the motor shows nothing of the load: correct the motor's state alone
        motor = replace(
            model, inertia=model.inertia * (1 - model.share), share=0.0, viscous=model.viscous + model.damping
        )
        A, inputs = _linear(motor)
        free_gain = np.concatenate([kalman_gain(*sampled_system(A, inputs, period), noise), np.zeros(2)])
    predictor = Predictor(period / count, F, G, gain, free_gain)
    friction = Friction(model.coulomb, model.excess, model.stribeck, model.deflection, model.bristle_time, model.scale)
    means = by_piece(
        lambda torque: effective_torque(model, period, torque, count, samples.held), samples.torque, samples.starts
    )
    level = np.zeros(position.size)
    if course is not None:
        means = means - course.ripple[:, None]
        level = course.level
    spring = Spring(model.stiffness, 0.0 if model.filled else model.damping, model.gap)
    record = Record(position, means, level, np.array(samples.starts, np.int64), np.array(samples.speeds))
    return Prediction(*_predict(record, predictor, friction, spring))


def innovations(model: AxisModel, noise: float, samples: Samples) -> Floats:
    """Return the innovations of a prediction, (n,) [u]."""
    return prediction(model, noise, samples).innovations


def error_variance(model: AxisModel, noise: float, period: float) -> float:
    """Return the variance of the innovations of a right model, for position noise of variance 1.

    Args:
        model: parameters of the axis.
        noise: standard deviation of the torque noise per standard deviation of the position noise [N·m/u].
        period: of the samples [s].
    """
    A, inputs = _linear(model)
    gain = kalman_gain(*sampled_system(A, inputs, period), noise)
    # the first gain is P / (P + 1), the variance P + 1
    return 1 / max(1 - float(gain[0]), 1e-12)


def _linear(model: AxisModel) -> tuple[Floats, Floats]:
    """Return the state matrix and the effects of the two torques side by side."""
    A, on_motor, on_load = model.matrices()
    return A, np.ascontiguousarray(np.stack([on_motor, on_load], axis=1))


def effective_torque(model: AxisModel, period: float, torque: Floats, count: int, held: bool) -> Floats:
    """Return the mean of the late and lagged torque over each step between samples, (n, count) [N·m]."""
    step = period / count
    n = torque.size
    following = torque if held else np.append(torque[1:], torque[-1])
    # the mean over a step is the difference of the torque's integral at its ends, exact for any delay
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (torque + following) * period)])
    time = np.arange(n * count + 1) * step - model.delay
    tick = np.clip(np.floor(time / period), 0, n - 1).astype(np.int64)
    into = np.clip(time - tick * period, 0, period)
    area = integral[tick] + torque[tick] * into + (following - torque)[tick] * into**2 / (2 * period)
    means = np.diff(area + np.minimum(time, 0) * torque[0]) / step
    if model.lag > 0:
        means = _lagged_means(means, math.exp(-step / model.lag), step / model.lag)
    means += model.offset
    return means.reshape(n, count)


@jit
def _lagged_means(means: Floats, decay: float, steps: float) -> Floats:
    """Return the means over steps of a first-order lag of an input that is constant in each.

    Args:
        means: of the input, (n,).
        decay: exp(-step/lag).
        steps: step/lag.
    """
    state = means[0]
    out = np.empty_like(means)
    for i in range(means.size):
        out[i] = means[i] + (state - means[i]) * (1.0 - decay) / steps
        state = means[i] + (state - means[i]) * decay
    return out


@jit
def _predict(record: Record, predictor: Predictor, friction: Friction, spring: Spring) -> tuple[Floats, Floats]:
    """Return the innovations and the mean directions, as in `Prediction`, (n,) each.

    Bristles and linear motion take turns, the bristles half a step ahead.

    Args:
        record: of the log.
        predictor: of the linear motion.
        friction: of the motor.
        spring: between motor and load.
    """
    position, torque, level, rows, speeds = record
    step, F, G, gain, free_gain = predictor
    _, excess, stribeck, deflection, bristle_time, scale = friction
    constant = max(friction.coulomb, _LEAST_TORQUE)
    half = 0.5 * spring.gap
    n = F.shape[0]
    out = np.empty(position.size)
    directions = np.zeros(position.size)
    x = np.zeros(n)
    y = np.zeros(n)
    free_motion = np.zeros(n)
    # stiffness of the bristles [N·m/rad]
    bristles = constant / deflection
    z = 0.0
    piece = 0
    for tick in range(position.size):
        if piece < rows.size and tick == rows[piece]:
            x[::2] = position[tick]
            x[1::2] = speeds[piece]
            # as far as they are stretched in sliding, less near rest
            z = deflection * math.tanh(speeds[piece] / (scale * stribeck))
            piece += 1
        error = position[tick] - x[0]
        out[tick] = error
        coulomb = max(constant + level[tick], _LEAST_SHARE * constant)
        # stretch of the bristles that breaks away from rest
        most = (coulomb + excess) / bristles
        correction = free_gain if n == 4 and abs(x[0] - x[2]) < half else gain
        for i in range(n):
            x[i] += correction[i] * error
        z = min(max(z + correction[0] * error / scale, -most), most)
        for j in range(torque.shape[1]):
            speed = x[1]
            w = x[1] / scale
            end, rate = _bristles(w, coulomb, excess, stribeck, bristles)
            # from the middle of the last step to that of this one
            z = end + (z - end) * math.exp(-step * rate)
            back = 0.0
            if half > 0.0 and n == 4:
                back = _slack(x[0] - x[2], x[1] - x[3], spring.stiffness, spring.lost_damping, half)
            # speed and stretch in the middle of the step, from the force at its begin: bristle damping is strong
            force = torque[tick, j] - bristles * (z + bristle_time * (w - rate * z))
            for i in range(n):
                free_motion[i] = 0.0
                for k in range(n):
                    free_motion[i] += F[i, k] * x[k]
                y[i] = free_motion[i] + G[i, 0] * force + G[i, 1] * back
            w = 0.5 * (w + y[1] / scale)
            if half > 0.0 and n == 4:
                stretch = 0.5 * (x[0] - x[2] + y[0] - y[2])
                rate = 0.5 * (x[1] - x[3] + y[1] - y[3])
                back = _slack(stretch, rate, spring.stiffness, spring.lost_damping, half)
            _, rate = _bristles(w, coulomb, excess, stribeck, bristles)
            force = torque[tick, j] - bristles * (z + bristle_time * (w - rate * z))
            for i in range(n):
                x[i] = free_motion[i] + G[i, 0] * force + G[i, 1] * back
            directions[tick] += _mean_sign(speed, x[1]) / torque.shape[1]
    return out, directions


@jit
def _mean_sign(first: float, last: float) -> float:
    """Return the mean sign of a speed that changes evenly from a first to a last value."""
    # of one sign the sum is the larger, of two the difference
    return (first + last) / max(abs(first + last), abs(last - first), 1e-300)


@jit
def _slack(stretch: float, rate: float, stiffness: float, damping: float, half: float) -> float:
    """Return what the spring and damper of the linear motion give too much: all within the gap, k half beyond."""
    if abs(stretch) < half:
        return stiffness * stretch + damping * rate
    return stiffness * half if stretch > 0.0 else -stiffness * half


@jit
def _bristles(w: float, coulomb: float, excess: float, stribeck: float, stiffness: float) -> tuple[float, float]:
    """Return the deflection that the bristles approach at a speed w, and the rate of the approach [rad, 1/s]."""
    level = coulomb
    # beyond, less than 1e-10 of the excess is left
    if abs(w) < 5.0 * stribeck:
        level += excess * math.exp(-((w / stribeck) ** 2))
    return level / stiffness * (1.0 if w > 0 else -1.0), stiffness * abs(w) / level
