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
from typing import Any

import numba
import numpy as np
from numba import types

from gantrysim.base.jit import c_function, jit
from gantrysim.engine.native.pointers import call, pointer, row_at, take_turn
from gantrysim.engine.native.tick import step
from gantrysim.machine.row import MAX_AXES, MISSED

SOURCE, RESISTIVE, WOUND = range(3)  # kinds of motors: of force, dcmotors without and with inductance

MAX_DOFS = 16

_OF_MOTORS = (
    "gear",
    "gain",  # force per control of a source
    "constant_of_motor",  # [N·m/A]
    "resistance",  # [ohm]
    "bus",  # [V]
    "lowest",  # control
    "highest",
    "weakest",  # force of the motor, without cogging and friction
    "strongest",
    "lag",  # electrical time constant [s]
    "remains",  # share of a current that a step leaves
    "rate",  # largest change of the current [A/s]
    "cogging",  # amplitude [N·m]
    "teeth",
    "phase",  # [rad]
    "stiffness",  # of the bristles [N·m/rad], 0 for none
    "damping",  # of the bristles [N·m·s/rad]
    "coulomb",  # [N·m]
    "static",  # [N·m]
    "stribeck",  # speed [rad/s]
)

# mechanics and motors of a machine with n joints and m axes; the rest of each field is not used
PLANT = np.dtype(
    [
        ("dofs", np.int64),  # n
        ("axes", np.int64),  # m
        ("step", np.float64),  # h [s]
        ("of_speed", np.float64, (MAX_DOFS, MAX_DOFS)),  # A
        ("of_place", np.float64, (MAX_DOFS, MAX_DOFS)),  # B
        ("push", np.float64, (MAX_DOFS, MAX_AXES)),  # P
        ("constant", np.float64, (MAX_DOFS,)),  # c
        # nozzle in the work frame by the places of the joints, and where they are 0 [mm]
        ("tip", np.float64, (3, MAX_DOFS)),
        ("tip_at_rest", np.float64, (3,)),
        # force of springs and dampers on each axis' joint, then on its load's: by place, by speed, and at rest
        ("passive_of_place", np.float64, (2 * MAX_AXES, MAX_DOFS)),
        ("passive_of_speed", np.float64, (2 * MAX_AXES, MAX_DOFS)),
        ("passive_at_rest", np.float64, (2 * MAX_AXES,)),
        ("kind", np.int64, (MAX_AXES,)),  # of the motor
        ("dof", np.int64, (MAX_AXES,)),  # of its joint
        *((name, np.float64, (MAX_AXES,)) for name in _OF_MOTORS),
    ]
)

# its state
STATE = np.dtype(
    [
        ("place", np.float64, (MAX_DOFS,)),  # q
        ("speed", np.float64, (MAX_DOFS,)),  # v
        ("current", np.float64, (MAX_AXES,)),  # of the windings [A]
        ("bristle", np.float64, (MAX_AXES,)),  # deflection [rad]
        ("change", np.float64, (MAX_DOFS,)),  # v' - v of the last step
        ("force", np.float64, (MAX_AXES,)),  # on each axis' joint in it [SI]
    ]
)

_LEAST_DIVISOR = 1e-15  # speed and time constant below which MuJoCo divides by this
_SLIDING = 80.0  # square of the speed over Stribeck's, from which friction is Coulomb's: exp(-80) is lost in rounding
_LARGEST_VALUE = 1e10  # of what MuJoCo takes for a valid position, speed and acceleration


@jit
def drive_motor(plant, state, a, control):
    """Return the force of an axis' motor on its joint now, and take current and bristle to the end of the step.

    Args:
        plant: the machine.
        state: its state, of which current and bristle of the axis change.
        a: number of the axis.
        control: of the actuator.
    """
    dof = plant.dof[a]
    gear = plant.gear[a]
    speed = gear * state.speed[dof]
    control = min(max(control, plant.lowest[a]), plant.highest[a])
    if plant.kind[a] == SOURCE:
        return gear * min(max(plant.gain[a] * control, plant.weakest[a]), plant.strongest[a])
    constant = plant.constant_of_motor[a]
    resistance = plant.resistance[a]
    back = constant * speed
    volts = min(max(resistance * control / constant + back, -plant.bus[a]), plant.bus[a])
    # the current that a standing winding would come to
    settled = (volts - back) / resistance
    force = constant * settled
    if plant.kind[a] == WOUND:
        current = state.current[a]
        force = constant * current
        furthest = plant.rate[a] * plant.lag[a]
        state.current[a] = current + min(max(settled - current, -furthest), furthest) * (1.0 - plant.remains[a])
    force = min(max(force, plant.weakest[a]), plant.strongest[a])
    if plant.cogging[a] != 0.0:
        force += plant.cogging[a] * np.sin(plant.teeth[a] * gear * state.place[dof] + plant.phase[a])
    if plant.stiffness[a] > 0.0:
        bristle = state.bristle[a]
        ratio = speed / max(plant.stribeck[a], _LEAST_DIVISOR)
        level = plant.coulomb[a]
        if ratio * ratio < _SLIDING:
            level += (plant.static[a] - plant.coulomb[a]) * np.exp(-ratio * ratio)
        rate = -plant.stiffness[a] * abs(speed) / max(level, _LEAST_DIVISOR)
        force -= plant.stiffness[a] * bristle + plant.damping[a] * (rate * bristle + speed)
        remains = np.exp(rate * plant.step)
        state.bristle[a] = (
            remains * bristle + ((remains - 1.0) / rate if abs(rate) > _LEAST_DIVISOR else plant.step) * speed
        )
    return gear * force


@jit
def move(plant, state, controls, applied):
    """Make a physics step; return whether the state is one that MuJoCo would warn of: no number, or too large a one.

    Args:
        plant: the machine.
        state: its state.
        controls: of the axes, (m,) or more.
        applied: forces on their joints besides, (m,) or more [SI].
    """
    n = plant.dofs
    m = plant.axes
    for a in range(m):
        state.force[a] = drive_motor(plant, state, a, controls[a]) + applied[a]
    for i in range(n):
        speed = plant.constant[i]
        for j in range(n):
            speed += plant.of_speed[i, j] * state.speed[j] + plant.of_place[i, j] * state.place[j]
        for a in range(m):
            speed += plant.push[i, a] * state.force[a]
        state.change[i] = speed - state.speed[i]
    largest_change = _LARGEST_VALUE * plant.step
    is_lost = False
    for i in range(n):
        change = state.change[i]
        speed = state.speed[i] + change
        place = state.place[i] + plant.step * speed
        state.speed[i] = speed
        state.place[i] = place
        if not (abs(place) <= _LARGEST_VALUE and abs(speed) <= _LARGEST_VALUE and abs(change) <= largest_change):
            is_lost = True
    return is_lost


@jit
def sense(plant, state, row):
    """Write what the machine is like before a physics step into the servo's row."""
    n = plant.dofs
    for a in range(plant.axes):
        dof = plant.dof[a]
        row.angle[a] = plant.gear[a] * state.place[dof]
        row.motor_speed[a] = plant.gear[a] * state.speed[dof]
        row.winding_current[a] = state.current[a] if plant.kind[a] == WOUND else np.nan
        row.joint_place[a] = state.place[dof]
    if row.phase == 0:
        for i in range(3):
            row.nozzle[i] = plant.tip_at_rest[i]
            for j in range(n):
                row.nozzle[i] += plant.tip[i, j] * state.place[j]
    if row.stages != 0:
        for a in range(plant.axes):
            row.joint_speed[a] = state.speed[plant.dof[a]]
            row.passive[a] = _passive(plant, state, a)
            if row.load_at[a] >= 0:
                row.load_place[a] = state.place[row.load_at[a]]
                row.load_passive[a] = _passive(plant, state, plant.axes + a)


@jit
def _passive(plant, state, line):
    force = plant.passive_at_rest[line]
    for j in range(plant.dofs):
        force += plant.passive_of_place[line, j] * state.place[j] + plant.passive_of_speed[line, j] * state.speed[j]
    return force


@jit
def follow(plant, state, row):
    """Make the physics step that follows a step of the servo, with what its row has act on the machine."""
    if row.stages != 0:
        for a in range(plant.axes):
            if plant.kind[a] == WOUND:
                state.current[a] = row.winding_current[a]
    if move(plant, state, row.control_torque, row.applied):
        row.lost = 1


@jit
def run(plant, state, row, steps):
    """Make a number of physics steps with the servo, until its run is done or an axis has reached a stop.

    An observer that waits for a later step of a run that is done is called at its end.

    Args:
        plant: the machine.
        state: its state.
        row: the servo's row.
        steps: number of physics steps.
    """
    for _ in range(steps):
        if row.stops == MISSED:
            return
        if row.fault != 0 or row.index >= row.ticks:
            if row.observer_step > row.steps:
                row.observer_step = 0
                call(row.observer, row.address, row.observer_argument)
            return
        sense(plant, state, row)
        step(row)
        follow(plant, state, row)


# addresses of what a batch has at a place
PLACE = np.dtype([("plant", np.int64), ("physics", np.int64), ("row", np.int64)])
_PLACE = numba.from_dtype(PLACE)
_PLANT = numba.from_dtype(PLANT)
_STATE = numba.from_dtype(STATE)
_INTEGER = types.int64


@cache
def loop() -> Any:
    """Return a C function that steps places, of: address of `PLACE` entries, of numbers, their count, steps, and turn.

    It holds no lock of Python's. Several threads may step places together: the turn is the address of an integer that
    they share, 0 at the begin, by which each place is stepped by the thread that is free first.
    """

    def step_places(places, numbers, count, steps, turn):
        chosen = numba.carray(pointer(numbers, _INTEGER), (count,))
        while True:
            taken = take_turn(turn)
            if taken >= count:
                return
            number = chosen[taken]
            place = numba.carray(pointer(places, _PLACE), (number + 1,))[number]
            plant = numba.carray(pointer(place.plant, _PLANT), (1,))[0]
            state = numba.carray(pointer(place.physics, _STATE), (1,))[0]
            row = row_at(place.row)
            row.address = place.row
            run(plant, state, row, steps)

    return c_function(step_places, types.void(*5 * [types.int64])).ctypes
