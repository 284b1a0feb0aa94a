"""Faults of a drive and its motor: a bus voltage that is reduced, and a winding that is open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.base.errors import InputError, between
from gantrysim.faults.fault import CURRENT, VOLTAGE, FaultAxis, Lasting, acts_in_step, check_electrical, spared_axis


def limit_voltage(row: Any, fault: Any) -> None:
    """Keep the drive's voltage R/K u + K w within what the bus has left; u is the control, w the motor's speed."""
    if acts_in_step(row, fault):
        axis = fault.axis
        back = fault.constant * row.motor_speed[axis]
        gain = fault.constant / fault.resistance
        lowest = gain * (-fault.value - back)
        highest = gain * (fault.value - back)
        row.control_torque[axis] = min(max(row.control_torque[axis], lowest), highest)


@dataclass(frozen=True, kw_only=True)
class BusSag(Lasting):
    """The drive's bus voltage is reduced; the drive's voltage is limited to it.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        axis: name of the axis; by default all axes.
        share: fraction of the bus voltage that remains, 0 to 1.
    """

    stages = ((VOLTAGE, limit_voltage),)
    in_drive = True

    share: float
    axis: str | None = None
    kind: Literal["bus sag"] = "bus sag"

    def _check(self) -> None:
        between("share", self.share, 0, 1)

    @property
    def acts(self) -> bool:
        return self.share < 1 and self.duration > 0

    @property
    def magnitude(self) -> str:
        return f"{100 * self.share:g} % of the bus voltage {self._span}"

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float | None:
        check_electrical(self.kind, axis)
        named = self.axis is not None
        if spared_axis(self.kind, axis, axes, named=named):
            return None
        if not math.isfinite(axis.bus_voltage):
            if not named and any(math.isfinite(other.bus_voltage) for other in axes):
                return None
            raise InputError(f"fault {self.kind}: axis {axis.name} is an ideal torque source, it has no bus")
        return self.share * axis.bus_voltage

    def drive_left(self, gain: float, bus: float, nominal_bus: float) -> tuple[float, float]:
        return gain, min(bus, self.share * nominal_bus)


def take_current(row: Any, fault: Any) -> None:
    """Take the current out of a winding that has inductance, in every physics step, as its voltage builds it up."""
    if acts_in_step(row, fault) and row.current_at[fault.axis] >= 0:
        row.winding_current[fault.axis] = 0.0


def take_control(row: Any, fault: Any) -> None:
    """Take the control too: the winding may have no current of its own in MuJoCo."""
    if acts_in_step(row, fault):
        row.control_torque[fault.axis] = 0.0


@dataclass(frozen=True, kw_only=True)
class OpenWinding(Lasting):
    """The motor's winding is open: its resistance is infinite, current and torque are zero at once, L/R being zero.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        axis: name of the axis.
    """

    stages = (
        (CURRENT, take_current),
        (VOLTAGE, take_control),
    )
    in_drive = True

    axis: str
    kind: Literal["open winding"] = "open winding"

    @property
    def magnitude(self) -> str:
        return f"no current {self._span}"

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float | None:
        check_electrical(self.kind, axis)
        return None if spared_axis(self.kind, axis, axes, named=True) else 0.0

    def drive_left(self, gain: float, bus: float, nominal_bus: float) -> tuple[float, float]:
        return 0.0, bus
