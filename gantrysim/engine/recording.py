"""The record of a simulation, from the log of its servo."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base import memory
from gantrysim.base.arrays import Floats
from gantrysim.base.columns import FileTable, array_of, blocks
from gantrysim.base.memory import check_ticks
from gantrysim.engine.record_columns import (
    IDEAL,
    TIPS,
    SentProgram,
    columns_of,
    constants,
    measured,
    protected,
    sent_columns,
)
from gantrysim.faults import InjectedFault
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.machine.machine import Machine
from gantrysim.machine.row import STEPPER, Log
from gantrysim.record.fault import Fault
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints


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
        self._scales: ArrayLike = False if drives is None else drives["load"] >= 0
        self._machine = machine
        self._setpoints = setpoints
        self._position = position
        self._dispenser = dispenser
        axes = position.shape[1]
        self._faults = faults
        self._drives = np.zeros((axes, 2))
        if drives is not None:
            self._drives = np.stack([drives["lead"], drives["mode"] == STEPPER], axis=1)
        count, axes = position.shape
        self._table: FileTable | None = None
        self.first = 0
        self._most = setpoints.most_ticks
        if count > memory.LONG:
            columns = columns_of(
                axes,
                waiting=setpoints.gates.size > 0,
                geometry=machine.geometry is not None,
                progress=setpoints.progress is not None,
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
            columns = self._measured(part, self.first + block.start)
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
            return thinned(self.record(ticks, fault), every)
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
            content |= self._measured(log, 0)
            self._displace(content, None)
            if every > 1:
                content["time"] = np.arange(0, ticks, every) * setpoints.period
                unchanging["period"] *= every
            return Run(**unchanging, **protected(content), fault=fault, injected=self._faults)
        self._write(ticks)
        sent = table.stored(ticks)["setpoint"].array() if setpoints.gates.size else np.arange(ticks)
        sent_columns(program, sent, content, table)
        self._displace(cast(dict[str, Any], table.stored(ticks)), table)
        stored = table.stored(ticks)
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

    def _measured(self, log: Log, first: int) -> dict[str, Floats]:
        return measured(self._machine, log, first, self._setpoints.period, self._faults, self._drives)


def thinned(run: Run, every: int) -> Run:
    """Return one of so many ticks of a record."""
    arrays = {field.name: getattr(run, field.name) for field in fields(run)}
    columns: dict[str, Any] = {name: value[::every] for name, value in arrays.items() if isinstance(value, np.ndarray)}
    return replace(run, **columns, period=run.period * every)


def perfect_record(machine: Machine, setpoints: Setpoints, position: Floats, dispenser: Dispenser) -> Run:
    """Return the record of a machine without following error, and without torque; arguments as in `LogBook`."""
    content: dict[str, Any] = {}
    program = SentProgram(machine, setpoints, position, dispenser)
    sent_columns(program, np.arange(len(position)), content)
    tip = content["commanded_tip"]
    none = np.zeros_like(position)
    content |= dict.fromkeys(("encoder", "motor"), position) | dict.fromkeys(TIPS, tip)
    content |= dict.fromkeys(("demand", "torque", "current", "voltage"), none)
    if machine.geometry is not None:
        content["geometric_tip"] = tip
    return Run(**constants(machine, setpoints, dispenser), **protected(content))
