"""A log of torque and position of a machine's axes: from a file of comma-separated values, or from a run."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, expanded, unknown
from gantrysim.base.files import replaced
from gantrysim.base.heads import name_and_unit
from gantrysim.base.input_files import opened
from gantrysim.identify.checks.times import even_period
from gantrysim.machine.axis import Axis
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run

DEMAND = "demand"
TORQUE = "torque"
_QUANTITIES = ("position", DEMAND, TORQUE)
# factors to s, to mm of a slide, to deg of a hinge, to N·m at the motor shaft
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}
_LENGTHS = {"m": 1e3, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "in": 25.4}
_ANGLES = {"rad": 180 / math.pi, "deg": 1.0, "°": 1.0}
_TORQUES = {"N·m": 1.0, "Nm": 1.0, "N*m": 1.0, "mN·m": 1e-3, "mNm": 1e-3}
_SI = {"time": "s", "mm": "m", "deg": "rad", "torque": "N·m"}  # of a column without a unit
_COUNTS = ("counts", "count", "edges")
_FEWEST = 100


@dataclass(frozen=True, eq=False)
class Log:
    """Torque and position of axes at even instants.

    Attributes:
        axes: their names.
        period: [s].
        position: of the motors, (n, axes) [mm or deg].
        torque: at the motor shafts, (n, axes) [N·m].
        held: whether `torque` is the demand, held from its sample to the next; else it is the motor's.
    """

    axes: tuple[str, ...]
    period: float
    position: Floats
    torque: Floats
    held: bool

    @classmethod
    def of(cls, run: Run) -> Log:
        """Return the log of a run: encoder positions and torque demands."""
        return cls(run.axes, run.period, np.array(run.encoder), np.array(run.demand), held=True)

    def save(self, file: str | Path, units: Mapping[str, str]) -> None:
        """Write the log as comma-separated values that `read_log` reads.

        Args:
            file: to write or replace.
            units: "mm" or "deg" by axis.

        Raises:
            InputError: the file cannot be written.
        """
        kind = DEMAND if self.held else TORQUE
        heads = ["time [s]"]
        columns = [self.period * np.arange(len(self.position))]
        for k, name in enumerate(self.axes):
            heads += [f"{name} {kind} [N·m]", f"{name} position [{units[name]}]"]
            columns += [self.torque[:, k], self.position[:, k]]
        with replaced(file) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(heads)
            writer.writerows([f"{value:.9g}" for value in row] for row in np.stack(columns, axis=1))


def read_log(file: str | Path, machine: Machine, columns: Mapping[str, str] | None = None) -> Log:
    """Read a log from comma-separated values whose first line names the columns.

    A column is `time`, or the name of an axis with `position`, and with `demand` or `torque`: `x position [mm]`,
    `x_torque`. Without a unit in brackets it is in SI. A position may be in counts of the encoder. Axes without columns
    are left out; where an axis has both demand and torque, the demand is taken. A table of `gantrysim export` is a log.

    Args:
        file: of the log.
        machine: whose axes are logged.
        columns: heads of the file by such names, as in {"x position": "MPOS AXIS(0) [mm]"}.

    Raises:
        InputError: no such file, a missing column, an unknown unit, a number that is none, or uneven times.
    """
    path = expanded(file)
    try:
        with opened(path) as content, TextIOWrapper(content, encoding="utf-8-sig", newline="") as stream:
            rows = [row for row in csv.reader(stream) if any(cell.strip() for cell in row) and not _remark(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"log {file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        return _parsed(rows, machine, columns or {})
    except InputError as error:
        raise InputError(f"log {file}: {error}") from None


def _parsed(rows: Sequence[Sequence[str]], machine: Machine, columns: Mapping[str, str]) -> Log:
    if len(rows) < _FEWEST + 1:
        raise InputError(f"has {max(len(rows) - 1, 0)} samples, must have at least {_FEWEST}")
    heads = _heads(rows[0], machine, columns)
    if "time" not in heads:
        raise InputError(f"has no column time; it has: {', '.join(rows[0])}")
    time = _column(rows, *heads["time"]) * _factor(heads["time"][1], "time", _TIMES, "time")
    period = even_period(time)  # from all stamps: a single difference may be rounded
    axes = [axis for axis in machine.axes if f"{axis.name} position" in heads]
    logged = [axis for axis in axes if f"{axis.name} {DEMAND}" in heads or f"{axis.name} {TORQUE}" in heads]
    if not logged:
        first = machine.axis_names[0]
        raise InputError(
            f"has no axis with position and torque; it must have columns such as {first} position [mm] and "
            f"{first} torque [N·m], and has: {', '.join(rows[0])}"
        )
    held = all(f"{axis.name} {DEMAND}" in heads for axis in logged)  # a demand is known between its samples too
    kind = DEMAND if held else TORQUE
    if missing := [axis.name for axis in logged if f"{axis.name} {kind}" not in heads]:
        raise InputError(f"has the torque of some axes and the demand of others: {missing[0]} has no {kind}")
    position = [_column(rows, *heads[f"{axis.name} position"]) * _travel(heads, axis) for axis in logged]
    torque = [
        _column(rows, *heads[f"{axis.name} {kind}"])
        * _factor(heads[f"{axis.name} {kind}"][1], f"{axis.name} {kind}", _TORQUES, "torque")
        for axis in logged
    ]
    names = tuple(axis.name for axis in logged)
    return Log(names, period, np.stack(position, axis=1), np.stack(torque, axis=1), held)


def _heads(row: Sequence[str], machine: Machine, columns: Mapping[str, str]) -> dict[str, tuple[int, str]]:
    """Return number and unit of the columns by their names."""
    known = ["time", *(f"{axis} {quantity}" for axis in machine.axis_names for quantity in _QUANTITIES)]
    stripped = [cell.strip() for cell in row]
    exported = _exported(machine)
    heads: dict[str, tuple[int, str]] = {}
    for name, head in columns.items():
        if name not in known:
            raise unknown("column", name, known)
        text, unit = name_and_unit(head)
        fitting = [k for k, cell in enumerate(stripped) if cell in (head.strip(), text)]
        if not fitting:
            raise InputError(f"has no column {head!r} for {name}; it has: {', '.join(stripped)}")
        heads[name] = fitting[0], unit or name_and_unit(stripped[fitting[0]])[1]
    for k, cell in enumerate(stripped):
        text, unit = exported.get(cell) or name_and_unit(cell)
        name = " ".join(re.split(r"[\s_.]+", text.strip()))
        if name in known and name not in heads:
            heads[name] = k, unit
    return heads


def _remark(row: Sequence[str]) -> bool:
    """Return whether a row is one of the remarks that head a table of `gantrysim export`."""
    return row[0].lstrip().startswith("#")


def _exported(machine: Machine) -> dict[str, tuple[str, str]]:
    """Return name and unit of the columns of a table of `gantrysim export`, by their heads."""
    columns = {"time_s": ("time", "s")}
    for axis in machine.plain_axes:
        columns[f"encoder_{axis.name}_{axis.unit}"] = f"{axis.name} position", axis.unit
        columns[f"demand_{axis.name}_Nm"] = f"{axis.name} {DEMAND}", "Nm"
        columns[f"torque_{axis.name}_Nm"] = f"{axis.name} {TORQUE}", "Nm"
    return columns


def _column(rows: Sequence[Sequence[str]], number: int, unit: str) -> Floats:
    values = np.empty(len(rows) - 1)
    for k, row in enumerate(rows[1:]):
        try:
            values[k] = float(row[number])
        except (ValueError, IndexError):
            cell = row[number] if number < len(row) else ""
            raise InputError(f"row {k + 2}, column {rows[0][number].strip()!r}: {cell!r} is no number") from None
    if not np.isfinite(values).all():
        bad = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InputError(f"row {bad + 2}, column {rows[0][number].strip()!r}: must be finite")
    return values


def _factor(unit: str, name: str, known: Mapping[str, float], kind: str) -> float:
    unit = unit or _SI[kind]
    if unit not in known:
        raise InputError(f"column {name}: unknown unit {unit!r}; known: {', '.join(known)}")
    return known[unit]


def _travel(heads: Mapping[str, tuple[int, str]], axis: Axis) -> float:
    """Return the factor of a column of positions to mm or deg."""
    name = f"{axis.name} position"
    unit = heads[name][1]
    if unit in _COUNTS:
        if not axis.resolution:
            raise InputError(f"column {name}: in counts, but the machine's {axis.name} has no encoder")
        return axis.resolution
    return _factor(unit, name, _LENGTHS if axis.unit == "mm" else _ANGLES, axis.unit)
