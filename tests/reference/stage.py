"""The machine `stage`: a table that turns, x on it, y on x, each axis two masses on a spring, integrated by RK4.

In the table's frame, which turns at W, a mass m at c = (p, q) has the velocity c' + W x c. A slide moves its masses
along -x or -y. With h the moment that a slide's acceleration exerts on the table, and Q the force along the slide,

    M s'' + h W'             = Q - sum m (2 W x c' - W² c) . d
    J W' + sum of h s''      = moment of the spring - J' W,       J = sum I + m c . c,    J' = 2 sum m c . c'

where d is the slide's direction and h = sum m (c x d). Springs, motors and friction are those of `two_mass`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numba
import numpy as np

from .law import MEMORY, Law, sampled
from .mjcf import Body, Drive
from .two_mass import STEP, Plant, drive_rates, within_current

AXES = 3  # th, x, y
PER_SI = np.array([180 / math.pi, 1e3, 1e3])  # degrees and millimetres
NEEDLE = (-200.0, 0.0)  # [mm]

# what turns with the table, and the slides that carry it: position in the state of its x and y, or -1
CARRIED = {"table": (-1, -1), "x_nut": (1, -1), "x_slide": (4, -1), "y_nut": (4, 2), "y_slide": (4, 5)}


def follow_stage(
    drives: Sequence[Drive], bodies: dict[str, Body], laws: Sequence[Law], setpoints: np.ndarray, step: float = STEP
) -> tuple[np.ndarray, np.ndarray]:
    """Return load positions (n, 3) [deg, mm, mm] and torque demands (n, 3) [N·m] at the ticks.

    Args:
        drives: th, x and y.
        bodies: by name.
        laws: the servos of the axes.
        setpoints: commanded positions, one per period, (n, 3) [deg, mm, mm].
        step: longest step of the integration [s].
    """
    masses = np.array([bodies[name] for name in CARRIED])
    slides = np.array(list(CARRIED.values()))
    numbers = np.array([within_current(law, drive).numbers() for law, drive in zip(laws, drives, strict=True)])
    table, *others = drives
    plants = tuple(Plant.of(drive) for drive in (table, *(replace(slide, nut=0.0) for slide in others)))
    rows = _follow(plants, masses, slides, numbers, laws[0].steps(step), np.ascontiguousarray(setpoints), PER_SI)
    return rows[:, :AXES], rows[:, AXES:]


def on_the_work(position: np.ndarray) -> np.ndarray:
    """Return the needle in the work frame, (n, 2) [mm]: R(-th) K + (x, y)."""
    angle = np.radians(position[:, 0])
    x, y = NEEDLE
    turned = np.stack([np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y], axis=1)
    return turned + position[:, 1:]


@numba.njit(cache=True, error_model="numpy")
def _rates(plants, masses, slides, torques, state, rates):
    """Write the time derivatives of the state: 6 positions, 6 speeds, 3 currents, 3 bristles.

    Positions and speeds are those of the motors of th, x, y, then those of the loads.
    """
    position, speed = state[:6], state[6:12]
    rates[:6] = speed
    turning = speed[3]
    inertia = change = 0.0
    mass, moment, force = np.zeros(6), np.zeros(6), np.zeros(6)
    for b in range(len(masses)):
        m, p, q, own = masses[b]
        i, j = slides[b]
        p_speed = q_speed = 0.0
        if i >= 0:
            p, p_speed = p - position[i], -speed[i]
        if j >= 0:
            q, q_speed = q - position[j], -speed[j]
        inertia += own + m * (p * p + q * q)
        change += 2 * m * (p * p_speed + q * q_speed)
        if i >= 0:
            mass[i] += m
            moment[i] += m * q
            force[i] += m * (-2 * turning * q_speed - turning * turning * p)
        if j >= 0:
            mass[j] += m
            moment[j] -= m * p
            force[j] += m * (2 * turning * p_speed - turning * turning * q)
    for a in range(3):
        plant = plants[a]
        shaft, rates[12 + a], rates[15 + a] = drive_rates(
            plant, torques[a], plant.gear * speed[a], state[12 + a], state[15 + a]
        )
        spring = plant.stiffness * (position[3 + a] - position[a]) + plant.flex_damping * (speed[3 + a] - speed[a])
        force[a] += plant.gear * shaft - plant.drag * speed[a] + spring
        force[3 + a] -= spring
    plant = plants[0]
    rates[6] = force[0] / plant.motor
    mass[1] += plants[1].motor
    mass[2] += plants[2].motor
    torque = force[3] - change * turning
    for s in (1, 2, 4, 5):
        torque -= moment[s] * force[s] / mass[s]
        inertia -= moment[s] * moment[s] / mass[s]
    rates[9] = torque / inertia
    for s in (1, 2, 4, 5):
        rates[6 + s] = (force[s] - moment[s] * rates[9]) / mass[s]


@numba.njit(cache=True, error_model="numpy")
def _integrate(plants, masses, slides, torques, state, steps, step, k):
    """Advance the state in place by the classical Runge-Kutta method."""
    for _ in range(steps):
        _rates(plants, masses, slides, torques, state, k[0])
        _rates(plants, masses, slides, torques, state + step / 2 * k[0], k[1])
        _rates(plants, masses, slides, torques, state + step / 2 * k[1], k[2])
        _rates(plants, masses, slides, torques, state + step * k[2], k[3])
        state += step / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])


@numba.njit(cache=True, error_model="numpy")
def _follow(plants, masses, slides, laws, steps, setpoints, per_si):
    """Return load positions and torque demands at each tick, (n, 6)."""
    before, first, after, second = steps
    state, k = np.zeros(18), np.zeros((4, 18))
    state[:3] = state[3:6] = setpoints[0] / per_si
    memory, held, demand = np.zeros((3, MEMORY)), np.zeros(3), np.zeros(3)
    rows = np.empty((len(setpoints), 6))
    for tick in range(len(setpoints)):
        for a in range(3):
            _, demand[a] = sampled(laws[a], memory[a], tick == 0, setpoints[tick, a], per_si[a] * state[a])
        rows[tick, :3] = state[3:6] * per_si
        rows[tick, 3:] = demand
        _integrate(plants, masses, slides, held, state, before, first, k)
        held[:] = demand
        _integrate(plants, masses, slides, held, state, after, second, k)
    return rows
