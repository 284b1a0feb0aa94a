"""The physics step of a machine whose joints all slide, as one compiled loop with the servo tick.

Its mechanics are linear. Numbers that `gantrysim.engine.linear` reads off MuJoCo give the speeds after a step,

    v' = c + A v + B q + P (gear F + f),    q' = q + h v'

with the forces F of the motors, and forces f on their joints besides. The motors are those of MuJoCo: ideal sources of
force, or its dcmotor with current control, a winding, a limit of the voltage, cogging and LuGre friction (Canudas de
Wit, Olsson, Åström and Lischinsky, IEEE Transactions on Automatic Control 40, 1995). A winding's current and a bristle
go on as if speed and voltage were constant in a step.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import c_function, jit
from gantrysim.engine.native.pointers import pointer, row_at
from gantrysim.engine.native.tick import step
from gantrysim.machine.row import MISSED

SOURCE, RESISTIVE, WOUND = range(3)  # kinds of motors: of force, dcmotors without and with inductance

MOTOR = np.dtype(
    [
        ("kind", np.int64),
        ("dof", np.int64),  # of its joint
        ("gear", np.float64),
        ("gain", np.float64),  # force per control of a source
        ("constant", np.float64),  # [N·m/A]
        ("resistance", np.float64),  # [ohm]
        ("bus", np.float64),  # [V]
        ("lowest", np.float64),  # control
        ("highest", np.float64),
        ("weakest", np.float64),  # force of the motor, without cogging and friction
        ("strongest", np.float64),
        ("lag", np.float64),  # electrical time constant [s]
        ("remains", np.float64),  # share of a current that a step leaves
        ("rate", np.float64),  # largest change of the current [A/s]
        ("cogging", np.float64),  # amplitude [N·m]
        ("teeth", np.float64),
        ("phase", np.float64),  # [rad]
        ("stiffness", np.float64),  # of the bristles [N·m/rad], 0 for none
        ("damping", np.float64),  # of the bristles [N·m·s/rad]
        ("coulomb", np.float64),  # [N·m]
        ("static", np.float64),  # [N·m]
        ("stribeck", np.float64),  # speed [rad/s]
    ]
)

_LEAST = 1e-15  # speed and time constant below which MuJoCo divides by this
_LARGEST = 1e10  # of what MuJoCo takes for a valid position, speed and acceleration


class Plant(NamedTuple):
    """Mechanics and motors of a machine, with n joints and m axes, and their state.

    Attributes:
        step: h [s].
        of_speed: A, (n, n).
        of_place: B, (n, n).
        push: P, (n, m).
        constant: c, (n,).
        tip: nozzle in the work frame by the places of the joints, and where they are 0, (3, n + 1) [mm].
        passive: force of springs and dampers on each axis' joint, then on its load's, by place, speed and 1,
            (2 m, 2 n + 1).
        motors: of the axes, (m,) of `MOTOR`.
        place: q, (n,).
        speed: v, (n,).
        current: of the windings, (m,) [A].
        bristle: deflection, (m,) [rad].
        change: space for v' - v, (n,).
        force: space for the force on each axis' joint, (m,).
    """

    step: float
    of_speed: Floats
    of_place: Floats
    push: Floats
    constant: Floats
    tip: Floats
    passive: Floats
    motors: NDArray[np.void]
    place: Floats
    speed: Floats
    current: Floats
    bristle: Floats
    change: Floats
    force: Floats


@jit
def stribeck_level(motor, speed):
    """Return the friction of a motor that slides at a speed, F_C + (F_S - F_C) exp(-(v / v_S)^2) [N·m]."""
    ratio = speed / max(motor.stribeck, _LEAST)
    return motor.coulomb + (motor.static - motor.coulomb) * np.exp(-ratio * ratio)


@jit
def drive_motor(plant, a, control):
    """Return the force of an axis' motor on its joint now, and take current and bristle to the end of the step.

    Args:
        plant: the machine; current and bristle of the axis change.
        a: number of the axis.
        control: of the actuator.
    """
    motor = plant.motors[a]
    angle = motor.gear * plant.place[motor.dof]
    speed = motor.gear * plant.speed[motor.dof]
    control = min(max(control, motor.lowest), motor.highest)
    if motor.kind == SOURCE:
        return motor.gear * min(max(motor.gain * control, motor.weakest), motor.strongest)
    volts = motor.resistance / motor.constant * control + motor.constant * speed
    volts = min(max(volts, -motor.bus), motor.bus)
    # the current that a standing winding would come to
    settled = volts / motor.resistance - motor.constant / motor.resistance * speed
    force = motor.constant * settled
    if motor.kind == WOUND:
        current = plant.current[a]
        force = motor.constant * current
        change = min(max((settled - current) / motor.lag, -motor.rate), motor.rate)
        plant.current[a] = current + change * motor.lag * (1.0 - motor.remains)
    force = min(max(force, motor.weakest), motor.strongest)
    if motor.cogging != 0.0:
        force += motor.cogging * np.sin(motor.teeth * angle + motor.phase)
    if motor.stiffness > 0.0:
        bristle = plant.bristle[a]
        rate = -motor.stiffness * abs(speed) / max(stribeck_level(motor, speed), _LEAST)
        force -= motor.stiffness * bristle + motor.damping * (rate * bristle + speed)
        left = np.exp(rate * plant.step)
        plant.bristle[a] = left * bristle + ((left - 1.0) / rate if abs(rate) > _LEAST else plant.step) * speed
    return motor.gear * force


@jit
def move(plant, controls, applied):
    """Make a physics step.

    Args:
        plant: the machine.
        controls: of the axes, (m,) or more.
        applied: forces on their joints besides, (m,) or more [SI].
    """
    n = len(plant.place)
    m = len(plant.motors)
    for a in range(m):
        plant.force[a] = drive_motor(plant, a, controls[a]) + applied[a]
    for i in range(n):
        speed = plant.constant[i]
        for j in range(n):
            speed += plant.of_speed[i, j] * plant.speed[j] + plant.of_place[i, j] * plant.place[j]
        for a in range(m):
            speed += plant.push[i, a] * plant.force[a]
        plant.change[i] = speed - plant.speed[i]
    for i in range(n):
        plant.speed[i] += plant.change[i]
        plant.place[i] += plant.step * plant.speed[i]


@jit
def sense(plant, row):
    """Write what the machine is like before a physics step into the servo's row, which lacks neither joints nor load.

    Args:
        plant: the machine.
        row: the row.
    """
    n = len(plant.place)
    for a in range(len(plant.motors)):
        motor = plant.motors[a]
        row.angle[a] = motor.gear * plant.place[motor.dof]
        row.motor_speed[a] = motor.gear * plant.speed[motor.dof]
        row.winding_current[a] = plant.current[a] if motor.kind == WOUND else np.nan
        row.joint_place[a] = plant.place[motor.dof]
    if row.phase == 0:
        for i in range(3):
            row.nozzle[i] = plant.tip[i, n]
            for j in range(n):
                row.nozzle[i] += plant.tip[i, j] * plant.place[j]
    if row.stages != 0:
        for a in range(len(plant.motors)):
            row.joint_speed[a] = plant.speed[plant.motors[a].dof]
            row.passive[a] = _passive(plant, a)
            if row.load_at[a] >= 0:
                row.load_place[a] = plant.place[row.load_at[a]]
                row.load_passive[a] = _passive(plant, len(plant.motors) + a)


@jit
def _passive(plant, line):
    n = len(plant.place)
    force = plant.passive[line, 2 * n]
    for j in range(n):
        force += plant.passive[line, j] * plant.place[j] + plant.passive[line, n + j] * plant.speed[j]
    return force


@jit
def _is_lost(plant):
    """Return whether the state is one that MuJoCo would warn of: no number, or too large a one."""
    for i in range(len(plant.place)):
        largest = max(abs(plant.place[i]), abs(plant.speed[i]), abs(plant.change[i]) / plant.step)
        if not largest <= _LARGEST:
            return True
    return False


@jit
def run(plant, row, steps):
    """Make a number of physics steps with the servo, until its run is done or an axis has reached a stop.

    Args:
        plant: the machine.
        row: the servo's row.
        steps: number of physics steps.
    """
    for _ in range(steps):
        if row.fault != 0 or row.index >= row.ticks or row.stops == MISSED:
            return
        sense(plant, row)
        step(row)
        if row.stages != 0:
            for a in range(row.axes):
                if row.current_at[a] >= 0:
                    plant.current[a] = row.winding_current[a]
        move(plant, row.control_torque, row.applied)
        if _is_lost(plant):
            row.lost = 1


# The places of a batch, whose machines have as many joints and axes as one another.

PLACE = np.dtype([("machine", np.int64), ("state", np.int64), ("dofs", np.int64), ("axes", np.int64)])  # addresses
_PLACE = numba.from_dtype(PLACE)
_MOTOR = numba.from_dtype(MOTOR)
_FLOAT = types.float64
_NUMBER = types.int64
_MOTOR_NUMBERS = MOTOR.itemsize // 8


def machine_shapes(dofs: int, axes: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of what a plant has of its machine, by the order in which it lies in memory."""
    return {
        "step": (1,),
        "of_speed": (dofs, dofs),
        "of_place": (dofs, dofs),
        "push": (dofs, axes),
        "constant": (dofs,),
        "tip": (3, dofs + 1),
        "passive": (2 * axes, 2 * dofs + 1),
        "motors": (axes, _MOTOR_NUMBERS),
    }


def state_shapes(dofs: int, axes: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a plant's state, by the order in which it lies in memory; the servo's row follows."""
    return {
        "place": (dofs,),
        "speed": (dofs,),
        "current": (axes,),
        "bristle": (axes,),
        "change": (dofs,),
        "force": (axes,),
    }


@jit
def _plant_at(place):
    """Return the plant at a place, and the address of the servo's row behind its state."""
    n = place.dofs
    m = place.axes
    at = place.machine
    step = numba.carray(pointer(at, _FLOAT), (1,))[0]
    at += 8
    of_speed = numba.carray(pointer(at, _FLOAT), (n, n))
    at += 8 * n * n
    of_place = numba.carray(pointer(at, _FLOAT), (n, n))
    at += 8 * n * n
    push = numba.carray(pointer(at, _FLOAT), (n, m))
    at += 8 * n * m
    constant = numba.carray(pointer(at, _FLOAT), (n,))
    at += 8 * n
    tip = numba.carray(pointer(at, _FLOAT), (3, n + 1))
    at += 24 * (n + 1)
    passive = numba.carray(pointer(at, _FLOAT), (2 * m, 2 * n + 1))
    at += 16 * m * (2 * n + 1)
    motors = numba.carray(pointer(at, _MOTOR), (m,))
    at = place.state
    here = numba.carray(pointer(at, _FLOAT), (n,))
    at += 8 * n
    speed = numba.carray(pointer(at, _FLOAT), (n,))
    at += 8 * n
    current = numba.carray(pointer(at, _FLOAT), (m,))
    at += 8 * m
    bristle = numba.carray(pointer(at, _FLOAT), (m,))
    at += 8 * m
    change = numba.carray(pointer(at, _FLOAT), (n,))
    at += 8 * n
    force = numba.carray(pointer(at, _FLOAT), (m,))
    at += 8 * m
    machine = (step, of_speed, of_place, push, constant, tip, passive, motors)
    return Plant(*machine, here, speed, current, bristle, change, force), at


@cache
def loop() -> Any:
    """Return a C function that steps places, of: address of `PLACE` entries, of numbers, their count, and steps.

    It holds no lock of Python's, and places may be stepped by several threads, each by one of them.
    """

    def step_places(places, numbers, count, steps):
        chosen = numba.carray(pointer(numbers, _NUMBER), (count,))
        for number in chosen:
            place = numba.carray(pointer(places, _PLACE), (number + 1,))[number]
            plant, address = _plant_at(place)
            row = row_at(address)
            row.address = address
            run(plant, row, steps)

    return c_function(step_places, types.void(types.int64, types.int64, types.int64, types.int64)).ctypes
