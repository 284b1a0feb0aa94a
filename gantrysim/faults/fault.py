"""A fault on purpose: when it acts, and what it is in words."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from gantrysim.base.errors import InputError, at_least

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
class Lasting(InjectedFault):
    """A fault on purpose with a duration, by default until the end [s]."""

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
