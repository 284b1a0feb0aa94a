"""A disturbance observer: what the axis did through its nominal inverse, less what it was told, filtered."""

from __future__ import annotations

import math

import numpy as np

from gantrysim.stability.compensator import Compensator

TAPS = 3  # sampled torque demands that act between three samples of the position
MOST_SHIFT = 32  # ticks by which the torque may be late in the model


def low_pass(bandwidth: float, period: float) -> tuple[float, float, float, float, float]:
    """Return a Butterworth filter of second order, by the bilinear transform, in the order of `notch.Coefficients`.

    Args:
        bandwidth: cut-off, below half the servo's frequency [Hz].
        period: servo period [s].
    """
    k = math.tan(math.pi * bandwidth * period)
    whole = 1 + math.sqrt(2) * k + k**2
    b = k**2 / whole
    return b, 2 * b, b, 2 * (k**2 - 1) / whole, (1 - math.sqrt(2) * k + k**2) / whole


def torque_taps(lag: float) -> tuple[int, tuple[float, float, float]]:
    """Return the delay in whole ticks and the weights of the demands from there on, by which a held torque moves.

    A torque u, held from tick to tick and f periods late, moves an inertia J by

        y[k] - 2 y[k-1] + y[k-2] = T^2/J ((1-f)^2/2 u[k-1] + (1/2 + f - f^2) u[k-2] + f^2/2 u[k-3])

    Args:
        lag: of the torque, in periods, at most `MOST_SHIFT`.
    """
    shift = int(min(lag, MOST_SHIFT))
    f = min(lag, MOST_SHIFT) - shift
    return shift, ((1 - f) ** 2 / 2, 0.5 + f - f**2, f**2 / 2)


def observed(acceleration: float, velocity: float, told: float, inertia: float, viscous: float) -> float:
    """Return the disturbance torque of one axis before the filter Q [N·m].

        d = J ddMPOS/T^2 + b dMPOS/T - u_n

    Args:
        acceleration: ddMPOS/T^2 [u/s²].
        velocity: dMPOS/T [u/s].
        told: u_n, the torque demands that acted, by `torque_taps` [N·m].
        inertia: J [N·m·s²/u].
        viscous: b [N·m·s/u].
    """
    return inertia * acceleration + viscous * velocity - told


def observing(
    law: Compensator,
    bandwidth: float,
    inertia: float,
    viscous: float,
    lag: float,
    period: float,
) -> Compensator:
    """Return a law with a disturbance observer, u = law(e) - Q d, as it answers to a position alone.

    Args:
        law: with its notch.
        bandwidth: of Q [Hz].
        inertia: J [N·m·s²/u].
        viscous: b [N·m·s/u].
        lag: of the torque, from the sample of the position on [s].
        period: servo period T [s].
    """
    q = low_pass(bandwidth, period)
    speed, rate = viscous / period, inertia / period**2
    inverse = Compensator.fir(np.array([rate + speed, -2 * rate - speed, rate])).then(q)
    shift, weights = torque_taps(lag / period)
    told = Compensator.fir(np.concatenate([np.zeros(1 + shift), weights])).then(q)
    return law.beside(inverse).around(told)
