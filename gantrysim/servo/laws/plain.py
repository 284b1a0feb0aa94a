"""A law in plain Python, which the engine calls at every servo tick instead of the servo's laws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats


@dataclass(frozen=True)
class Tick:
    """Inputs of a user-defined law at one servo tick.

    Attributes:
        time: time of the tick [s].
        period: servo period T [s].
        commanded: DPOS, (axes,) [mm].
        measured: MPOS, quantised by the encoder, (axes,) [mm].
        error: following error DPOS - MPOS, (axes,) [mm].
        demand_velocity: dDPOS/T, (axes,) [mm/s].
        demand_acceleration: ddDPOS/T^2, (axes,) [mm/s²].
        measured_velocity: dMPOS/T, (axes,) [mm/s].
    """

    time: float
    period: float
    commanded: Floats
    measured: Floats
    error: Floats
    demand_velocity: Floats
    demand_acceleration: Floats
    measured_velocity: Floats


class PlainLaw(Protocol):
    """A law in plain Python: returns the torque demands of all axes at one tick, (axes,) [N·m]."""

    def __call__(self, tick: Tick, /) -> ArrayLike: ...
