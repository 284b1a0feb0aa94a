"""A nozzle that drips."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import at_least
from gantrysim.faults.fault import Lasting


@dataclass(frozen=True, kw_only=True)
class DrippingNozzle(Lasting):
    """Glue flows while the valve is closed.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        flow: flow rate while the valve is closed, on top of what the dispenser's lag still delivers [mm³/s].
    """

    flow: float
    kind: Literal["dripping nozzle"] = "dripping nozzle"

    def _check(self) -> None:
        at_least("flow", self.flow, 0, "mm³/s")

    @property
    def acts(self) -> bool:
        return self.flow > 0 and self.duration > 0

    @property
    def magnitude(self) -> str:
        return f"{self.flow:g} mm³/s while the valve is closed, {self._span}"

    def flow_left(self, flow: Floats, valve: Floats, edges: Floats) -> Floats:
        return flow + self.flow * np.minimum(1 - valve, self._shares(edges))
