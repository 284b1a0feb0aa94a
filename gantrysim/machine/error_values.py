"""Errors of a geometry that a machine can have, a value per column; the others are refused or left out."""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.axis import Axis
from gantrysim.machine.geometry import BENDING, ERRORS, OF_FRAME, OF_GUIDES, Geometry


class RigidMachine(Protocol):
    """A machine whose geometry is ideal."""

    @property
    def name(self) -> str: ...
    @property
    def axes(self) -> tuple[Axis, ...]: ...
    def tip(self, position: ArrayLike) -> Floats:
        """Return the nozzle in the work frame, (n, 3) [mm], at axis positions, (n, axes) [mm or deg]."""
        ...


def error_values(
    machine: RigidMachine, geometry: Geometry, placing: Collection[str], has_ram: bool
) -> dict[str, float]:
    """Return the errors that are not 0, by column such as "play_x" or "squareness_xy".

    An error of the accuracy class that the machine cannot have is left out, where the machine has others of its kind.

    Args:
        machine: the rigid machine.
        geometry: its errors.
        placing: names of the axes x, y and z that place the nozzle.
        has_ram: whether z carries the nozzle on a ram.

    Raises:
        InputError: an error that the machine cannot have.
    """
    values: dict[str, float] = {}
    for name in ERRORS:
        if name in OF_FRAME:
            values |= _of_frame(machine, geometry, name, placing, has_ram)
        else:
            values |= _of_axes(machine, geometry, name, placing)
    return values


def _of_frame(
    machine: RigidMachine, geometry: Geometry, name: str, placing: Collection[str], has_ram: bool
) -> dict[str, float]:
    value = geometry.of(name)
    assert isinstance(value, float | int)
    if not value:
        return {}
    if all(axis in placing for axis in OF_FRAME[name]) and (name not in BENDING or has_ram):
        return {name: value}
    # a class suits machines of other arrangements too, an error that a user states is meant for this one
    if geometry.given(name) or not placing:
        raise refusal(machine, name)
    return {}


def _of_axes(machine: RigidMachine, geometry: Geometry, name: str, placing: Collection[str]) -> dict[str, float]:
    """Return the values of an error of screws or guides, a column per axis."""
    value = geometry.of(name)
    given = geometry.given(name)
    listed = isinstance(value, tuple)
    columns = {}
    values = np.broadcast_to(np.asarray(value, float), len(machine.axes))
    for axis, axis_value in zip(machine.axes, values, strict=True):
        if name == "play" and not given and axis.name == "z":
            continue  # the weight takes up the play of an accuracy class
        if name in OF_GUIDES:
            applies = axis.name in placing and (name != "yaw" or axis.name != "z")
        else:
            applies = axis.unit == "mm" or (name == "play" and listed)
        if axis_value and applies:
            columns[f"{name}_{axis.name}"] = float(axis_value)
        elif axis_value and (listed or (name in OF_GUIDES and not placing)):
            raise refusal(machine, name, axis.name)
    if given and np.any(value) and not columns:
        raise refusal(machine, name)
    return columns


def refusal(machine: RigidMachine, error: str, axis: str = "") -> InputError:
    """Return the refusal of an error that a machine, or one of its axes, cannot have."""
    of_axis = f" of axis {axis}" if axis else ""
    axes = ", ".join(f"{machine_axis.name} [{machine_axis.unit}]" for machine_axis in machine.axes)
    return InputError(
        f"geometry: machine {machine.name} with the axes {axes} can have no {error}{of_axis}: "
        "errors of guides and frame need axes x, y and z in series, those of screws an axis in mm; give others alone"
    )
