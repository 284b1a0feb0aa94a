"""Faults on purpose in the servo tick: of the encoder, the setpoints, the coupling, the winding and the bus."""

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from gantrysim.base.jit import inner_jit
from gantrysim.native.pointers import injected_faults, vector
from gantrysim.native.row import BUS, DROPOUT, EXTRAPOLATED, HELD, OFFSET, SLIP, WINDING


@inner_jit
def turned(row, axis, position):
    """Return the position of an axis' motor, which is ahead of the axis where its coupling has slipped."""
    faults = injected_faults(row)
    for k in range(row.injected_count):
        fault = faults[k]
        if fault.kind == SLIP and fault.axis == axis and fault.begin <= row.tick < fault.end:
            position += fault.value
    return position


@inner_jit
def reported(row, axis, measured):
    """Return the position that the encoder reports."""
    faults = injected_faults(row)
    frozen = False
    for k in range(row.injected_count):
        fault = faults[k]
        if fault.axis == axis and fault.begin <= row.tick < fault.end:
            if fault.kind == OFFSET:
                measured += fault.value
            elif fault.kind == DROPOUT:
                frozen = frozen or row.tick > 0
    return row.measured[axis] if frozen else measured


@inner_jit
def received(row, axis, setpoint):
    """Return the setpoint with which the drive works; at the first tick it has no earlier one."""
    faults = injected_faults(row)
    if row.tick == 0:
        return setpoint
    for k in range(row.injected_count):
        fault = faults[k]
        if fault.axis == axis and fault.begin <= row.tick < fault.end:
            if fault.kind == HELD:
                return row.commanded[axis]
            if fault.kind == EXTRAPOLATED:
                return row.commanded[axis] + row.demand_velocity[axis] * row.period
    return setpoint


@inner_jit
def interrupt(data, row):
    """Take the current out of open windings; before every physics step, as MuJoCo integrates it from the voltage."""
    faults = injected_faults(row)
    currents = vector(data, row.act_at)
    for k in range(row.injected_count):
        fault = faults[k]
        if fault.kind == WINDING and row.current[fault.axis] >= 0 and _acts(row, fault):
            currents[row.current[fault.axis]] = 0.0


@inner_jit
def limit_voltage(data, row):
    """Keep the drives' voltage R/K u + K w, with the control u and the motor's speed w, within what the bus has left.

    Drives of an open winding, which may have no current of its own in MuJoCo, get no control.
    """
    faults = injected_faults(row)
    ctrl, velocity = vector(data, row.ctrl_at), vector(data, row.actuator_velocity_at)
    if row.drives == 0:  # else the drives have just set them
        for a in range(row.axes):
            ctrl[row.control[a]] = row.held[a] * row.drive_gain[a]
    for k in range(row.injected_count):
        fault = faults[k]
        if not _acts(row, fault):
            continue
        place = row.control[fault.axis]
        if fault.kind == WINDING:
            ctrl[place] = 0.0
        elif fault.kind == BUS:
            back = fault.constant * velocity[row.output[fault.axis]]
            gain = fault.constant / fault.resistance
            ctrl[place] = min(max(ctrl[place], gain * (-fault.value - back)), gain * (fault.value - back))


@inner_jit
def _acts(row, fault):
    """Return whether a fault acts in this physics step."""
    return fault.begin * row.substeps <= row.steps < fault.end * row.substeps
