"""A nozzle that is partly clogged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import between
from gantrysim.faults.fault import Lasting


@dataclass(frozen=True, kw_only=True)
class CloggedNozzle(Lasting):
    """The nozzle lets only a share of the flow through; what it holds back is lost.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        share: fraction of the flow that remains, 0 to 1.
    """

    share: float
    kind: Literal["clogged nozzle"] = "clogged nozzle"

    def _check(self) -> None:
        between("share", self.share, 0, 1)

    @property
    def acts(self) -> bool:
        return self.share < 1 and self.duration > 0

    @property
    def magnitude(self) -> str:
        return f"{100 * self.share:g} % of the flow {self._span}"

    def flow_left(self, flow: Floats, valve: Floats, edges: Floats) -> Floats:
        return flow * (1 - (1 - self.share) * self._shares(edges))
