"""Transmissions: from the motor's turn to the slide's travel, with inertia, stiffness, friction and accuracy."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gantrysim.base.errors import InputError
from gantrysim.machine.design.settings import Count, NotNegative, Positive, Table, key
from gantrysim.machine.geometry import SCREWS

_STEEL = 7850.0  # density [kg/m³]


class _Transmission(Table):
    stiffness: Positive | Literal["rigid"] = key(
        "stiffness of the drive train at the slide, motor locked; for CoreXY, of one belt [N/µm]; or rigid, where its "
        "mode is far beyond the servo's rate or not known"
    )
    damping_ratio: NotNegative = key("damping ratio of the load on this stiffness, motor locked", 0.03)
    efficiency: Annotated[float, Field(gt=0, le=1)] = key(
        "fraction of the work that reaches the slide; the rest is friction proportional to the force", 1.0
    )
    friction: NotNegative = key("friction of bearings, seals and preload, at the motor [N·m]", 0.0)
    coupling_inertia: NotNegative = key("inertia of coupling and encoder disc, at the motor [kg·m²]", 0.0)

    @property
    def spring(self) -> float:
        """Stiffness at the slide [N/m].

        Raises:
            InputError: it is rigid.
        """
        if self.stiffness == "rigid":
            raise InputError("stiffness = 'rigid': belts or drives that couple axes need one, in N/µm")
        return 1e6 * self.stiffness

    @property
    def travel_per_turn(self) -> float:
        """Travel of the slide per turn of the motor [mm]."""
        raise NotImplementedError

    @property
    def gear(self) -> float:
        """Motor angle per travel, 2 pi / travel per turn [rad/m]."""
        return 2e3 * math.pi / self.travel_per_turn

    @property
    def turning(self) -> float:
        """Inertia that turns with the rotor [kg·m²]."""
        raise NotImplementedError

    def error(self, travel: float) -> float:
        """Return the error of the travel by the accuracy class, plus or minus [µm]; travel in mm."""
        return 0.0

    @property
    def periodic_error(self) -> float:
        """Amplitude of the error within a turn by the accuracy class [µm]."""
        return 0.0

    @property
    def facts(self) -> dict[str, float]:
        """What the MJCF states of it as custom numerics, with a value per actuator: [1, µm/300 mm, µm]."""
        return {
            "efficiency": self.efficiency,
            "travel_error": self.error(300),
            "periodic_error": self.periodic_error,
        }


class Screw(_Transmission):
    """A ball screw. Its inertia is given, or pi rho l d^4 / 32 of a steel cylinder as thick as the thread."""

    kind: Literal["screw"] = key("screw, a ball screw")
    lead: Positive = key("travel per turn [mm]")
    inertia: NotNegative | None = key("inertia of the screw; by default from diameter and length [kg·m²]", None)
    diameter: Positive | None = key("outer diameter, from which the inertia follows [mm]", None)
    length: Positive | None = key("length of the screw, from which the inertia follows [mm]", None)
    accuracy: str | None = key(f"accuracy class of ISO 3408-3 or JIS B 1192: {', '.join(SCREWS)}", None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.inertia is None and (self.diameter is None or self.length is None):
            raise InputError("a screw needs its inertia, or diameter and length")
        if self.accuracy is not None and self.accuracy not in SCREWS:
            raise InputError(f"accuracy = {self.accuracy!r}: must be one of {', '.join(SCREWS)}")
        return self

    @property
    def travel_per_turn(self) -> float:
        return self.lead

    @property
    def turning(self) -> float:
        inertia = self.inertia
        if inertia is None:
            inertia = math.pi * _STEEL * 1e-3 * (self.length or 0) * (1e-3 * (self.diameter or 0)) ** 4 / 32
        return inertia + self.coupling_inertia

    def error(self, travel: float) -> float:
        return SCREWS[self.accuracy][0] * travel / 300 if self.accuracy else 0.0

    @property
    def periodic_error(self) -> float:
        return 0.5 * SCREWS[self.accuracy][1] if self.accuracy else 0.0


class _Reduced(_Transmission):
    ratio: Positive = key("turns of the motor per turn of the pulley or pinion", 1.0)
    inertia: NotNegative = key("inertia of the pulley or pinion and of everything that turns with it [kg·m²]")
    accuracy: NotNegative = key("travel error, plus or minus [µm per 300 mm]", 0.0)

    @property
    def circumference(self) -> float:
        """Travel per turn of pulley or pinion [mm]."""
        raise NotImplementedError

    @property
    def travel_per_turn(self) -> float:
        return self.circumference / self.ratio

    @property
    def turning(self) -> float:
        return self.inertia / self.ratio**2 + self.coupling_inertia

    def error(self, travel: float) -> float:
        return self.accuracy * travel / 300


class Belt(_Reduced):
    """A toothed belt on a pulley."""

    kind: Literal["belt"] = key("belt, a toothed belt")
    teeth: Count = key("number of teeth of the pulley")
    pitch: Positive = key("pitch of the belt [mm]")

    @property
    def circumference(self) -> float:
        return self.teeth * self.pitch


class Rack(_Reduced):
    """A rack; the pinion's travel per turn is pi times module times teeth, over the cosine of the helix angle."""

    kind: Literal["rack"] = key("rack, with a pinion")
    teeth: Count = key("number of teeth of the pinion")
    module: Positive = key("normal module [mm]")
    helix: Annotated[float, Field(ge=0, lt=60)] = key("helix angle [deg]", 0.0)

    @property
    def circumference(self) -> float:
        return math.pi * self.module * self.teeth / math.cos(math.radians(self.helix))


Transmission = Annotated[Screw | Belt | Rack, Field(discriminator="kind")]
