"""A deliberate fault: when it acts, and what it is in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, finite

_ROUNDING = 1e-9  # of a time in servo periods

# Points of the servo tick at which a fault acts
CURRENT = "current"  # before each physics step: changes `row.winding_current`
SETPOINT = "setpoint"  # changes `row.setpoint`
MOTOR = "motor"  # changes `row.motor`, the motor's position
REPORT = "report"  # changes `row.seen`, the position that the encoder reports
VOLTAGE = "voltage"  # before each physics step: changes `row.control_torque`, the drive's voltage as a torque


class FaultAxis(NamedTuple):
    """An axis, as deliberate faults depend on it.

    Attributes:
        machine: name of its machine.
        name: of the axis.
        resolution: axis travel per encoder count, 0 for an exact encoder [u].
        bus_voltage: of its drive, inf for an ideal torque source [V].
        mode: command mode of its drive.
        delayed: whether the actuator has a delay of its own.
    """

    machine: str
    name: str
    resolution: float
    bus_voltage: float
    mode: str
    delayed: bool


@dataclass(frozen=True, kw_only=True)
class InjectedFault:
    """A deliberate fault. Each kind is a file with its dataclass, and all that it does in a run.

    Attributes:
        time: time at which it begins [s].
        stages: what it does at points of the servo tick: functions of the row and of the fault's entry there, plain
            Python that numba can compile.
        in_model: whether it changes the model while it lasts, see `change_model`.
        in_drive: whether it changes the drive, see `drive_left`.
    """

    stages: ClassVar[tuple[tuple[str, Callable[[Any, Any], None]], ...]] = ()
    in_model: ClassVar[bool] = False
    in_drive: ClassVar[bool] = False

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

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float | None:
        """Return the value of its entry in the tick for one axis; None where it does nothing there.

        Args:
            axis: one on which it acts.
            axes: all axes of the machine.

        Raises:
            InputError: an axis that cannot have this fault.
        """
        return 0.0

    def change_model(self, model: Any, axis: int) -> None:
        """Put the fault of an axis, given by its number, into a model of MuJoCo's."""

    def drive_left(self, gain: float, bus: float, nominal_bus: float) -> tuple[float, float]:
        """Return what is left of a drive: torque per torque demanded, and bus voltage [V]."""
        return gain, bus

    def flow_left(self, flow: Floats, valve: Floats, edges: Floats) -> Floats:
        """Return the flow out of the nozzle, the mean over each period, (n,) [mm³/s].

        Args:
            flow: without this fault, (n,) [mm³/s].
            valve: share of each period for which the valve is open, (n,).
            edges: begin of each period, and the end of the last, (n + 1,) [s].
        """
        return flow

    def table(self) -> dict[str, Any]:
        """Return its values by name, from which `fault_of` makes it."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def __str__(self) -> str:
        axis = getattr(self, "axis", None)
        on = "" if axis is None else f" {axis}" if self.kind.endswith("axis") else f" on axis {axis}"
        return f"{self.kind}{on} at t = {self.time:.4f} s: {self.magnitude}"


@dataclass(frozen=True, kw_only=True)
class Lasting(InjectedFault):
    """A deliberate fault with a duration, by default until the end [s]."""

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

    def _shares(self, edges: Floats) -> Floats:
        """Return the share of every period, given by their edges, for which the fault lasts, (n,)."""
        inside = np.clip(edges, self.time, self.time + self.duration)
        shares = np.diff(inside) / np.diff(edges)
        # an edge at the begin or end of the fault is beside it by a rounding
        shares[shares < _ROUNDING] = 0.0
        shares[shares > 1 - _ROUNDING] = 1.0
        return shares


def check_counts(counts: float) -> None:
    """Raise InputError for a number of counts that is not whole."""
    if finite("counts", counts) != int(counts):
        raise InputError(f"counts = {counts:g}: must be a whole number")


def servo_ticks(count: int) -> str:
    """Return a number of servo ticks as text."""
    return "1 servo tick" if count == 1 else f"{count} servo ticks"


def acts_at_tick(row: Any, fault: Any) -> bool:
    """Return whether a fault acts at this servo tick."""
    acting: bool = fault.begin <= row.tick and row.tick < fault.end
    return acting


def acts_in_step(row: Any, fault: Any) -> bool:
    """Return whether a fault acts in this physics step."""
    acting: bool = fault.begin * row.substeps <= row.steps and row.steps < fault.end * row.substeps
    return acting


# What electrical faults need of an axis: a drive whose voltage the servo tick sets.


def check_electrical(kind: str, axis: FaultAxis) -> None:
    """Raise InputError for an axis whose actuator has a delay of its own, so that the tick does not set its voltage."""
    if axis.delayed:
        raise InputError(f"fault {kind}: machine {axis.machine} has an actuator with a delay of its own")


def spared_axis(kind: str, axis: FaultAxis, axes: Sequence[FaultAxis], *, named: bool) -> bool:
    """Return whether a fault of all axes leaves out one, a stepper in open loop among servo axes.

    Raises:
        InputError: the fault is one of steppers in open loop alone.

    Args:
        kind: of the fault.
        axis: the axis.
        axes: all axes of the machine.
        named: whether the fault names the axis.
    """
    if axis.mode != "stepper":
        return False
    if not named and any(other.mode != "stepper" for other in axes):
        return True
    raise InputError(f"fault {kind}: axis {axis.name} is a stepper in open loop; of a servo axis only")
