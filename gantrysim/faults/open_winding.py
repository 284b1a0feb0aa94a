"""A motor whose winding is open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.faults.fault import CURRENT, VOLTAGE, FaultAxis, Lasting, acts_in_step, check_electrical, spared_axis


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
