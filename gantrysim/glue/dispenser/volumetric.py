"""A volumetric pump: auger, progressive cavity or gear, whose shaft meters the glue, less its slip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import at_least, positive
from gantrysim.glue.dispenser.pressurised import Line

_LARGEST_VALUE = 1e9
_PER_TORQUE = 2e6 * math.pi  # kPa for each N·m and mm³


@dataclass(frozen=True)
class Pump:
    """A pump driven by a shaft.

    With D the displacement and n the speed of the shaft, at the pressure p, it displaces

        q = D n - g p.

    The slip g p flows back through clearances: that of a progressive cavity pump depends on its geometry, the pressure
    and the viscosity, and is small with an elastic stator (doi:10.1007/s12182-020-00458-6). An auger slips most: the
    channel of its metering zone, W wide and H high, drags W H v / 2 and the pressure drives W H^3 / (12 viscosity)
    dp/dz back, the flows between a plate that slides at v and one that rests. g goes with the inverse of the viscosity;
    here it is constant. Nor are there the ripple of teeth or chambers, wear, or starvation at the inlet. Between pump
    and needle the glue is stored in walls and hose.

    Attributes:
        displacement: volume of a revolution D, without slip [mm³/rev].
        leak: slip for each kPa of pressure at the needle, g [mm³/(s·kPa)].
        compliance: volume stored between pump and needle for each kPa [mm³/kPa].
        torque: of the shaft, less friction; inf for a motor that never stalls [N·m].

    Raises:
        InputError: a value out of bounds.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": True}

    displacement: float = 50.0
    leak: float = 0.0
    compliance: float = 0.005
    torque: float = math.inf

    def __post_init__(self) -> None:
        for name, unit in (("displacement", "mm³/rev"), ("compliance", "mm³/kPa")):
            positive(f"{name} of the pump", getattr(self, name), unit, _LARGEST_VALUE)
        at_least("leak of the pump", self.leak, 0, "mm³/(s·kPa)", _LARGEST_VALUE)
        if self.torque != math.inf:
            positive("torque of the pump", self.torque, "N·m")

    @property
    def unit(self) -> float:
        """Volume of a revolution [mm³]."""
        return self.displacement

    @property
    def limit(self) -> float:
        """Pressure at which the motor stalls, 2 pi torque / D [kPa]."""
        return _PER_TORQUE * self.torque / self.displacement

    load: ClassVar[str] = "torque"
    load_unit: ClassVar[str] = "N·m"
    speed_unit: ClassVar[str] = "rev/s"

    @property
    def strength_limit(self) -> float:
        """Torque of the shaft [N·m]."""
        return self.torque

    def effort(self, pressure: Floats) -> Floats:
        """Return the torque that pressures [kPa] take of the shaft [N·m]."""
        return pressure * self.displacement / _PER_TORQUE

    @property
    def strength(self) -> str:
        """What limits the pressure, in words."""
        return f"a torque of {self.torque:g} N·m turns a pump of {self.displacement:g} mm³/rev"

    def line(self, conductance: float) -> Line:
        """Return the line between pump and a needle of this conductance [mm³/s]."""
        return Line(conductance, self.compliance, self.leak, self.limit, 0.0, math.inf)
