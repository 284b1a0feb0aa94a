"""A stepper in open loop in the servo tick: its two phases and their drive."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache

import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import axis_log, drives_at, row_at, vector
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.engine.native.stepping_field import field_at, mean_stepped, stepped, turn_target
from gantrysim.machine.row import STEPPER


@cache
def stepper_stage() -> int:
    """Return the address of the stage of steppers in open loop, see `drives`."""

    def stage(data, userdata, argument):
        row = row_at(userdata)
        drives = drives_at(argument, row.axes)
        for axis in range(row.axes):
            if drives[axis].mode == STEPPER:
                turn_field(data, row, axis, drives[axis])

    return compiled_stage(stage)


@jit
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
    theta = drive.poles * vector(data, row.actuator_length_at)[row.output[axis]] * row.scale[axis]
    speed = vector(data, row.actuator_velocity_at)[row.output[axis]]
    turn_target(row, axis, drive)
    amplitude = 0.0 if row.fault != 0 else drive.amplitude
    if drive.logged == 0:
        field = drive.poles * stepped(drive.start, drive)
        drive.phases[0] = amplitude * np.cos(field)
        drive.phases[1] = amplitude * np.sin(field)
    turn = drive.poles * speed * row.scale[axis] * row.period / row.substeps
    current, mean = _step_circuit(row, drive, theta, turn, drive.constant * speed, amplitude)
    if row.current[axis] >= 0:
        vector(data, row.act_at)[row.current[axis]] = mean
    vector(data, row.ctrl_at)[row.control[axis]] = drive.constant * mean
    if row.tick > drive.logged:
        drive.logged = row.tick
        entry = axis_log(row, row.tick - 1)[axis]
        entry.current = current
        entry.demand = drive.volts


@jit
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
    first = drive.phases[0]
    second = drive.phases[1]
    # a winding reaches its current at the end of a step of the circuit, one without inductance has it throughout
    ahead = 1.0 if drive.left > 0.0 else 0.5
    remains = (drive.left - 1.0) / np.log(drive.left) if drive.left > 0.0 else 0.0
    total = 0.0
    current = 0.0
    largest = 0.0
    # the rotor's angle at the middles of the circuit's steps turns by the same each time
    middle = theta + turn * (0.5 / steps - 0.5)
    cosine = np.cos(middle)
    sine = np.sin(middle)
    turn_cosine = np.cos(turn / steps)
    turn_sine = np.sin(turn / steps)
    angle = np.inf
    wanted_a = wanted_b = 0.0
    for k in range(steps):
        if 2 * k == steps:
            current = second * np.cos(theta) - first * np.sin(theta)
        share = (k + ahead) / steps - 0.5
        low = field_at(row, drive, share - 0.5 / steps)
        high = field_at(row, drive, share + 0.5 / steps)
        field = mean_stepped(low, high, drive)
        if field != angle:  # mostly it rests on a microstep
            angle = field
            wanted_a = amplitude * np.cos(drive.poles * angle)
            wanted_b = amplitude * np.sin(drive.poles * angle)
        away = -back * sine
        along = back * cosine
        a = gain * (wanted_a - drive.left * first) + away
        b = gain * (wanted_b - drive.left * second) + along
        a = min(max(a, -drive.bus), drive.bus)
        b = min(max(b, -drive.bus), drive.bus)
        settled_a = (a - away) / drive.resistance
        settled_b = (b - along) / drive.resistance
        mean_a = settled_a + (first - settled_a) * remains
        mean_b = settled_b + (second - settled_b) * remains
        total += mean_b * cosine - mean_a * sine
        first = drive.left * first + (a - away) / gain
        second = drive.left * second + (b - along) / gain
        largest = max(largest, abs(a), abs(b))
        turned = cosine * turn_cosine - sine * turn_sine
        sine = sine * turn_cosine + cosine * turn_sine
        cosine = turned
    drive.phases[0] = first
    drive.phases[1] = second
    drive.volts = largest
    return current, total / steps
