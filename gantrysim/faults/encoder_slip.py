"""An encoder that has slipped on its shaft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gantrysim.base.quantity import with_minus
from gantrysim.faults.encoder_glitch import add_offset, offset_of_counts
from gantrysim.faults.fault import REPORT, FaultAxis, Lasting, check_counts


@dataclass(frozen=True, kw_only=True)
class EncoderSlip(Lasting):
    """The encoder has slipped on its shaft, or has lost counts.

    Attributes:
        time: time at which the fault begins [s].
        duration: how long the fault lasts, by default until the end [s].
        axis: name of the axis.
        counts: counts added to the reported position.
    """

    stages = ((REPORT, add_offset),)

    axis: str
    counts: int
    kind: Literal["encoder slip"] = "encoder slip"

    def _check(self) -> None:
        check_counts(self.counts)

    @property
    def acts(self) -> bool:
        return self.counts != 0 and self.duration > 0

    @property
    def magnitude(self) -> str:
        return f"{with_minus(f'{self.counts:+d}')} counts {self._span}"

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float:
        return offset_of_counts(self.kind, self.counts, axis)
