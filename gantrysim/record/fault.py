"""Why a run ended before its setpoints did."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """Reason why a run ended before the end of its setpoints.

    Attributes:
        kind: "following error", "travel", "overspeed", "oscillation", "diverged", "position error" or "settling".
        axis: name of the axis that tripped.
        time: time of the servo tick that detected it [s].
        value: value of the quantity at that time.
        limit: bound of the quantity.
        unit: unit of value and limit: mm or deg, mm/s or deg/s, N·m, or the number of swings of the torque demand from
            limit to limit.
        reaction: reaction of the controller, if the kind has several.
    """

    kind: str
    axis: str
    time: float
    value: float
    limit: float
    unit: str
    reaction: str = ""

    def __str__(self) -> str:
        text = f"{self.kind} on axis {self.axis} at t = {self.time:.4f} s"
        if self.kind == "oscillation":
            text += f": the torque demand has swung {self.value:g} times from limit to limit"
        elif math.isfinite(self.limit):
            text += f": {self.value:.4g} {self.unit}, limit {self.limit:.4g} {self.unit}"
        return f"{text}; {self.reaction}" if self.reaction else text
