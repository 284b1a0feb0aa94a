"""The table of a machine: every key of its TOML file.

A transmission leads from the motor's turn to the slide's travel, with inertia, stiffness, friction and accuracy.
"""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from gantrysim.base.errors import InputError
from gantrysim.base.input_files import field_names, one_line, read_toml
from gantrysim.machine.design.library import AC_SERVO, PER_RMS, RPM, Motor, counts_of, motor_of
from gantrysim.machine.design.settings import Count, NotNegative, Positive, Table, key
from gantrysim.machine.geometry import SCREWS

_STEEL = 7850.0  # density [kg/m³]
Arrangement = Literal["bridge", "table", "cantilever", "tandem", "corexy"]
Mode = Literal["torque", "velocity", "position", "stepper"]
_TORQUE_SHARE = 0.5  # share of its torque at rest that a stepper keeps at the default speed
_MICROSTEPS = 16
_SPEED_SHARE = 0.8  # of the no-load speed that the default speed uses


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


class Guides(Table):
    """Guides of a slide."""

    friction: NotNegative = key("dry friction of all blocks [N]", 0.0)
    viscous: NotNegative = key("viscous friction of all blocks [N·s/m]", 0.0)


class Drive(Table):
    """Motor, encoder, supply and transmission of an axis."""

    motor: str | dict[str, Any] = key("name in the motor library, or a table of the motor's data")
    encoder: str | Positive | None = key(
        "name in the encoder library, or counts per revolution; optional for a stepper", None
    )
    voltage: Positive = key("bus voltage, at the motor's terminals [V]")
    current: Positive | None = key("peak current of the drive, by default the motor's [A]", None)
    current_rms: Positive | None = key(
        "peak current of the drive of an AC servo, per phase, by default the motor's [A rms]", None
    )
    current_loop: Positive = key(
        "bandwidth of the current loop, which replaces the lag of a slower winding [Hz]", 1000.0
    )
    mode: Mode | None = key(
        "command mode of the drive: torque, velocity or position; by default torque, position for a closed-loop "
        "stepper, and steps for a stepper in open loop",
        None,
    )
    microsteps: Count | None = key("microsteps per full step of a stepper in open loop, by default 16", None)
    nut_mass: Positive = key("mass of the nut or belt clamp with its bracket [kg]", 0.15)
    transmission: Transmission = key("screw, belt or rack")

    @field_validator("motor", "encoder")
    @classmethod
    def _check_known(cls, value: Any, info: Any) -> Any:
        if info.field_name == "motor":
            motor_of(value)
        elif value is not None:
            counts_of(value)
        return value

    @model_validator(mode="after")
    def _check_steps(self) -> Self:
        kind = self.known_motor.kind
        motor = f"{'an' if kind[0] in 'aeiou' else 'a'} {kind} motor"
        if self.encoder is None and kind != "stepper":
            raise InputError(f"encoder is missing, {motor} needs it")
        if self.mode == "stepper" and kind != "stepper":
            raise InputError(f"mode = 'stepper': {motor} runs in a closed loop; use torque, velocity or position")
        if self.microsteps is not None and kind != "stepper":
            raise InputError(f"microsteps: {motor} has none, leave it out")
        if self.current is not None and kind == AC_SERVO:
            raise InputError(f"current = {self.current:g} A: the drive of an ac servo is rated in A rms: current_rms")
        if self.current_rms is not None and kind != AC_SERVO:
            raise InputError(f"current_rms: {motor} has no phases with rms currents, give current")
        return self

    @cached_property
    def known_motor(self) -> Motor:
        """The motor's data."""
        return motor_of(self.motor)

    @property
    def counts(self) -> float:
        """Of the encoder per revolution, 0 without one."""
        return 0.0 if self.encoder is None else counts_of(self.encoder)

    @property
    def used_mode(self) -> str:
        """Command mode of the drive."""
        if self.mode is not None:
            return self.mode
        return {"stepper": "stepper", "closed-loop stepper": "position"}.get(self.known_motor.kind, "torque")

    @property
    def fine_steps(self) -> int:
        """Microsteps per full step of a stepper, 0 of any other motor."""
        if self.known_motor.kind != "stepper":
            return 0
        return self.microsteps or _MICROSTEPS

    @property
    def peak_current(self) -> float:
        """Peak current, the lower of the drive's, if given, and the motor's [A]."""
        limit = self.current
        if self.current_rms is not None:
            limit = PER_RMS * self.current_rms
        return min(limit or self.known_motor.current, self.known_motor.current)

    @property
    def lag(self) -> float:
        """Time constant of the torque: L/R, or the current loop's if that is shorter [s]."""
        motor = self.known_motor
        return min(motor.inductance / motor.resistance, 1 / (2 * math.pi * self.current_loop))

    @property
    def armature(self) -> float:
        """Inertia at the motor's shaft: rotor, transmission, coupling [kg·m²]."""
        return self.known_motor.rotor_inertia + self.transmission.turning

    @property
    def field_rate(self) -> float:
        """Largest angular frequency of a stepper in its field, that without load; 0 of any other motor [rad/s]."""
        if not self.fine_steps:
            return 0.0
        motor = self.known_motor
        # torque per angle: of the field, p K I, and of the detent torque, which has four periods per electrical one
        stiffness = motor.pole_pairs * (motor.K * self.peak_current + 4 * motor.detent_torque)
        return math.sqrt(stiffness / self.armature)

    @property
    def highest_speed(self) -> float:
        """Default speed limit of the motor [rad/s].

        The lowest of its mechanical limit, 80 % of its no-load speed and, of a stepper, the speed at which the bus
        leaves half of its peak torque.
        """
        motor = self.known_motor
        fastest = min(motor.max_speed * RPM, _SPEED_SHARE * self.voltage / motor.K)
        if not motor.steps:
            return fastest
        low = 0.0
        high = fastest
        peak = motor.K * self.peak_current
        if motor.torque_at(high, self.voltage, self.peak_current) >= _TORQUE_SHARE * peak:
            return high
        for _ in range(40):
            middle = 0.5 * (low + high)
            if motor.torque_at(middle, self.voltage, self.peak_current) >= _TORQUE_SHARE * peak:
                low = middle
            else:
                high = middle
        return low


class Slide(Table):
    """An axis of the machine."""

    travel: tuple[float, float] = key("lowest and highest position, a range that includes 0 [mm]")
    speed: Positive | None = key("speed limit, by default what the motor reaches on this bus voltage [mm/s]", None)
    guides: Guides = key("friction of the guides", Guides())
    drive: Drive | None = key("motor and transmission; for CoreXY, both are in [belts]", None)

    @field_validator("travel")
    @classmethod
    def _check_travel(cls, value: tuple[float, float]) -> tuple[float, float]:
        low, high = value
        if not low <= 0 <= high or not 1 <= high - low <= 1e5:
            raise InputError(f"travel = [{low:g}, {high:g}] mm: must include 0 and be 1 mm to 100 m long")
        return value


class Masses(Table):
    """Moving masses without motors, whose masses in the library are added to the parts that carry them."""

    bridge: Positive | None = key("mass of the bridge or arm that carries x, without its nut [kg]", None)
    table: Positive | None = key("mass of the moving table with the work, for the arrangement table [kg]", None)
    carriage: Positive = key("mass of the carriage; with a syringe if there is no z axis [kg]")
    ram: Positive | None = key("mass of the z axis' ram with the syringe [kg]", None)


class MachineTable(Table):
    """A machine: arrangement, axes, masses."""

    name: str = key("name of the machine in the MJCF", "machine")
    arrangement: Arrangement = key("bridge, table, cantilever, tandem or corexy")
    gap: Positive = key("height of the nozzle above the work piece with all axes at zero [mm]", 0.5)
    x: Slide = key("axis along the bridge")
    y: Slide = key("axis of the bridge, or of the table")
    z: Slide | None = key("vertical axis, upwards", None)
    belts: Drive | None = key("for corexy: each of the two motors with its belt", None)
    masses: Masses = key("moving masses")
    span: Positive | None = key("for tandem: distance between the two y drives [mm]", None)
    skew_stiffness: NotNegative = key("for tandem: stiffness of the guides against skew of the bridge [N·m/rad]", 0.0)
    arm_stiffness: Positive | None = key("for cantilever: yaw stiffness of arm and guide [N·m/rad]", None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        kind = self.arrangement
        moving = "table" if kind == "table" else "bridge"
        # each key with its value, and whether the arrangement has it
        keys = {
            "belts": (self.belts, kind == "corexy"),
            "x.drive": (self.x.drive, kind != "corexy"),
            "y.drive": (self.y.drive, kind != "corexy"),
            "span": (self.span, kind == "tandem"),
            "arm_stiffness": (self.arm_stiffness, kind == "cantilever"),
            "masses.table": (self.masses.table, moving == "table"),
            "masses.bridge": (self.masses.bridge, moving == "bridge"),
            "masses.ram": (self.masses.ram, self.z is not None),
        }
        for name, (value, has_key) in keys.items():
            if has_key and value is None:
                needs = "the z axis" if name == "masses.ram" else f"arrangement = {kind!r}"
                raise InputError(f"{name} is missing, {needs} needs it")
            if not has_key and value is not None:
                machine = "a machine without z" if name == "masses.ram" else f"arrangement = {kind!r}"
                raise InputError(f"{name}: {machine} has none, leave it out")
        if self.skew_stiffness and kind != "tandem":
            raise InputError(f"skew_stiffness: arrangement = {kind!r} has none, leave it out")
        if self.belts is not None and self.belts.transmission.kind != "belt":
            raise InputError(f"belts.transmission.kind = {self.belts.transmission.kind!r}: must be 'belt'")
        if self.belts is not None and self.belts.transmission.error(1.0):
            raise InputError(
                "belts.transmission.accuracy: does not apply to CoreXY, whose motors are not slides: leave it out"
            )
        if self.z is not None and self.z.drive is None:
            raise InputError("z.drive is missing")
        return self


def read_table(file: Path) -> MachineTable:
    """Return the table of a machine in a TOML file.

    Raises:
        InputError: a file that cannot be read, or a key that is unknown, missing or out of its bounds.
    """
    label = f"machine {file}"
    content = read_toml(file, label)
    try:
        return MachineTable.model_validate(content)
    except ValidationError as error:
        known = field_names(MachineTable)
        raise InputError(f"{label}: {one_line(error, known, content=content, located=True)}") from None
