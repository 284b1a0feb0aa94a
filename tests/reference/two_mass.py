"""An axis as two masses on a spring, with winding, LuGre friction, encoder and sampled servo, integrated by RK4.

With the motor side at x, the load at y [m], the motor's angle gear x and speed w = gear dx/dt:

    (nut + rotor gear²) x'' = gear (K i - F) - (damping + rotor_damping gear²) x' + k (y - x) + c (y' - x')
    load y''                = - k (y - x) - c (y' - x')
    L i'                    = clip(R/K torque + K w, bus) - K w - R i
    F                       = sigma0 z + sigma1 z',     z' = w - sigma0 |w| z / g(w)
    g(w)                    = coulomb + (static - coulomb) exp(-(w / stribeck)²)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numba
import numpy as np

from .law import MEMORY, Law, sampled
from .mjcf import Drive

STEP = 10e-6  # of the integration [s]


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


class Plant(NamedTuple):
    """The numbers of the equations, as compiled code takes them."""

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

    @classmethod
    def of(cls, drive: Drive) -> Plant:
        return cls(
            drive.nut + drive.rotor * drive.gear**2,
            drive.load,
            drive.damping + drive.rotor_damping * drive.gear**2,
            *(getattr(drive, name) for name in cls._fields[3:]),
        )


def within_current(law: Law, drive: Drive) -> Law:
    """Return the law with its torque limited to that of the drive's current limit."""
    return replace(law, limit=min(law.limit, drive.constant * drive.current))


def follow(drive: Drive, law: Law, setpoints: np.ndarray, step: float = STEP) -> Motion:
    """Return the motion of an axis that starts at rest at its first setpoint.

    Args:
        drive: the axis, a slide.
        law: its servo.
        setpoints: commanded positions, one per period, (n,) [mm].
        step: longest step of the integration; it is shortened so as to divide period and delay [s].
    """
    numbers = within_current(law, drive).numbers()
    return Motion(*_follow(Plant.of(drive), numbers, law.steps(step), np.ascontiguousarray(setpoints)).T)


@numba.njit(cache=True, error_model="numpy")
def drive_rates(p, torque, w, current, z):
    """Return shaft torque, and time derivatives of current and bristle, at a torque demand and a motor speed."""
    level = p.coulomb + (p.static - p.coulomb) * math.exp(-((w / p.stribeck) ** 2))
    slip = w - p.bristle * abs(w) * z / level
    friction = p.bristle * z + p.bristle_damping * slip
    voltage = min(max(p.resistance / p.constant * torque + p.constant * w, -p.bus), p.bus)
    return (
        p.constant * current - friction,
        (voltage - p.constant * w - p.resistance * current) / p.inductance,
        slip,
    )


@numba.njit(cache=True, error_model="numpy")
def _rates(p, torque, x, v, y, u, current, z):
    """Return the time derivatives of x, x', y, y', i and z."""
    shaft, slope, slip = drive_rates(p, torque, p.gear * v, current, z)
    spring = p.stiffness * (y - x) + p.flex_damping * (u - v)
    return v, (p.gear * shaft - p.drag * v + spring) / p.motor, u, -spring / p.load, slope, slip


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
def _integrated(p, state, torque, steps, step):
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
def _follow(plant, law, steps, setpoints):
    """Return encoder, motor, load, demand and torque at each tick, (n, 5)."""
    before, first, after, second = steps
    state = (1e-3 * setpoints[0], 0.0, 1e-3 * setpoints[0], 0.0, 0.0, 0.0)
    memory, held = np.zeros(MEMORY), 0.0
    rows = np.empty((len(setpoints), 5))
    for tick in range(len(setpoints)):
        position = 1e3 * state[0]
        measured, demand = sampled(law, memory, tick == 0, setpoints[tick], position)
        rows[tick] = (measured, position, 1e3 * state[2], demand, plant.constant * state[4])
        state = _integrated(plant, state, held, before, first)
        held = demand
        state = _integrated(plant, state, held, after, second)
    return rows
