"""Faults on purpose of encoder, axis, motor, bus and setpoints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from gantrysim.base.errors import InputError, at_least, between, finite, unknown, whole
from gantrysim.faults.fault import InjectedFault, Lasting


@dataclass(frozen=True, kw_only=True)
class EncoderDropout(Lasting):
    """The encoder stands still: the position that it reports freezes.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        axis: name of the axis.
    """

    axis: str
    kind: Literal["encoder dropout"] = "encoder dropout"

    @property
    def magnitude(self) -> str:
        return f"position frozen {self._span}"


@dataclass(frozen=True, kw_only=True)
class EncoderGlitch(InjectedFault):
    """The encoder is off for some servo ticks.

    Attributes:
        time: time at which it begins [s].
        ticks: its length in servo ticks.
        axis: name of the axis.
        counts: counts by which the reported position is too large.
    """

    axis: str
    counts: int
    ticks: int = 1
    kind: Literal["encoder glitch"] = "encoder glitch"

    def _check(self) -> None:
        _counts(self.counts)
        whole("ticks", self.ticks, 0)

    @property
    def acts(self) -> bool:
        return self.counts != 0 and self.ticks > 0

    def lasting(self, period: float) -> float:
        return self.ticks * period

    @property
    def magnitude(self) -> str:
        return f"{self.counts:+d} counts for {_ticks(self.ticks)}"


@dataclass(frozen=True, kw_only=True)
class EncoderSlip(Lasting):
    """The encoder has slipped on its shaft, or has lost counts.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        axis: name of the axis.
        counts: counts by which the reported position is too large.
    """

    axis: str
    counts: int
    kind: Literal["encoder slip"] = "encoder slip"

    def _check(self) -> None:
        _counts(self.counts)

    @property
    def acts(self) -> bool:
        return self.counts != 0 and self.duration > 0

    @property
    def magnitude(self) -> str:
        return f"{self.counts:+d} counts {self._span}"


@dataclass(frozen=True, kw_only=True)
class StuckAxis(Lasting):
    """Coulomb friction in the axis' joint, of motor, screw and nut together: a tight spot or a seized axis.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        axis: name of the axis.
        friction: friction force of a linear axis, torque about a rotary one; inf for a seized axis [N or N·m].
    """

    axis: str
    friction: float = math.inf
    kind: Literal["stuck axis"] = "stuck axis"

    def _check(self) -> None:
        if self.friction != math.inf:
            at_least("friction", self.friction, 0, "N or N·m")

    @property
    def acts(self) -> bool:
        return self.friction > 0 and self.duration > 0

    @property
    def magnitude(self) -> str:
        size = "seized" if math.isinf(self.friction) else f"friction {self.friction:g} N or N·m"
        return f"{size} {self._span}"


@dataclass(frozen=True, kw_only=True)
class SlippingAxis(Lasting):
    """The coupling between motor and axis, or a belt on its pulley, slips by a distance, at once.

    The motor, whose encoder measures it, is ahead of the axis from then on. It is a slip of known size, not a limit of
    the transmitted torque: motor and axis share one joint of the machine, so the slip itself takes no torque.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        axis: name of the axis.
        offset: distance by which the axis lags its motor, as axis travel [mm or deg].
    """

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


@dataclass(frozen=True, kw_only=True)
class OpenWinding(Lasting):
    """The motor's winding is open: its resistance is infinite, current and torque are zero at once, L/R being zero.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        axis: name of the axis.
    """

    axis: str
    kind: Literal["open winding"] = "open winding"

    @property
    def magnitude(self) -> str:
        return f"no current {self._span}"


@dataclass(frozen=True, kw_only=True)
class BusSag(Lasting):
    """The drive's bus voltage is reduced; the drive's voltage is limited to it.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        axis: name of the axis; by default all axes.
        share: share of the bus voltage that is left, 0 to 1.
    """

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


@dataclass(frozen=True, kw_only=True)
class LostPackets(InjectedFault):
    """The drive does not receive the setpoints of some servo ticks.

    The controller sends them all the same, and the record's `commanded` holds what it sends; the servo's error is
    against what the drive works with.

    Attributes:
        time: time of the first lost setpoint [s].
        ticks: number of servo ticks without a setpoint.
        axis: name of the axis; by default all axes.
        drive: what the drive does: "hold" the last setpoint, or "extrapolate" it at its last velocity.
    """

    ticks: int
    axis: str | None = None
    drive: Literal["hold", "extrapolate"] = "hold"
    kind: Literal["lost packets"] = "lost packets"

    def _check(self) -> None:
        whole("ticks", self.ticks, 0)
        if self.drive not in ("hold", "extrapolate"):
            raise unknown("drive", self.drive, ("hold", "extrapolate"))

    def lasting(self, period: float) -> float:
        return self.ticks * period

    @property
    def magnitude(self) -> str:
        does = {"hold": "holds the last one", "extrapolate": "extrapolates"}[self.drive]
        return f"no setpoint for {_ticks(self.ticks)}, the drive {does}"


def _counts(counts: float) -> None:
    if finite("counts", counts) != int(counts):
        raise InputError(f"counts = {counts:g}: must be a whole number")


def _ticks(count: int) -> str:
    return "1 servo tick" if count == 1 else f"{count} servo ticks"
