"""A dispensing needle: its size, and the laminar flow of a yield-stress glue through it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive, unknown

PASCAL = 1e3  # pascals per kilopascal

# Inner and outer diameter of regular-wall needles [mm]: the nominal inches of the Birmingham-based needle gauge
GAUGES = {
    "14G": (1.600, 2.108),
    "15G": (1.372, 1.829),
    "16G": (1.194, 1.651),
    "17G": (1.067, 1.473),
    "18G": (0.838, 1.270),
    "19G": (0.686, 1.067),
    "20G": (0.603, 0.908),
    "21G": (0.514, 0.819),
    "22G": (0.413, 0.718),
    "23G": (0.337, 0.641),
    "24G": (0.311, 0.565),
    "25G": (0.260, 0.514),
    "27G": (0.210, 0.413),
    "28G": (0.184, 0.362),
    "30G": (0.159, 0.311),
}

_WIDEST_DIAMETER = 100.0  # bore and outer diameter [mm]
_LARGEST_VALUE = 1e9  # length, consistency, index and yield stress
_NEWTON_STEPS = 8  # of Newton's method; from there on the residual is rounding


@dataclass(frozen=True)
class Needle:
    """A needle and its glue, with shear stress tau = tau_y + K (shear rate)^n above the yield stress tau_y.

    This Herschel-Bulkley glue does not flow below the wall stress tau_y, that is below the pressure drop
    p_y = 2 tau_y L / R. Above it, with bore radius R, length L and phi = p_y / p,

        Q = C p^(1/n) (1 - phi)^(1 + 1/n) ((1 - phi)^2 + 2 a phi (1 - phi) + b phi^2),
        C = pi R^3 / (3 + 1/n) (R / (2 K L))^(1/n),  a = (3 n + 1) / (2 n + 1),  b = (3 n + 1) / (n + 1)

    which is the Rabinowitsch integral Q = pi R^3 / tau_w^3 times that of tau^2 ((tau - tau_y) / K)^(1/n) from tau_y to
    the wall stress tau_w = p R / (2 L), as the shear stress grows with the radius and the glue sticks to the wall. With
    n = 1 it is a Bingham glue and the Buckingham-Reiner law. Without a yield stress it is a power-law glue, Q = C
    p^(1/n); if also n = 1, K is the viscosity and the law that of Hagen and Poiseuille, Q = pi R^4 p / (8 K L).

    Args:
        bore: inner diameter, 2 R [mm], or a gauge such as "21G".
        length: length L [mm].
        consistency: consistency K of the glue [Pa·s^n].
        index: flow index n, below 1 for a shear-thinning glue.
        yield_stress: yield stress tau_y of the glue [Pa].
        outer: outer diameter at the tip; None for that of a standard needle with this bore [mm].

    Raises:
        InputError: an unknown gauge, a value not greater than 0, a negative yield stress, an outer diameter not larger
            than the bore, or values whose flow at 1 kPa without a yield stress is not a finite number above 0.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    bore: float | str = 0.84
    length: float = 25.0
    consistency: float = 50.0
    index: float = 0.6
    yield_stress: float = 0.0
    outer: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.bore, str):
            if self.bore not in GAUGES:
                raise unknown("gauge of the needle", self.bore, GAUGES)
        else:
            positive("bore of the needle", self.bore, "mm", _WIDEST_DIAMETER)
        for name, unit in (("length", "mm"), ("consistency", "Pa·s^n"), ("index", "")):
            positive(f"{name} of the needle", getattr(self, name), unit, _LARGEST_VALUE)
        at_least("yield_stress of the needle", self.yield_stress, 0, "Pa", _LARGEST_VALUE)
        if self.outer is not None and positive("outer of the needle", self.outer, "mm", _WIDEST_DIAMETER) <= self.inner:
            raise InputError(
                f"outer of the needle = {self.outer:g} mm: must be greater than its bore, {self.inner:g} mm"
            )
        if not 0 < self.conductance < math.inf:
            raise InputError(f"needle {self}: its flow at 1 kPa is {self.conductance:g} mm³/s")
        if self.yield_stress > 0 and not 0 < self.yield_flow < math.inf:
            raise InputError(f"needle {self}: its flow at the yield pressure is {self.yield_flow:g} mm³/s")

    @cached_property
    def inner(self) -> float:
        """Inner diameter [mm]."""
        return GAUGES[self.bore][0] if isinstance(self.bore, str) else self.bore

    @cached_property
    def face(self) -> float:
        """Outer diameter; by default with the wall of the standard needles, interpolated between their bores [mm]."""
        if self.outer is not None:
            return self.outer
        bores, outers = np.array(sorted(GAUGES.values())).T
        return self.inner + float(np.interp(self.inner, bores, outers - bores))

    @cached_property
    def conductance(self) -> float:
        """Flow at 1 kPa without a yield stress, C [mm³/s]."""
        radius = 0.5 * self.inner
        try:
            shear_rate: float = (radius * PASCAL / (2 * self.consistency * self.length)) ** (1 / self.index)
            return math.pi * radius**3 / (3 + 1 / self.index) * shear_rate
        except OverflowError:
            return math.inf

    @cached_property
    def yield_pressure(self) -> float:
        """Pressure drop below which nothing flows, p_y [kPa]."""
        return 4 * self.yield_stress * self.length / (self.inner * PASCAL)

    @property
    def yield_flow(self) -> float:
        """Flow at the yield pressure of the same glue without a yield stress [mm³/s]."""
        try:
            return float(self.conductance * self.yield_pressure ** (1 / self.index))
        except OverflowError:
            return math.inf

    @property
    def shape(self) -> tuple[float, float]:
        """Constants a and b of the flow law."""
        return (3 * self.index + 1) / (2 * self.index + 1), (3 * self.index + 1) / (self.index + 1)

    def flow(self, pressure: ArrayLike) -> Floats:
        """Return the flow Q [mm³/s] at a pressure drop p of at least 0 [kPa], of the same shape."""
        p = np.asarray(pressure, float)
        free = self.conductance * p ** (1 / self.index)
        if not self.yield_stress:
            return free
        a, b = self.shape
        phi = np.minimum(np.divide(self.yield_pressure, p, out=np.ones_like(p), where=p > 0), 1.0)
        core = (1 - phi) ** 2 + 2 * a * phi * (1 - phi) + b * phi**2
        return free * (1 - phi) ** (1 + 1 / self.index) * core

    def pressure(self, flow: ArrayLike) -> Floats:
        """Return the pressure drop p [kPa] for a flow of at least 0 [mm³/s], of the same shape; 0 for no flow."""
        q = np.asarray(flow, float)
        if not self.yield_stress:
            return (q / self.conductance) ** self.index
        # with z = p / p_y - 1 the flow over `yield_flow` is z^(1/n + 1) (z^2 + 2 a z + b) / (1 + z)^3
        a, b = self.shape
        power = 1 / self.index
        share = np.where(q > 0, q, self.yield_flow) / self.yield_flow
        z = (share / b) ** (1 / (power + 1)) + share ** (1 / power)
        # in logarithms, where the slope lies between 1/n and 1/n + 1
        for _ in range(_NEWTON_STEPS):
            core = z**2 + 2 * a * z + b
            error = (power + 1) * np.log(z) + np.log(core) - 3 * np.log1p(z) - np.log(share)
            slope = power + 1 + 2 * z * (z + a) / core - 3 * z / (1 + z)
            z = z * np.exp(-error / slope)
        return np.where(q > 0, self.yield_pressure * (1 + z), 0.0)
