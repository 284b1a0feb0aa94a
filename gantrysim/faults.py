"""Faults on purpose: what is to fail in a run, when, and by how much.

Times are those of the run. Faults of the encoder, the drive, the axis and the setpoints begin and end with a servo
tick, the first at or after their time; faults of the dispenser at their very time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Literal, TypeAlias

from gantrysim.errors import InputError, at_least, between, finite, positive, unknown, whole

ATMOSPHERE = 101.325  # [kPa]

_ROUNDING = 1e-9  # of a time in servo periods


@dataclass(frozen=True, kw_only=True)
class InjectedFault:
    """A fault on purpose.

    Attributes:
        time: time at which it begins [s].
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": True}

    kind: str
    time: float

    def __post_init__(self) -> None:
        try:
            at_least("time", self.time, 0, "s")
            self._check()
        except InputError as error:
            raise InputError(f"fault {self.kind}: {error}") from None

    def _check(self) -> None:
        """Raise InputError for a value out of bounds."""

    @property
    def acts(self) -> bool:
        """Whether it changes anything: neither its magnitude nor its duration is zero."""
        return self.lasting(1.0) > 0

    def lasting(self, period: float) -> float:
        """Return for how long it lasts with a servo period, inf for until the end [s]."""
        raise NotImplementedError

    @property
    def magnitude(self) -> str:
        """What it does, in words."""
        raise NotImplementedError

    def acting(self, period: float) -> tuple[float, float]:
        """Return the first servo tick at which it acts and the first at which it no longer does, inf for never."""
        end = (self.time + self.lasting(period)) / period
        return math.ceil(self.time / period - _ROUNDING), end if math.isinf(end) else math.ceil(end - _ROUNDING)

    def table(self) -> dict[str, Any]:
        """Return its values by name, from which `fault_of` makes it."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def __str__(self) -> str:
        axis = getattr(self, "axis", None)
        on = "" if axis is None else f" {axis}" if self.kind.endswith("axis") else f" on axis {axis}"
        return f"{self.kind}{on} at t = {self.time:.4f} s: {self.magnitude}"


@dataclass(frozen=True, kw_only=True)
class _Lasting(InjectedFault):
    duration: float = math.inf

    def __post_init__(self) -> None:
        if self.duration != math.inf:
            try:
                at_least("duration", self.duration, 0, "s")
            except InputError as error:
                raise InputError(f"fault {self.kind}: {error}") from None
        super().__post_init__()

    def lasting(self, period: float) -> float:
        return self.duration

    @property
    def _span(self) -> str:
        return "until the end" if math.isinf(self.duration) else f"for {self.duration:g} s"


@dataclass(frozen=True, kw_only=True)
class EncoderDropout(_Lasting):
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
class EncoderSlip(_Lasting):
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
class StuckAxis(_Lasting):
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
class SlippingAxis(_Lasting):
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
class OpenWinding(_Lasting):
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
class BusSag(_Lasting):
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


@dataclass(frozen=True, kw_only=True)
class CloggedNozzle(_Lasting):
    """The nozzle lets only a share of the flow through; what it holds back is lost.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        share: share of the flow that is left, 0 to 1.
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


@dataclass(frozen=True, kw_only=True)
class DrippingNozzle(_Lasting):
    """Glue flows while the valve is closed.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        flow: flow while the valve is closed, besides what the dispenser's lag still gives [mm³/s].
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


@dataclass(frozen=True, kw_only=True)
class AirBubble(InjectedFault):
    """A bubble of air leaves with the glue: first nothing comes, then a surge.

    A bubble that takes the volume V under the gauge pressure p of the line took V (1 + p / p0) before, with p0 =
    101.325 kPa (isothermal, an ideal gas). From `time` on the dispenser displaces

        V + C,  C = V p / p0,

    without any glue: it pushes the bubble out, and compresses it. C comes back when the bubble has left, as it expands
    into the open and the line relaxes, with the flow C / T exp(-t / T) on top of the dispenser's. So the volume laid
    is in the end that of the dispenser less V.

    Attributes:
        time: time at which it reaches the nozzle's tip [s].
        volume: volume V of the bubble in the line [mm³].
        pressure: gauge pressure p of the line [kPa].
        recovery: time constant T of the surge [s].
    """

    volume: float
    pressure: float = 0.0
    recovery: float = 0.05
    kind: Literal["air bubble"] = "air bubble"

    def _check(self) -> None:
        at_least("volume", self.volume, 0, "mm³")
        at_least("pressure", self.pressure, 0, "kPa")
        positive("recovery", self.recovery, "s")

    @property
    def acts(self) -> bool:
        return self.volume > 0

    def lasting(self, period: float) -> float:
        return math.inf  # until it has left, which the flow decides

    @property
    def compression(self) -> float:
        """Volume C that compresses the bubble, and that the surge gives back [mm³]."""
        return self.volume * self.pressure / ATMOSPHERE

    @property
    def magnitude(self) -> str:
        surge = f", then a surge of {self.compression:.4g} mm³" if self.compression else ""
        return f"{self.volume:g} mm³ of air{surge}"


AnyFault: TypeAlias = (
    EncoderDropout
    | EncoderGlitch
    | EncoderSlip
    | StuckAxis
    | SlippingAxis
    | OpenWinding
    | BusSag
    | LostPackets
    | CloggedNozzle
    | DrippingNozzle
    | AirBubble
)

KINDS: dict[str, Any] = {  # the dataclasses by kind
    str(next(field.default for field in fields(each) if field.name == "kind")): each for each in AnyFault.__args__
}
FLOW_FAULTS = (CloggedNozzle, DrippingNozzle, AirBubble)


def fault_of(table: Any) -> InjectedFault:
    """Return the fault of a table of its values.

    Raises:
        InputError: an unknown kind, or a value out of bounds.
        TypeError: a value that is missing, or an unknown one.
    """
    if not isinstance(table, dict):
        raise InputError(f"fault {table!r}: must be a table of its values")
    kind = str(table.get("kind"))
    if kind not in KINDS:
        raise unknown("fault", kind, KINDS)
    fault: InjectedFault = KINDS[kind](**table)
    return fault


def check_faults(
    faults: Sequence[InjectedFault], machine: str, axes: Sequence[str], longest: float
) -> tuple[InjectedFault, ...]:
    """Return faults, checked against a run, in their order.

    Args:
        faults: the faults.
        machine: name of the machine, for messages.
        axes: names of its axes.
        longest: longest duration of the run [s].

    Raises:
        InputError: one that is no fault, of an axis that the machine does not have, or after the end of the run.
    """
    for fault in faults:
        if not isinstance(fault, InjectedFault):
            raise InputError(f"faults: holds a {type(fault).__name__}: must be faults such as {', '.join(KINDS)}")
        axis = getattr(fault, "axis", None)
        if axis is not None and axis not in axes:
            raise InputError(f"fault {fault.kind}: axis = {axis!r}: machine {machine} has {', '.join(axes)}")
        if fault.time > longest:
            raise InputError(
                f"fault {fault.kind}: time = {fault.time:g} s: must be at most {longest:g} s, the run's length"
            )
    return tuple(faults)


def _counts(counts: float) -> None:
    if finite("counts", counts) != int(counts):
        raise InputError(f"counts = {counts:g}: must be a whole number")


def _ticks(count: int) -> str:
    return "1 servo tick" if count == 1 else f"{count} servo ticks"
