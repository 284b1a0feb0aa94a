"""A log of torque and position of a machine's axes: from a table that another program has written, or from a run."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.errors import InputError, unknown
from gantrysim.base.files import replaced_file
from gantrysim.identify.checks.sampling import even_period
from gantrysim.machine.axis import Axis
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.tables.column_table import ColumnTable, Source
from gantrysim.tables.reading import read_table
from gantrysim.tables.units import TIME
from gantrysim.tables.units import TORQUE as TORQUE_UNIT

DEMAND = "demand"
TORQUE = "torque"
_QUANTITIES = ("position", DEMAND, TORQUE)
_SI = {"mm": "m", "deg": "rad"}  # of a position without a unit
_COUNTS = ("counts", "count", "edges")
_FEWEST = 100  # samples
_JUMP = 1.5  # between two stamps, from which samples are missing, of the usual step


@dataclass(frozen=True, eq=False)
class Log:
    """Torque and position of axes at even instants, in one piece or several.

    Rows are missing between two pieces: how long, and where the axes went meanwhile, is not known.

    Attributes:
        axes: their names.
        period: [s].
        position: of the motors, (n, axes) [mm or deg].
        torque: at the motor shafts, (n, axes) [N·m].
        held: whether `torque` is the demand, held from its sample to the next; else it is the motor's.
        notes: what of the log was left out.
        starts: the rows at which a piece begins, rising from 0.
    """

    axes: tuple[str, ...]
    period: float
    position: Floats
    torque: Floats
    held: bool
    notes: tuple[str, ...] = ()
    starts: tuple[int, ...] = (0,)

    @property
    def pieces(self) -> tuple[slice, ...]:
        """The rows of each piece, in their order."""
        ends = (*self.starts[1:], len(self.position))
        return tuple(slice(start, end) for start, end in zip(self.starts, ends, strict=True))

    @property
    def longest(self) -> Log:
        """The longest piece alone, with a note if there are others."""
        if len(self.starts) == 1:
            return self
        rows = max(self.pieces, key=lambda piece: piece.stop - piece.start)
        note = (
            f"log: of {len(self.position)} rows in {len(self.starts)} pieces, the {rows.stop - rows.start} of the "
            "longest are used"
        )
        return replace(
            self, position=self.position[rows], torque=self.torque[rows], notes=(*self.notes, note), starts=(0,)
        )

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
        with replaced_file(file) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(heads)
            writer.writerows([f"{value:.9g}" for value in row] for row in np.stack(columns, axis=1))


def read_log(file: str | Path, machine: Machine, columns: Mapping[str, str] | None = None) -> Log:
    """Read a log from any table that `read_table` reads: text of any dialect, Parquet, MATLAB, MCAP.

    A column is `time`, or the name of an axis with `position`, and with `demand` or `torque`: `x position [mm]`,
    `x_torque`. Without a unit in brackets it is in SI. A position may be in counts of the encoder. Axes without columns
    are left out; where an axis has both demand and torque, the demand is taken. A table of `gantrysim export` is a log.
    Where rows have gaps or are missing, the longest stretch without is the log, and a note says so.

    Args:
        file: of the log.
        machine: whose axes are logged.
        columns: sources by such names, as in {"x position": "MPOS AXIS(0) [mm]", "x torque": "I*0.0302 N·m"}.

    Raises:
        InputError: no such file, a missing column, an unknown unit, a number that is none, or uneven times.
    """
    try:
        return _logged_axes(read_table(file), machine, columns or {})
    except InputError as error:
        raise InputError(f"log {str(error).removeprefix('log ')}") from None


def _logged_axes(table: ColumnTable, machine: Machine, columns: Mapping[str, str]) -> Log:
    sources = _sources(table, machine, columns)
    listed = ", ".join(table.order)
    if "time" not in sources:
        raise InputError(f"{table.label}: has no column time; it has: {listed}")
    axes = [axis for axis in machine.axes if f"{axis.name} position" in sources]
    logged = [axis for axis in axes if f"{axis.name} {DEMAND}" in sources or f"{axis.name} {TORQUE}" in sources]
    if not logged:
        first = machine.axis_names[0]
        raise InputError(
            f"{table.label}: has no axis with position and torque; it must have columns such as {first} position [mm] "
            f"and {first} torque [N·m], and has: {listed}"
        )
    # a demand is known between its samples too
    held = all(f"{axis.name} {DEMAND}" in sources for axis in logged)
    kind = DEMAND if held else TORQUE
    if missing := [axis.name for axis in logged if f"{axis.name} {kind}" not in sources]:
        raise InputError(
            f"{table.label}: has the torque of some axes and the demand of others: {missing[0]} has no {kind}"
        )
    time = table.values(sources["time"], TIME)
    position = np.stack([_position(table, sources[f"{axis.name} position"], axis) for axis in logged], axis=1)
    torque = np.stack([table.values(sources[f"{axis.name} {kind}"], TORQUE_UNIT) for axis in logged], axis=1)
    stretch = _longest_stretch(time, [position, torque])
    samples = stretch.stop - stretch.start
    if samples < _FEWEST:
        without = " without a gap" if samples < time.size else ""
        raise InputError(f"{table.label}: has {samples} samples{without}, must have at least {_FEWEST}")
    notes = []
    if samples < time.size:
        notes.append(
            f"log: of {time.size} rows, {samples} are used, the longest stretch without a gap, from "
            f"{time[stretch.start]:g} s to {time[stretch.stop - 1]:g} s"
        )
    try:
        # from all stamps: a single difference may be rounded
        period = even_period(time[stretch])
    except InputError as error:
        raise InputError(f"{table.label}: {error}") from None
    names = tuple(axis.name for axis in logged)
    return Log(names, period, position[stretch], torque[stretch], held, tuple(notes))


def _sources(table: ColumnTable, machine: Machine, columns: Mapping[str, str]) -> dict[str, Source]:
    """Return where the quantities stand: as given, else by the names of the columns."""
    known = ["time", *(f"{axis} {quantity}" for axis in machine.axis_names for quantity in _QUANTITIES)]
    exported = _exported_columns(machine)
    sources: dict[str, Source] = {}
    for name, text in columns.items():
        if name not in known:
            raise InputError(f"{table.label}: {unknown('column', name, known)}")
        sources[name] = Source.parse(name, text)
    for column in table.order:
        name = exported.get(column) or " ".join(re.split(r"[\s_.]+", column.strip()))
        unit = table.units.get(column, "")
        if unit:
            name = name.removesuffix(f" {unit}")
        if name in known and name not in sources:
            sources[name] = Source(column)
    return sources


def _exported_columns(machine: Machine) -> dict[str, str]:
    """Return the names of the columns of a table of `gantrysim export`, by their heads."""
    columns = {"time_s": "time"}
    for axis in machine.plain_axes:
        columns[f"encoder_{axis.name}_{axis.unit}"] = f"{axis.name} position"
        columns[f"demand_{axis.name}_Nm"] = f"{axis.name} {DEMAND}"
        columns[f"torque_{axis.name}_Nm"] = f"{axis.name} {TORQUE}"
    return columns


def _position(table: ColumnTable, source: Source, axis: Axis) -> Floats:
    """Return the positions of an axis [mm or deg]."""
    unit = source.unit or table.unit_of(source.column)
    if unit in _COUNTS and not axis.resolution:
        raise InputError(f"{table.label}: column {source.column} is in counts, but {axis.name} has no encoder")
    counts = dict.fromkeys(_COUNTS, axis.resolution) if axis.resolution else {}
    return table.values(source._replace(unit=unit or _SI[axis.unit]), axis.unit, counts)


def _longest_stretch(time: Floats, columns: Iterable[Floats]) -> slice:
    """Return the longest stretch of rows that have all values, and whose stamps follow without a jump."""
    whole = np.isfinite(time)
    for column in columns:
        whole &= np.isfinite(column).all(axis=1)
    best = slice(0, 0)
    for first, after in spans(whole):
        for begin, end in _between_jumps(time, int(first), int(after)):
            if end - begin > best.stop - best.start:
                best = slice(begin, end)
    return best


def _between_jumps(time: Floats, first: int, after: int) -> NDArray[np.int64]:
    """Return the bounds of the stretches of stamps between jumps ahead, (k, 2)."""
    steps = np.diff(time[first:after])
    jumps = np.flatnonzero(steps > _JUMP * np.median(steps)) if steps.size else np.zeros(0, np.int64)
    bounds = np.concatenate([[first], first + 1 + jumps, [after]])
    return np.column_stack([bounds[:-1], bounds[1:]])
