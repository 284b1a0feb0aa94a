"""A measured trace: positions of the command, the encoders or the nozzle, from a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, unknown
from gantrysim.compare.traces import Assignment, Log, Source
from gantrysim.record.run import Run

LEAST = 8  # samples of a trace


@dataclass(frozen=True)
class Trace:
    """Measured positions, in the controller's or instrument's own frame.

    Attributes:
        time: instants of the samples, rising, (n,) [s].
        axes: positions by "commanded" and "encoder", those that are measured, (n, axes) [mm or deg].
        nozzle: (n, 3) [mm], nan in z where only x and y are measured; or None.
        notes: what had to be filled in.
    """

    time: Floats
    axes: Mapping[str, Floats]
    nozzle: Floats | None
    notes: tuple[str, ...] = ()

    @property
    def links(self) -> tuple[str, ...]:
        """Names of what is measured."""
        return (*self.axes, *(() if self.nozzle is None else ("nozzle",)))

    @classmethod
    def of(cls, log: Log, given: Assignment, run: Run) -> Trace:
        """Return the trace that a log holds, by an assignment or, where it is empty, by the names of its columns.

        Raises:
            InputError: quantities or columns that are unknown, nothing measured, or times that do not rise.
        """
        sources = dict(given.columns) or _recognised(log, run)
        period = given.period if given.period is not None else log.period
        quantities = {"time", *"xyz", *(f"{link}.{axis}" for link in ("commanded", "encoder") for axis in run.axes)}
        for key in sources:
            if key not in quantities:
                raise unknown("quantity", key, quantities)
        units = dict(zip(run.axes, run.units, strict=True))
        axes = {}
        notes = []
        for link in ("commanded", "encoder"):
            of_link = {axis: sources[f"{link}.{axis}"] for axis in run.axes if f"{link}.{axis}" in sources}
            if of_link:
                columns = {axis: log.values(source, units[axis], period) for axis, source in of_link.items()}
                size = len(next(iter(columns.values())))
                axes[link] = np.column_stack([columns.get(axis, np.full(size, np.nan)) for axis in run.axes])
                if missing := [axis for axis in run.axes if axis not in of_link]:
                    instead = (
                        "that of the simulation" if link == "commanded" else "that of the command, in both budgets"
                    )
                    notes.append(f"{link} of {', '.join(missing)} is not measured: {instead}")
        nozzle = None
        of_nozzle = {axis: sources[axis] for axis in "xyz" if axis in sources}
        if of_nozzle:
            if not {"x", "y"} <= of_nozzle.keys():
                raise InputError(f"{log.label}: nozzle in {', '.join(of_nozzle)}: must be in x and y, and may be in z")
            columns = {axis: log.values(source, "mm", period) for axis, source in of_nozzle.items()}
            nozzle = np.column_stack([columns.get(axis, np.full(len(columns["x"]), np.nan)) for axis in "xyz"])
            if "z" not in of_nozzle:
                notes.append("nozzle in z is not measured: that of the command")
        columns_measured = [*axes.values(), *([] if nozzle is None else [nozzle])]
        if not columns_measured:
            raise InputError(
                f"{log.label}: no position is measured: --columns must name some of {', '.join(sorted(quantities))}; "
                f"columns are {', '.join(log.columns)}"
            )
        time = _times(log, sources.get("time"), period, len(columns_measured[0]))
        return cls(time, axes, nozzle, tuple(notes))


def _times(log: Log, source: Source | None, period: float | None, size: int) -> Floats:
    if source is not None:
        time = log.values(source, "s", period)
    elif log.lost:
        raise InputError(f"{log.label}: samples were lost (overrun), so it must have a column of time")
    elif period is None:
        raise InputError(f"{log.label}: has no time: name its column, as time=t, or the period of its samples")
    else:
        time = period * np.arange(size, dtype=np.float64)
    if time.size < LEAST:
        raise InputError(f"{log.label}: has {time.size} samples, must have at least {LEAST}")
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        raise InputError(f"{log.label}: time goes from {time[back[0]]:g} s to {time[back[0] + 1]:g} s: must rise")
    return time


def _recognised(log: Log, run: Run) -> dict[str, Source]:
    """Return the quantities of tables of `gantrysim export` and of softMC's RECORD."""
    columns = {"time": "time_s" if "time_s" in log.columns else "time", **{axis: f"nozzle_{axis}_mm" for axis in "xyz"}}
    for axis, unit in zip(run.axes, run.units, strict=True):
        for link, word in (("commanded", "PCMD"), ("encoder", "PFB")):
            plain = f"{link}_{axis}_{unit}"
            columns[f"{link}.{axis}"] = plain if plain in log.columns else f"{word} {axis}"
    return {key: Source(name) for key, name in columns.items() if name in log.columns}
