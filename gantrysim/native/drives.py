"""Drives in the servo tick that are no plain ones: what their encoders report, and the loops that they close."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from gantrysim.base.jit import inner_jit
from gantrysim.native.injection import reported, turned
from gantrysim.native.pointers import axis_log, drives_of, gains_of, vector
from gantrysim.native.row import POSITION, STEPPER, TORQUE, VELOCITY
from gantrysim.native.supervision import watch_oscillation
from gantrysim.servo import law, notch

_law, _filtered = inner_jit(law.law), inner_jit(notch.filtered)
_COEFFICIENTS = len(notch.Coefficients._fields)
_DRIVE = 2**40  # added to the number of a sample that the drive takes itself, for its noise

_STEP, _FIRST, _SECOND = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_UNIT = 2.0**-53


@inner_jit
def read(data, row, axis, motor, position):
    """Return the position that the servo's encoder reads before it is counted, see `_read`."""
    drive = drives_of(row)[axis]
    if drive.counts:
        begun = (row.phase - row.delay) % row.substeps  # a new target is about to be taken where it is 0
        return _stepped(_field(row, drive, 0.0) if begun else drive.target, drive)
    return _read(data, row, drive, motor, position, row.tick)


@inner_jit
def _read(data, row, drive, motor, position, sample):
    """Return the position that an encoder reads at a numbered sample before it is counted.

    The position x is the motor's, or that of the joint and of the load on its spring. The encoder adds
    e1 sin(2 pi x / p) + e2 sin(4 pi x / p), with the signal period p, and white noise.
    """
    seen = motor
    if drive.load >= 0:
        seen = position + (vector(data, row.qpos_at)[drive.load] - drive.load_zero) * drive.per_si
    angle = seen * drive.signal
    seen += drive.once * np.sin(angle) + drive.twice * np.sin(2.0 * angle)
    if drive.noise > 0.0:
        seen += drive.noise * normal(drive.seed, sample)
    return seen


@inner_jit
def delayed(row, axis, measured):
    """Return what the encoder reported some ticks ago, at the start what it reported first."""
    drive = drives_of(row)[axis]
    slots = drive.delay + 1
    if row.tick == 0:
        drive.history[:] = measured
    drive.history[row.tick % slots] = measured
    return drive.history[(row.tick + 1) % slots]


@inner_jit
def follow_demands(data, row):
    """Set the controls of one physics step so that the torques follow the demands held.

    A control u that is held for a step takes the torque T of a winding to T + (1 - exp(-h R / L)) (u - T). With
    u = T + lead (T* - T) it comes as much nearer to the demand T* as a lag of the current loop's bandwidth f does,
    1 - exp(-2 pi f h). MuJoCo limits the voltage of u to the bus.
    """
    ctrl, currents = vector(data, row.ctrl_at), vector(data, row.act_at)
    drives = drives_of(row)
    for a in range(row.axes):
        drive, demand = drives[a], row.held[a] * row.drive_gain[a]
        if drive.loss > 0.0:
            _lose(data, row, drive)
        if drive.mode == STEPPER:
            turn_field(data, row, a, drive)
            continue
        if drive.mode != TORQUE:
            demand = _closed_loop(data, row, a, drive) * row.drive_gain[a]
        if drive.lead == 0.0:
            ctrl[row.control[a]] = demand
        else:
            torque = drive.constant * currents[row.current[a]]
            ctrl[row.control[a]] = torque + drive.lead * (demand - torque)


@inner_jit
def _lose(data, row, drive):
    """Apply the friction of a transmission of efficiency e that carries the force F: (1/e - 1) |F| against the motion.

    A motor that drives its load does the work F / e per travel; one that brakes it gets F (2 - 1/e) back. The friction
    turns within a presliding x: s' = (v - |v| s) / x, its share s being the sign of v after it (Dahl).
    """
    passive, speed = vector(data, row.qfrc_passive_at), vector(data, row.qvel_at)[drive.dof]
    force = passive[drive.spring] if drive.spring >= 0 else passive[drive.dof] + drive.damping * speed
    vector(data, row.qfrc_applied_at)[drive.dof] = -drive.loss * abs(force) * drive.slid
    side = np.sign(speed)
    left = np.exp(-abs(speed) * row.period / row.substeps / drive.presliding)
    drive.slid = side + (drive.slid - side) * left


@inner_jit
def turn_field(data, row, axis, drive):
    """Give a stepper in open loop its torque of this physics step, and drive its phases to the field's next angle.

    With the electrical angle p x of the rotor the phases have the torque and the back-EMF of

        T = K (i_b cos p x - i_a sin p x),    e_a = -K w sin p x,    e_b = K w cos p x

    The driver wants the currents I cos p f and I sin p f of the field's angle f, counted in microsteps. Each of its two
    bridges sets the voltage, within the bus, at which L di/dt = v - R i - e takes the current there in one step of the
    circuit. At rest the torque is K I sin p (f - x).

    The torque is the mean over half a physics step before and after its begin. Sampled there, microsteps that follow
    each other faster than physics steps would fold into slow ripples, which shake the rotor in its field. The window is
    centred, as a torque that is late or early by half a step would drive or damp the rotor.
    """
    at = row.output[axis]
    theta = drive.poles * vector(data, row.actuator_length_at)[at] * row.scale[axis]
    speed = vector(data, row.actuator_velocity_at)[at]
    _turn_target(row, axis, drive)
    amplitude = 0.0 if row.fault != 0 else drive.amplitude
    if drive.logged == 0:
        field = drive.poles * _stepped(drive.start, drive)
        drive.phases[0], drive.phases[1] = amplitude * np.cos(field), amplitude * np.sin(field)
    turn = drive.poles * speed * row.scale[axis] * row.period / row.substeps
    current, mean = _step_circuit(row, drive, theta, turn, drive.constant * speed, amplitude)
    if row.current[axis] >= 0:
        vector(data, row.act_at)[row.current[axis]] = mean
    vector(data, row.ctrl_at)[row.control[axis]] = drive.constant * mean
    if row.tick > drive.logged:
        drive.logged = row.tick
        entry = axis_log(row, row.tick - 1)[axis]
        entry.current, entry.demand = current, drive.volts


@inner_jit
def _step_circuit(row, drive, theta, turn, back, amplitude):
    """Step the phase currents from half a physics step before now to half a step after it.

    Returns:
        The current that makes torque now, and its mean over the step [A].

    Args:
        row: the row.
        drive: the drive, whose phases and largest voltage change.
        theta: electrical angle of the rotor now [rad].
        turn: of that angle in a physics step [rad].
        back: back-EMF of a phase across the rotor [V].
        amplitude: of the phase currents [A].
    """
    steps = drive.circuit
    gain = drive.resistance / (1.0 - drive.left)
    first, second = drive.phases[0], drive.phases[1]
    # a winding reaches its current at the end of a step of the circuit, one without inductance has it throughout
    ahead = 1.0 if drive.left > 0.0 else 0.5
    remains = (drive.left - 1.0) / np.log(drive.left) if drive.left > 0.0 else 0.0
    total = 0.0
    current = 0.0
    largest = 0.0
    # the rotor's angle at the middles of the circuit's steps turns by the same each time
    middle = theta + turn * (0.5 / steps - 0.5)
    cosine, sine = np.cos(middle), np.sin(middle)
    turn_cosine, turn_sine = np.cos(turn / steps), np.sin(turn / steps)
    angle = np.inf
    wanted_a = wanted_b = 0.0
    for k in range(steps):
        if 2 * k == steps:
            current = second * np.cos(theta) - first * np.sin(theta)
        share = (k + ahead) / steps - 0.5
        low, high = _field(row, drive, share - 0.5 / steps), _field(row, drive, share + 0.5 / steps)
        field = _mean_stepped(low, high, drive)
        if field != angle:  # mostly it rests on a microstep
            angle = field
            wanted_a = amplitude * np.cos(drive.poles * angle)
            wanted_b = amplitude * np.sin(drive.poles * angle)
        away, along = -back * sine, back * cosine
        a = gain * (wanted_a - drive.left * first) + away
        b = gain * (wanted_b - drive.left * second) + along
        a, b = min(max(a, -drive.bus), drive.bus), min(max(b, -drive.bus), drive.bus)
        settled_a, settled_b = (a - away) / drive.resistance, (b - along) / drive.resistance
        mean_a = settled_a + (first - settled_a) * remains
        mean_b = settled_b + (second - settled_b) * remains
        total += mean_b * cosine - mean_a * sine
        first = drive.left * first + (a - away) / gain
        second = drive.left * second + (b - along) / gain
        largest = max(largest, abs(a), abs(b))
        cosine, sine = cosine * turn_cosine - sine * turn_sine, sine * turn_cosine + cosine * turn_sine
    drive.phases[0], drive.phases[1], drive.volts = first, second, largest
    return current, total / steps


@inner_jit
def _turn_target(row, axis, drive):
    """Take the setpoint that is due at this physics step as the target."""
    if row.phase == row.delay % row.substeps:
        drive.came_from = drive.start if drive.logged > 0 else drive.target
        drive.start, drive.target = drive.target, row.commanded[axis]
        if row.delay == row.substeps:
            drive.target, drive.next = drive.next, row.commanded[axis]


@inner_jit
def _closed_loop(data, row, axis, drive):
    """Return the torque demand of a drive that closes a loop itself, sampled in steps of its own period.

    In velocity mode, with the velocity v as a difference of the motor's positions and the servo's demand w,

        out = K (w - v + sum(w - v) t / Ti)

    In position mode it is the servo's own law and notch at the drive's period. The setpoint goes in a straight line
    from the last to this one, one servo period late.
    """
    if drive.mode == POSITION:
        _turn_target(row, axis, drive)
    if row.phase % drive.every == 0:
        at = row.output[axis]
        position = vector(data, row.actuator_length_at)[at] * row.scale[axis]
        speed = vector(data, row.actuator_velocity_at)[at]
        motor, sample = position, _DRIVE + row.steps
        if row.injected_count > 0:
            motor = turned(row, axis, position)
        seen = motor
        if drive.mode == POSITION or drive.load < 0:
            seen = _read(data, row, drive, motor, position, sample)
        if row.resolution[axis] > 0.0:
            seen = row.resolution[axis] * np.floor(seen / row.resolution[axis] + 0.5)
        if row.injected_count > 0:
            seen = reported(row, axis, seen)
        if drive.mode == VELOCITY:
            if drive.logged == 0:
                drive.before = seen
            error = row.held[axis] - (seen - drive.before) / drive.period
            drive.before = seen
            total = drive.sum + error * drive.period
            torque = drive.gain * (error + drive.rate * total)
        else:
            error = _field(row, drive, 0.0) - seen
            if drive.logged == 0:
                drive.before, drive.position = error, seen
            total = drive.sum + error * drive.period
            torque = _law(
                error,
                total,
                (error - drive.before) / drive.period,
                (drive.target - drive.start) / row.period,
                row.demand_acceleration[axis],
                (seen - drive.position) / drive.period,
                gains_of(row, axis),
            )
            torque, drive.first, drive.second = _filtered(
                torque, to_fixed_tuple(row.notch[axis], _COEFFICIENTS), drive.first, drive.second
            )
            drive.before, drive.position = error, seen
        limit = drive.limit
        if drive.reactance > 0.0:
            limit = min(limit, _left_by_reactance(drive, speed, np.sign(torque)))
        drive.torque = min(max(torque, -limit), limit)
        if abs(torque) <= limit or torque * error < 0.0:  # anti-windup
            drive.sum = total
        if abs(torque) > limit and limit > 0.0 and row.fault == 0:
            watch_oscillation(row, axis, np.sign(torque))
    if row.fault != 0:
        drive.torque = 0.0
    if row.tick > drive.logged:
        drive.logged = row.tick
        axis_log(row, row.tick - 1)[axis].demand = drive.torque
    return drive.torque


@inner_jit
def _left_by_reactance(drive, speed, side):
    """Return the largest torque to one side that bus, resistance and reactance leave at a speed, in the torque's axis.

    (R i + K w)^2 + (X i)^2 = V^2 with X = p w L, where K w is positive if the motor drives.
    """
    back = drive.constant * speed * side
    reactance = drive.reactance * speed
    square = drive.resistance**2 + reactance**2
    half = drive.resistance * back
    under = half**2 - square * (back**2 - drive.bus**2)
    if under < 0.0:
        return 0.0
    return drive.constant * max((np.sqrt(under) - half) / square, 0.0)


@inner_jit
def _field(row, drive, share):
    """Return where the field is at a share of a physics step, on its way from the last setpoint to this one [u]."""
    begun = (row.phase - row.delay) % row.substeps + share
    if begun < 0.0:
        return drive.start + (drive.start - drive.came_from) * begun / row.substeps
    return drive.start + (drive.target - drive.start) * begun / row.substeps


@inner_jit
def _stepped(field, drive):
    return drive.microstep * np.floor(field / drive.microstep + 0.5)


@inner_jit
def _mean_stepped(low, high, drive):
    """Return the mean of a field in microsteps while it goes from one place to another.

    With the integral of floor(w), n w - n (n + 1) / 2 where n = floor(w), from the first microstep on.
    """
    steps = (high - low) / drive.microstep
    begin = low / drive.microstep + 0.5
    first = np.floor(begin)
    begin -= first
    end = begin + steps
    if np.floor(end) == 0.0:
        return drive.microstep * first
    whole = np.floor(end)
    return drive.microstep * (first + (whole * end - 0.5 * whole * (whole + 1.0)) / steps)


@inner_jit
def normal(seed, tick):
    """Return a number of the standard normal distribution, by Box and Muller, that depends on seed and tick alone."""
    first = _mixed(seed + np.uint64(2 * tick) * _STEP)
    second = _mixed(seed + np.uint64(2 * tick + 1) * _STEP)
    radius = np.sqrt(-2.0 * np.log((np.float64(first >> np.uint64(11)) + 0.5) * _UNIT))
    return radius * np.cos(2.0 * np.pi * np.float64(second >> np.uint64(11)) * _UNIT)


@inner_jit
def _mixed(number):
    """Return 64 bits that look random (the finaliser of SplitMix64, Steele, Lea and Flood 2014)."""
    number = (number ^ (number >> np.uint64(30))) * _FIRST
    number = (number ^ (number >> np.uint64(27))) * _SECOND
    return number ^ (number >> np.uint64(31))
