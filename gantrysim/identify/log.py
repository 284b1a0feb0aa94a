"""A log of torque and position of a machine's axes: from a table that another program has written, or from a run."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive, unknown
from gantrysim.base.files import replaced_file
from gantrysim.identify.instants import instants_of
from gantrysim.identify.sizes import times_words
from gantrysim.machine.axis import Axis
from gantrysim.machine.machine import Machine
from gantrysim.record.run import Run
from gantrysim.tables.column_table import SAMPLES, ColumnTable, Source
from gantrysim.tables.reading import read_table
from gantrysim.tables.units import ANGLE, COUNTS, KINDS, LENGTH, SI, SPEED, TIME, TURNING, spaced_name
from gantrysim.tables.units import TORQUE as TORQUE_UNIT

DEMAND = "demand"
TORQUE = "torque"
POSITION = "position"
VELOCITY = "velocity"
_QUANTITIES = (POSITION, VELOCITY, DEMAND, TORQUE)
_SPEEDS = {"mm": SPEED, "deg": TURNING}


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
        begins: instants of these rows [s]; by default a row is missing between two pieces.
    """

    axes: tuple[str, ...]
    period: float
    position: Floats
    torque: Floats
    held: bool
    notes: tuple[str, ...] = ()
    starts: tuple[int, ...] = (0,)
    begins: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not self.begins:
            begins = tuple((start + k) * self.period for k, start in enumerate(self.starts))
            object.__setattr__(self, "begins", begins)

    @property
    def time(self) -> Floats:
        """Instants of the rows, (n,) [s]."""
        parts = [
            begin + self.period * np.arange(piece.stop - piece.start)
            for begin, piece in zip(self.begins, self.pieces, strict=True)
        ]
        return np.concatenate(parts)

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
        sizes = [piece.stop - piece.start for piece in self.pieces]
        longest = sizes.index(max(sizes))
        rows = self.pieces[longest]
        note = (
            f"log: of {len(self.position)} rows in {len(self.starts)} pieces, the {rows.stop - rows.start} of the "
            "longest are used"
        )
        return replace(
            self,
            position=self.position[rows],
            torque=self.torque[rows],
            notes=(*self.notes, note),
            starts=(0,),
            begins=(self.begins[longest],),
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
        columns = [self.time]
        for k, name in enumerate(self.axes):
            heads += [f"{name} {kind} [N·m]", f"{name} position [{units[name]}]"]
            columns += [self.torque[:, k], self.position[:, k]]
        with replaced_file(file) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(heads)
            writer.writerows([f"{value:.9g}" for value in row] for row in np.stack(columns, axis=1))


class Rows(NamedTuple):
    """The rows of a table that are read, numbered from 1 without its heads.

    Attributes:
        first: number of the first.
        last: number of the last, 0 for that of the table.
    """

    first: int = 1
    last: int = 0

    @classmethod
    def parse(cls, text: str) -> Rows:
        """Return the rows of a text "1000:20000", whose ends may be left out.

        Raises:
            InputError: a text that is none.
        """
        first, colon, last = (part.strip() for part in text.partition(":"))
        if not colon or not all(part == "" or (part.isdecimal() and int(part) > 0) for part in (first, last)):
            raise InputError(f"--rows {text}: must be FIRST:LAST, numbers of rows from 1, as in 1000:20000")
        return cls(int(first or 1), int(last or 0))

    def of(self, count: int, label: str) -> slice:
        """Return the rows as places in a table of so many.

        Raises:
            InputError: a table that is too short.
        """
        last = self.last or count
        if not self.first <= last <= count:
            raise InputError(f"{label}: rows {self.first}:{self.last or ''}: must rise from 1 to {count}, its last row")
        return slice(self.first - 1, last)


def read_log(
    file: str | Path,
    machine: Machine,
    columns: Mapping[str, str] | None = None,
    period: float | None = None,
    rows: Rows | None = None,
) -> Log:
    """Read a log from any table that `read_table` reads: text of any dialect, Parquet, MATLAB, MCAP.

    A column is `time`, or the name of an axis with `position` or `velocity`, and with `demand` or `torque`:
    `x position [mm]`, `x_torque`. Without a unit in brackets it is in SI. A position may be in counts of the encoder,
    and that of a slide in turns of its motor. Axes without columns are left out. Where an axis has both demand and
    torque, the demand is taken; where it has both position and velocity, the position, and the velocity must agree with
    it. What `columns` gives goes before what the table's heads say of the same axis. A table of `gantrysim export` is a
    log. Where rows have gaps or are missing, a piece ends, and a note says so.

    Args:
        file: of the log.
        machine: whose axes are logged.
        columns: sources by such names, as in {"x position": "MPOS AXIS(0) [mm]", "x torque": "I*0.0302 N·m"}.
        period: of the samples, for a log without time or with rounded stamps [s].
        rows: that are read.

    Raises:
        InputError: no such file, a missing column, an unknown unit, a number that is none, uneven times, another
            period, or a velocity that is not that of the position.
    """
    given = None if period is None else positive("period", period, "s")
    try:
        return _logged_axes(read_table(file), machine, columns or {}, given, rows or Rows())
    except InputError as error:
        raise InputError(f"log {str(error).removeprefix('log ')}") from None


@dataclass(frozen=True)
class _Reading:
    """The columns of a table that are a log's, in the rows that are read.

    Attributes:
        table: of the log.
        sources: of its quantities.
        rows: that are read.
    """

    table: ColumnTable
    sources: Mapping[str, Source]
    rows: slice

    def has(self, name: str) -> bool:
        return name in self.sources

    def values(self, name: str, unit: str, further: Mapping[str, float] | None = None) -> Floats:
        return self.table.values(self.sources[name], unit, further)[self.rows]

    def torque(self, axis: Axis, kind: str) -> Floats:
        """Return the torques of an axis [N·m]."""
        return self.values(f"{axis.name} {kind}", TORQUE_UNIT)

    def position(self, axis: Axis) -> Floats:
        """Return the positions of an axis [mm or deg]."""
        source = self.in_si(POSITION, axis)
        further = {**_motor_units(axis, ANGLE), **_count_units(axis)}
        return self.table.values(source, axis.unit, further)[self.rows]

    def velocity(self, axis: Axis) -> Floats:
        """Return the velocities of an axis [mm/s or deg/s]."""
        source = self.in_si(VELOCITY, axis)
        counts = {f"{name}/s": size for name, size in _count_units(axis).items()}
        return self.table.values(source, _SPEEDS[axis.unit], {**_motor_units(axis, TURNING), **counts})[self.rows]

    def in_si(self, quantity: str, axis: Axis) -> Source:
        """Return the source of a position or a velocity, in SI where no unit is given.

        Raises:
            InputError: counts of an axis without an encoder.
        """
        per_time = "/s" if quantity == VELOCITY else ""
        source = self.sources[f"{axis.name} {quantity}"]
        unit = source.unit or self.table.unit_of(source.column)
        if unit.removesuffix(per_time) in COUNTS and not axis.resolution:
            raise InputError(f"{self.table.label}: column {source.column} is in counts, but {axis.name} has no encoder")
        return source._replace(unit=unit or SI[axis.unit] + per_time)


def _motor_units(axis: Axis, kind: str) -> dict[str, float]:
    """Return the units of an angle, or of its change, as those of the motor that moves a slide."""
    if axis.unit != LENGTH:
        return {}
    return {unit: math.radians(factor) * axis.scale for unit, factor in KINDS[kind].items()}


def _count_units(axis: Axis) -> dict[str, float]:
    return dict.fromkeys(COUNTS, axis.resolution) if axis.resolution else {}


def _logged_axes(
    table: ColumnTable, machine: Machine, columns: Mapping[str, str], period: float | None, rows: Rows
) -> Log:
    sources = _sources(table, machine, columns)
    period = period or table.period
    if "time" not in sources and period is None:
        raise InputError(
            f"{table.label}: has no column time: name it, as in --column 'time=t [ms]', or give --period; it has: "
            f"{', '.join(table.order)}"
        )
    if "time" not in sources and table.lost:
        raise InputError(f"{table.label}: samples were lost, and it has no column time to show where")
    logged, kind = _chosen_axes(table, machine, sources, frozenset(columns))
    reading = _Reading(table, sources, rows.of(table.rows, table.label))
    time = None
    if reading.has("time"):
        time = reading.values("time", TIME, {SAMPLES: period} if period else None)
    torque = np.stack([reading.torque(axis, kind) for axis in logged], axis=1)
    motion = [
        reading.position(axis) if reading.has(f"{axis.name} {POSITION}") else reading.velocity(axis) for axis in logged
    ]
    whole = np.isfinite(np.column_stack([torque, *motion])).all(axis=1).astype(bool)
    try:
        instants = instants_of(whole, time, period, reading.rows.start + 1)
    except InputError as error:
        raise InputError(f"{table.label}: {error}") from None
    used = np.concatenate([np.arange(piece.start, piece.stop) for piece in instants.pieces])
    sizes = [piece.stop - piece.start for piece in instants.pieces]
    starts = (0, *np.cumsum(sizes)[:-1].tolist())
    notes = list(instants.notes)
    position = []
    for axis, values in zip(logged, motion, strict=True):
        moved = values[used]
        if not reading.has(f"{axis.name} {POSITION}"):
            moved = _integrated_position(moved, starts, instants.period)
            notes.append(
                f"{axis.name}: its position is integrated from its velocity: where in the travel it moves is not known"
            )
        elif reading.has(f"{axis.name} {VELOCITY}"):
            agreement = _agreement(moved, reading.velocity(axis)[used], starts, instants.period)
            try:
                notes.append(_agreement_words(axis, agreement, reading.in_si(VELOCITY, axis).unit))
            except InputError as error:
                raise InputError(f"{table.label}: {error}") from None
        position.append(moved)
    return Log(
        axes=tuple(axis.name for axis in logged),
        period=instants.period,
        position=np.stack(position, axis=1),
        torque=torque[used],
        held=kind == DEMAND,
        notes=tuple(notes),
        starts=starts,
        begins=instants.begins,
    )


def _sources(table: ColumnTable, machine: Machine, columns: Mapping[str, str]) -> dict[str, Source]:
    """Return where the quantities stand: as given, else by the names of the columns."""
    known = ["time", *(f"{axis} {quantity}" for axis in machine.axis_names for quantity in _QUANTITIES)]
    exported = _exported_columns(machine)
    sources: dict[str, Source] = {}
    for name, text in columns.items():
        if name not in known:
            raise InputError(f"{table.label}: {unknown('column', name, known)}")
        sources[name] = Source.parse(name, text)
    folded = {name.casefold(): name for name in known}
    for head, column in (*((name, name) for name in table.order), *table.aliases.items()):
        name = exported.get(head) or spaced_name(head)
        unit = table.units.get(column, "")
        if unit:
            name = name.removesuffix(f" {unit}")
        # x and X may be two axes
        name = name if name in known else folded.get(name.casefold(), "")
        if name and name not in sources:
            sources[name] = Source(column)
    for axis in machine.axis_names:
        for pair in ((POSITION, VELOCITY), (DEMAND, TORQUE)):
            # what the user gives stands alone: a head neither replaces it nor contradicts it
            unnamed = [quantity for quantity in pair if f"{axis} {quantity}" not in columns]
            if len(unnamed) == 1:
                sources.pop(f"{axis} {unnamed[0]}", None)
    return sources


def _exported_columns(machine: Machine) -> dict[str, str]:
    """Return the names of the columns of a table of `gantrysim export`, by their heads."""
    columns = {"time_s": "time"}
    for axis in machine.plain_axes:
        columns[f"encoder_{axis.name}_{axis.unit}"] = f"{axis.name} {POSITION}"
        columns[f"demand_{axis.name}_Nm"] = f"{axis.name} {DEMAND}"
        columns[f"torque_{axis.name}_Nm"] = f"{axis.name} {TORQUE}"
    return columns


def _chosen_axes(
    table: ColumnTable, machine: Machine, sources: Mapping[str, Source], given: frozenset[str]
) -> tuple[list[Axis], str]:
    """Return the axes with motion and torque, and which torque they all have.

    Raises:
        InputError: no such axis, or torques of different kinds.
    """

    def has(axis: Axis, *quantities: str) -> bool:
        return any(f"{axis.name} {quantity}" in sources for quantity in quantities)

    moved = [axis for axis in machine.axes if has(axis, POSITION, VELOCITY)]
    logged = [axis for axis in moved if has(axis, DEMAND, TORQUE)]
    if not logged:
        first = moved[0].name if moved else machine.axis_names[0]
        half = f"{first} has motion and no torque" if moved else "has no axis with position or velocity, and torque"
        raise InputError(
            f"{table.label}: {half}; it must have columns such as {first} position [mm] and {first} torque [N·m], or "
            f"others that --column names; it has: {', '.join(table.order)}"
        )
    named = {kind for kind in (DEMAND, TORQUE) for axis in machine.axes if f"{axis.name} {kind}" in given}
    if len(named) == 1:
        # an axis that only its heads name does not decide which torque the log has
        kind = named.pop()
        return [axis for axis in logged if has(axis, kind)], kind
    # a demand is known between its samples too
    kind = DEMAND if all(has(axis, DEMAND) for axis in logged) else TORQUE
    if missing := [axis.name for axis in logged if not has(axis, kind)]:
        raise InputError(
            f"{table.label}: has the torque of some axes and the demand of others: {missing[0]} has no {kind}"
        )
    return logged, kind


# Velocities: integrated where there is no position, and compared with it where there is one.

_WINDOW = 0.05  # over which a velocity is compared with the change of the position, well above a drive's filter [s]
_AGREEING_SIZES = 0.1  # largest difference of their sizes
_LEAST_CORRELATION = 0.9  # of a velocity with the change of the position that it is of
_FEWEST_WINDOWS = 8


def _integrated_position(velocity: Floats, starts: Sequence[int], period: float) -> Floats:
    """Return positions by the trapezoidal rule, from zero, (n,); a piece begins where the last one has ended."""
    steps = 0.5 * period * (velocity[1:] + velocity[:-1])
    steps[np.array(starts[1:], int) - 1] = 0.0
    return np.concatenate([[0.0], np.cumsum(steps)])


class _Agreement(NamedTuple):
    """How a velocity agrees with a position.

    Attributes:
        size: of the velocity's integral over windows, of the position's change; nan where the position stands still.
        correlation: of the two.
    """

    size: float
    correlation: float

    @property
    def holds(self) -> bool:
        return abs(self.size - 1) <= _AGREEING_SIZES and self.correlation >= _LEAST_CORRELATION


def _agreement(position: Floats, velocity: Floats, starts: Sequence[int], period: float) -> _Agreement | None:
    """Return how a velocity agrees with a position; None where neither moves, or the log is too short."""
    width = max(round(_WINDOW / period), 2)
    changes = []
    for first, after in zip(starts, (*starts[1:], position.size), strict=True):
        ends = np.arange(first, after, width)
        integral = _integrated_position(velocity[first:after], (0,), period)[ends - first]
        changes.append(np.diff(np.column_stack([position[ends], integral]), axis=0))
    moved, integrated = np.concatenate(changes).T
    known = np.isfinite(integrated)
    moved = moved[known]
    integrated = integrated[known]
    size = float(moved @ moved)
    if moved.size < _FEWEST_WINDOWS or not (size or integrated.any()):
        return None
    common = float(moved @ integrated)
    if not common:
        return _Agreement(math.nan, 0.0)
    return _Agreement(common / size, common / math.sqrt(size * float(integrated @ integrated)))


def _agreement_words(axis: Axis, agreement: _Agreement | None, unit: str) -> str:
    """Return that a velocity agrees with the position, in words.

    Args:
        axis: of both.
        agreement: how they agree.
        unit: in which the velocity was read.

    Raises:
        InputError: they do not agree.
    """
    if agreement is None:
        return f"{axis.name}: its position is used; its velocity is not compared with it, as too little moves"
    if agreement.holds:
        return f"{axis.name}: its position is used; its velocity agrees within {100 * abs(agreement.size - 1):.1g} %"
    if abs(agreement.correlation) < _LEAST_CORRELATION:
        words = (
            f"its velocity is not that of its position: their changes correlate by {agreement.correlation:.2g}, must "
            f"be at least {_LEAST_CORRELATION:g}"
        )
    else:
        known = KINDS[_SPEEDS[axis.unit]]
        size = agreement.size / known.get(unit, 1.0)
        meant = [name for name, factor in known.items() if abs(size * factor - 1) < _AGREEING_SIZES / 2]
        hint = f" ({' or '.join(meant)} read as {unit}?)" if meant else ""
        words = (
            f"its velocity is {times_words(agreement.size)} the change of its position per time{hint}, must be "
            f"{1 - _AGREEING_SIZES:g} to {1 + _AGREEING_SIZES:g} times"
        )
    raise InputError(
        f"axis {axis.name}: {words}; name one of the two by --column, the other is then not read, or check both"
    )
