"""A coupling or a belt that slips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.base.errors import finite
from gantrysim.faults.fault import MOTOR, FaultAxis, Lasting, acts_at_tick


def turn_ahead(row: Any, fault: Any) -> None:
    """Put the motor ahead of the axis."""
    if acts_at_tick(row, fault):
        row.motor[fault.axis] += fault.value


@dataclass(frozen=True, kw_only=True)
class SlippingAxis(Lasting):
    """The coupling between motor and axis, or a belt on its pulley, slips by a distance, at once.

    The motor, whose encoder measures it, is ahead of the axis from then on. It is a slip of known size, not a limit of
    the transmitted torque: motor and axis share one joint of the machine, so the slip itself takes no torque.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        axis: name of the axis.
        offset: distance by which the axis lags its motor, as axis travel [mm or deg].
    """

    stages = ((MOTOR, turn_ahead),)

    axis: str
    offset: float
    kind: Literal["slipping axis"] = "slipping axis"

    def _check(self) -> None:
        finite("offset", self.offset, "mm or deg")

    @property
    def acts(self) -> bool:
        return self.offset != 0 and self.duration > 0

    @property
    def magnitude(self) -> str:
        return f"the axis lags its motor by {self.offset:g} mm or deg {self._span}"

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float:
        return self.offset
