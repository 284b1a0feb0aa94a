"""An axis as two masses on a spring, with winding, LuGre friction, encoder and sampled servo, integrated by RK4.

With the motor side at x, the load at y [m], the motor's angle gear x and speed w = gear dx/dt:

    (nut + rotor gear²) x'' = gear (K i - F) - (damping + rotor_damping gear²) x' + k (y - x) + c (y' - x')
    load y''                = - k (y - x) - c (y' - x')
    L i'                    = clip(R/K torque + K w, bus) - K w - R i
    F                       = sigma0 z + sigma1 z',     z' = w - sigma0 |w| z / g(w)
    g(w)                    = coulomb + (static - coulomb) exp(-(w / stribeck)²)

Once per period T the encoder gives the nearest count, and with the following error E the servo demands

    torque = kp E + ki T sum(E) + kd dE/T + velocity_ff dDPOS/T + acceleration_ff ddDPOS/T² + output_velocity dMPOS/T

through the notch and the torque limit; it takes effect after the delay and is held for a period. The sum leaves out a
tick whose demand is beyond the limit on the side to which the error drives it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np

from .mjcf import Drive

STEP = 10e-6  # of the integration [s]


@dataclass(frozen=True)
class Law:
    """The servo of one axis in plain numbers, per mm.

    Attributes:
        period: T [s].
        delay: from the sample to the output [s].
        kp, ki, kd, velocity_ff, acceleration_ff, output_velocity: see above [N·m per mm, mm·s, mm/s, mm/s²].
        limit: largest torque demand [N·m].
        count: travel per encoder count, 0 for an exact encoder [mm].
        notch: centre [Hz] and damping of numerator and denominator of the filter on the torque; no filter at 0 Hz.
    """

    period: float
    delay: float
    kp: float
    ki: float
    kd: float
    velocity_ff: float
    acceleration_ff: float
    output_velocity: float
    limit: float
    count: float
    notch: tuple[float, float, float] = (0.0, 1.0, 1.0)


@dataclass(frozen=True)
class Motion:
    """An axis at the instants of the samples, (n,) each.

    Attributes:
        encoder, motor, load: positions as measured, of the motor side and of the load [mm].
        demand: torque demand, after its limit [N·m].
        torque: of the motor, K i [N·m].
    """

    encoder: np.ndarray
    motor: np.ndarray
    load: np.ndarray
    demand: np.ndarray
    torque: np.ndarray


class _Plant(NamedTuple):
    """The numbers of the equations, as the compiled code takes them."""

    motor: float  # nut + rotor gear² [kg]
    load: float
    drag: float  # damping + rotor_damping gear² [N·s/m]
    stiffness: float
    flex_damping: float
    gear: float
    constant: float
    resistance: float
    inductance: float
    bus: float
    bristle: float
    bristle_damping: float
    coulomb: float
    static: float
    stribeck: float


def notch_coefficients(frequency: float, numerator: float, denominator: float, period: float) -> tuple[float, ...]:
    """Return b0, b1, b2, a1, a2 of the sampled notch.

        N(s) = (s² + 2 z_n w0 s + w0²) / (s² + 2 z_d w0 s + w0²),    s = w0 / tan(w0 T / 2) (z - 1) / (z + 1)

    The substitution leaves the centre where it is. At 0 Hz it is the identity.
    """
    if frequency == 0:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    k = math.tan(math.pi * frequency * period)
    whole = 1 + 2 * denominator * k + k * k
    middle = 2 * (k * k - 1) / whole
    return (
        (1 + 2 * numerator * k + k * k) / whole,
        middle,
        (1 - 2 * numerator * k + k * k) / whole,
        middle,
        (1 - 2 * denominator * k + k * k) / whole,
    )


def follow(drive: Drive, law: Law, setpoints: np.ndarray, step: float = STEP) -> Motion:
    """Return the motion of an axis that starts at rest at its first setpoint.

    Args:
        drive: the axis.
        law: its servo.
        setpoints: commanded positions, one per period, (n,) [mm].
        step: longest step of the integration; it is shortened so as to divide period and delay [s].
    """
    before = math.ceil(law.delay / step - 1e-9)
    after = math.ceil((law.period - law.delay) / step - 1e-9)
    plant = _Plant(
        drive.nut + drive.rotor * drive.gear**2,
        drive.load,
        drive.damping + drive.rotor_damping * drive.gear**2,
        *(getattr(drive, name) for name in _Plant._fields[3:]),
    )
    limit = min(law.limit, drive.constant * drive.current)
    gains = np.array([law.kp, law.ki, law.kd, law.velocity_ff, law.acceleration_ff, law.output_velocity])
    notch = np.array(notch_coefficients(*law.notch, law.period))
    timing = np.array([law.period, law.delay / max(before, 1), (law.period - law.delay) / max(after, 1)])
    columns = _follow(plant, gains, notch, timing, before, after, limit, law.count, np.ascontiguousarray(setpoints))
    return Motion(*columns.T)


@numba.njit(cache=True, error_model="numpy")
def _rates(p, torque, x, v, y, u, current, z):
    """Return the time derivatives of x, x', y, y', i and z."""
    w = p.gear * v
    level = p.coulomb + (p.static - p.coulomb) * math.exp(-((w / p.stribeck) ** 2))
    slip = w - p.bristle * abs(w) * z / level
    friction = p.bristle * z + p.bristle_damping * slip
    spring = p.stiffness * (y - x) + p.flex_damping * (u - v)
    voltage = min(max(p.resistance / p.constant * torque + p.constant * w, -p.bus), p.bus)
    return (
        v,
        (p.gear * (p.constant * current - friction) - p.drag * v + spring) / p.motor,
        u,
        -spring / p.load,
        (voltage - p.constant * w - p.resistance * current) / p.inductance,
        slip,
    )


@numba.njit(cache=True, error_model="numpy")
def _moved(state, by, rates):
    return (
        state[0] + by * rates[0],
        state[1] + by * rates[1],
        state[2] + by * rates[2],
        state[3] + by * rates[3],
        state[4] + by * rates[4],
        state[5] + by * rates[5],
    )


@numba.njit(cache=True, error_model="numpy")
def _integrated(p, state, torque, step, steps):
    """Return the state after a number of steps of the classical Runge-Kutta method."""
    for _ in range(steps):
        k1 = _rates(p, torque, *state)
        k2 = _rates(p, torque, *_moved(state, step / 2, k1))
        k3 = _rates(p, torque, *_moved(state, step / 2, k2))
        k4 = _rates(p, torque, *_moved(state, step, k3))
        for share, rates in ((6, k1), (3, k2), (3, k3), (6, k4)):
            state = _moved(state, step / share, rates)
    return state


@numba.njit(cache=True, error_model="numpy")
def _follow(plant, gains, notch, timing, before, after, limit, count, setpoints):
    """Return encoder, motor, load, demand and torque at each tick, (n, 5)."""
    kp, ki, kd, velocity_ff, acceleration_ff, output_velocity = gains
    b0, b1, b2, a1, a2 = notch
    period, first, second = timing
    state = (1e-3 * setpoints[0], 0.0, 1e-3 * setpoints[0], 0.0, 0.0, 0.0)
    rows = np.empty((len(setpoints), 5))
    total = 0.0
    held = 0.0
    w1 = w2 = 0.0  # of the notch
    old_command = old_measured = old_error = old_velocity = 0.0
    for tick in range(len(setpoints)):
        position = 1e3 * state[0]
        measured = count * np.rint(position / count) if count > 0 else position
        command = setpoints[tick]
        error = command - measured
        if tick == 0:
            old_command, old_measured, old_error = command, measured, error
        velocity = (command - old_command) / period
        trial = total + period * error
        torque = (
            kp * error
            + ki * trial
            + kd * (error - old_error) / period
            + velocity_ff * velocity
            + acceleration_ff * (velocity - old_velocity) / period
            + output_velocity * (measured - old_measured) / period
        )
        old_command, old_measured, old_error, old_velocity = command, measured, error, velocity
        filtered = b0 * torque + w1
        w1 = b1 * torque - a1 * filtered + w2
        w2 = b2 * torque - a2 * filtered
        demand = min(max(filtered, -limit), limit)
        if demand == filtered or demand * error < 0:
            total = trial
        rows[tick, 0] = measured
        rows[tick, 1] = position
        rows[tick, 2] = 1e3 * state[2]
        rows[tick, 3] = demand
        rows[tick, 4] = plant.constant * state[4]
        state = _integrated(plant, state, held, first, before)
        held = demand
        state = _integrated(plant, state, held, second, after)
    return rows
