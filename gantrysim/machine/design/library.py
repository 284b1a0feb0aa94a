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
from gantrysim.base.input_files import validated_model
from gantrysim.machine.design.settings import NotNegative, Positive, Table, key

# AC servo motors as their data sheets give them, and the DC motor that is equivalent to one.
#
# A three-phase synchronous motor with sinusoidal back-EMF, its current kept at right angles to the field by the drive,
# obeys the equations of a DC motor. With the rms phase current I, resistance R_ph and inductance L_ph of one phase in
# star, and Ke the rms back-EMF between two terminals per speed, the power balance over the three phases is
#
#     3 V_ph I = 3 R_ph I² + d/dt (3/2 L_ph I²) + T w,    T w = 3 (Ke w / sqrt(3)) I
#
# hence T = sqrt(3) Ke I, the torque constant in N·m/A rms. A DC motor with the current i = sqrt(3/2) I has the same
# torque, copper loss, magnetic energy and terminal power if
#
#     K = sqrt(2/3) T / I = sqrt(2) Ke,    R = 2 R_ph,    L = 2 L_ph
#
# R and L are then what an ohmmeter and an LCR meter show between two terminals, and K is the amplitude of the back-EMF
# there. The voltage is the amplitude between two terminals: an inverter with space vector modulation reaches that of
# its DC bus, so the bus limits both motors alike.

PER_RMS = math.sqrt(1.5)  # current of the equivalent DC motor per rms current of a phase
_KRPM = 1e3 * 2 * math.pi / 60  # [rad/s]
# relative difference of the two constants of a data sheet that is accepted: one is measured warm, one cold
_SAME_CONSTANTS = 0.1
# a data sheet's voltage constant of another kind, relative to rms between two phases
_KINDS = {
    "rms from phase to neutral, give sqrt(3) times it": 1 / math.sqrt(3),
    "amplitude from phase to neutral, give sqrt(3/2) times it": math.sqrt(2 / 3),
    "amplitude between two phases, give it divided by sqrt(2)": math.sqrt(2),
}


class AcServo(Table):
    """An AC servo motor; currents in A rms of a phase."""

    kind: Literal["ac servo"] = key("ac servo, a three-phase synchronous motor")
    voltage: Positive = key("nominal voltage of the DC bus, sqrt(2) times the mains voltage [V]")
    torque_constant_rms: Positive | None = key("torque per rms phase current [N·m/A rms]", None)
    voltage_constant_rms: Positive | None = key(
        "rms back-EMF between two phases, in place of the torque constant or to check it [V/krpm]", None
    )
    resistance_phase_to_phase: Positive | None = key(
        "resistance between two terminals; required unless given per phase [ohm]", None
    )
    resistance_per_phase: Positive | None = key(
        "resistance of one phase in star, in place of phase to phase [ohm]", None
    )
    inductance_phase_to_phase: NotNegative | None = key(
        "inductance between two terminals; required unless given per phase [H]", None
    )
    inductance_per_phase: NotNegative | None = key(
        "inductance of one phase in star, in place of phase to phase [H]", None
    )
    rotor_inertia: Positive = key("inertia of the rotor [kg·m²]")
    continuous_torque: Positive = key("rated torque, or continuous torque at standstill [N·m]")
    peak_torque: Positive | None = key(
        "torque for seconds; limits the current if iron saturates below the peak current [N·m]", None
    )
    peak_current_rms: Positive | None = key("phase current allowed for seconds [A rms]", None)
    max_speed: Positive = key("mechanical speed limit [rpm]")
    mass: NotNegative = key("mass of the motor [kg]")
    pole_pairs: Annotated[int, Field(ge=1, le=1000)] = key("number of pole pairs, half the number of poles")
    detent_torque: NotNegative = key("amplitude of the cogging torque without current [N·m]", 0.0)
    sources: dict[str, str] = key("source of each number, by key, or under `rest`", {})

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.torque_constant_rms is None and self.voltage_constant_rms is None:
            raise InputError("torque_constant_rms and voltage_constant_rms missing: an ac servo needs one of them")
        for quantity in ("resistance", "inductance"):
            line = getattr(self, f"{quantity}_phase_to_phase")
            phase = getattr(self, f"{quantity}_per_phase")
            if (line is None) == (phase is None):
                problem = "missing" if line is None else "both given"
                raise InputError(
                    f"{quantity}_phase_to_phase and {quantity}_per_phase {problem}: give one, the first is twice the "
                    "second"
                )
        if self.peak_torque is None and self.peak_current_rms is None:
            raise InputError("peak_torque and peak_current_rms missing: an ac servo needs at least one")
        self._check_constants()
        return self

    def _check_constants(self) -> None:
        """Refuse a voltage constant that the torque constant contradicts, as T/I = sqrt(3) Ke by conservation."""
        if self.torque_constant_rms is None or self.voltage_constant_rms is None:
            return
        expected = self.torque_constant_rms / math.sqrt(3) * _KRPM
        ratio = self.voltage_constant_rms / expected
        if abs(ratio - 1) <= _SAME_CONSTANTS:
            return
        likely = [kind for kind, factor in _KINDS.items() if abs(ratio / factor - 1) <= _SAME_CONSTANTS]
        cause = f"it looks like the {likely[0]}" if likely else "correct one of them, or leave one out"
        raise InputError(
            f"voltage_constant_rms = {self.voltage_constant_rms:g} V/krpm: torque_constant_rms = "
            f"{self.torque_constant_rms:g} N·m/A rms gives {expected:.3g} V/krpm between two phases; {cause}"
        )

    @property
    def torque_constant(self) -> float:
        """K of the equivalent DC motor [N·m/A]; of the torque constant where both constants are given."""
        if self.torque_constant_rms is not None:
            return self.torque_constant_rms / PER_RMS
        return math.sqrt(2) * (self.voltage_constant_rms or math.nan) / _KRPM

    @property
    def resistance(self) -> float:
        """R of the equivalent DC motor [ohm]."""
        return self.resistance_phase_to_phase or 2 * (self.resistance_per_phase or math.nan)

    @property
    def inductance(self) -> float:
        """L of the equivalent DC motor [H]."""
        if self.inductance_phase_to_phase is not None:
            return self.inductance_phase_to_phase
        return 2 * (self.inductance_per_phase or 0.0)

    @property
    def peak_current(self) -> float:
        """Peak current of the equivalent DC motor, the lower that peak current and peak torque allow [A]."""
        current = math.inf if self.peak_current_rms is None else PER_RMS * self.peak_current_rms
        torque = math.inf if self.peak_torque is None else self.peak_torque
        return min(current, torque / self.torque_constant)


RPM = 2 * math.pi / 60  # [rad/s]
CONSISTENT_RATING = 0.015  # relative difference of a stated no-load speed or stall torque and the one computed
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
        if self.steps and not self.pole_pairs:
            raise InputError(f"pole_pairs of a {self.kind} motor missing: 50 with full steps of 1.8 deg")
        if self.steps and self.torque_constant is not None:
            raise InputError(
                "torque_constant of a stepper: follows from holding_torque and rated_current, leave it out"
            )
        stated = (("no_load_speed", self.no_load_speed, "rpm"), ("stall_torque", self.stall_torque, "N·m"))
        for name, value, unit in stated:
            computed = self.computed_ratings[name]
            if value is not None and abs(value - computed) > CONSISTENT_RATING * computed:
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
        # both phases together, see the class
        if self.rated_current:
            return math.sqrt(2) * self.rated_current
        return self.voltage / self.resistance

    @property
    def continuous(self) -> float:
        """Continuous torque [N·m]."""
        return self.continuous_torque or self.holding_torque or 0.0

    @property
    def computed_ratings(self) -> dict[str, float]:
        """No-load speed (V - R I0) / K [rpm] and stall torque K V / R [N·m] at the nominal voltage."""
        speed = (self.voltage - self.resistance * self.no_load_current) / self.K
        return {"no_load_speed": speed / RPM, "stall_torque": self.K * self.voltage / self.resistance}

    @property
    def friction(self) -> tuple[float, float]:
        """Coulomb friction [N·m] and viscous friction [N·m·s/rad]: each half of the no-load torque (assumption)."""
        half = 0.5 * self.K * self.no_load_current
        return half, half / (self.computed_ratings["no_load_speed"] * RPM)

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
        return validated_model(Motor, table, label)
    servo = validated_model(AcServo, table, label)
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
    return validated_model(Encoder, _content()["encoders"][encoder], f"encoder {encoder}").counts
