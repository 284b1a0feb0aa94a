"""A measured trace: positions of the command, the encoders or the nozzle, from a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, expanded_path, positive, unknown
from gantrysim.base.input_files import read_toml
from gantrysim.record.run import Run
from gantrysim.tables.column_table import SAMPLES, ColumnTable, Source
from gantrysim.tables.units import SI, TORQUE, spaced_name

# Which columns of a log are which quantities, as a user assigns them.


@dataclass(frozen=True)
class Assignment:
    """Which columns of a log are which quantities.

    Attributes:
        columns: by quantity: time; x, y, z of the nozzle; commanded.AXIS, encoder.AXIS, demand.AXIS and torque.AXIS.
        period: of the samples, for a log without time [s].
        blocks: columns of a TABLE dump, one block after the other.
    """

    columns: Mapping[str, Source]
    period: float | None = None
    blocks: int = 0

    @classmethod
    def parse(cls, text: str) -> Assignment:
        """Return the mapping of a text "time=t,x=px*0.001,y=py[um]", or of a TOML file with a table [columns].

        Raises:
            InputError: no such file, or a text that is none.
        """
        if "=" not in text:
            content = read_toml(expanded_path(text), f"--columns {text}")
            table = content.pop("columns", None)
            if not isinstance(table, dict) or not content.keys() <= {"period", "blocks"}:
                raise InputError(f"--columns {text}: must have a table [columns], and may have period and blocks")
            period = content.get("period")
            blocks = content.get("blocks", 0)
            if not isinstance(blocks, int):
                raise InputError(f"--columns {text}: blocks = {blocks!r}: must be a whole number")
            given = None if period is None else positive("period", period, "s")
            columns = {key: Source.parse(f"--columns {key}", str(value)) for key, value in table.items()}
            return cls(columns, given, blocks)
        pairs = [part.partition("=") for part in text.split(",")]
        return cls({key.strip(): Source.parse(f"--columns {key}", value) for key, _, value in pairs})


_LINKS = ("commanded", "encoder")
_TORQUES = ("demand", "torque")
LEAST_SAMPLES = 8  # samples of a trace


@dataclass(frozen=True)
class Trace:
    """Measured positions, in the controller's or instrument's own frame.

    Attributes:
        time: instants of the samples, rising, (n,) [s].
        axes: positions by "commanded" and "encoder", those that are measured, (n, axes) [mm or deg].
        nozzle: (n, 3) [mm], nan in z where only x and y are measured; or None.
        notes: what had to be filled in.
        torques: at the motor shafts, by "demand" of the servo or "torque" of the motor, the one that is measured, nan
            for an axis that is not, (n, axes) [N·m].
    """

    time: Floats
    axes: Mapping[str, Floats]
    nozzle: Floats | None
    notes: tuple[str, ...] = ()
    torques: Mapping[str, Floats] = field(default_factory=dict)

    @property
    def links(self) -> tuple[str, ...]:
        """Names of what is measured."""
        return (*self.axes, *(() if self.nozzle is None else ("nozzle",)))

    @classmethod
    def of(cls, log: ColumnTable, given: Assignment, run: Run) -> Trace:
        """Return the trace that a log holds, by an assignment or, where it is empty, by the names of its columns.

        Raises:
            InputError: quantities or columns that are unknown, nothing measured, or times that do not rise.
        """
        recognised: list[str] = []
        sources = dict(given.columns)
        if not sources:
            sources, recognised = _recognised_columns(log, run)
        period = given.period if given.period is not None else log.period
        quantities = {"time", *"xyz", *(f"{of_axis}.{axis}" for of_axis in (*_LINKS, *_TORQUES) for axis in run.axes)}
        for key in sources:
            if key not in quantities:
                raise unknown("quantity", key, quantities)
        axes, missing = _positions_of_axes(log, sources, run)
        notes = [*recognised, *missing]
        nozzle = _nozzle(log, sources)
        if nozzle is not None and "z" not in sources:
            notes.append("nozzle in z is not measured: that of the command")
        measured = [*axes.values(), *([] if nozzle is None else [nozzle])]
        if not measured:
            raise InputError(
                f"{log.label}: no position is measured: --columns must name some of {', '.join(sorted(quantities))}; "
                f"columns are {', '.join(log.order)}"
            )
        time = _times(log, sources.get("time"), period, len(measured[0]))
        whole = _without_gaps(time, measured)
        if not whole.all():
            notes.append(f"{np.count_nonzero(~whole)} of {whole.size} rows have gaps and are left out")
        time = time[whole]
        _check_rise(log.label, time)
        axes = {link: positions[whole] for link, positions in axes.items()}
        torques = {kind: values[whole] for kind, values in _torques_of_axes(log, sources, run).items()}
        return cls(time, axes, None if nozzle is None else nozzle[whole], tuple(notes), torques)

    @classmethod
    def of_run(cls, record: Run, run: Run) -> Trace:
        """Return a record of a run as a trace, as of another machine or another version.

        Args:
            record: that is taken for measured.
            run: beside which it is compared.

        Raises:
            InputError: other axes.
        """
        if record.axes != run.axes:
            raise InputError(f"its axes are {', '.join(record.axes)}: must be those of the run, {', '.join(run.axes)}")
        axes = {link: np.array(getattr(record, link)) for link in _LINKS}
        return cls(np.array(record.time), axes, np.array(record.nozzle), (), {"demand": np.array(record.demand)})


def _positions_of_axes(
    log: ColumnTable, sources: Mapping[str, Source], run: Run
) -> tuple[dict[str, Floats], list[str]]:
    """Return the measured positions by link, nan for an axis that is not, and notes on what is not measured."""
    units = dict(zip(run.axes, run.units, strict=True))
    axes = {}
    notes = []
    for link in _LINKS:
        of_link = {axis: sources[f"{link}.{axis}"] for axis in run.axes if f"{link}.{axis}" in sources}
        if not of_link:
            continue
        columns = {axis: log.values(source, units[axis]) for axis, source in of_link.items()}
        size = len(next(iter(columns.values())))
        axes[link] = np.column_stack([columns.get(axis, np.full(size, np.nan)) for axis in run.axes])
        if missing := [axis for axis in run.axes if axis not in of_link]:
            instead = "that of the simulation" if link == "commanded" else "that of the command, in both budgets"
            notes.append(f"{link} of {', '.join(missing)} is not measured: {instead}")
    return axes, notes


def _torques_of_axes(log: ColumnTable, sources: Mapping[str, Source], run: Run) -> dict[str, Floats]:
    """Return the measured torques by kind, nan for an axis that is not; demands where both are measured."""
    for kind in _TORQUES:
        columns = [
            log.values(sources[f"{kind}.{axis}"], TORQUE) if f"{kind}.{axis}" in sources else None for axis in run.axes
        ]
        measured = [column for column in columns if column is not None]
        if measured:
            missing = np.full(len(measured[0]), np.nan)
            return {kind: np.column_stack([missing if column is None else column for column in columns])}
    return {}


def _nozzle(log: ColumnTable, sources: Mapping[str, Source]) -> Floats | None:
    of_nozzle = {axis: sources[axis] for axis in "xyz" if axis in sources}
    if not of_nozzle:
        return None
    if not {"x", "y"} <= of_nozzle.keys():
        raise InputError(f"{log.label}: nozzle in {', '.join(of_nozzle)}: must be in x and y, and may be in z")
    columns = {axis: log.values(source, "mm") for axis, source in of_nozzle.items()}
    return np.column_stack([columns.get(axis, np.full(len(columns["x"]), np.nan)) for axis in "xyz"])


def _without_gaps(time: Floats, measured: Sequence[Floats]) -> NDArray[np.bool_]:
    """Return whether the time and every column that is measured anywhere has a value, (n,)."""
    whole = np.isfinite(time)
    for positions in measured:
        missing = np.isnan(positions)
        whole &= ~missing[:, ~missing.all(axis=0)].any(axis=1)
    return whole


def _times(log: ColumnTable, source: Source | None, period: float | None, size: int) -> Floats:
    if source is not None:
        return log.values(source, "s", {} if period is None else {SAMPLES: period})
    if log.lost:
        raise InputError(f"{log.label}: samples were lost (overrun), so it must have a column of time")
    if period is None:
        raise InputError(f"{log.label}: has no time: name its column, as time=t, or the period of its samples")
    return period * np.arange(size, dtype=np.float64)


def _check_rise(label: str, time: Floats) -> None:
    if time.size < LEAST_SAMPLES:
        raise InputError(f"{label}: has {time.size} samples, must have at least {LEAST_SAMPLES}")
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        raise InputError(f"{label}: time goes from {time[back[0]]:g} s to {time[back[0] + 1]:g} s: must rise")


def _recognised_columns(log: ColumnTable, run: Run) -> tuple[dict[str, Source], list[str]]:
    """Return the quantities that the names of the columns tell, and notes on names that could mean something else.

    The names are those of `gantrysim export`, of a log for `gantrysim identify` or `replay`, of softMC's RECORD, and
    those of the quantities themselves.
    """
    names = {"time": ["time s", "time", "t"]}
    # names of a machine's log, whose positions are in SI where no unit is given
    of_log: dict[str, str] = {}
    for axis in "xyz":
        names[axis] = [f"nozzle {axis} mm", f"nozzle {axis}", axis]
    for axis, unit in zip(run.axes, run.units, strict=True):
        for link, record, words in (("commanded", "PCMD", ("command", "commanded")), ("encoder", "PFB", ("position",))):
            logged = [f"{axis} {word}" for word in words]
            names[f"{link}.{axis}"] = [f"{link} {axis} {unit}", f"{link} {axis}", f"{record} {axis}", *logged]
            of_log |= dict.fromkeys(logged, SI[unit])
        for kind in _TORQUES:
            names[f"{kind}.{axis}"] = [f"{kind} {axis} Nm", f"{kind} {axis}", f"{axis} {kind}"]
    columns: dict[str, str] = {}
    for column in log.columns:
        columns.setdefault(spaced_name(column), column)
    sources = {}
    for quantity, candidates in names.items():
        name = next((name for name in candidates if name in columns), None)
        if name is not None:
            column = columns[name]
            sources[quantity] = Source(column, unit=log.unit_of(column) or of_log.get(name, ""))
    plain_axes = [axis for axis in "xyz" if axis in sources and sources[axis].column == axis]
    if not plain_axes:
        return sources, []
    units = ", ".join(f"{axis} [{log.unit_of(axis) or 'mm'}]" for axis in plain_axes)
    example = plain_axes[0]
    return sources, [f"taken as the nozzle's: {units}; encoders are named by --columns encoder.{example}={example}"]
