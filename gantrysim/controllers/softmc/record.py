"""RECORD: samples of a run, taken by the controller at a multiple of the servo period."""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import unknown, whole_number
from gantrysim.base.files import replaced_file
from gantrysim.record.run import Run

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
