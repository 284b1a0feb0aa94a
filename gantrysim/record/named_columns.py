"""The record of a run as named columns, with units in their names, for tables outside the package."""

from __future__ import annotations

from importlib import metadata
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError, meant_names, nearest, short_text
from gantrysim.base.extras import pandas_frame
from gantrysim.base.quantity import Quantity

if TYPE_CHECKING:
    import pandas


def _signal(attribute: str, label: str, unit: str, meaning: str) -> Quantity[Any]:
    return Quantity(attribute, label=label, unit=unit, form=".6g", meaning=meaning, path=(attribute,))


TIME = _signal("time", "time", "s", "Time of the servo tick")
# of each axis, in its own unit
POSITIONS = tuple(
    _signal(attribute, label, "mm", meaning).by_axis(())
    for attribute, label, meaning in (
        ("commanded", "commanded position", "Setpoint of the axis, DPOS"),
        ("encoder", "encoder position", "Measured position of the axis, MPOS, in whole encoder counts"),
        ("motor", "motor position", "Exact position of the axis' motor"),
    )
)
# of each axis
DRIVES = tuple(
    _signal(attribute, label, unit, meaning).by_axis(())
    for attribute, label, unit, meaning in (
        ("demand", "torque demand", "N·m", "Torque demand of the servo, after its limit"),
        ("torque", "torque", "N·m", "Electromagnetic torque of the motor"),
        ("current", "current", "A", "Current of the motor; nan for an ideal torque source"),
        (
            "voltage",
            "voltage",
            "V",
            "Terminal voltage at the tick's demand; nan for an ideal torque source",
        ),
    )
)
# in x, y and z of the work frame
POINT_COLUMNS = tuple(
    _signal(attribute, label, "mm", meaning).by_axis(())
    for attribute, label, meaning in (
        ("commanded_tip", "commanded nozzle", "Nozzle of a rigid machine at the commanded positions"),
        ("encoder_tip", "nozzle at the encoders", "Nozzle of a rigid machine at the encoder positions"),
        ("motor_tip", "nozzle at the motors", "Nozzle of a rigid machine at the motor positions"),
        ("nozzle", "nozzle", "Tip of the nozzle in the work frame"),
    )
)
GLUE = (
    _signal("flow", "flow", "mm³/s", "Flow out of the nozzle, the mean over the period after the tick"),
    _signal("flow_demand", "requested flow", "mm³/s", "Flow requested by the program over the same period"),
    _signal("dispense", "dispenser", "", "Whether the dispenser is commanded to be on"),
)
SIGNALS = (TIME, *POSITIONS, *DRIVES, *POINT_COLUMNS, *GLUE)


class Record(Protocol):
    """The attributes of a `Run` that have a column, or describe the columns."""

    @property
    def machine(self) -> Any: ...
    @property
    def axes(self) -> Any: ...
    @property
    def units(self) -> Any: ...
    @property
    def period(self) -> Any: ...
    @property
    def time(self) -> Any: ...
    @property
    def dispense(self) -> Any: ...
    @property
    def fault(self) -> Any: ...
    @property
    def injected(self) -> Any: ...
    @property
    def job_sha256(self) -> Any: ...
    @property
    def machine_sha256(self) -> Any: ...


class _Named(NamedTuple):
    """A column: what it holds, and its place in the signal's array, None for an array that is one column."""

    quantity: Quantity[Any]
    place: int | None = None

    @property
    def name(self) -> str:
        return self.quantity.name

    @property
    def label(self) -> str:
        return self.quantity.key

    def of(self, run: Record) -> NDArray[Any]:
        array = self.quantity.get(run)
        return array if self.place is None else array[:, self.place]


def _all_columns(run: Record) -> list[_Named]:
    """Return all columns in the order of a table.

    Raises:
        InputError: two columns would have one name, because of the names of the axes.
    """
    named = [_Named(TIME)]
    axes = list(zip(run.axes, run.units, strict=True))
    for signal in POSITIONS:
        named += [_Named(signal.of_axis(axis, unit), k) for k, (axis, unit) in enumerate(axes)]
    for signal in DRIVES:
        named += [_Named(signal.of_axis(axis), k) for k, (axis, _) in enumerate(axes)]
    for signal in POINT_COLUMNS:
        named += [_Named(signal.of_axis(axis), k) for k, axis in enumerate("xyz")]
    named += [_Named(signal) for signal in GLUE]
    if len({entry.label for entry in named}) < len(named):
        raise InputError(f"axes {', '.join(run.axes)}: two columns of a table would have one name")
    return named


def column_names(run: Record) -> tuple[str, ...]:
    """Return the names of the columns, see `columns`.

    Raises:
        InputError: as `columns`.
    """
    return tuple(named.label for named in _all_columns(run))


def column(run: Record, name: str) -> NDArray[Any]:
    """Return a column by its name, with or without its unit, (n,), read-only.

    Raises:
        InputError: no column has this name, as for a slice of times; or as `columns`.
    """
    if not isinstance(name, str | int):
        raise InputError(
            f"run[{_key_text(name)}]: a run has columns by name, with all its ticks: write run['encoder_x'][part] with "
            "part = (run.time >= 0.1) & (run.time < 0.2)"
        )
    named = _all_columns(run)
    # a name with its unit goes before the same one without, which an axis called "x_mm" might have
    by_name = {entry.name: entry for entry in named} | {entry.label: entry for entry in named}
    if name not in by_name:
        question = meant_names(nearest(str(name), [entry.name for entry in named]))
        raise InputError(
            f"unknown column {short_text(name)}: {f'{question} ' if question else ''}run.columns lists all"
        )
    return by_name[name].of(run)


def _key_text(key: object) -> str:
    """Return a key between brackets as it was written, shortened."""
    if not isinstance(key, slice):
        return short_text(key)
    parts = [key.start, key.stop] if key.step is None else [key.start, key.stop, key.step]
    return ":".join("" if part is None else short_text(part) for part in parts)


def columns(run: Record) -> dict[str, NDArray[Any]]:
    """Return the columns of a run by name, each (n,): those of `SIGNALS`, with their units.

    As time_s, commanded_x_mm, torque_x_Nm and nozzle_x_mm; docs/values.md lists them.

    Raises:
        InputError: two columns would have one name, because of the names of the axes.
    """
    return {named.label: np.ascontiguousarray(named.of(run)) for named in _all_columns(run)}


def description(run: Record) -> dict[str, str]:
    """Return the metadata of a run for a table: machine, axes, period, fault, versions."""
    return {
        "program": "gantrysim",
        "version": metadata.version("gantrysim"),
        "machine": str(run.machine),
        "axes": ", ".join(run.axes),
        "axis_units": ", ".join(run.units),
        "period_s": repr(float(run.period)),
        "fault": "" if run.fault is None else str(run.fault),
        "deliberate_faults": "; ".join(map(str, run.injected)),
        "job_sha256": run.job_sha256,
        "machine_sha256": run.machine_sha256,
    }


def frame(run: Record) -> pandas.DataFrame:
    """Return the columns as a pandas DataFrame, with the description as its `attrs`.

    Raises:
        InputError: pandas is not installed.
    """
    table = pandas_frame("Run.to_frame", columns(run))
    table.attrs = description(run)
    return table
