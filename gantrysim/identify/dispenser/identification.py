"""Identify a dispenser and its glue from measurements, and judge which values these show."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.glue.dispenser.dispenser import JET, PISTON, TIME_PRESSURE, VALVE, VOLUMETRIC
from gantrysim.glue.dispenser.driven import Drive, Motor
from gantrysim.glue.dispenser.needle import PASCAL, Needle
from gantrysim.glue.dispenser.piston import Piston
from gantrysim.glue.dispenser.volumetric import Pump
from gantrysim.identify.dispenser.advice import Advice, advice_for
from gantrysim.identify.dispenser.checks import check_measurements
from gantrysim.identify.dispenser.fit import NONE, DispenserFit, check_explained, fit_dispenser, values_of
from gantrysim.identify.dispenser.measurements import DOTS, RECORD, Measurements
from gantrysim.identify.dispenser.model import (
    COMPLIANCE,
    CONSISTENCY,
    CONTACT_ANGLE,
    DEAD_TIME,
    DISPLACEMENT,
    DROP,
    EDGES,
    FLOW,
    INDEX,
    LEAK,
    OPENING,
    PLUNGER,
    PUMP_COMPLIANCE,
    RHEOLOGY,
    TIMES,
    YIELD,
    Model,
    needle_sizes,
    needle_with,
    sample_interval,
)
from gantrysim.identify.result import KNOWN_DAMPING, KNOWN_INTERVAL

OFFSET = "open_time_offset"
LAG = "lag"
VISCOSITY = "viscosity"
FLOW_AT_PRESSURE = "flow_at_pressure"

# values that follow from the parameters: unit and words
DERIVED_VALUES = {
    OFFSET: ("s", "glue flows longer than the command, by"),
    LAG: ("s", "lag of small changes"),
    VISCOSITY: ("Pa·s", "viscosity at the middle stress"),
    FLOW_AT_PRESSURE: ("mm³/s", "flow at the pressure written"),
}
# values that are adopted together or not at all, as correlated ones repeat the measurements only together
GROUPS = (
    (FLOW, DROP),
    (*RHEOLOGY, DISPLACEMENT, LEAK, PLUNGER, VISCOSITY, FLOW_AT_PRESSURE),
    (*TIMES, OFFSET),
    (PUMP_COMPLIANCE, COMPLIANCE, LAG),
    (CONTACT_ANGLE,),
)
_BOUNDS = {YIELD: 0.25, LEAK: KNOWN_DAMPING}  # largest half interval, of the value; of the others `KNOWN_INTERVAL`
_UNEXPLAINED_SHARE = 0.15  # largest share of a reading that the law may leave
_SHARE_OF_DOT = 0.1  # half interval of the open-time offset that is known, of the shortest open time
_UNKNOWN = 10.0  # half interval from which no measurement bears on a value, of the value


@dataclass(frozen=True)
class DispenserValue:
    """A value of a dispenser with its confidence.

    Attributes:
        name: key of a job's table [dispenser] or, the contact angle, [bead]; or a name of `DERIVED_VALUES`.
        label: in words.
        unit: of the value.
        value: fitted.
        low, high: ends of the 95 % interval.
        identified: whether half the interval is within its bound, and no reason forbids it.
        reason: why it is not identified, empty if it is.
    """

    name: str
    label: str
    unit: str
    value: float
    low: float
    high: float
    identified: bool
    reason: str = ""


@dataclass(frozen=True, eq=False)
class DispenserIdentification:
    """A dispenser and its glue, fitted to measurements.

    Attributes:
        fit: of all parameters.
    """

    fit: DispenserFit

    @property
    def measured(self) -> Measurements:
        """What it was fitted to."""
        return self.fit.measured

    @cached_property
    def values(self) -> tuple[DispenserValue, ...]:
        """The parameters, and what follows from them."""
        values = [self._parameter(k) for k, shown in enumerate(self.fit.parameters) if shown.name not in EDGES]
        return (*values, *(self._derived_value(name) for name in self._derivable))

    def __getitem__(self, name: str) -> DispenserValue:
        return next(value for value in self.values if value.name == name)

    @cached_property
    def adopted(self) -> frozenset[str]:
        """Names of the parameters that the tables take: groups of which at least one value is identified."""
        known = {value.name for value in self.values if value.identified}
        return frozenset(name for group in GROUPS if known.intersection(group) for name in group)

    @cached_property
    def advice(self) -> Advice | None:
        """The two measurements that would narrow the intervals most; None where nothing can be added."""
        needs = {parameter.name: self._bound_of(parameter.name) for parameter in self.fit.parameters}
        return advice_for(self.fit, needs)

    @property
    def notes(self) -> list[str]:
        """Remarks on what the measurements do not show."""
        notes = []
        measured = self.measured
        if not measured.has_needle and measured.driver and measured.kind != JET:
            notes.append(
                "bore and length of the needle are not given: consistency and yield stress are those of the needle "
                f"written, {Needle().inner:g} x {Needle().length:g} mm; the flow at each pressure is as measured"
            )
        if any(record.has("mass") for record in measured.of_kind(RECORD)):
            notes.append("dead times and lag include those of the scale; a flow meter, or dots, are faster")
        if measured.kind == PISTON and measured.of_kind(RECORD):
            notes.append("compliance is that at the fill of the record: bulk_modulus is set to inf")
        if self._is_driven and LAG in self._derivable:
            notes.append(
                f"advance = {self[LAG].value:.4g} s compensates the lag at the largest flow of the record, where "
                "E or the controller can"
            )
        elif OPENING in self.adopted and self[OPENING].identified:
            notes.append(
                f"advance = {self[OPENING].value:.4g} s compensates the opening, start_lead and stop_lead the dead "
                "times, where the controller can; the tables leave them at 0"
            )
        return notes

    @property
    def tables(self) -> dict[str, Any]:
        """The tables [dispenser] and [bead] of a job, with what is adopted; all else is left at its default."""
        values = {name: value for name, value in self.fit.values.items() if name in self.adopted}
        angle = values.pop(CONTACT_ANGLE, None)
        table: dict[str, Any] = {"kind": self.measured.kind}
        if self.measured.kind == VALVE and self.measured.driver:
            table |= {"metering": TIME_PRESSURE, "pressure": self._pressure}
        if self._needs_needle:
            table["needle"] = self._needle_table
        for name, value in values.items():
            outer, dot, inner = name.rpartition(".")
            place = table.setdefault(outer, {}) if dot else table
            place[inner] = value
        if self.measured.kind == PISTON:
            table.setdefault("piston", {})["bulk_modulus"] = math.inf
        tables = {"dispenser": table}
        return tables | ({"bead": {"contact_angle": angle}} if angle is not None else {})

    @property
    def _needs_needle(self) -> bool:
        # also that of a bead, whose face presses it
        return self.measured.kind in (VOLUMETRIC, PISTON, VALVE) and (
            self.measured.driver != "" or self.measured.has_needle
        )

    @property
    def _needle_table(self) -> dict[str, Any]:
        experiment = self.measured.experiments[0]
        bore, length = (float(sizes[0]) for sizes in needle_sizes(experiment))
        table = {"bore": bore, "length": length}
        if experiment.has("outer"):
            table["outer"] = float(experiment.columns["outer"][0])
        return table

    @cached_property
    def _pressure(self) -> float:
        """The middle one of the pressures at which glue flowed [kPa]."""
        needle = needle_with(self.fit.values, *self._sizes)
        pressures = np.concatenate([x.columns["pressure"] for x in self.measured.experiments if x.has("pressure")])
        flowing = np.sort(pressures[needle.flow(pressures) > 0])
        return float(flowing[flowing.size // 2])

    @property
    def _sizes(self) -> tuple[float, float]:
        bore, length = needle_sizes(self.measured.experiments[0])
        return float(bore[0]), float(length[0])

    @property
    def _is_driven(self) -> bool:
        return self.measured.kind in (VOLUMETRIC, PISTON)

    @property
    def _shows_pressure(self) -> bool:
        """Whether the measurements depend on the pressure that the needle makes: a pump without slip does not."""
        return any(x.has("pressure") for x in self.measured.experiments) or bool(self.measured.of_kind(RECORD))

    @property
    def _derivable(self) -> list[str]:
        names = []
        if DEAD_TIME in self.fit.values:
            names.append(OFFSET)
        if self._is_driven and self.measured.of_kind(RECORD):
            names.append(LAG)
        has_pressure = any(x.has("pressure") for x in self.measured.experiments)
        if CONSISTENCY in self.fit.values and self.measured.has_needle and has_pressure:
            names.append(VISCOSITY)
        if self.measured.driver == "pressure":
            names.append(FLOW_AT_PRESSURE)
        return names

    def _bound_of(self, name: str) -> float:
        return _BOUNDS.get(name, KNOWN_INTERVAL)

    def _slack(self, name: str) -> float:
        """Return the half interval within which a time is known, whatever its value [s]."""
        if name not in (*TIMES, OFFSET, LAG):
            return 0.0
        shortest = min((float(dots.columns["open time"].min()) for dots in self.measured.of_kind(DOTS)), default=0.0)
        return max(sample_interval(self.measured), _SHARE_OF_DOT * shortest if name == OFFSET else 0.0)

    def _parameter(self, k: int) -> DispenserValue:
        parameter = self.fit.parameters[k]
        value = self.fit.values[parameter.name]
        # of a term that the measurements do not need, the interval that it would have
        choices = self.fit.choices[-1:] if value == NONE.get(parameter.name) else self.fit.choices
        middle = float(choices[0].x[k])
        half = self.fit.half_width(lambda x: float(x[k]), choices)
        low = min(max(parameter.value(middle - half), parameter.low), value)
        high = max(min(parameter.value(middle + half), parameter.high), value)
        reason = self._reason(parameter.name, value, low, high)
        return DispenserValue(parameter.name, parameter.label, parameter.unit, value, low, high, not reason, reason)

    def _derived_value(self, name: str) -> DispenserValue:
        """Return a value that follows from the parameters; its logarithm is normal where it is above zero."""
        unit, label = DERIVED_VALUES[name]
        is_log = name != OFFSET

        def function(x: Floats) -> float:
            value = self._value_of(name, values_of(self.fit.parameters, x))
            return math.log(max(value, 1e-300)) if is_log else value

        middle = function(self.fit.x)
        half = self.fit.half_width(function)
        ends = (middle - half, middle, middle + half)
        low, value, high = (math.exp(min(end, 700.0)) if is_log else end for end in ends)
        reason = self._reason(name, value, low, high)
        return DispenserValue(name, label, unit, value, low, high, not reason, reason)

    def _value_of(self, name: str, values: dict[str, float]) -> float:
        if name == OFFSET:
            return self._open_time_offset(values)
        needle = needle_with(values, *self._sizes)
        if name == LAG:
            return self._drive(values, needle).lags(self._record_flow(values))[0]
        if name == FLOW_AT_PRESSURE:
            return float(needle.flow(self._pressure))
        stress = self._middle_stress
        excess = max(stress - values[YIELD], 1e-9)
        rate = (excess / values[CONSISTENCY]) ** (1 / values[INDEX])
        return float(stress / rate)

    def _open_time_offset(self, values: dict[str, float]) -> float:
        """Return volume over settled flow, less the open time, of the longest dots or of those of a second [s]."""
        dots = self.measured.of_kind(DOTS)
        experiment = (dots or self.measured.of_kind(RECORD))[0]
        times = experiment.columns["open time"] if dots else np.ones(1)
        row = int(times.argmax())
        model = Model(self.measured)
        flow = float(model.steady(values, experiment)[0][row])
        time = float(times[row])
        return model.dot(values, experiment, row, time) / max(flow, 1e-12) - time

    def _drive(self, values: dict[str, float], needle: Needle) -> Drive:
        if self.measured.kind == VOLUMETRIC:
            pump = Pump(values[DISPLACEMENT], values[LEAK], values[PUMP_COMPLIANCE])
            return Drive(pump, Motor(), needle)
        piston = Piston(values[PLUNGER], compliance=values[COMPLIANCE], bulk_modulus=math.inf)
        return Drive(piston, Motor(), needle)

    def _record_flow(self, values: dict[str, float]) -> float:
        record = self.measured.of_kind(RECORD)[0]
        return float(Model(self.measured).steady(values, record)[0].max())

    @cached_property
    def _middle_stress(self) -> float:
        """Geometric mean of the wall stresses at which glue flowed [Pa]."""
        stresses = []
        for x in self.measured.experiments:
            if x.has("pressure"):
                bore, length = needle_sizes(x)
                stresses.append(PASCAL * x.columns["pressure"] * bore / (4 * length))
        stress = np.concatenate(stresses)
        flowing = stress[stress > 1.01 * self.fit.values[YIELD]]
        return float(np.sqrt(flowing.min() * flowing.max()))

    def _reason(self, name: str, value: float, low: float, high: float) -> str:
        """Return why a value is not identified, "" if it is."""
        if name in NONE and low <= NONE[name] <= high and name != INDEX:
            return "includes zero"
        needs_size = name in (CONSISTENCY, YIELD, PUMP_COMPLIANCE, COMPLIANCE)
        if needs_size and not self.measured.has_needle:
            return "needle not given"
        if name == INDEX and self._is_driven and not self._shows_pressure:
            return "no pressure measured"
        half = 0.5 * (high - low)
        if half <= max(self._bound_of(name) * abs(value), self._slack(name)):
            return ""
        return "not measured" if half > _UNKNOWN * abs(value) else "interval"


def identify_dispenser(
    measured: Measurements, progress: Callable[[float], None] = lambda _: None
) -> DispenserIdentification:
    """Fit a dispenser and its glue to measurements.

    Args:
        measured: of the dispenser, see `read_measurements`.
        progress: called with the completed share.

    Raises:
        NotIdentifiedError: measurements that are spoiled, in a sentence, or that no dispenser of the kind explains.
    """
    check_measurements(measured)
    fit = fit_dispenser(measured, progress)
    check_explained(fit, _UNEXPLAINED_SHARE)
    return DispenserIdentification(fit)
