"""A stepper in open loop: its two phases and their driver."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.engine.drives.field import field_at, mean_stepped, stepped_place, turn_target
from gantrysim.engine.drives.part import STEPPER, DrivenAxis, DrivePart

# longest step of a stepper's circuit [s]: a bridge needs about 10 us from one microstep's current to the next, and of a
# step four times as long the mean torque was 8 % too high
_CIRCUIT = 4e-6


def _stepper(driven: DrivenAxis) -> dict[str, Any]:
    """Return the driver of a stepper in open loop, whose motor constant is the nominal one times the gain."""
    axis = driven.axis
    if driven.drive.mode != "stepper":
        return {}
    motor = axis.phases
    if motor is None or not motor.microsteps:
        raise InputError(
            f"servo mode of axis {axis.name} = 'stepper': its motor is not a stepper with microsteps; use 'torque', or "
            "a table of the machine with a motor of kind 'stepper'"
        )
    # even, as the record has the currents at the middle
    steps = 2 * math.ceil(0.5 * driven.step / _CIRCUIT)
    inductance = motor.inductance if axis.lag > 0 else 0.0
    return {
        "circuit": steps,
        "poles": motor.pole_pairs / axis.scale,
        "microstep": axis.electrical_period / (4 * motor.microsteps),
        "amplitude": min(driven.drive.torque_limit, axis.peak_torque) / axis.motor_constant,
        "constant": driven.gain * axis.motor_constant,
        "resistance": axis.resistance,
        "bus": axis.bus_voltage,
        "left": math.exp(-axis.resistance * driven.step / steps / inductance) if inductance else 0.0,
    }


def _turn_field(row, tape, axis, drive):
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
    if drive.mode == STEPPER:
        stepper = drive.stepper
        theta = stepper.poles * row.angle[axis] * row.scale[axis]
        speed = row.motor_speed[axis]
        turn_target(row, axis, drive.field, drive.logged > 0)
        amplitude = 0.0 if row.fault != 0 else stepper.amplitude
        if drive.logged == 0:
            field = stepper.poles * stepped_place(drive.field.start, stepper)
            stepper.phases[0] = amplitude * np.cos(field)
            stepper.phases[1] = amplitude * np.sin(field)
        turn = stepper.poles * speed * row.scale[axis] * row.period / row.substeps
        current, mean = _step_circuit(row, drive, theta, turn, stepper.constant * speed, amplitude)
        if row.current_at[axis] >= 0:
            row.winding_current[axis] = mean
        row.control_torque[axis] = stepper.constant * mean
        if row.tick > drive.logged:
            drive.logged = row.tick
            entry = tape.log.axis[row.tick - 1 - row.first, axis]
            entry.current = current
            entry.demand = stepper.volts


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
    stepper = drive.stepper
    steps = stepper.circuit
    gain = stepper.resistance / (1.0 - stepper.left)
    first = stepper.phases[0]
    second = stepper.phases[1]
    # a winding reaches its current at the end of a step of the circuit, one without inductance has it throughout
    ahead = 1.0 if stepper.left > 0.0 else 0.5
    remains = (stepper.left - 1.0) / np.log(stepper.left) if stepper.left > 0.0 else 0.0
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
        low = field_at(row, drive.field, share - 0.5 / steps)
        high = field_at(row, drive.field, share + 0.5 / steps)
        place = mean_stepped(low, high, stepper)
        # mostly it rests on a microstep
        if place != angle:
            angle = place
            wanted_a = amplitude * np.cos(stepper.poles * angle)
            wanted_b = amplitude * np.sin(stepper.poles * angle)
        away = -back * sine
        along = back * cosine
        a = gain * (wanted_a - stepper.left * first) + away
        b = gain * (wanted_b - stepper.left * second) + along
        a = min(max(a, -stepper.bus), stepper.bus)
        b = min(max(b, -stepper.bus), stepper.bus)
        settled_a = (a - away) / stepper.resistance
        settled_b = (b - along) / stepper.resistance
        mean_a = settled_a + (first - settled_a) * remains
        mean_b = settled_b + (second - settled_b) * remains
        total += mean_b * cosine - mean_a * sine
        first = stepper.left * first + (a - away) / gain
        second = stepper.left * second + (b - along) / gain
        largest = max(largest, abs(a), abs(b))
        turned = cosine * turn_cosine - sine * turn_sine
        sine = sine * turn_cosine + cosine * turn_sine
        cosine = turned
    stepper.phases[0] = first
    stepper.phases[1] = second
    stepper.volts = largest
    return current, total / steps


STEPPING = DrivePart(
    "stepper",
    [
        ("circuit", np.int64),  # steps of the circuit per physics step, even
        ("poles", np.float64),  # electrical radians per u
        ("microstep", np.float64),  # [u]
        ("amplitude", np.float64),  # of the phase currents [A]
        ("constant", np.float64),  # of the motor with its perturbation [N·m/A]
        ("resistance", np.float64),  # [ohm]
        ("bus", np.float64),  # [V]
        ("left", np.float64),  # share of a phase current that is left after a step of the circuit
        ("phases", np.float64, (2,)),  # currents [A]
        ("volts", np.float64),  # largest phase voltage of the last physics step [V]
    ],
    _stepper,
    (("drive", _turn_field),),
    lambda servo, entries: "stepper" in servo.modes,
)
