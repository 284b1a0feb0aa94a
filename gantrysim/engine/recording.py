"""The record of a simulation, from the log of its servo."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim import memory
from gantrysim.arrays import Floats, read_only
from gantrysim.columns import FileTable, array_of, blocks
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.engine.injection import faulted_flow, stretches
from gantrysim.fault import Fault
from gantrysim.faults import InjectedFault
from gantrysim.jit import jit
from gantrysim.machine.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.memory import check_ticks
from gantrysim.native.row import STEPPER, Log
from gantrysim.run import Run


class LogBook:
    """The log of a run: all of it in memory, or where the run is long its last ticks, with the record in a file.

    Args:
        machine: the machine of the run.
        setpoints: its setpoints.
        position: the same for all the machine's axes, (setpoints, axes) [mm or deg].
        dispenser: its dispenser.
        faults: faults on purpose.
        drives: that are no plain ones, (axes,) of `DRIVE`.
        scales: whether the servo has each axis' position from its load, (axes,) or one for all.

    Attributes:
        log: the entries in memory.
        first: tick of the first of them.
    """

    def __init__(
        self,
        machine: Machine,
        setpoints: Setpoints,
        position: Floats,
        dispenser: Dispenser,
        faults: tuple[InjectedFault, ...] = (),
        drives: NDArray[np.void] | None = None,
        scales: ArrayLike = False,
    ) -> None:
        self._scales = scales
        self._machine, self._setpoints, self._position, self._dispenser = machine, setpoints, position, dispenser
        axes = position.shape[1]
        self._faults, self._drives = faults, np.zeros((axes, 2))
        if drives is not None:
            self._drives = np.stack([drives["lead"], drives["mode"] == STEPPER], axis=1)
        count, axes = position.shape
        self._table: FileTable | None = None
        self.first = 0
        self._most = setpoints.most_ticks
        if count > memory.LONG:
            columns = _columns(axes, waiting=setpoints.gates.size > 0, geometry=machine.geometry is not None)
            self._table = FileTable(self._most, columns)
            self.log = Log.of(0, axes)
        else:
            self.log = Log.of(min(self._most, 2 * count), axes)

    def begin(self, row: np.void) -> None:
        """Begin at the first tick of a run; write the log's addresses into its servo's row."""
        if self._table is not None:
            self.first, self.log = 0, self.log.until(0)
        self._address(row)

    def _address(self, row: np.void) -> None:
        row["log"] = self.log.tick.ctypes.data - self.first * self.log.tick.itemsize
        row["axis_log"] = self.log.axis.ctypes.data - self.first * self.log.axis.itemsize * self.log.axis.shape[1]

    def make_room(self, row: np.void, ticks: int) -> None:
        """Make room for more ticks of the servo that writes here.

        Raises:
            InputError: the run waits for longer than there is memory for, or its file cannot be written.
        """
        begun = int(row["tick"])
        ticks = min(ticks, self._most - begun)
        if begun + ticks <= self.first + len(self.log.tick):
            return
        if self._table is not None:
            self._write(begun)
            # what the supervision looks back on stays
            log = self.log.until(begun - self.first)
            kept = log.since(max(len(log.tick) - self._setpoints.supervision.position_error_delay, 0))
            self.first = begun - len(kept.tick)
            room = len(kept.tick) + ticks
        else:
            kept = self.log.until(begun)
            room = min(max(begun + ticks, 2 * len(self.log.tick)), self._most)
            check_ticks(
                room, f"the run waits at its {self._setpoints.gates.size} gates and", "allow for a larger error"
            )
        self.log = Log.of(room, self.log.axis.shape[1])
        self.log.tick[: len(kept.tick)], self.log.axis[: len(kept.tick)] = kept.tick, kept.axis
        self._address(row)

    def _write(self, begun: int) -> None:
        """Write the ticks before one to the file."""
        assert self._table is not None
        log = self.log.until(begun - self.first)
        for block in blocks(len(log.tick)):
            part = Log(log.tick[block], log.axis[block])
            columns = self._measured(part, self.first + block.start)
            if self._machine.geometry is not None:
                columns[_IDEAL] = columns.pop("nozzle")
            self._table.write(self.first + block.start, columns)
            if self._setpoints.gates.size:
                self._table.write(self.first + block.start, {"setpoint": part.tick["setpoint"]})

    def finite(self, tick: int) -> bool:
        """Whether the positions logged at a tick are."""
        at = tick - self.first
        return bool(np.isfinite(self.log.tick["nozzle"][at]).all() and np.isfinite(self.log.axis["encoder"][at]).all())

    def record(self, ticks: int, fault: Fault | None) -> Run:
        """Return the record of the first ticks.

        Args:
            ticks: number of them, at least one.
            fault: why the run ended early, or None.
        """
        machine, setpoints, table = self._machine, self._setpoints, self._table
        kept = _constants(machine, setpoints, self._dispenser)
        content: dict[str, Any] = {}
        if table is None:
            log = self.log.until(ticks)
            _send(machine, setpoints, self._position, log.tick["setpoint"], self._dispenser, content, self._faults)
            content |= self._measured(log, 0)
            self._displace(content, None)
            return Run(**kept, **_protected(content), fault=fault, injected=self._faults)
        self._write(ticks)
        sent = table.stored(ticks)["setpoint"].array() if setpoints.gates.size else np.arange(ticks)
        _send(machine, setpoints, self._position, sent, self._dispenser, content, self._faults, table)
        self._displace(cast(dict[str, Any], table.stored(ticks)), table)
        stored = table.stored(ticks)
        for name in ("setpoint", _IDEAL):
            stored.pop(name, None)
        return Run(**kept, **cast(dict[str, Any], stored), fault=fault, injected=self._faults)

    def _displace(self, content: dict[str, Any], table: FileTable | None) -> None:
        """Displace the nozzle by the errors of the machine's geometry, if any; in the table where there is one."""
        errors = self._machine.kinematic_errors
        if errors is None:
            return
        motor, rigid = array_of(content["motor"]), array_of(content["motor_tip"])
        ideal = array_of(content["nozzle" if table is None else _IDEAL])
        every, parts = list(blocks(len(motor))), []
        for block, tip in zip(every, errors.tips((motor[block] for block in every), self._scales), strict=True):
            columns = {"geometric_tip": tip, "nozzle": ideal[block] + (tip - rigid[block])}
            if table is None:
                parts.append(columns)
            else:
                table.write(block.start, columns)
        if parts:
            content |= {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _measured(self, log: Log, first: int) -> dict[str, Floats]:
        return _measured(self._machine, log, first, self._setpoints.period, self._faults, self._drives)


def _columns(axes: int, *, waiting: bool, geometry: bool) -> dict[str, tuple[np.dtype[Any], tuple[int, ...]]]:
    """Return the columns of a record in a file."""
    number = np.dtype(np.float64)
    names = {"": ("time", "flow", "flow_demand"), "axes": ("commanded", *_OF_AXES), "tip": (*_TIPS, "commanded_tip")}
    tails = {"": (), "axes": (axes,), "tip": (3,)}
    columns = {name: (number, tails[kind]) for kind, group in names.items() for name in group}
    columns |= {name: (number, (3,)) for name in ("geometric_tip", _IDEAL) if geometry}
    whole = {"setpoint": (np.dtype(np.int64), ())} if waiting else {}
    return {**columns, "dispense": (np.dtype(np.bool_), ()), **whole}


_OF_AXES = ("encoder", "motor", "demand", "torque", "current", "voltage")
_TIPS = ("encoder_tip", "motor_tip", "nozzle")
_IDEAL = "ideal_nozzle"  # the nozzle of the same machine with an ideal geometry


def _measured(
    machine: Machine, log: Log, first: int, period: float, faults: tuple[InjectedFault, ...], special: Floats
) -> dict[str, Floats]:
    """Return the part of a record that was measured, from the log from a first tick on."""
    drives = np.array(
        [
            (gain, axis.motor_constant, axis.resistance, axis.bus_voltage, axis.peak_torque, *own)
            for gain, axis, own in zip(machine.drive_gain, machine.axes, special, strict=True)
        ]
    )
    ticks = len(log.axis)
    columns = np.empty((len(_OF_AXES), len(drives), ticks))
    for begin, after, own in stretches(faults, machine.axis_names, period, range(first, first + ticks), drives):
        part = slice(begin - first, after - first)
        _fill(columns[:, :, part], log.axis[part], own)
    of_axes = {name: column.T for name, column in zip(_OF_AXES, columns, strict=True)}
    tips = (machine.tip(of_axes["encoder"]), machine.tip(of_axes["motor"]), log.tick["nozzle"].copy())
    return {**of_axes, **dict(zip(_TIPS, tips, strict=True))}


@jit
def _fill(columns: Floats, log: NDArray[np.void], drives: Floats) -> None:
    """Fill in encoder, motor, demand, torque, current and voltage, (6, axes, n).

    Columns are several times as fast to work on as rows. The voltage is by the drive's law: terminal voltage for the
    demanded torque, back-EMF compensated, within the bus; with a current loop, for what it asks for, see
    `gantrysim.native.drives.follow_demands`. A stepper in open loop has the torque of its current, which is also its
    demand, and the voltage that it logs.

    Args:
        columns: to be filled in.
        log: of the axes, (n, axes) of `LOG_AXIS`.
        drives: gain, motor constant, resistance, bus voltage, peak torque, lead, and 1 for a stepper in open loop, of
            each axis, (axes, 7).
    """
    n, axes = log.shape
    for a in range(axes):
        gain, constant, resistance, bus, peak, lead, stepping = drives[a]
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
                demand, volts = torque, entry.demand
            for row, value in enumerate((entry.encoder, entry.motor, demand, torque, amperes, volts)):
                columns[row, a, k] = value


@jit
def _speeds(tip: Floats, period: float) -> Floats:
    """Return the mean speed over the period after each tick, 0 after the last, (n,) [mm/s].

    Args:
        tip: commanded nozzle, (n, 3) [mm].
        period: servo period [s].
    """
    speeds = np.zeros(len(tip))
    for k in range(len(tip) - 1):
        x, y, z = tip[k + 1, 0] - tip[k, 0], tip[k + 1, 1] - tip[k, 1], tip[k + 1, 2] - tip[k, 2]
        speeds[k] = np.sqrt(x * x + y * y + z * z) / period
    return speeds


def perfect_record(machine: Machine, setpoints: Setpoints, position: Floats, dispenser: Dispenser) -> Run:
    """Return the record of a machine without tracking error, and without torque; arguments as in `LogBook`."""
    content: dict[str, Any] = {}
    _send(machine, setpoints, position, np.arange(len(position)), dispenser, content)
    tip, none = content["commanded_tip"], np.zeros_like(position)
    content |= dict.fromkeys(("encoder", "motor"), position) | dict.fromkeys(_TIPS, tip)
    content |= dict.fromkeys(("demand", "torque", "current", "voltage"), none)
    if machine.geometry is not None:
        content["geometric_tip"] = tip
    return Run(**_constants(machine, setpoints, dispenser), **_protected(content))


def _protected(content: dict[str, Any]) -> dict[str, Any]:
    return {name: read_only(array) for name, array in content.items()}


def _send(
    machine: Machine,
    setpoints: Setpoints,
    position: Floats,
    sent: NDArray[np.integer],
    dispenser: Dispenser,
    content: dict[str, Any],
    faults: tuple[InjectedFault, ...] = (),
    table: FileTable | None = None,
) -> None:
    """Add the columns of a record that follow from the setpoints.

    Args:
        machine: as in `LogBook`.
        setpoints: likewise.
        position: likewise.
        sent: index of the setpoint at each tick, (n,).
        dispenser: as in `LogBook`.
        content: to which the columns are added, unless there is a table.
        faults: as in `LogBook`.
        table: to which they are written block by block.
    """
    n, period = sent.size, setpoints.period
    waited = sent[-1] != n - 1  # else one at a tick
    speed = np.zeros(n)
    for block in [slice(0, n)] if table is None else blocks(n):
        ahead = slice(block.start, block.stop + 1)
        commanded = position[sent[ahead]] if waited else position[: sent.size][ahead]
        tip, count = machine.tip(commanded), block.stop - block.start
        speed[block] = _speeds(tip, period)[:count]
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
    if table is None:
        content |= columns
    else:
        table.write(0, columns)


def _constants(machine: Machine, setpoints: Setpoints, dispenser: Dispenser) -> dict[str, Any]:
    """Return the part of a record that is no array."""
    return {
        "machine": machine.name,
        "axes": machine.axis_names,
        "units": tuple(axis.unit for axis in machine.axes),
        "requested": setpoints.requested,
        "period": setpoints.period,
        "gap": machine.gap,
        **_needle(machine, dispenser),
    }


def _needle(machine: Machine, dispenser: Dispenser) -> dict[str, float]:
    """Return the size of the dispenser's needle, or else of the machine's; empty where neither has one."""
    needle = dispenser.needle
    size = machine.needle if needle is None else (needle.face, needle.length)
    return {} if size is None else {"face": size[0], "needle_length": size[1]}
