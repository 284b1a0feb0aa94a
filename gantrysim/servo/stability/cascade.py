"""Velocity loops in the drives as part of the motion that the servo sees: two rates in one sampled system."""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.servo.stability.motion import LinearSystem

_SAME_TIME = 1e-9  # relative


def with_velocity_loops(
    system: LinearSystem, motors: Floats, gain: Floats, rate: Floats, times: tuple[float, float, float]
) -> LinearSystem:
    """Return the motion of axes whose drives close velocity loops, from velocity demand to position, per servo period.

    At each of its samples j, t apart, a drive takes the velocity v[j] = (y[j] - y[j-1]) / t of its motor and sets

        u[j] = K (w - v[j] + z[j+1] / Ti),        z[j+1] = z[j] + t (w - v[j])

    until the next. The demand w changes once per servo period, at the drive's first sample not before the servo's
    delay.

    Args:
        system: the motion over t, torque demands in.
        motors: positions of the motors, (axes, states) [mm or deg].
        gain: K, (axes,) [N·m·s/u].
        rate: 1 / Ti, (axes,) [1/s].
        times: t, servo period, servo delay [s].
    """
    t, period, delay = times
    n = len(system.F)
    m = len(gain)
    G = system.G0 + system.G1
    H = motors
    K = np.diag(gain)
    identity = np.eye(m)
    whole = np.diag(gain * (1 + rate * t))
    step = np.zeros((n + 2 * m, n + 2 * m))
    enter = np.zeros((n + 2 * m, m))
    x = slice(0, n)
    before = slice(n, n + m)
    z = slice(n + m, n + 2 * m)
    # z[j+1] put into u[j]: the factor 1 + t / Ti on w - v[j], and z[j] / Ti beside it
    step[x, x] = system.F - G @ whole @ H / t
    step[x, before] = G @ whole / t
    step[x, z] = G @ K @ np.diag(rate)
    step[before, x] = H
    step[z, x] = -H
    step[z, before] = identity
    step[z, z] = identity
    enter[x] = G @ whole
    enter[z] = t * identity
    F = np.eye(n + 2 * m)
    G0 = np.zeros_like(enter)
    G1 = np.zeros_like(enter)
    # drive samples that still act on the last demand; rounding must not make one of a delay of whole samples
    late = math.ceil(delay / t * (1 - _SAME_TIME))
    for j in range(round(period / t)):
        F = step @ F
        G0 = step @ G0 + enter * (j < late)
        G1 = step @ G1 + enter * (j >= late)
    return LinearSystem(system.axes, F, G0, G1, np.concatenate([system.H, np.zeros((m, 2 * m))], axis=1))
