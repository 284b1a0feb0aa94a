"""Faults on purpose of the nozzle: what comes out instead of the dispenser's flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from gantrysim.base.errors import at_least, between, positive
from gantrysim.faults.fault import InjectedFault, Lasting

ATMOSPHERE = 101.325  # [kPa]


@dataclass(frozen=True, kw_only=True)
class CloggedNozzle(Lasting):
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
class DrippingNozzle(Lasting):
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
