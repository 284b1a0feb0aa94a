"""Another travel for the axes of a machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import mujoco

from gantrysim.base.errors import InputError, finite, unknown
from gantrysim.machine.axis import PER_SI, Axis

Travel = Mapping[str, tuple[float, float]]


def travel_edit(axes: tuple[Axis, ...], travel: Travel) -> Callable[[mujoco.MjSpec], None]:
    """Return what changes the travel of axes in an MJCF; masses, stiffness and drawing stay.

    Args:
        axes: of the machine.
        travel: least and largest position by the axis' name [mm or deg].

    Raises:
        InputError: an unknown axis, or bounds that are no numbers or not ascending.
    """
    units = {axis.name: axis.unit for axis in axes}
    for name, (low, high) in travel.items():
        if name not in units:
            raise unknown("axis of travel", name, units)
        finite(f"travel.{name}", low, units[name])
        finite(f"travel.{name}", high, units[name])
        if not low < high:
            raise InputError(f"travel.{name} = {low:g} to {high:g} {units[name]}: must be ascending")

    def edit(spec: mujoco.MjSpec) -> None:
        for name, bounds in travel.items():
            # MuJoCo's specification has angles in degrees where its compiler reads them so
            in_degrees = units[name] == "deg" and spec.compiler.degree
            factor = 1.0 if in_degrees else math.radians(1.0) if units[name] == "deg" else 1 / PER_SI["mm"]
            spec.joint(name).range = [bound * factor for bound in bounds]

    return edit
