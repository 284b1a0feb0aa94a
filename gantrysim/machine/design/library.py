"""Motors and encoders: data of their data sheets, derived values, and the library of both."""

from __future__ import annotations

import math
import tomllib
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, Final, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from gantrysim.base.errors import InputError, unknown
from gantrysim.base.toml_files import validated
from gantrysim.machine.design.ac_servo import AcServo
from gantrysim.machine.design.settings import NotNegative, Positive, Table, key

RPM = 2 * math.pi / 60  # [rad/s]
CONSISTENT = 0.015  # relative difference of a stated no-load speed or stall torque and the one computed
AC_SERVO: Final = "ac servo"
_ANGLES = np.linspace(0, np.pi / 2, 721)  # of the current ahead of the torque-producing axis


class Winding(NamedTuple):
    """Constants of a motor's winding, by the letters of the equations.

    Attributes:
        K: torque and back-EMF constant [N·m/A, V·s/rad].
        R: resistance [ohm].
        L: inductance [H].
        pole_pairs: p; 0 for a brushed motor.
    """

    K: float
    R: float
    L: float
    pole_pairs: float


class Encoder(Table):
    """An encoder on the motor's shaft."""

    counts: Positive = key("counts per revolution, all edges")
    sources: dict[str, str] = key("origin of the numbers", {})


class Motor(Table):
    """A motor as its data sheet gives it.

    Steppers have no torque constant on their data sheet. With both phases at the rated current I their torque is the
    holding torque T, and the field equals one of a current of sqrt(2) I in the torque-producing axis, hence
    K = T / (sqrt(2) I). In that axis a two-phase motor with the resistance and inductance of one phase obeys the
    equations of a DC motor, copper loss included.
    """

    kind: Literal["brushed", "bldc", "ac servo", "stepper", "closed-loop stepper"] = key(
        "brushed, bldc, stepper or closed-loop stepper; an ac servo has its own keys, see below"
    )
    voltage: Positive = key("nominal voltage [V]")
    torque_constant: Positive | None = key("torque and back-EMF constant [N·m/A]", None)
    holding_torque: Positive | None = key("for a stepper: holding torque, both phases at the rated current [N·m]", None)
    rated_current: Positive | None = key("for a stepper: rated current of a phase [A]", None)
    resistance: Positive = key("resistance of the winding [ohm]")
    inductance: NotNegative = key("inductance of the winding [H]")
    rotor_inertia: Positive = key("inertia of the rotor [kg·m²]")
    no_load_current: NotNegative = key("current without load at the nominal voltage [A]", 0.0)
    no_load_speed: Positive | None = key(
        "speed without load at the nominal voltage, checked against the other values [rpm]", None
    )
    stall_torque: Positive | None = key(
        "torque at standstill and the nominal voltage, checked against the other values [N·m]", None
    )
    continuous_torque: Positive | None = key(
        "torque that heating allows continuously; for a stepper, by default its holding torque [N·m]", None
    )
    peak_current: Positive | None = key(
        "current allowed for seconds; for a stepper, by default sqrt(2) times the rated current [A]", None
    )
    max_speed: Positive = key("mechanical speed limit [rpm]")
    mass: NotNegative = key("mass of the motor [kg]")
    pole_pairs: Annotated[int, Field(ge=0, le=1000)] = key("number of pole pairs; 0 for a brushed motor", 0)
    detent_torque: NotNegative = key("amplitude of the cogging torque without current [N·m]", 0.0)
    sources: dict[str, str] = key("source of each number, by key, or under `rest`", {})

    @model_validator(mode="after")
    def _check(self) -> Self:
        needed = ("holding_torque", "rated_current") if self.steps else ("torque_constant", "continuous_torque")
        missing = [name for name in needed if getattr(self, name) is None]
        if missing:
            raise InputError(f"{' and '.join(missing)} of a {self.kind} motor missing")
        if self.steps and self.torque_constant is not None:
            raise InputError(
                "torque_constant of a stepper: follows from holding_torque and rated_current, leave it out"
            )
        stated = (("no_load_speed", self.no_load_speed, "rpm"), ("stall_torque", self.stall_torque, "N·m"))
        for name, value, unit in stated:
            computed = self.computed[name]
            if value is not None and abs(value - computed) > CONSISTENT * computed:
                raise InputError(
                    f"{name} = {value:g} {unit}: voltage, constant, resistance and no-load current give "
                    f"{computed:.4g} {unit}; correct one of them or leave {name} out"
                )
        return self

    @property
    def steps(self) -> bool:
        """Whether it is a stepper."""
        return "stepper" in self.kind

    @property
    def K(self) -> float:  # noqa: N802 - the letter of the equations
        """Torque and back-EMF constant [N·m/A, V·s/rad]."""
        if self.torque_constant is not None:
            return self.torque_constant
        return (self.holding_torque or 0.0) / (math.sqrt(2) * (self.rated_current or math.inf))

    @property
    def current(self) -> float:
        """Peak current [A]; of a stepper sqrt(2) times the current of a phase."""
        if self.peak_current is not None:
            return self.peak_current
        if self.rated_current:  # both phases together, see the class
            return math.sqrt(2) * self.rated_current
        return self.voltage / self.resistance

    @property
    def continuous(self) -> float:
        """Continuous torque [N·m]."""
        return self.continuous_torque or self.holding_torque or 0.0

    @property
    def computed(self) -> dict[str, float]:
        """No-load speed (V - R I0) / K [rpm] and stall torque K V / R [N·m] at the nominal voltage."""
        speed = (self.voltage - self.resistance * self.no_load_current) / self.K
        return {"no_load_speed": speed / RPM, "stall_torque": self.K * self.voltage / self.resistance}

    @property
    def friction(self) -> tuple[float, float]:
        """Coulomb friction [N·m] and viscous friction [N·m·s/rad]: each half of the no-load torque (assumption)."""
        half = 0.5 * self.K * self.no_load_current
        return half, half / (self.computed["no_load_speed"] * RPM)

    def torque_at(self, speed: float, voltage: float, current: float) -> float:
        """Return the largest torque at a speed, see `largest_torque`."""
        winding = Winding(self.K, self.resistance, self.inductance, self.pole_pairs)
        return largest_torque(winding, speed, voltage, current)


def largest_torque(winding: Winding, speed: float, voltage: float, current: float) -> float:
    """Return the largest torque that a voltage and a current allow at a speed [N·m].

    With the current i at an angle b ahead of the torque-producing axis, and X = p w L,

        v_q = R i cos b - X i sin b + K w,   v_d = -R i sin b - X i cos b,   T = K i cos b

    The torque is the largest over b with v_q² + v_d² <= V², i <= I. Without poles, as of a brushed motor, X is zero.

    Args:
        winding: K, R, L and p.
        speed: w [rad/s].
        voltage: V, its amplitude [V].
        current: I, its amplitude [A].
    """
    K, R, L, pole_pairs = winding  # noqa: N806
    X = pole_pairs * speed * L  # noqa: N806
    # without reactance no current weakens the field
    b = _ANGLES if X > 0 else _ANGLES[:1]
    # (R² + X²) i² + 2 K w (R cos b - X sin b) i + (K w)² - V² = 0
    square = R**2 + X**2
    half = K * speed * (R * np.cos(b) - X * np.sin(b))
    discriminant = half**2 - square * ((K * speed) ** 2 - voltage**2)
    root = np.sqrt(np.maximum(discriminant, 0))
    high = np.where(discriminant >= 0, (-half + root) / square, 0.0)
    low = np.where(discriminant >= 0, (-half - root) / square, np.inf)
    allowed = np.where((low <= current) & (high > 0), np.minimum(high, current), 0.0)
    return float((K * allowed * np.cos(b)).max())


# keys of a data sheet in rms and phase values
_ONLY_AC = frozenset(AcServo.model_fields) - frozenset(Motor.model_fields)


@cache
def _content() -> dict[str, Any]:
    return tomllib.loads((files("gantrysim.machine.design") / "library.toml").read_text(encoding="utf-8"))


def motor_names() -> list[str]:
    """Return the names of the motors of the library."""
    return sorted(_content()["motors"])


def encoder_names() -> list[str]:
    """Return the names of the encoders of the library."""
    return sorted(_content()["encoders"])


def motor_of(motor: str | dict[str, Any]) -> Motor:
    """Return a motor of the library by its name, or one described by a table.

    Raises:
        InputError: an unknown name, or data that contradicts itself.
    """
    if isinstance(motor, dict):
        return _motor_in(motor, "motor")
    if motor not in _content()["motors"]:
        raise unknown("motor", motor, motor_names())
    return _motor_in(_content()["motors"][motor], f"motor {motor}")


def _motor_in(table: dict[str, Any], label: str) -> Motor:
    """Return the motor of a table; of an AC servo motor the equivalent DC motor."""
    kind = table.get("kind")
    if kind != AC_SERVO:
        foreign = [name for name in table if name in _ONLY_AC]
        if foreign:
            raise InputError(f"{label}: {foreign[0]}: a key of kind = {AC_SERVO!r}, not of kind = {kind!r}")
        return validated(Motor, table, label)
    servo = validated(AcServo, table, label)
    return Motor(
        kind=AC_SERVO,
        voltage=servo.voltage,
        torque_constant=servo.torque_constant,
        resistance=servo.resistance,
        inductance=servo.inductance,
        rotor_inertia=servo.rotor_inertia,
        continuous_torque=servo.continuous_torque,
        peak_current=servo.peak_current,
        max_speed=servo.max_speed,
        mass=servo.mass,
        pole_pairs=servo.pole_pairs,
        detent_torque=servo.detent_torque,
        sources=servo.sources,
    )


def counts_of(encoder: str | float) -> float:
    """Return the counts per revolution of an encoder of the library, or the number given."""
    if not isinstance(encoder, str):
        return float(encoder)
    if encoder not in _content()["encoders"]:
        raise unknown("encoder", encoder, encoder_names())
    return validated(Encoder, _content()["encoders"][encoder], f"encoder {encoder}").counts
