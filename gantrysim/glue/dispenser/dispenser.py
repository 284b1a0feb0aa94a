"""Dispenser: from the program's command to the flow out of the nozzle.

    command --leads--> valve --compensation--> request --dead time--> lag --syringe--> needle--> flow

Rising and falling flow, or pressure, have separate time constants. Syringe and needle turn pressure into flow. Where
the program drives a motor, a pump or a piston takes the place of the lag:

    command --leads--> request, or E --compensation--> motor --> pump or piston --pressure--> needle --> flow
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import blocks
from gantrysim.base.errors import InputError, at_least, check_one_of, positive
from gantrysim.glue.dispenser.command import NOTHING, Material, ValveTimes, cuts, on_ticks, without_e, without_output
from gantrysim.glue.dispenser.driven import Drive, Driven, Load, Motor, driven_flow, driven_notes, loads
from gantrysim.glue.dispenser.jet import Jet, Shots, jet_notes, shots
from gantrysim.glue.dispenser.lag import Lag, NeedleLaw, driven_volumes, lagged_volumes, syringe_volumes
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.glue.dispenser.piston import Piston
from gantrysim.glue.dispenser.syringe import ATMOSPHERE, Syringe
from gantrysim.glue.dispenser.volumetric import Pump
from gantrysim.record.setpoints import Setpoints

VOLUMETRIC = "volumetric"
TIME_PRESSURE = "time-pressure"
VALVE = "valve"
PISTON = "piston"
JET = "jet"
_KINDS = (VALVE, VOLUMETRIC, PISTON, JET)
_OF_VALVES = ("pressure", "syringe", "dead_time", "closing_dead_time", "opening", "closing")  # not of driven ones
# keys that state the amount of glue, and their units
DEMANDS = {
    "flow": "mm³/s",
    "area": "mm²",
    "pressure": "kPa",
    "filament": "mm",
    "e_volume": "mm³/mm",
    "per_output": "mm³/s",
}

_LARGEST_VALUE = 1e9  # largest flow, area and pressure
_LONGEST_TIME = 4.0  # dead time, time constants, leads and advance; a larger number was typed in milliseconds [s]
_CLIPPED_SHARE = 1e-3  # share of the volume from which a clipped demand is noted
_EMPTY_SYRINGE = 1e-9  # glue that remains in an empty syringe, relative to that at the start


@dataclass(frozen=True)
class Dispenser:
    """A dispenser: a valve with a pump or a vessel, or a driven pump or piston. `Dispenser()` dispenses nothing.

    While the program dispenses, the request r(t) is a fixed flow, an area times the commanded path speed (a
    controller's speed-proportional analogue output), or a fixed pressure. A time-pressure dispenser converts a flow
    request to the pressure that drives this flow through the needle. The state y, the flow of a volumetric dispenser or
    the pressure of a time-pressure one, follows

        dy/dt = (r(t - dead_time) - y) / T,  T = opening where y rises, closing where it falls,

    solved exactly between the edges of r, which need not lie at servo ticks. With a syringe, y is the pressure at the
    valve, from which air flows into the syringe; see `Syringe`.

    The leads shift the switching of the valve, but not the speed that `area` multiplies. `advance` compensates the lag:
    with r(k) the mean request of servo period k, the controller requests

        c(k) = r(k) + advance (r(k) - r(k-1)) / period,  0 <= c <= limit.

    With advance = T, a ramp is followed without lag, and an opening makes up for the volume that the lag withholds. A
    closing cannot, because the flow is never negative: use `stop_lead`. (Klipper's pressure advance adds the same term
    to the filament.)

    The motor of a driven dispenser follows c(k) too, but it can be below zero where the motor can reverse, so that a
    closing is compensated as well; and it follows E where the program has it. Its lag is that of the glue under
    pressure: pump or piston, and needle, state it.

    Attributes:
        flow: flow rate while the dispenser is on [mm³/s].
        area: cross-section of the bead, an alternative to `flow`: the flow rate is then area times path speed [mm²].
        pressure: pressure while the dispenser is on, an alternative to `flow` with time-pressure metering [kPa].
        metering: "volumetric" (a pump or screw meters the flow) or "time-pressure" (a pressure drives the needle).
        needle: needle, also used for the bead's section and for pictures; None for the needle in the machine's model.
            Required for time-pressure metering.
        syringe: air volume and fill level for time-pressure metering; None applies the pressure directly to the glue.
        dead_time: delay from the command until the flow begins to change [s].
        closing_dead_time: the same of a valve that closes; None for `dead_time` [s].
        opening: time constant of rising flow or pressure [s].
        closing: time constant of falling flow or pressure [s].
        start_lead: lead of the valve's opening: time ahead of the program's on command [s].
        stop_lead: lead of the valve's closing: time ahead of the program's off command [s].
        advance: lag compensation: adds the request's rate of change multiplied by this time [s].
        limit: largest request: a flow rate [mm³/s], or a pressure [kPa] with time-pressure metering; inf for none.
        filament: diameter of the filament that the program feeds by E, an alternative to `flow`: the flow rate is then
            the speed of E times the filament's section [mm].
        e_volume: volume of glue for each millimetre of E, an alternative to `filament`; by default of a piston that is
            driven by E, whose stroke E then is, that of its bore [mm³/mm].
        kind: "valve" (with a pump that runs, or a pressure), "volumetric" (a driven pump: auger, progressive cavity or
            gear), "piston" (a driven syringe, or an extruder's filament) or "jet" (drops of one volume).
        pump: of a volumetric dispenser; None for the default one.
        piston: of a piston dispenser; None for the default one.
        motor: of a driven dispenser; None for one without limits.
        per_output: flow rate for each unit of the program's `flow_output`, an alternative to `flow`: an analogue output
            or PWM [mm³/s].
        jet: drops of a jet; None for the default ones.

    Raises:
        InputError: more than one of flow, area, pressure, filament and e_volume, or a value out of bounds.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": True}

    flow: float = 0.0
    area: float = 0.0
    pressure: float = 0.0
    metering: Literal["volumetric", "time-pressure"] = "volumetric"
    dead_time: float = 0.0
    opening: float = 0.0
    closing: float = 0.0
    start_lead: float = 0.0
    stop_lead: float = 0.0
    advance: float = 0.0
    limit: float = math.inf
    needle: Needle | None = None
    syringe: Syringe | None = None
    filament: float = 0.0
    e_volume: float = 0.0
    kind: Literal["valve", "volumetric", "piston", "jet"] = "valve"
    pump: Pump | None = None
    piston: Piston | None = None
    motor: Motor | None = None
    per_output: float = 0.0
    jet: Jet | None = None
    closing_dead_time: float | None = None

    def __post_init__(self) -> None:
        for name, unit in DEMANDS.items():
            at_least(name, getattr(self, name), 0, unit, _LARGEST_VALUE)
        given = [f"{name} = {getattr(self, name):g} {unit}" for name, unit in DEMANDS.items() if getattr(self, name)]
        if len(given) > 1:
            raise InputError(f"{' and '.join(given)}: only one of {', '.join(DEMANDS)} can be given")
        for name in ("dead_time", "closing_dead_time", "opening", "closing", "start_lead", "stop_lead", "advance"):
            if getattr(self, name) is not None:
                at_least(name, getattr(self, name), 0, "s", _LONGEST_TIME)
        check_one_of("metering", self.metering, (VOLUMETRIC, TIME_PRESSURE))
        check_one_of("kind of dispenser", self.kind, _KINDS)
        self._check_kind()
        if self.metering == TIME_PRESSURE and self.needle is None:
            raise InputError("metering time-pressure: needs a needle, which converts pressure to flow")
        if self.metering == VOLUMETRIC and self.syringe is not None:
            raise InputError("metering volumetric: takes no syringe; a syringe needs time-pressure")
        if self.pressure:
            if self._driven is None:
                raise InputError(f"{given[0]}: metering volumetric takes flow or area; pressure needs time-pressure")
            with np.errstate(over="ignore"):
                flow = float(self._driven.flow(self.pressure))
            if not flow <= _LARGEST_VALUE:
                raise InputError(
                    f"{given[0]}: drives {flow:g} mm³/s through the needle, must be at most {_LARGEST_VALUE:g} mm³/s"
                )
            if not flow:
                least = self._driven.yield_pressure
                raise InputError(f"{given[0]}: must be greater than the needle's yield pressure, {least:.4g} kPa")
        if not isinstance(self.limit, float) or self.limit != math.inf:
            unit = "kPa" if self.metering == TIME_PRESSURE else "mm³/s"
            limit = positive("limit", self.limit, unit)
            request = float(self._request(np.array([self.flow]))[0]) if self.flow else self.pressure
            if request > limit:
                raise InputError(f"limit = {limit:g} {unit}: must be at least the request, {request:g} {unit}")

    def _check_kind(self) -> None:
        """Check that the dispenser has no values of another kind."""
        of_kind = {"pump": VOLUMETRIC, "piston": PISTON, "jet": JET}
        for name, kind in of_kind.items():
            if getattr(self, name) is not None and self.kind != kind:
                raise InputError(f"dispenser.{name} with kind = {self.kind}: must be with kind = {kind}")
        if self.kind in (VALVE, JET) and self.motor is not None:
            raise InputError(f"dispenser.motor with kind = {self.kind}: must be with kind = volumetric or piston")
        if self.kind == VALVE:
            return
        if self.needle is None and self.kind != JET:
            raise InputError(f"dispenser of kind {self.kind}: needs a needle with its glue, through which it is driven")
        foreign = [name for name in _OF_VALVES if getattr(self, name) and (self.kind, name) != (JET, "dead_time")]
        if self.metering == TIME_PRESSURE:
            foreign.append("metering")
        if foreign:
            raise InputError(
                f"dispenser.{foreign[0]} with kind = {self.kind}: must be with kind = valve; a driven one lags by its "
                "compliance and its needle, a jet not at all"
            )

    @property
    def drive(self) -> Drive | None:
        """Pump or piston with motor and needle; None for a valve or a jet."""
        if self.kind in (VALVE, JET):
            return None
        assert self.needle is not None
        body: Pump | Piston = self.pump or Pump() if self.kind == VOLUMETRIC else self.piston or Piston()
        return Drive(body, self.motor or Motor(), self.needle)

    @property
    def _driven(self) -> Needle | None:
        """The needle through which a pressure drives the flow, None for a volumetric dispenser."""
        return self.needle if self.metering == TIME_PRESSURE else None

    @property
    def flows_at_all(self) -> bool:
        """Whether glue flows while the dispenser is on."""
        return bool(self.per_e) or any(getattr(self, name) for name in DEMANDS)

    @property
    def per_e(self) -> float:
        """Volume for each millimetre that the program feeds by E, 0 where E does not state the amount [mm³/mm]."""
        if self.kind == PISTON and not any(getattr(self, name) for name in DEMANDS):
            return (self.piston or Piston()).unit
        return self.e_volume or 0.25 * math.pi * self.filament**2

    def flow_demand(
        self, dispense: ArrayLike, speed: ArrayLike, period: float = 1.0, material: Material = NOTHING
    ) -> Floats:
        """Return the mean flow requested by the program in each servo period, without leads and lags, (n,) [mm³/s].

        Args:
            dispense: dispenser command between each tick and the next, (n,).
            speed: mean commanded path speed over that period, (n,) [mm/s].
            period: servo period, which only a program with E needs [s].
            material: what the program feeds by E.
        """
        on = np.asarray(dispense, bool)
        if self.per_e:
            return self.per_e / period * material.laid()
        if not self.flows_at_all:
            return np.zeros(on.shape)
        return np.where(on, self._demand(self._measure(np.asarray(speed, float), material)), 0.0)

    def flows(self, dispense: ArrayLike, speed: ArrayLike, period: float, material: Material = NOTHING) -> Floats:
        """Return the mean flow out of the nozzle over the period after each tick, (n,) [mm³/s].

        The dispenser is at rest before the first tick.

        Args:
            dispense: as for `flow_demand`, (n,).
            speed: as for `flow_demand`, (n,) [mm/s].
            period: servo period [s].
            material: as for `flow_demand`.

        Raises:
            InputError: a start lead longer than the time before the first dispensing, arrays not both of shape (n,),
                a speed that is negative or not finite, or no E where the dispenser follows it.
        """
        on = np.asarray(dispense, bool)
        speeds = np.asarray(speed, float)
        positive("period", period, "s")
        if on.ndim != 1 or speeds.shape != on.shape:
            raise InputError(f"speed of shape {speeds.shape}: must be that of dispense, (n,), here {on.shape}")
        if not (speeds.min(initial=0.0) >= 0 and speeds.max(initial=0.0) < math.inf):
            tick = int(np.flatnonzero(~(np.isfinite(speeds) & (speeds >= 0)))[0])
            raise InputError(f"speed = {speeds[tick]:g} mm/s at tick {tick}: must be finite and at least 0 mm/s")
        if not self.flows_at_all:
            return np.zeros(on.size)
        speeds = self._measure(speeds, material)
        if self.drive is not None:
            return self.driven(on, speeds, period, material).out.flow
        if self.kind == JET:
            return self._shots(on, speeds, period, material).flow
        if self.per_e:
            # a valve that follows E is open while E lays material
            speeds = material.laid() / period
            on = on | (speeds > 0)
        valve = self._valve(on, period)
        if not valve.opens.size:
            return np.zeros(on.size)
        state = self._at_rest()
        parts = [self._flows(block, speeds, valve, period, state) for block in blocks(on.size)]
        return np.concatenate(parts)

    def _flows(self, block: slice, speed: Floats, valve: ValveTimes, period: float, state: Floats) -> Floats:
        """Return the flow over a block of periods, given the state before it, which becomes that after it."""
        delay = self.dead_time / period
        # a tick more on either side: edges lie between ticks
        first = max(math.floor(block.start - delay) - 1, 0)
        last = min(max(math.ceil(block.stop - delay) + 1, first), speed.size)
        breaks, value = self._requests(first, last, speed, valve, period)
        value = np.clip(value, 0.0, self.limit)
        return self._lagged_flow(breaks, value, block, period, state)

    def _requests(
        self, first: int, last: int, speed: Floats, valve: ValveTimes, period: float
    ) -> tuple[Floats, Floats]:
        """Return when the request changes from one tick to another, (k + 1,) [periods], and its values, (k,)."""
        # the compensation needs the mean request of the period before
        before = first - 1 if self.advance and first else first
        ticks = np.arange(before, last + 1, dtype=np.float64)
        request = self._request(self._demand(speed[before : last + 1]))
        breaks = cuts(np.concatenate(valve), before, last)
        open_until_next = valve.is_open(breaks[:-1])
        value = np.where(open_until_next, request[breaks[:-1].astype(np.intp) - before], 0.0)
        if self.advance:
            amount = value * np.diff(breaks)
            mean = np.bincount(breaks[:-1].astype(np.intp) - before, amount, minlength=last - before)
            change = np.diff(mean, prepend=0.0)
            breaks = ticks[first - before :]
            value = (mean + self.advance / period * change)[first - before :]
        return breaks, value

    def driven(self, on: NDArray[np.bool_], speed: Floats, period: float, material: Material) -> Driven:
        """Return what a driven dispenser does; arguments as of `flows`."""
        drive = self.drive
        assert drive is not None
        return driven_flow(drive, self._command(on, speed, period, material), period, by_position=bool(self.per_e))

    def loads(
        self, dispense: ArrayLike, speed: ArrayLike, period: float, material: Material = NOTHING
    ) -> tuple[Load, ...]:
        """Return what a program asks of the motor's limits; empty without; arguments as of `flows`."""
        if self.drive is None or not self.flows_at_all:
            return ()
        measure = self._measure(np.asarray(speed, float), material)
        result = self.driven(np.asarray(dispense, bool), measure, period, material)
        return loads(self.drive, result, period, by_position=bool(self.per_e))

    def _shots(self, on: NDArray[np.bool_], speed: Floats, period: float, material: Material) -> Shots:
        """Return what a jet shoots; arguments as of `flows`."""
        command = self.per_e / period * material.laid() if self.per_e else self._command(on, speed, period, material)
        return shots(self.jet or Jet(), command, period, self.dead_time)

    def _command(self, on: NDArray[np.bool_], speed: Floats, period: float, material: Material) -> Floats:
        """Return the rate that is commanded of a motor over the period after each tick, (n,) [mm³/s]."""
        if self.per_e:
            command = self.per_e / period * material.stroke()
            if self.advance:
                command = command + self.advance / period * np.diff(command, prepend=0.0)
        else:
            breaks, value = self._requests(0, on.size, np.append(speed, 0.0), self._valve(on, period), period)
            amount = value * np.diff(breaks)
            command = np.bincount(breaks[:-1].astype(np.intp), amount, minlength=on.size).astype(np.float64)
        return np.clip(command, -self.limit, self.limit)

    def notes(
        self, dispense: ArrayLike, speed: ArrayLike, period: float, material: Material = NOTHING
    ) -> tuple[str, ...]:
        """Return notes on a run, such as when the syringe runs empty, or the motor stalls; arguments as of `flows`."""
        on = np.asarray(dispense, bool)
        speeds = self._measure(np.asarray(speed, float), material)
        if not self.flows_at_all:
            return ()
        volume = float(self.flow_demand(on, speeds, period, material).sum()) * period
        if self.drive is not None:
            return driven_notes(self.drive, self.driven(on, speeds, period, material), volume, period)
        if self.kind == JET:
            return jet_notes(self.jet or Jet(), self._shots(on, speeds, period, material), volume)
        notes = self._clipping_notes(on, speeds, period, material)
        if self.syringe is None:
            return notes
        flow = self.flows(on, speeds, period, material)
        empty = np.flatnonzero(np.cumsum(flow) * period >= (1 - _EMPTY_SYRINGE) * self.syringe.glue)
        if not empty.size:
            return notes
        return (
            *notes,
            f"the syringe of {self.syringe.glue:.4g} mm³ runs empty at t = {(empty[0] + 1) * period:.4g} s",
        )

    def _clipping_notes(
        self, on: NDArray[np.bool_], speed: Floats, period: float, material: Material
    ) -> tuple[str, ...]:
        """Return a note on what the compensation's demand below zero costs, which a valve cannot follow."""
        if not self.advance:
            return ()
        if self.per_e:
            speed = material.laid() / period
            on = on | (speed > 0)
        breaks, value = self._requests(0, on.size, np.append(speed, 0.0), self._valve(on, period), period)
        # nothing is requested after the last tick, and a request at it falls to zero there
        duration = np.diff(breaks) * period
        below = float(np.maximum(-value, 0.0) @ duration)
        total = float(value @ duration)
        if below <= _CLIPPED_SHARE * total:
            return ()
        what = "volume" if self._driven is None else "pressure times time"
        amount = f"{below:.3g} mm³, " if self._driven is None else ""
        return (
            f"dispenser.advance = {self.advance:g} s asks for less than no flow where the flow falls, which a valve "
            f"cannot do: that adds {amount}{100 * below / total:.3g} % to the program's {what}. stop_lead closes "
            "earlier; a dispenser whose motor reverses adds nothing (kind = piston or volumetric).",
        )

    def material_note(self, *, is_advanced: bool) -> str:
        """Return what becomes of the material that a program feeds by E, in a sentence.

        Args:
            is_advanced: whether the program sets pressure advance.
        """
        if self.per_e and self.kind == JET:
            return f"E's volume is shot in drops, {self.per_e:.4g} mm³ for each mm, without its retractions."
        if self.per_e and self.kind != VALVE:
            advance = ", with the program's pressure advance" if is_advanced else ""
            moved = "plunger" if self.kind == PISTON else "pump"
            return f"E drives the dispenser's {moved}, {self.per_e:.4g} mm³ for each mm{advance}."
        if not self.per_e:
            name = next((name for name in DEMANDS if getattr(self, name)), "")
            amount = f"dispenser.{name} = {getattr(self, name):g} {DEMANDS[name]}" if name else "nothing"
            return (
                f"E's amount of material is not laid: {amount} is; "
                f"{f'--set dispenser.{name}=0 ' if name else ''}--set dispenser.filament=1.75 lays E's volume."
            )
        advance = (
            "; the program's pressure advance moves an extruder's motor and has no effect here, dispenser.advance "
            "compensates the valve's lag"
            if is_advanced
            else ""
        )
        return (
            f"The dispenser is a valve: it lays E's volume, {self.per_e:.4g} mm³ for each mm, through its lag, and "
            f"cannot pull back, so that retractions only close it{advance}."
        )

    def open_share(self, dispense: ArrayLike, period: float) -> Floats:
        """Return the fraction of the period after each tick in which the valve is open, (n,); arguments as `flows`."""
        on = np.asarray(dispense, bool)
        valve = self._valve(on, period)
        edges = np.unique(np.clip(np.concatenate([np.arange(on.size + 1.0), *valve]), 0, on.size))
        open_for = np.where(valve.is_open(edges[:-1]), np.diff(edges), 0.0)
        return np.bincount(edges[:-1].astype(np.intp), open_for, minlength=on.size).astype(np.float64)

    def check(self, setpoints: Setpoints) -> None:
        """Raise InputError where the start lead is longer than the time before dispensing, or E is missing."""
        if self.per_e and setpoints.extrusion is None:
            raise without_e()
        if self.per_output and setpoints.analogue is None:
            raise without_output()
        self._valve(setpoints.dispense, setpoints.period)

    def held_back(self, setpoints: Setpoints) -> Setpoints:
        """Return the setpoints, delayed if the start lead is longer than the time before the first dispensing."""
        return setpoints.wait(max(self.start_lead - setpoints.time_before_glue, 0.0))

    def _demand(self, speed: Floats) -> Floats:
        """Return the flow while the dispenser is on, at speeds of path or E, or set points, of their shape [mm³/s]."""
        if self.per_e:
            return self.per_e * speed
        if self.area or self.per_output:
            return (self.area or self.per_output) * speed
        if self._driven is not None and self.pressure:
            return np.full(speed.shape, float(self._driven.flow(self.pressure)))
        return np.full(speed.shape, self.flow)

    def _measure(self, speed: Floats, material: Material) -> Floats:
        """Return what the flow is proportional to: the path speed, or the set point of an output, (n,)."""
        return material.set_point() if self.per_output else speed

    def _request(self, flow: Floats) -> Floats:
        """Return the request for a flow: the flow itself, or the pressure for it [kPa]."""
        return flow if self._driven is None else self._driven.pressure(flow)

    def _valve(self, on: NDArray[np.bool_], period: float) -> ValveTimes:
        # `dead_time` delays the request as a whole
        return ValveTimes.of(on, period, self.start_lead, self.stop_lead + self.dead_time - self.closing_delay)

    @property
    def closing_delay(self) -> float:
        """Dead time of the valve's closing [s]."""
        return self.dead_time if self.closing_dead_time is None else self.closing_dead_time

    def _at_rest(self) -> Floats:
        """Return the state of the lag before the first tick, see `gantrysim.glue.dispenser.lag`."""
        syringe = self.syringe
        return np.zeros(1) if syringe is None else np.array([0.0, ATMOSPHERE, syringe.glue, syringe.air])

    def _lagged_flow(self, breaks: Floats, value: Floats, block: slice, period: float, state: Floats) -> Floats:
        """Return the mean flow over each period of a block for a request of `value` between `breaks` [periods]."""
        delayed = on_ticks(breaks + self.dead_time / period)
        # nothing is requested before the first tick
        if breaks[0] == 0:
            delayed = np.concatenate([[0.0], delayed])
            value = np.concatenate([[0.0], value])
        edges = cuts(delayed, block.start, block.stop)
        request_index = np.minimum(np.searchsorted(delayed, edges[:-1], "right") - 1, value.size - 1)
        volume = self._volumes(period * np.diff(edges), value[request_index], state)
        period_index = edges[:-1].astype(np.intp) - block.start
        return np.bincount(period_index, volume, minlength=block.stop - block.start) / period

    def _volumes(self, duration: Floats, request: Floats, state: Floats) -> Floats:
        """Return the volumes over pieces of constant request, (k,) [mm³]; the state becomes that after them."""
        lag = Lag(self.opening, self.closing)
        needle = self._driven
        if needle is None:
            return lagged_volumes(duration, request, lag, state)
        law = NeedleLaw(needle.conductance, needle.yield_pressure, 1 / needle.index, *needle.shape)
        if self.syringe is None:
            return needle.conductance * driven_volumes(duration, request, lag, law, state)
        air = (self.syringe.rate, self.syringe.critical_ratio)
        return syringe_volumes(duration, request, lag, law, air, state)
