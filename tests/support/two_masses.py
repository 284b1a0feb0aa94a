"""An axis of two or three masses with friction, backlash and a servo, by Heun's method: no code of gantrysim.

motor x'' = gear (T - F) - b x' - k slack(x - y) - c (x' - y'),    lag T' = demand - T
load y''  = k slack(x - y) + c (x' - y') - k2 (y - u) - c2 (y' - u'),    m2 u'' = k2 (y - u) + c2 (y' - u')
F = s0 z + s1 z',    z' = w - s0 |w| z / g,    g = fc + (fs - fc) exp(-(w / ws)²),    w = gear x'
"""

import math
from typing import NamedTuple

import numba
import numpy as np


class Plant(NamedTuple):
    """SI units, friction at the motor; without m2 there is no third mass."""

    motor: float
    load: float
    k: float
    c: float
    b: float
    fc: float
    fs: float
    gear: float
    lag: float = 2.75e-4
    gap: float = 0.0
    m2: float = 1e-3
    k2: float = 1e5
    c2: float = 6.0
    ws: float = 3.1
    s0: float = 7.2
    s1: float = 0.01


@numba.njit(cache=True, error_model="numpy")
def follow(p, gains, commands, period, delay, count, limit, steps):
    """Return encoder position [m] and torque demand [N·m] at each tick, (n, 2).

    gains: kp, ki, kd, acceleration feed-forward per m; the demand takes effect after the delay.
    """
    kp, ki, kd, feed = gains
    rows, total, held = np.empty((len(commands), 2)), 0.0, 0.0
    last_command = before = commands[0]
    last_error = last_speed = 0.0
    s, r = np.zeros(8), np.zeros(8)
    s[0] = s[2] = s[4] = before
    h, late = period / steps, round(delay / period * steps)
    for tick in range(len(commands)):
        measured = count * np.rint(s[0] / count)
        error = commands[tick] - measured
        total += period * error
        speed = (commands[tick] - last_command) / period
        demand = kp * error + ki * total + kd * (error - last_error) / period + feed * (speed - last_speed) / period
        demand = min(max(demand, -limit), limit)
        last_command, last_error, last_speed = commands[tick], error, speed
        rows[tick] = (measured, demand)
        for step in range(steps):
            asked = held if step < late else demand
            for stage in range(2):
                q = s + h * r if stage else s
                w = p.gear * q[1]
                level = p.fc + (p.fs - p.fc) * math.exp(-((w / p.ws) ** 2))
                slip = w - p.s0 * abs(w) * q[6] / level
                friction = p.s0 * q[6] + p.s1 * slip
                stretch = q[0] - q[2]
                stretch -= min(max(stretch, -p.gap / 2), p.gap / 2)
                spring = p.k * stretch + p.c * (q[1] - q[3])
                second = p.k2 * (q[2] - q[4]) + p.c2 * (q[3] - q[5])
                rates = np.array(
                    [
                        q[1],
                        (p.gear * (q[7] - friction) - p.b * q[1] - spring) / p.motor,
                        q[3],
                        (spring - second) / p.load,
                        q[5],
                        second / p.m2,
                        slip,
                        (asked - q[7]) / p.lag,
                    ]
                )
                if stage == 0:
                    r = rates
                else:
                    s = s + 0.5 * h * (r + rates)
        held = demand
    return rows
