"""A piston: a syringe whose plunger a motor drives, or the filament of an extruder."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.glue.dispenser.pressurised import Line

_LARGEST_VALUE = 1e9
_ML = 1e3  # mm³ per ml
_KILOPASCALS = 1e3  # per N/mm²


@dataclass(frozen=True)
class Piston:
    """A plunger, or a filament, that is driven into a volume of glue before the needle.

    Its stroke compresses the glue and widens syringe and tube before it drives the needle's flow; see
    `gantrysim.glue.dispenser.pressurised` for the equations: a bulk modulus B = -V dp/dV stores V / B for each unit of
    pressure, and the needle's flow is that of Herschel and Bulkley. The lag of small changes is C dp/dQ, which for a
    shear-thinning glue is shorter the higher the flow: no linear advance fits all. Friction of the plunger costs force,
    but sticks nowhere. The melt of a filament has the viscosity of the needle's glue whatever the flow: melting is not
    simulated. Nothing flows once the plunger has reached its end.

    Attributes:
        plunger: diameter of the plunger, or of the filament [mm].
        charge: volume of glue at the start, in the syringe or the melt chamber; inf for one that is refilled, as by
            filament [ml].
        compliance: widening of syringe and tube, and of the mechanics that push [mm³/kPa].
        bulk_modulus: of the glue, less with air in it; inf for an incompressible one [MPa].
        force: of the motor on the plunger; inf for a motor that never stalls [N].
        seal_friction: of the plunger, which the force has to overcome first [N].

    Raises:
        InputError: a value out of bounds, or a force that does not overcome the friction.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": True}

    plunger: float = 16.0
    charge: float = 10.0
    compliance: float = 0.05
    bulk_modulus: float = 1500.0
    force: float = math.inf
    seal_friction: float = 0.0

    def __post_init__(self) -> None:
        for name, unit in (("plunger", "mm"), ("compliance", "mm³/kPa")):
            positive(f"{name} of the piston", getattr(self, name), unit, _LARGEST_VALUE)
        for name, unit in (("charge", "ml"), ("bulk_modulus", "MPa"), ("force", "N")):
            if getattr(self, name) != math.inf:
                positive(f"{name} of the piston", getattr(self, name), unit)
        at_least("seal_friction of the piston", self.seal_friction, 0, "N", _LARGEST_VALUE)
        if self.force <= self.seal_friction:
            raise InputError(
                f"force of the piston = {self.force:g} N: must be above its seal_friction, {self.seal_friction:g} N"
            )

    @property
    def unit(self) -> float:
        """Volume of a millimetre of stroke [mm³]."""
        return 0.25 * math.pi * self.plunger**2

    @property
    def glue(self) -> float:
        """Volume that the plunger can displace [mm³]."""
        return _ML * self.charge

    @property
    def limit(self) -> float:
        """Pressure at which the motor stalls [kPa]."""
        return _KILOPASCALS * (self.force - self.seal_friction) / self.unit

    load: ClassVar[str] = "force"
    load_unit: ClassVar[str] = "N"
    speed_unit: ClassVar[str] = "mm/s"

    @property
    def strength_limit(self) -> float:
        """Force of the motor [N]."""
        return self.force

    def effort(self, pressure: Floats) -> Floats:
        """Return the force that pressures [kPa] take of the motor [N]."""
        return self.seal_friction + pressure * self.unit / _KILOPASCALS

    @property
    def strength(self) -> str:
        """What limits the pressure, in words."""
        return (
            f"a force of {self.force:g} N, of which {self.seal_friction:g} N is friction, drives a plunger of "
            f"{self.plunger:g} mm"
        )

    def line(self, conductance: float) -> Line:
        """Return the line between plunger and a needle of this conductance [mm³/s]."""
        # of a chamber that is refilled, the compliance is all that counts
        is_finite = self.charge < math.inf
        glue = self.glue if is_finite else 0.0
        modulus = _KILOPASCALS * self.bulk_modulus if is_finite else math.inf
        return Line(conductance, self.compliance, 0.0, self.limit, glue, modulus)
