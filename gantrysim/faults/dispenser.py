"""Faults of the dispenser: a nozzle that is partly clogged or drips, and a bubble of air in the glue."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import at_least, between, positive
from gantrysim.faults.fault import InjectedFault, Lasting


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


ATMOSPHERE = 101.325  # [kPa]


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
        time: time at which the bubble reaches the nozzle's tip [s].
        volume: volume V of the bubble in the line [mm³].
        pressure: gauge pressure p in the line [kPa].
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
        # until it has left, which the flow decides
        return math.inf

    @property
    def compression(self) -> float:
        """Volume C that compresses the bubble, and that the surge gives back [mm³]."""
        return self.volume * self.pressure / ATMOSPHERE

    @property
    def magnitude(self) -> str:
        surge = f", then a surge of {self.compression:.4g} mm³" if self.compression else ""
        return f"{self.volume:g} mm³ of air{surge}"

    def flow_left(self, flow: Floats, valve: Floats, edges: Floats) -> Floats:
        volume = np.concatenate([[0.0], np.cumsum(flow * np.diff(edges))])
        before = float(np.interp(self.time, edges, volume))
        # volume displaced by when it has left
        gone = before + self.volume + self.compression
        k = int(np.searchsorted(volume, gone))
        laid = np.minimum(volume, before)
        if k < volume.size:
            leaves = float(edges[k - 1] + (gone - volume[k - 1]) / flow[k - 1])
            surge = -np.expm1(-np.maximum(edges - leaves, 0.0) / self.recovery)
            laid = laid + np.maximum(volume - gone, 0.0) + self.compression * surge
        # what came before keeps its last bit
        first = int(np.searchsorted(edges, self.time, "right")) - 1
        return np.concatenate([flow[:first], np.maximum(np.diff(laid[first:]) / np.diff(edges[first:]), 0.0)])
