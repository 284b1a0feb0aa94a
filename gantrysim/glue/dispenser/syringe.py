"""The air that drives the glue of a syringe: as glue is used up its volume grows, and with it the lag."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from gantrysim.base.errors import InputError, at_least, finite, positive
from gantrysim.base.jit import jit

ATMOSPHERE = 101.325  # [kPa]

_ML = 1e3  # mm³ per ml
_PER_BAR = 1e6  # mm³/s at p0 per dm³/(s·bar)
_LARGEST_VALUE = 1e6  # volumes [ml] and conductance [dm³/(s·bar)]
_TIME_STEP = 0.05  # of the integration, relative to the time constant


@dataclass(frozen=True)
class Syringe:
    """A syringe pressurised with air from a valve through a hose.

    The air above the glue and in the hose has the volume V: `dead_volume` with a full syringe, and more as glue is
    used. Air flows in and out through the sonic conductance C of ISO 6358: with upstream pressure p1, downstream
    pressure p2, both absolute, and the critical pressure ratio b,

        q = C p1 psi(p2 / p1),  psi(r) = 1 for r <= b, else sqrt(1 - ((r - b) / (1 - b))^2)

    (as also in the manuals of MapleSim's and Simscape's orifices by that standard), and the air pressure follows dp/dt
    = (p0 q - p dV/dt) / V with p0 = 100 kPa. This is isothermal, because the wall of the barrel holds the temperature
    of so little air. A pressure pulse rises and falls with T = V / (C p0), more slowly as the syringe empties. The
    piston has no friction. Nothing flows once the glue is used up.

    Attributes:
        volume: volume of glue in a full syringe [ml].
        fill: fraction of that volume present at the start of the program, above 0 and at most 1.
        dead_volume: air volume with a full syringe: in the hose and above the glue [ml].
        conductance: sonic conductance C of valve and hose; the default is for adiabatic flow through 1 m of hose with a
            bore of 2.5 mm and a friction factor of 0.03 [dm³/(s·bar)].
        critical_ratio: critical pressure ratio b of valve and hose, at least 0 and below 1; the default is for that
            hose.

    Raises:
        InputError: a value out of bounds.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    volume: float = 10.0
    fill: float = 1.0
    dead_volume: float = 6.0
    conductance: float = 0.35
    critical_ratio: float = 0.2

    def __post_init__(self) -> None:
        for name, unit in (("volume", "ml"), ("dead_volume", "ml"), ("conductance", "dm³/(s·bar)")):
            positive(f"{name} of the syringe", getattr(self, name), unit, _LARGEST_VALUE)
        if positive("fill of the syringe", self.fill) > 1:
            raise InputError(f"fill of the syringe = {self.fill:g}: must be at most 1")
        if at_least("critical_ratio of the syringe", self.critical_ratio, 0) >= 1:
            raise InputError(f"critical_ratio of the syringe = {finite('', self.critical_ratio):g}: must be below 1")

    @property
    def glue(self) -> float:
        """Volume of the glue at the start [mm³]."""
        return _ML * self.volume * self.fill

    @property
    def air(self) -> float:
        """Volume of the air at the start [mm³]."""
        return _ML * (self.dead_volume + self.volume * (1 - self.fill))

    @property
    def rate(self) -> float:
        """Rate C p0 at which air flows in [mm³/s]."""
        return _PER_BAR * self.conductance


@jit
def exchanged_pressure(pressure: float, supply: float, duration: float, constant: float, ratio: float) -> float:
    """Return the pressure of a constant volume of air after a time under a constant supply, all absolute.

    Choked, it rises linearly and falls exponentially. Above b the pressure ratio is r = b + (1 - b) sin u, with
    du/dt = 1 / ((1 - b) T) where it rises. Where it falls r is the inverse ratio, and du/dt = r / ((1 - b) T).

    Args:
        pressure: at the beginning.
        supply: pressure of the supply, or of the atmosphere to which it is vented.
        duration: the time [s].
        constant: T [s].
        ratio: critical pressure ratio b.
    """
    remaining = duration / constant  # time in units of T
    if supply > pressure:
        r = pressure / supply
        if r < ratio:
            if r + remaining <= ratio:
                return pressure + supply * remaining
            remaining -= ratio - r
            r = ratio
        angle = math.asin((r - ratio) / (1.0 - ratio)) + remaining / (1.0 - ratio)
        if angle >= 0.5 * math.pi:  # the pressures are equal
            return supply
        return supply * (ratio + (1.0 - ratio) * math.sin(angle))
    if supply < pressure:
        r = supply / pressure
        if r < ratio:
            choked = math.log(ratio / r)
            if remaining <= choked:
                return pressure * math.exp(-remaining)
            remaining -= choked
            r = ratio
        free = 1.0 - ratio
        angle = math.asin((r - ratio) / free)
        # by Runge and Kutta, of fourth order
        while remaining > 0.0 and angle < 0.5 * math.pi:
            step = min(remaining, _TIME_STEP) / free
            a = step * (ratio + free * math.sin(angle))
            b = step * (ratio + free * math.sin(angle + 0.5 * a))
            c = step * (ratio + free * math.sin(angle + 0.5 * b))
            d = step * (ratio + free * math.sin(angle + c))
            angle += (a + 2.0 * (b + c) + d) / 6.0
            remaining -= _TIME_STEP
        if angle >= 0.5 * math.pi:
            return supply
        return supply / (ratio + free * math.sin(angle))
    return pressure
