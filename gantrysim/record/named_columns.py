"""The record of a run as named columns, with units in their names, for tables outside the package."""

from __future__ import annotations

from importlib import metadata
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.errors import InputError, meant, nearest, shown

if TYPE_CHECKING:
    import pandas

_PER_AXIS = {  # unit; None for that of the axis
    "commanded": None,
    "encoder": None,
    "motor": None,
    "demand": "Nm",
    "torque": "Nm",
    "current": "A",
    "voltage": "V",
}
_TIPS = ("commanded_tip", "encoder_tip", "motor_tip", "nozzle")
_FLOWS = ("flow", "flow_demand")


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
    """A column: its name, the unit that ends its name in a table, the attribute that holds it, and its place there."""

    name: str
    unit: str
    attribute: str
    place: int | None = None

    @property
    def label(self) -> str:
        return f"{self.name}_{self.unit}" if self.unit else self.name

    def of(self, run: Record) -> NDArray[Any]:
        array = getattr(run, self.attribute)
        return array if self.place is None else array[:, self.place]


def _all_columns(run: Record) -> list[_Named]:
    """Return all columns in the order of a table.

    Raises:
        InputError: two columns would have one name, because of the names of the axes.
    """
    named = [_Named("time", "s", "time")]
    for name, unit in _PER_AXIS.items():
        axes = zip(run.axes, run.units, strict=True)
        named += [_Named(f"{name}_{axis}", unit or axis_unit, name, k) for k, (axis, axis_unit) in enumerate(axes)]
    for name in _TIPS:
        named += [_Named(f"{name}_{axis}", "mm", name, k) for k, axis in enumerate("xyz")]
    named += [_Named(name, "mm3_per_s", name) for name in _FLOWS]
    named.append(_Named("dispense", "", "dispense"))
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
        InputError: no column has this name; or as `columns`.
    """
    named = _all_columns(run)
    # a name with its unit goes before the same one without, which an axis called "x_mm" might have
    by_name = {entry.name: entry for entry in named} | {entry.label: entry for entry in named}
    if name not in by_name:
        question = meant(nearest(str(name), [entry.name for entry in named]))
        raise InputError(f"unknown column {shown(name)}: {f'{question} ' if question else ''}run.columns lists all")
    return by_name[name].of(run)


def columns(run: Record) -> dict[str, NDArray[Any]]:
    """Return the columns of a run by name, each (n,).

    time_s; commanded_x_mm, encoder_x_mm, motor_x_mm, demand_x_Nm, torque_x_Nm, current_x_A and voltage_x_V of each
    axis; commanded_tip_x_mm, encoder_tip_x_mm, motor_tip_x_mm and nozzle_x_mm in x, y and z; flow_mm3_per_s,
    flow_demand_mm3_per_s; dispense.

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
        "faults_on_purpose": "; ".join(map(str, run.injected)),
        "job_sha256": run.job_sha256,
        "machine_sha256": run.machine_sha256,
    }


def frame(run: Record) -> pandas.DataFrame:
    """Return the columns as a pandas DataFrame, with the description as its `attrs`.

    Raises:
        InputError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise InputError("Run.to_frame: pandas is not installed: pip install 'gantrysim[tables]'") from None
    table = pandas.DataFrame(columns(run))
    table.attrs = description(run)
    return table
