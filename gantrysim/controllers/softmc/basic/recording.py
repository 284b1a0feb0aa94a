"""RECORD: samples of a run, taken by the controller at a multiple of the servo period.

`Record` is that of a program of values; the other classes are the RECORD of a program in MC-Basic: which of its columns
are sampled, and from when to when.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, unknown, whole_number
from gantrysim.base.files import replaced_file
from gantrysim.controllers.softmc.basic.timeline import Mark
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints

EXPRESSIONS = ("PCMD", "PFB", "PE", "VCMD", "VFB", "SETPOINT")


@dataclass(frozen=True)
class Record:
    """Samples expressions every `gap` servo ticks, from the first tick on.

    The expressions, one column per axis: PCMD, the commanded position; PFB, the measured position; PE, their
    difference; VCMD and VFB, the change of PCMD and PFB per period; and SETPOINT, the commanded nozzle position in
    x, y and z.

    Args:
        points: maximum number of samples.
        gap: number of servo ticks per sample.
        what: expressions to record, in the order of the columns.
    """

    points: int
    gap: int = 1
    what: tuple[str, ...] = EXPRESSIONS

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", whole_number("points", self.points, 1))
        object.__setattr__(self, "gap", whole_number("gap", self.gap, 1))
        what = (self.what,) if isinstance(self.what, str) else tuple(self.what)
        for name in what:
            if str(name).upper() not in EXPRESSIONS:
                raise unknown("expression", str(name), EXPRESSIONS)
        object.__setattr__(self, "what", tuple(name.upper() for name in what))

    def of(self, run: Run, delay: int = 0) -> dict[str, Floats]:
        """Return the columns: "time" [s], and one per expression and axis, as "PCMD x".

        Args:
            run: to sample.
            delay: age of the command in PE, in servo periods: the group's `position_error_delay`.
        """
        columns = {"time": run.time[: self.points * self.gap : self.gap]}
        for name in self.what:
            values = evaluated_expression(name, run, whole_number("delay", delay, 0))[
                : self.points * self.gap : self.gap
            ]
            for a, axis in enumerate("xyz" if name == "SETPOINT" else run.axes):
                columns[f"{name} {axis}"] = values[:, a]
        return columns

    def write(self, run: Run, file: str | os.PathLike[str], delay: int = 0) -> None:
        """Write the columns as CSV, with units in the header."""
        columns = self.of(run, delay)
        units = {"time": "s", **{f"SETPOINT {axis}": "mm" for axis in "xyz"}}
        for axis, unit in zip(run.axes, run.units, strict=True):
            units |= {f"{name} {axis}": unit for name in ("PCMD", "PFB", "PE")}
            units |= {f"{name} {axis}": f"{unit}/s" for name in ("VCMD", "VFB")}
        with replaced_file(file) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow([f"{name} [{units[name]}]" for name in columns])
            writer.writerows(np.column_stack(list(columns.values())).tolist())


def evaluated_expression(name: str, run: Run, delay: int) -> Floats:
    """Return an expression at every tick of a run, (n, axes); PE with the command of `delay` ticks before."""
    if name == "SETPOINT":
        return run.commanded_tip
    if name == "PE":
        sent = np.maximum(np.arange(len(run.commanded)) - delay, 0)
        return run.commanded[sent] - run.encoder
    values = run.commanded if name in ("PCMD", "VCMD") else run.encoder
    if name in ("PCMD", "PFB"):
        return values
    return np.diff(values, axis=0, prepend=values[:1]) / run.period


@dataclass(frozen=True)
class Column:
    """An expression of RecData.

    Attributes:
        name: as the program writes it.
        what: "clock", or one of PCMD, PFB, PE, VCMD, VFB and SETPOINT, in lower case.
        index: of the coordinate, from 0.
    """

    name: str
    what: str
    index: int = 0


@dataclass
class Recording:
    """A RECORD of the program.

    Attributes:
        file: as the program names it.
        points: maximum number of samples.
        gap: servo ticks per sample.
        columns: what is sampled.
        spans: instants of RECORDON and RECORDOFF, or RECORDCLOSE; None where the program ended before.
        closed: whether RECORDCLOSE was run.
    """

    file: str
    points: int
    gap: int
    columns: tuple[Column, ...]
    spans: list[tuple[Mark, Mark | None]] = field(default_factory=list)
    closed: bool = False

    @property
    def running(self) -> bool:
        """Whether samples are taken."""
        return bool(self.spans) and self.spans[-1][1] is None

    def stop(self, mark: Mark) -> None:
        """Take no more samples from an instant on."""
        if self.running:
            self.spans[-1] = (self.spans[-1][0], mark)

    def write(
        self,
        run: Run,
        file: str | os.PathLike[str],
        coordinates: Sequence[str],
        setpoints: Setpoints,
        ends: NDArray[np.int64],
        delay: int,
    ) -> None:
        """Write the samples as CSV, one row each, with units in the header.

        Args:
            run: to sample.
            file: to write.
            coordinates: names of the group's axes.
            setpoints: those of the run.
            ends: setpoints at the ends of the program's steps.
            delay: age of the command in PE, in servo periods.
        """
        rows = rows_of(run, setpoints)
        taken: list[NDArray[np.int64]] = []
        for begin, end in self.spans:
            first = _row(rows, begin.tick(ends, run.period))
            last = len(run.time) - 1 if end is None else _row(rows, end.tick(ends, run.period))
            taken.append(np.arange(first, min(last, len(run.time) - 1) + 1, self.gap))
        samples = np.concatenate([*taken, np.zeros(0, np.int64)])[: self.points]
        values = [_column(column, run, coordinates, delay) for column in self.columns]
        with replaced_file(file) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow([f"{column.name} [{unit}]" for column, (unit, _) in zip(self.columns, values, strict=True)])
            writer.writerows(np.column_stack([of[samples] for _, of in values]).tolist())


def rows_of(run: Run, setpoints: Setpoints) -> NDArray[np.int64]:
    """Return the row of a run at which each setpoint is reached, (n,).

    At a gate the run has further rows, during which the command rests: the k-th change of the command in the run is
    the k-th change in the setpoints, and what the rests between two changes have in excess lies at the gate.
    """
    rows = np.arange(len(setpoints.position), dtype=np.int64)
    if not len(setpoints.gates):
        return rows
    changes = _changes(setpoints.position)
    seen = _changes(run.commanded)
    shift = 0
    extra = np.zeros(len(rows), np.int64)
    for gate in setpoints.gates.tolist():
        following = int(np.searchsorted(changes, gate, side="right"))
        if following < len(changes):
            if following >= len(seen):
                break
            waited = int(seen[following] - changes[following]) - shift
        else:
            waited = len(run.time) - len(rows) - shift
        shift += max(waited, 0)
        extra[gate + 1 :] = shift
    return rows + extra


def _changes(position: Floats) -> NDArray[np.int64]:
    return np.flatnonzero(np.any(np.diff(position, axis=0) != 0, axis=1)) + 1


def _row(rows: NDArray[np.int64], tick: int) -> int:
    return int(rows[min(tick, len(rows) - 1)])


def _column(column: Column, run: Run, coordinates: Sequence[str], delay: int) -> tuple[str, Floats]:
    if column.what == "clock":
        return "ms", np.round(1e3 * run.time, 9)
    if column.what == "setpoint" and column.index < 3:
        return "mm", run.commanded_tip[:, column.index]
    name = coordinates[column.index] if column.index < len(coordinates) else ""
    axis = run.axes.index(name) if name in run.axes else column.index
    if axis >= len(run.axes):
        raise InputError(f"{column.name}: must be a coordinate of the axes {', '.join(run.axes)}")
    what = "PCMD" if column.what == "setpoint" else column.what.upper()
    unit = run.units[axis] + ("/s" if what in ("VCMD", "VFB") else "")
    return unit, evaluated_expression(what, run, delay)[:, axis]
