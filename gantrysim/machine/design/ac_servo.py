"""AC servo motors as their data sheets give them, and the DC motor that is equivalent to one.

A three-phase synchronous motor with sinusoidal back-EMF, its current kept at right angles to the field by the drive,
obeys the equations of a DC motor. With the rms phase current I, resistance R_ph and inductance L_ph of one phase in
star, and Ke the rms back-EMF between two terminals per speed, the power balance over the three phases is

    3 V_ph I = 3 R_ph I² + d/dt (3/2 L_ph I²) + T w,    T w = 3 (Ke w / sqrt(3)) I

hence T = sqrt(3) Ke I, the torque constant in N·m/A rms. A DC motor with the current i = sqrt(3/2) I has the same
torque, copper loss, magnetic energy and terminal power if

    K = sqrt(2/3) T / I = sqrt(2) Ke,    R = 2 R_ph,    L = 2 L_ph

R and L are then what an ohmmeter and an LCR meter show between two terminals, and K is the amplitude of the back-EMF
there. The voltage is the amplitude between two terminals: an inverter with space vector modulation reaches that of its
DC bus, so the bus limits both motors alike.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gantrysim.base.errors import InputError
from gantrysim.machine.design.settings import NotNegative, Positive, Table, key

PER_RMS = math.sqrt(1.5)  # current of the equivalent DC motor per rms current of a phase
_KRPM = 1e3 * 2 * math.pi / 60  # [rad/s]
# relative difference of the two constants of a data sheet that is accepted: one is measured warm, one cold
_SAME = 0.1
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
        if abs(ratio - 1) <= _SAME:
            return
        likely = [kind for kind, factor in _KINDS.items() if abs(ratio / factor - 1) <= _SAME]
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
