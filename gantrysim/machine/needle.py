"""A dispensing needle: the laminar flow of a power-law glue through a capillary."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, positive

PASCAL = 1e3  # pascals per kilopascal


@dataclass(frozen=True)
class Needle:
    """A needle and its glue, with shear stress K (shear rate)^n.

        Q = pi R^3 / (3 + 1/n) (R dp / (2 K L))^(1/n)

    for bore radius R, length L and pressure drop dp (Bird, Armstrong and Hassager, Dynamics of Polymeric Liquids,
    vol. 1, 1987, power-law flow in tubes). With n = 1, K is the viscosity and this is the law of Hagen and Poiseuille,
    Q = pi R^4 dp / (8 K L).

    Args:
        bore: inner diameter, 2 R [mm].
        length: L [mm].
        consistency: K [Pa·s^n].
        index: n, below 1 for a shear-thinning glue.

    Raises:
        InputError: a value not greater than 0, or values whose flow at 1 kPa is not a finite number above 0.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    bore: float = 0.84
    length: float = 25.0
    consistency: float = 50.0
    index: float = 0.6

    def __post_init__(self) -> None:
        for name, unit in (("bore", "mm"), ("length", "mm"), ("consistency", "Pa·s^n"), ("index", "")):
            positive(f"{name} of the needle", getattr(self, name), unit)
        if not 0 < self.conductance < math.inf:
            raise InputError(f"needle {self}: its flow at 1 kPa is {self.conductance:g} mm³/s")

    @property
    def conductance(self) -> float:
        """Flow at 1 kPa, C in Q = C p^(1/n) [mm³/s]."""
        radius = 0.5 * self.bore
        try:
            shear_rate: float = (radius * PASCAL / (2 * self.consistency * self.length)) ** (1 / self.index)
            return math.pi * radius**3 / (3 + 1 / self.index) * shear_rate
        except OverflowError:
            return math.inf

    def flow(self, pressure: ArrayLike) -> Floats:
        """Return the flow Q [mm³/s] at a pressure drop p of at least 0 [kPa], of the same shape."""
        return self.conductance * np.asarray(pressure, float) ** (1 / self.index)

    def pressure(self, flow: ArrayLike) -> Floats:
        """Return the pressure drop p [kPa] for a flow of at least 0 [mm³/s], of the same shape."""
        return (np.asarray(flow, float) / self.conductance) ** self.index
