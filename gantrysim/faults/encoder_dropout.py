"""An encoder that stands still."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.faults.fault import REPORT, Lasting, acts_at_tick


def freeze(row: Any, fault: Any) -> None:
    """Report the position of the tick before, once there is one."""
    if row.tick > 0 and acts_at_tick(row, fault):
        row.seen[fault.axis] = row.measured[fault.axis]


@dataclass(frozen=True, kw_only=True)
class EncoderDropout(Lasting):
    """The encoder stands still: the position that it reports freezes.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        axis: name of the axis.
    """

    stages = ((REPORT, freeze),)

    axis: str
    kind: Literal["encoder dropout"] = "encoder dropout"

    @property
    def magnitude(self) -> str:
        return f"position frozen {self._span}"
