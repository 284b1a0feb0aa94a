"""The record of a run as named columns, with units in their names, for tables outside the package."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

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


def columns(run: Record) -> dict[str, NDArray[Any]]:
    """Return the columns of a run by name, each (n,).

    time_s; commanded_x_mm, encoder_x_mm, motor_x_mm, demand_x_Nm, torque_x_Nm, current_x_A and voltage_x_V of each
    axis; commanded_tip_x_mm, encoder_tip_x_mm, motor_tip_x_mm and nozzle_x_mm in x, y and z; flow_mm3_per_s,
    flow_demand_mm3_per_s; dispense.

    Raises:
        InputError: two columns would have one name, because of the names of the axes.
    """
    labelled: list[tuple[str, NDArray[Any]]] = [("time_s", run.time)]
    for name, unit in _PER_AXIS.items():
        labels = [f"{name}_{axis}_{unit or axis_unit}" for axis, axis_unit in zip(run.axes, run.units, strict=True)]
        labelled += zip(labels, _split(getattr(run, name)), strict=True)
    for name in _TIPS:
        labels = [f"{name}_{axis}_mm" for axis in "xyz"]
        labelled += zip(labels, _split(getattr(run, name)), strict=True)
    labelled += [(f"{name}_mm3_per_s", getattr(run, name)) for name in _FLOWS]
    labelled.append(("dispense", run.dispense))
    table = dict(labelled)
    if len(table) < len(labelled):
        raise InputError(f"axes {', '.join(run.axes)}: two columns of a table would have one name")
    return table


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


def _split(array: Floats) -> Sequence[Floats]:
    return [np.ascontiguousarray(column) for column in array.T]
