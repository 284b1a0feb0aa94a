"""Setpoints that the drive does not receive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.base.errors import unknown, whole_number
from gantrysim.faults.fault import SETPOINT, FaultAxis, InjectedFault, acts_at_tick, servo_ticks

_HOLD = 0.0
_EXTRAPOLATE = 1.0


def lose_setpoint(row: Any, fault: Any) -> None:
    """Let the drive work with the last setpoint, or one that goes on at its velocity; at the first tick it has none."""
    if row.tick > 0 and acts_at_tick(row, fault):
        axis = fault.axis
        row.setpoint[axis] = row.commanded[axis]
        if fault.value == _EXTRAPOLATE:
            row.setpoint[axis] = row.commanded[axis] + row.demand_velocity[axis] * row.period


@dataclass(frozen=True, kw_only=True)
class LostPackets(InjectedFault):
    """The drive does not receive the setpoints of some servo ticks.

    The controller sends them all the same, and the record's `commanded` holds what it sends; the servo's error is
    against what the drive works with.

    Attributes:
        time: time of the first lost setpoint [s].
        ticks: number of servo ticks without a setpoint.
        axis: name of the axis; by default all axes.
        drive: behaviour of the drive meanwhile: "hold" the last setpoint, or "extrapolate" it at its last velocity.
    """

    stages = ((SETPOINT, lose_setpoint),)

    ticks: int
    axis: str | None = None
    drive: Literal["hold", "extrapolate"] = "hold"
    kind: Literal["lost packets"] = "lost packets"

    def _check(self) -> None:
        whole_number("ticks", self.ticks, 0)
        if self.drive not in ("hold", "extrapolate"):
            raise unknown("drive", self.drive, ("hold", "extrapolate"))

    def lasting(self, period: float) -> float:
        return self.ticks * period

    @property
    def magnitude(self) -> str:
        does = {"hold": "holds the last one", "extrapolate": "extrapolates"}[self.drive]
        return f"no setpoint for {servo_ticks(self.ticks)}, the drive {does}"

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float:
        return _HOLD if self.drive == "hold" else _EXTRAPOLATE
