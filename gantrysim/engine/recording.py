"""The record of a simulation, from the log of its servo."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import Floats, read_only, read_only_view
from gantrysim.base.columns import FileTable, array_of, blocks
from gantrysim.base.jit import jit
from gantrysim.base.memory import check_ticks
from gantrysim.engine.drives.part import STEPPER
from gantrysim.engine.injection import faulted_flow, stretches
from gantrysim.faults import InjectedFault
from gantrysim.glue.dispenser.command import Material
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.driven import Load
from gantrysim.machine.machine import Machine
from gantrysim.machine.row import Log
from gantrysim.record.run import Run
from gantrysim.record.run_file import Fault
from gantrysim.record.setpoints import MATERIAL, Setpoints

# The columns of a record: from a log, from the setpoints, and the part that is no array.


def columns_of(
    axes: int, *, waiting: bool, geometry: bool, optional: tuple[str, ...]
) -> dict[str, tuple[np.dtype[Any], tuple[int, ...]]]:
    """Return the columns of a record in a file."""
    number = np.dtype(np.float64)
    names = {"": ("time", "flow", "flow_demand"), "axes": ("commanded", *OF_AXES), "tip": (*TIPS, "commanded_tip")}
    tails = {"": (), "axes": (axes,), "tip": (3,)}
    columns = {name: (number, tails[kind]) for kind, group in names.items() for name in group}
    columns |= {name: (number, (3,)) for name in ("geometric_tip", IDEAL) if geometry}
    columns |= dict.fromkeys(optional, (number, ()))
    whole = {"setpoint": (np.dtype(np.int64), ())} if waiting else {}
    return {**columns, "dispense": (np.dtype(np.bool_), ()), **whole}


OF_AXES = ("encoder", "motor", "demand", "torque", "current", "voltage")
TIPS = ("encoder_tip", "motor_tip", "nozzle")
_OPTIONAL = ("progress", *MATERIAL)  # columns of setpoints that may be missing
IDEAL = "ideal_nozzle"  # the nozzle of the same machine with an ideal geometry


def measured_columns(
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
    `gantrysim.engine.drives.current_loop.follow_demand`. A stepper in open loop has the torque of its current, which is
    also its demand, and the voltage that it logs.

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


def protected_columns(content: dict[str, Any]) -> dict[str, Any]:
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
        _fill_speeds(speed[block], read_only_view(tip), period)
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
    optional = {}
    for name in _OPTIONAL:
        column = getattr(setpoints, name)
        if column is not None:
            optional[name] = column[sent] if waited else column[:n]
    material = Material(**{name: optional[name] for name in MATERIAL if name in optional})
    flow = dispenser.flows(dispense, speed, period, material)
    if faults:
        flow = faulted_flow(faults, flow, dispenser.open_share(dispense, period), period)
    columns = {
        "flow": flow,
        "flow_demand": dispenser.flow_demand(dispense, speed, period, material),
        "dispense": dispense,
        **optional,
    }
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
    commands = _commands(run)
    return run.replaced(flow=dispenser.flows(*commands), flow_demand=dispenser.flow_demand(*commands))


def dispenser_notes(run: Run, dispenser: Dispenser) -> tuple[str, ...]:
    """Return the dispenser's notes on the commands of a run."""
    return dispenser.notes(*_commands(run))


def dispenser_loads(run: Run, dispenser: Dispenser) -> tuple[Load, ...]:
    """Return what the commands of a run ask of the dispenser's motor."""
    return dispenser.loads(*_commands(run))


def _commands(run: Run) -> tuple[NDArray[np.bool_], Floats, float, Material]:
    """Return what a dispenser follows in a run."""
    speed = np.empty(len(run.time))
    _fill_speeds(speed, read_only_view(run.commanded_tip), run.period)
    return run.dispense, speed, run.period, Material(run.extrusion, run.extruder, run.analogue)


class LogBook:
    """The log of a run: all of it in memory, or where the run is long its last ticks, with the record in a file.

    Args:
        machine: the machine of the run.
        setpoints: its setpoints.
        position: the same for all the machine's axes, (setpoints, axes) [mm or deg].
        dispenser: its dispenser.
        faults: deliberate faults.
        drives: that are no plain ones, (axes,) of `DRIVE`.

    Attributes:
        log: the entries in memory.
        first: tick of the first of them.
        whole: whether there is room in memory for all ticks that the run may have.
    """

    def __init__(
        self,
        machine: Machine,
        setpoints: Setpoints,
        position: Floats,
        dispenser: Dispenser,
        faults: tuple[InjectedFault, ...] = (),
        drives: NDArray[np.void] | None = None,
    ) -> None:
        # whether the servo has each axis' position from its load
        self._scales: ArrayLike = False if drives is None else drives["encoder"]["load"] >= 0
        self._machine = machine
        self._setpoints = setpoints
        self._position = position
        self._dispenser = dispenser
        axes = position.shape[1]
        self._faults = faults
        self._drives = np.zeros((axes, 2))
        if drives is not None:
            self._drives = np.stack([drives["current"]["lead"], drives["mode"] == STEPPER], axis=1)
        count, axes = position.shape
        self._table: FileTable | None = None
        self.first = 0
        self._most = setpoints.most_ticks
        if count > memory.LONG_RUN:
            columns = columns_of(
                axes,
                waiting=setpoints.gates.size > 0,
                geometry=machine.geometry is not None,
                optional=tuple(name for name in _OPTIONAL if getattr(setpoints, name) is not None),
            )
            self._table = FileTable(self._most, columns)
            self.log = Log.of(0, axes)
        else:
            self.log = Log.of(min(self._most, 2 * count), axes)
        self.whole = self._table is None and self._most <= 2 * count

    def begin(self, row: np.void) -> None:
        """Begin at the first tick of a run; write the log's addresses into its servo's row."""
        if self._table is not None:
            self.first = 0
            self.log = self.log.until(0)
        self._address(row)

    def _address(self, row: np.void) -> None:
        row["log"] = self.log.tick.ctypes.data
        row["axis_log"] = self.log.axis.ctypes.data
        row["first"] = self.first

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
            present = log.since(max(len(log.tick) - self._setpoints.supervision.position_error_delay, 0))
            self.first = begun - len(present.tick)
            room = len(present.tick) + ticks
        else:
            present = self.log.until(begun)
            room = min(max(begun + ticks, 2 * len(self.log.tick)), self._most)
            check_ticks(
                room, f"the run waits at its {self._setpoints.gates.size} gates and", "allow for a larger error"
            )
        self.log = Log.of(room, self.log.axis.shape[1])
        self.log.tick[: len(present.tick)] = present.tick
        self.log.axis[: len(present.tick)] = present.axis
        self._address(row)

    def _write(self, begun: int) -> None:
        """Write the ticks before one to the file."""
        assert self._table is not None
        log = self.log.until(begun - self.first)
        for block in blocks(len(log.tick)):
            part = Log(log.tick[block], log.axis[block])
            columns = self._measured_columns(part, self.first + block.start)
            if self._machine.geometry is not None:
                columns[IDEAL] = columns.pop("nozzle")
            self._table.write(self.first + block.start, columns)
            if self._setpoints.gates.size:
                self._table.write(self.first + block.start, {"setpoint": part.tick["setpoint"]})

    def finite(self, tick: int) -> bool:
        """Whether the positions logged at a tick are."""
        entry = tick - self.first
        nozzle = self.log.tick["nozzle"][entry]
        encoder = self.log.axis["encoder"][entry]
        return bool(np.isfinite(nozzle).all() and np.isfinite(encoder).all())

    def record(self, ticks: int, fault: Fault | None, every: int = 1) -> Run:
        """Return the record of the first ticks.

        Args:
            ticks: number of them, at least one.
            fault: why the run ended early, or None.
            every: number of ticks of the servo for each of the record.
        """
        if every > 1 and self._remembers:
            return thinned_run(self.record(ticks, fault), every)
        machine = self._machine
        setpoints = self._setpoints
        table = self._table
        program = SentProgram(machine, setpoints, self._position, self._dispenser, self._faults)
        unchanging = constants(machine, setpoints, self._dispenser)
        content: dict[str, Any] = {}
        if table is None:
            log = self.log.until(ticks)
            if every > 1:
                log = Log(log.tick[::every].copy(), log.axis[::every].copy())
            sent_columns(program, log.tick["setpoint"], content)
            content |= self._measured_columns(log, 0)
            self._displace(content, None)
            if every > 1:
                content["time"] = np.arange(0, ticks, every) * setpoints.period
                unchanging["period"] *= every
            return Run(**unchanging, **protected_columns(content), fault=fault, injected=self._faults)
        self._write(ticks)
        sent = table.first_rows(ticks)["setpoint"].array() if setpoints.gates.size else np.arange(ticks)
        sent_columns(program, sent, content, table)
        self._displace(cast(dict[str, Any], table.first_rows(ticks)), table)
        stored = table.first_rows(ticks)
        for name in ("setpoint", IDEAL):
            stored.pop(name, None)
        return Run(**unchanging, **cast(dict[str, Any], stored), fault=fault, injected=self._faults)

    @property
    def _remembers(self) -> bool:
        """Whether a row of the record follows from rows before it: glue, play, faults, and all that is in a file."""
        acts = self._dispenser.flows_at_all or self._machine.geometry is not None or self._faults
        return self._table is not None or bool(acts)

    def _displace(self, content: dict[str, Any], table: FileTable | None) -> None:
        """Displace the nozzle by the errors of the machine's geometry, if any; in the table where there is one."""
        errors = self._machine.kinematic_errors
        if errors is None:
            return
        motor = array_of(content["motor"])
        rigid = array_of(content["motor_tip"])
        ideal = array_of(content["nozzle" if table is None else IDEAL])
        every = list(blocks(len(motor)))
        parts = []
        for block, tip in zip(every, errors.tips((motor[block] for block in every), self._scales), strict=True):
            columns = {"geometric_tip": tip, "nozzle": ideal[block] + (tip - rigid[block])}
            if table is None:
                parts.append(columns)
            else:
                table.write(block.start, columns)
        if parts:
            content |= {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _measured_columns(self, log: Log, first: int) -> dict[str, Floats]:
        return measured_columns(self._machine, log, first, self._setpoints.period, self._faults, self._drives)


def thinned_run(run: Run, every: int) -> Run:
    """Return one of so many ticks of a record."""
    arrays = {field.name: getattr(run, field.name) for field in fields(run)}
    columns: dict[str, Any] = {name: value[::every] for name, value in arrays.items() if isinstance(value, np.ndarray)}
    return replace(run, **columns, period=run.period * every)


def perfect_record(machine: Machine, setpoints: Setpoints, position: Floats, dispenser: Dispenser) -> Run:
    """Return the record of a machine without following error, and without torque; arguments as in `LogBook`."""
    count, axes = position.shape
    program = SentProgram(machine, setpoints, position, dispenser)
    content: dict[str, Any] = {}
    if count > memory.LONG_RUN:
        optional = tuple(name for name in _OPTIONAL if getattr(setpoints, name) is not None)
        columns = columns_of(axes, waiting=False, geometry=False, optional=optional)
        sent = ("time", "commanded", "commanded_tip", "flow", "flow_demand", "dispense", *optional)
        table = FileTable(count, {name: columns[name] for name in sent})
        sent_columns(program, np.arange(count), content, table)
        content |= table.first_rows(count)
    else:
        sent_columns(program, np.arange(count), content)
        content = protected_columns(content)
    tip = content["commanded_tip"]
    none = read_only(np.zeros_like(position))
    content |= dict.fromkeys(("encoder", "motor"), content["commanded"]) | dict.fromkeys(TIPS, tip)
    content |= dict.fromkeys(("demand", "torque", "current", "voltage"), none)
    if machine.geometry is not None:
        content["geometric_tip"] = tip
    return Run(**constants(machine, setpoints, dispenser), **content)
