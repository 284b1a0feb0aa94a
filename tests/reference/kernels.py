"""The compiled equations of the references: servo, drive, an axis as two masses, the rotary table; integrated by RK4.

All compiled code stands in this one file, by whose date numba's cache goes.

**Servo.** Once per period T the encoder gives the nearest count, and with the following error E the servo demands

    torque = kp E + ki T sum(E) + kd dE/T + velocity_ff dDPOS/T + acceleration_ff ddDPOS/T² + output_velocity dMPOS/T

through the notch and the torque limit; it takes effect after the delay and is held for a period. The sum leaves out a
tick whose demand is beyond the limit on the side to which the error drives it.

**Drive.** At the speed w of the motor

    L i' = clip(R/K torque + K w, bus) - K w - R i
    F    = sigma0 z + sigma1 z',     z' = w - sigma0 |w| z / g(w)
    g(w) = coulomb + (static - coulomb) exp(-(w / stribeck)²)

**Axis.** With the motor side at x, the load at y [m] and w = gear x'

    (nut + rotor gear²) x'' = gear (K i - F) - (damping + rotor_damping gear²) x' + k (y - x) + c (y' - x')
    load y''                = - k (y - x) - c (y' - x')

**Table.** In the frame of the table, which turns at W, a mass m at c = (p, q) has the velocity c' + W x c. A slide
moves its masses along d, which is -x or -y. With the force Q along the slide, and h = sum m (c x d)

    M s'' + h W'           = Q - sum m (2 W x c' - W² c) . d
    J W' + sum of h s''    = moment of the spring - J' W,       J = sum I + m c . c,    J' = 2 sum m c . c'
"""

from __future__ import annotations

import math

import numba
import numpy as np

MEMORY = 8  # numbers that the servo of an axis keeps from tick to tick


@numba.njit(cache=True, error_model="numpy")
def _sampled(numbers, memory, first, command, position):
    """Return the torque demand of one tick [N·m]; memory is zero before the first."""
    kp, ki, kd, velocity_ff, acceleration_ff, output_velocity, b0, b1, b2, a1, a2, limit, count, period = numbers
    total, w1, w2, old_command, old_measured, old_error, old_velocity, _ = memory
    measured = count * np.rint(position / count) if count > 0 else position
    error = command - measured
    if first:
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
    filtered = b0 * torque + w1
    demand = min(max(filtered, -limit), limit)
    memory[0] = trial if demand == filtered or demand * error < 0 else total
    memory[1] = b1 * torque - a1 * filtered + w2
    memory[2] = b2 * torque - a2 * filtered
    memory[3], memory[4], memory[5], memory[6] = command, measured, error, velocity
    return demand


@numba.njit(cache=True, error_model="numpy")
def _drive_rates(p, torque, w, current, z):
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
def _axis_rates(p, torque, x, v, y, u, current, z):
    """Return the time derivatives of x, x', y, y', i and z."""
    shaft, slope, slip = _drive_rates(p, torque, p.gear * v, current, z)
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
def _axis_after(p, state, torque, steps, step):
    """Return the state after a number of steps of the classical Runge-Kutta method."""
    for _ in range(steps):
        # one call in a loop: four would be compiled four times over
        after = state
        rates = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for place, share in ((0.0, 6.0), (step / 2, 3.0), (step / 2, 3.0), (step, 6.0)):
            rates = _axis_rates(p, torque, *_moved(state, place, rates))
            after = _moved(after, step / share, rates)
        state = after
    return state


@numba.njit(cache=True, error_model="numpy")
def follow_axis(plant, law, steps, setpoints):
    """Return load position, torque demand and motor torque at each tick, (n, 3)."""
    before, first, after, second = steps
    state = (1e-3 * setpoints[0], 0.0, 1e-3 * setpoints[0], 0.0, 0.0, 0.0)
    memory, held = np.zeros(MEMORY), 0.0
    rows = np.empty((len(setpoints), 3))
    for tick in range(len(setpoints)):
        demand = _sampled(law, memory, tick == 0, setpoints[tick], 1e3 * state[0])
        rows[tick] = (1e3 * state[2], demand, plant.constant * state[4])
        for torque, count, step in ((held, before, first), (demand, after, second)):
            state = _axis_after(plant, state, torque, count, step)
        held = demand
    return rows


@numba.njit(cache=True, error_model="numpy")
def _table_rates(plants, masses, slides, torques, state, rates):
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
        shaft, rates[12 + a], rates[15 + a] = _drive_rates(
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
def _integrate_table(plants, masses, slides, torques, state, steps, step, k):
    """Advance the state in place by the classical Runge-Kutta method."""
    for _ in range(steps):
        _table_rates(plants, masses, slides, torques, state, k[0])
        _table_rates(plants, masses, slides, torques, state + step / 2 * k[0], k[1])
        _table_rates(plants, masses, slides, torques, state + step / 2 * k[1], k[2])
        _table_rates(plants, masses, slides, torques, state + step * k[2], k[3])
        state += step / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])


@numba.njit(cache=True, error_model="numpy")
def follow_table(plants, masses, slides, laws, steps, setpoints, per_si):
    """Return load positions, torque demands and motor torques at each tick, (n, 9)."""
    before, first, after, second = steps
    state, k = np.zeros(18), np.zeros((4, 18))
    state[:3] = state[3:6] = setpoints[0] / per_si
    memory, held, demand = np.zeros((3, MEMORY)), np.zeros(3), np.zeros(3)
    rows = np.empty((len(setpoints), 9))
    for tick in range(len(setpoints)):
        for a in range(3):
            demand[a] = _sampled(laws[a], memory[a], tick == 0, setpoints[tick, a], per_si[a] * state[a])
            rows[tick, 6 + a] = plants[a].constant * state[12 + a]
        rows[tick, :3] = state[3:6] * per_si
        rows[tick, 3:6] = demand
        _integrate_table(plants, masses, slides, held, state, before, first, k)
        held[:] = demand
        _integrate_table(plants, masses, slides, held, state, after, second, k)
    return rows
