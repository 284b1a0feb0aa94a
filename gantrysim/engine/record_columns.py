"""The columns of a record: from a log, from the setpoints, and the part that is no array."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, read_only, seen
from gantrysim.base.columns import FileTable, blocks
from gantrysim.base.jit import jit
from gantrysim.engine.injection import faulted_flow, stretches
from gantrysim.faults import InjectedFault
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.machine.row import Log
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints


def columns_of(
    axes: int, *, waiting: bool, geometry: bool, progress: bool
) -> dict[str, tuple[np.dtype[Any], tuple[int, ...]]]:
    """Return the columns of a record in a file."""
    number = np.dtype(np.float64)
    names = {"": ("time", "flow", "flow_demand"), "axes": ("commanded", *OF_AXES), "tip": (*TIPS, "commanded_tip")}
    tails = {"": (), "axes": (axes,), "tip": (3,)}
    columns = {name: (number, tails[kind]) for kind, group in names.items() for name in group}
    columns |= {name: (number, (3,)) for name in ("geometric_tip", IDEAL) if geometry}
    columns |= {"progress": (number, ())} if progress else {}
    whole = {"setpoint": (np.dtype(np.int64), ())} if waiting else {}
    return {**columns, "dispense": (np.dtype(np.bool_), ()), **whole}


OF_AXES = ("encoder", "motor", "demand", "torque", "current", "voltage")
TIPS = ("encoder_tip", "motor_tip", "nozzle")
IDEAL = "ideal_nozzle"  # the nozzle of the same machine with an ideal geometry


def measured(
    machine: Machine, log: Log, first: int, period: float, faults: tuple[InjectedFault, ...], special: Floats
) -> dict[str, Floats]:
    """Return the part of a record that was measured, from the log from a first tick on."""
    drives = np.array(
        [
            (gain, axis.motor_constant, axis.resistance, axis.bus_voltage, axis.peak_torque, *extra)
            for gain, axis, extra in zip(machine.drive_gain, machine.plain_axes, special, strict=True)
        ]
    )
    ticks = len(log.axis)
    columns = np.empty((len(OF_AXES), len(drives), ticks))
    for begin, after, faulted in stretches(faults, machine.axis_names, period, range(first, first + ticks), drives):
        part = slice(begin - first, after - first)
        _fill(columns[:, :, part], log.axis[part], faulted)
    of_axes = {name: column.T for name, column in zip(OF_AXES, columns, strict=True)}
    tips = (machine.tip(of_axes["encoder"]), machine.tip(of_axes["motor"]), log.tick["nozzle"].copy())
    return {**of_axes, **dict(zip(TIPS, tips, strict=True))}


@jit
def _fill(columns: Floats, log: NDArray[np.void], drives: Floats) -> None:
    """Fill in encoder, motor, demand, torque, current and voltage, (6, axes, n).

    Columns are several times as fast to work on as rows. The voltage is by the drive's law: terminal voltage for the
    demanded torque, back-EMF compensated, within the bus; with a current loop, for what it asks for, see
    `gantrysim.engine.native.drives.follow_demands`. A stepper in open loop has the torque of its current, which is also
    its demand, and the voltage that it logs.

    Args:
        columns: to be filled in.
        log: of the axes, (n, axes) of `LOG_AXIS`.
        drives: gain, motor constant, resistance, bus voltage, peak torque, lead, and 1 for a stepper in open loop, of
            each axis, (axes, 7).
    """
    n, axes = log.shape
    for a in range(axes):
        gain = drives[a, 0]
        constant = drives[a, 1]
        resistance = drives[a, 2]
        bus = drives[a, 3]
        peak = drives[a, 4]
        lead = drives[a, 5]
        stepping = drives[a, 6]
        for k in range(n):
            entry = log[k, a]
            wanted = gain * entry.demand  # about to be delivered
            back = constant * entry.motor_speed
            control = wanted
            if lead != 0.0:
                control = constant * entry.current + lead * (wanted - constant * entry.current)
            volts = min(max(resistance / constant * control + back, -bus), bus)
            amperes = (volts - back) / resistance if np.isnan(entry.current) else entry.current
            delivered = wanted if np.isnan(constant) else constant * amperes
            torque = min(max(delivered, -peak), peak)
            demand = entry.demand
            if stepping != 0.0:
                demand = torque
                volts = entry.demand
            columns[0, a, k] = entry.encoder
            columns[1, a, k] = entry.motor
            columns[2, a, k] = demand
            columns[3, a, k] = torque
            columns[4, a, k] = amperes
            columns[5, a, k] = volts


@jit
def _fill_speeds(speeds: Floats, tip: Floats, period: float) -> None:
    """Fill in the mean speed over the period after each tick, 0 after the last, (n,) [mm/s].

    Args:
        speeds: to be filled in.
        tip: commanded nozzle, (n, 3), and where it goes on (n + 1, 3) [mm].
        period: servo period [s].
    """
    speeds[-1] = 0.0
    for k in range(len(tip) - 1):
        x = tip[k + 1, 0] - tip[k, 0]
        y = tip[k + 1, 1] - tip[k, 1]
        z = tip[k + 1, 2] - tip[k, 2]
        speeds[k] = np.sqrt(x * x + y * y + z * z) / period


def protected(content: dict[str, Any]) -> dict[str, Any]:
    """Return the content with its arrays read-only."""
    return {name: read_only(array) for name, array in content.items()}


class SentProgram(NamedTuple):
    """What is sent to a machine, arguments as of `LogBook`."""

    machine: Machine
    setpoints: Setpoints
    position: Floats
    dispenser: Dispenser
    faults: tuple[InjectedFault, ...] = ()


def sent_columns(
    program: SentProgram, sent: NDArray[np.integer], content: dict[str, Any], table: FileTable | None = None
) -> None:
    """Add the columns of a record that follow from the setpoints.

    Args:
        program: what is sent.
        sent: index of the setpoint at each tick, (n,).
        content: to which the columns are added, unless there is a table.
        table: to which they are written block by block.
    """
    machine, setpoints, position, dispenser, faults = program
    n = sent.size
    period = setpoints.period
    waited = sent[-1] != n - 1  # else one at a tick
    speed = np.empty(n)
    for block in [slice(0, n)] if table is None else blocks(n):
        ahead = slice(block.start, block.stop + 1)
        commanded = position[sent[ahead]] if waited else position[: sent.size][ahead]
        tip = machine.tip(commanded)
        count = block.stop - block.start
        _fill_speeds(speed[block], seen(tip), period)
        columns = {
            "time": np.arange(block.start, block.stop, dtype=np.float64) * period,
            "commanded": commanded[:count],
            "commanded_tip": tip[:count],
        }
        if table is None:
            content |= columns
        else:
            table.write(block.start, columns)
    dispense = setpoints.dispense[sent] if waited else setpoints.dispense[:n]
    flow = dispenser.flows(dispense, speed, period)
    if faults:
        flow = faulted_flow(faults, flow, dispenser.open_share(dispense, period), period)
    columns = {
        "flow": flow,
        "flow_demand": dispenser.flow_demand(dispense, speed),
        "dispense": dispense,
    }
    if setpoints.progress is not None:
        columns["progress"] = setpoints.progress[sent] if waited else setpoints.progress[:n]
    if table is None:
        content |= columns
    else:
        table.write(0, columns)


def constants(machine: Machine, setpoints: Setpoints, dispenser: Dispenser) -> dict[str, Any]:
    """Return the part of a record that is no array."""
    return {
        "machine": machine.name,
        "axes": machine.axis_names,
        "units": tuple(axis.unit for axis in machine.plain_axes),
        "requested": setpoints.requested,
        "period": setpoints.period,
        "gap": machine.gap,
        **needle_values(machine, dispenser),
    }


def needle_values(machine: Machine, dispenser: Dispenser) -> dict[str, float]:
    """Return the size of the dispenser's needle, or else of the machine's; empty where neither has one."""
    needle = dispenser.needle
    size = machine.needle if needle is None else (needle.face, needle.length)
    return {} if size is None else {"face": size[0], "needle_length": size[1]}


def dispensed_otherwise(run: Run, dispenser: Dispenser) -> Run:
    """Return the record of a complete run with another dispenser, which lays its glue along the same motion.

    It equals that of a run with this dispenser, as no glue acts on the motion.

    Args:
        run: a record without faults, on purpose or not.
        dispenser: with a start lead as long as that of the run, so that it holds the program back for as long, and the
            same needle.
    """
    speed = np.empty(len(run.time))
    _fill_speeds(speed, seen(run.commanded_tip), run.period)
    return run.replaced(
        flow=dispenser.flows(run.dispense, speed, run.period), flow_demand=dispenser.flow_demand(run.dispense, speed)
    )
