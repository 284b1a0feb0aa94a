"""Drives in the servo tick: current loops, and friction of transmissions.

Each kind of drive is a stage of its own that sets the controls of its axes in every physics step; the argument of all
is the address of the drives.
"""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from functools import cache

import numpy as np

from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import drives_at, row_at, vector
from gantrysim.engine.native.stages import compiled_stage
from gantrysim.machine.row import TORQUE


@cache
def torque_stage() -> int:
    """Return the address of the stage of drives that take torques."""

    def stage(data, userdata, argument):
        row = row_at(userdata)
        drives = drives_at(argument, row.axes)
        for axis in range(row.axes):
            if drives[axis].mode == TORQUE:
                follow_demand(data, row, axis, drives[axis], row.held[axis])

    return compiled_stage(stage)


@cache
def transmission_stage() -> int:
    """Return the address of the stage of transmissions with losses."""

    def stage(data, userdata, argument):
        row = row_at(userdata)
        drives = drives_at(argument, row.axes)
        for axis in range(row.axes):
            if drives[axis].loss > 0.0:
                lose(data, row, drives[axis])

    return compiled_stage(stage)


@jit
def follow_demand(data, row, axis, drive, torque_demand):
    """Set the control of one physics step so that the torque follows a demand: current follows it as a first-order lag.

    A control u that is held for a step takes the torque T of a winding to T + (1 - exp(-h R / L)) (u - T). With
    u = T + lead (T* - T) it comes as much nearer to the demand T* as a lag of the current loop's bandwidth f does,
    1 - exp(-2 pi f h). MuJoCo limits the voltage of u to the bus.
    """
    ctrl = vector(data, row.ctrl_at)
    demand = torque_demand * row.drive_gain[axis]
    if drive.lead == 0.0:
        ctrl[row.control[axis]] = demand
    else:
        torque = drive.constant * vector(data, row.act_at)[row.current[axis]]
        ctrl[row.control[axis]] = torque + drive.lead * (demand - torque)


@jit
def lose(data, row, drive):
    """Add the friction of a transmission of efficiency e that carries the force F: (1/e - 1) |F| against the motion.

    A motor that drives its load does the work F / e per travel; one that brakes it gets F (2 - 1/e) back. The friction
    turns within a presliding x: s' = (v - |v| s) / x, its share s being the sign of v after it (Dahl).
    """
    passive = vector(data, row.qfrc_passive_at)
    speed = vector(data, row.qvel_at)[drive.dof]
    force = passive[drive.spring] if drive.spring >= 0 else passive[drive.dof] + drive.damping * speed
    vector(data, row.qfrc_applied_at)[drive.dof] -= drive.loss * abs(force) * drive.slid
    side = np.sign(speed)
    memory = np.exp(-abs(speed) * row.period / row.substeps / drive.presliding)
    drive.slid = side + (drive.slid - side) * memory
