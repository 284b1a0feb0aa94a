"""Logs of axes whose friction follows other laws than the fitted one: semi-implicit Euler, no code of gantrysim.

motor x'' = gear (T - F) - b x' - k (x - y) - c (x' - y'),    load y'' = k (x - y) + c (x' - y'),    lag T' = demand - T

F opposes the motion with the level of its law, and holds an axis at rest as long as it can. Cogging adds a torque that
repeats over the travel; with backlash, spring and damper act beyond half the gap alone. All is SI; torques and levels
are at the motor shaft.
"""

import math
from typing import NamedTuple

import numba
import numpy as np

LAWS = ("coulomb", "stribeck", "lugre", "asymmetric", "position", "load", "quadratic")
ALL_LAWS = (*LAWS, "cogging", "backlash")


class FrictionPlant(NamedTuple):
    """An axis and its friction; `law` is the place of the friction law's name in `ALL_LAWS`.

    Attributes:
        motor, load: masses at the axis [kg].
        k, c: spring between them [N/m, N·s/m].
        b: viscous friction [N·s/m].
        fc, fs: Coulomb and static friction [N·m].
        gear: motor angle per travel [rad/m].
        law: friction law.
        ws: Stribeck speed [rad/s].
        s0, s1: stiffness [N·m/rad] and damping [N·m·s/rad] of the bristles of LuGre friction.
        strength: asymmetric: Fc is (1 ± strength) times as high by direction; position: amplitude of Fc over the
            travel, of Fc; load: friction per motor torque; quadratic: friction at `fast` beside the others, of Fc;
            cogging: amplitude of its torque, of Fc.
        length: of a period of friction or cogging over the travel [m].
        fast: speed at which the quadratic part reaches `strength` [rad/s].
        lag: electrical time constant [s].
        weight: constant torque [N·m].
        gap: backlash between motor and load [m].
        uneven: viscous friction is (1 ± uneven) times as high by direction.
    """

    motor: float
    load: float
    k: float
    c: float
    b: float
    fc: float
    fs: float
    gear: float
    law: int = 0
    ws: float = 3.1
    s0: float = 7.2
    s1: float = 0.01
    strength: float = 0.0
    length: float = 0.02
    fast: float = 150.0
    lag: float = 2.75e-4
    weight: float = 0.0
    gap: float = 0.0
    uneven: float = 0.0


@numba.njit(cache=True, error_model="numpy")
def _level(p, w, x, torque, way):
    """Return the level of the friction in sliding or at the point of sliding, in the direction `way` [N·m]."""
    if p.law == 1:
        return p.fc + (p.fs - p.fc) * math.exp(-abs(w) / p.ws)
    if p.law == 3:
        return p.fc * (1.0 + p.strength * way)
    if p.law == 4:
        return p.fc * (1.0 + p.strength * math.sin(2 * math.pi * x / p.length))
    if p.law == 5:
        return p.fc + p.strength * abs(torque)
    if p.law == 6:
        return p.fc * (1.0 + p.strength * (w / p.fast) ** 2)
    return p.fc


@numba.njit(cache=True, error_model="numpy")
def drive(p, gains, commands, period, delay, count, limit, steps):
    """Return encoder position [m], torque demand [N·m] and motor torque [N·m] at each tick, (n, 3).

    gains: kp, ki, kd, acceleration feed-forward per m; the demand takes effect after the delay.
    """
    kp, ki, kd, feed = gains
    rows = np.empty((len(commands), 3))
    total = 0.0
    held = 0.0
    last_command = before = commands[0]
    last_error = last_speed = 0.0
    x = y = before
    v = u = z = torque = 0.0
    h = period / steps
    late = round(delay / period * steps)
    half = 0.5 * p.gap
    for tick in range(len(commands)):
        measured = count * np.rint(x / count) if count > 0 else x
        error = commands[tick] - measured
        total += period * error
        speed = (commands[tick] - last_command) / period
        demand = kp * error + ki * total + kd * (error - last_error) / period + feed * (speed - last_speed) / period
        demand = min(max(demand, -limit), limit)
        last_command, last_error, last_speed = commands[tick], error, speed
        rows[tick, 0] = measured
        rows[tick, 1] = demand
        rows[tick, 2] = torque
        for step in range(steps):
            viscous = p.b * (1.0 + p.uneven if v > 0 else 1.0 - p.uneven)
            asked = held if step < late else demand
            torque += h * (asked - torque) / p.lag
            stretch = x - y
            spring = 0.0
            if abs(stretch) > half or half == 0.0:
                spring = p.k * (stretch - min(max(stretch, -half), half)) + p.c * (v - u)
            ripple = p.fc * p.strength * math.sin(2 * math.pi * x / p.length) if p.law == 7 else 0.0
            u += h * spring / p.load
            if p.law == 2:
                w = p.gear * v
                level = p.fc + (p.fs - p.fc) * math.exp(-((w / p.ws) ** 2))
                slip = w - p.s0 * abs(w) * z / level
                z += h * slip
                friction = p.s0 * z + p.s1 * slip
                v += h * (p.gear * (torque + p.weight - friction) - viscous * v - spring) / p.motor
            else:
                pushed = v + h * (p.gear * (torque + p.weight - ripple) - viscous * v - spring) / p.motor
                way = 1.0 if pushed > 0 else -1.0
                most = h * p.gear * _level(p, p.gear * v, x, torque, way) / p.motor
                v = 0.0 if abs(pushed) <= most else pushed - way * most
            x += h * v
            y += h * u
        held = demand
    return rows
