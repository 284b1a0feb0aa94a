"""Faults of an encoder: off for some servo ticks, slipped on its shaft, or standing still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.base.errors import InputError, whole_number
from gantrysim.base.quantity import with_minus
from gantrysim.faults.fault import (
    REPORT,
    FaultAxis,
    InjectedFault,
    Lasting,
    acts_at_tick,
    check_counts,
    servo_ticks,
)


def add_offset(row: Any, fault: Any) -> None:
    """Add an offset to the position that the encoder reports."""
    if acts_at_tick(row, fault):
        row.seen[fault.axis] += fault.value


def offset_of_counts(kind: str, counts: int, axis: FaultAxis) -> float:
    """Return counts of an axis' encoder as axis travel [u], or raise InputError for an encoder without counts."""
    if not axis.resolution:
        raise InputError(f"fault {kind}: axis {axis.name} has no encoder counts; its position is exact")
    return counts * axis.resolution


@dataclass(frozen=True, kw_only=True)
class EncoderGlitch(InjectedFault):
    """The encoder is off for some servo ticks.

    Attributes:
        time: time at which the fault begins [s].
        ticks: how long the fault lasts, in servo ticks.
        axis: name of the axis.
        counts: counts added to the reported position.
    """

    stages = ((REPORT, add_offset),)

    axis: str
    counts: int
    ticks: int = 1
    kind: Literal["encoder glitch"] = "encoder glitch"

    def _check(self) -> None:
        check_counts(self.counts)
        whole_number("ticks", self.ticks, 0)

    @property
    def acts(self) -> bool:
        return self.counts != 0 and self.ticks > 0

    def lasting(self, period: float) -> float:
        return self.ticks * period

    @property
    def magnitude(self) -> str:
        return f"{with_minus(f'{self.counts:+d}')} counts for {servo_ticks(self.ticks)}"

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float:
        return offset_of_counts(self.kind, self.counts, axis)


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
