"""Dispenser: from the program's command to the flow out of the nozzle.

    command --leads--> valve --compensation--> request --dead time--> lag --syringe--> needle--> flow

Rising and falling flow, or pressure, have separate time constants. Syringe and needle turn pressure into flow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import blocks
from gantrysim.base.errors import InputError, at_least, positive, unknown
from gantrysim.dispenser.lag import driven_volumes, lagged_volumes, syringe_volumes
from gantrysim.dispenser.needle import Needle
from gantrysim.dispenser.syringe import ATMOSPHERE, Syringe
from gantrysim.record.setpoints import Setpoints

VOLUMETRIC = "volumetric"
TIME_PRESSURE = "time-pressure"

_MOST = 1e9  # largest flow, area and pressure
_LONGEST = 1e3  # dead time, time constants, leads and advance [s]
_EMPTY = 1e-9  # rest in an empty syringe, of what it held
_EDGE = 1e-9  # distance from a tick within which an edge is at the tick [servo periods]


@dataclass(frozen=True)
class Dispenser:
    """A dispenser: a valve with a pump or a pressure vessel. `Dispenser()` dispenses nothing.

    While the program dispenses, the request r(t) is a fixed flow, an area times the commanded path speed (a
    controller's speed-proportional analogue output), or a fixed pressure. A time-pressure dispenser turns a flow
    demand into the pressure that drives it through the needle. The state y, the flow of a volumetric dispenser or the
    pressure of a time-pressure one, follows

        dy/dt = (r(t - dead_time) - y) / T,  T = opening where y rises, closing where it falls,

    solved exactly between the edges of r, which need not lie at servo ticks. With a syringe y is the pressure at the
    valve, from which air flows into the syringe; see `Syringe`.

    The leads shift the valve against the program's on and off, not the speed that `area` multiplies. `advance`
    compensates the lag: with r(k) the mean request of servo period k, the controller requests

        c(k) = r(k) + advance (r(k) - r(k-1)) / period,  0 <= c <= limit.

    With advance = T a ramp is followed without lag, and an opening recovers the volume that the lag withheld. A closing
    cannot, as no flow is negative: use `stop_lead`. (Klipper's pressure advance adds the same term to the filament.)

    Attributes:
        flow: flow while the dispenser is on [mm³/s].
        area: cross-section of the bead, an alternative to `flow`: the flow is area * path speed [mm²].
        pressure: pressure while the dispenser is on, an alternative to `flow` with time-pressure metering [kPa].
        metering: "volumetric" (a pump or screw meters the flow) or "time-pressure" (a pressure drives the needle).
        needle: the needle, also that of the bead's section and of pictures; None for the one that the machine's model
            draws. A time-pressure dispenser must have one.
        syringe: air volume and fill of a time-pressure dispenser; None for pressure that acts on the glue at once.
        dead_time: time from the command to the first change [s].
        opening: time constant T of rising flow or pressure [s].
        closing: time constant T of falling flow or pressure [s].
        start_lead: time by which the valve opens before the program's on [s].
        stop_lead: time by which the valve closes before the program's off [s].
        advance: compensation of the lag [s].
        limit: largest request, a flow [mm³/s] or with time-pressure metering a pressure [kPa]; inf for none.

    Raises:
        InputError: more than one of flow, area and pressure, or a value out of bounds.
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

    def __post_init__(self) -> None:
        demands = {"flow": "mm³/s", "area": "mm²", "pressure": "kPa"}
        for name, unit in demands.items():
            at_least(name, getattr(self, name), 0, unit, _MOST)
        given = [f"{name} = {getattr(self, name):g} {unit}" for name, unit in demands.items() if getattr(self, name)]
        if len(given) > 1:
            raise InputError(f"{' and '.join(given)}: only one of flow, area and pressure can be given")
        for name in ("dead_time", "opening", "closing", "start_lead", "stop_lead", "advance"):
            at_least(name, getattr(self, name), 0, "s", _LONGEST)
        if self.metering not in (VOLUMETRIC, TIME_PRESSURE):
            raise unknown("metering", self.metering, (VOLUMETRIC, TIME_PRESSURE))
        if self.metering == TIME_PRESSURE and self.needle is None:
            raise InputError("metering time-pressure: needs a needle, which turns pressure into flow")
        if self.metering == VOLUMETRIC and self.syringe is not None:
            raise InputError("metering volumetric: takes no syringe; a syringe needs time-pressure")
        if self.pressure:
            if self._driven is None:
                raise InputError(f"{given[0]}: metering volumetric takes flow or area; pressure needs time-pressure")
            with np.errstate(over="ignore"):
                flow = float(self._driven.flow(self.pressure))
            if not flow <= _MOST:
                raise InputError(
                    f"{given[0]}: drives {flow:g} mm³/s through the needle, must be at most {_MOST:g} mm³/s"
                )
            if not flow:
                least = self._driven.yield_pressure
                raise InputError(f"{given[0]}: must be greater than the needle's yield pressure, {least:.4g} kPa")
        if self.limit != math.inf:
            unit = "kPa" if self.metering == TIME_PRESSURE else "mm³/s"
            limit = positive("limit", self.limit, unit)
            request = float(self._request(np.array([self.flow]))[0]) if self.flow else self.pressure
            if request > limit:
                raise InputError(f"limit = {limit:g} {unit}: must be at least the request, {request:g} {unit}")

    @property
    def _driven(self) -> Needle | None:
        """The needle through which a pressure drives the flow, None for a volumetric dispenser."""
        return self.needle if self.metering == TIME_PRESSURE else None

    @property
    def _flows_at_all(self) -> bool:
        return bool(self.flow or self.area or self.pressure)

    def flow_demand(self, dispense: ArrayLike, speed: ArrayLike) -> Floats:
        """Return the flow demanded by the program, without leads and lags, over each servo period, (n,) [mm³/s].

        Args:
            dispense: dispenser command from each tick to the next, (n,).
            speed: mean commanded path speed over that period, (n,) [mm/s].
        """
        on = np.asarray(dispense, bool)
        return np.where(on, self._demand(np.asarray(speed, float)), 0.0) if self._flows_at_all else np.zeros(on.shape)

    def flows(self, dispense: ArrayLike, speed: ArrayLike, period: float) -> Floats:
        """Return the mean flow out of the nozzle over the period after each tick, (n,) [mm³/s].

        The dispenser is at rest before the first tick.

        Args:
            dispense: as for `flow_demand`, (n,).
            speed: as for `flow_demand`, (n,) [mm/s].
            period: servo period [s].

        Raises:
            InputError: a start lead longer than the time before the first dispensing, arrays not both of shape (n,),
                or a speed that is negative or not finite.
        """
        on = np.asarray(dispense, bool)
        speeds = np.asarray(speed, float)
        positive("period", period, "s")
        if on.ndim != 1 or speeds.shape != on.shape:
            raise InputError(f"speed of shape {speeds.shape}: must be that of dispense, (n,), here {on.shape}")
        if not (speeds.min(initial=0.0) >= 0 and speeds.max(initial=0.0) < math.inf):
            wrong = int(np.flatnonzero(~(np.isfinite(speeds) & (speeds >= 0)))[0])
            raise InputError(f"speed = {speeds[wrong]:g} mm/s at tick {wrong}: must be finite and at least 0 mm/s")
        if not self._flows_at_all:
            return np.zeros(on.size)
        begins, ends = self._valve(on, period)
        if not begins.size:
            return np.zeros(on.size)
        state = self._at_rest()
        parts = [self._flows(block, on.size, speeds, (begins, ends), period, state) for block in blocks(on.size)]
        return np.concatenate(parts)

    def _flows(
        self, block: slice, ticks: int, speed: Floats, valve: tuple[Floats, Floats], period: float, state: Floats
    ) -> Floats:
        """Return the flow over a block of periods, given the state before it, which becomes that after it."""
        late = self.dead_time / period
        first = max(math.floor(block.start - late) - 1, 0)
        last = min(max(math.ceil(block.stop - late) + 1, first), ticks)
        breaks, value = self._requests(first, last, speed, valve, period)
        return self._lagged(breaks, value, block, period, state)

    def _requests(
        self, first: int, last: int, speed: Floats, valve: tuple[Floats, Floats], period: float
    ) -> tuple[Floats, Floats]:
        """Return when the request changes from one tick to another, (k + 1,) [periods], and its values, (k,)."""
        begins, ends = valve
        before = first - 1 if self.advance and first else first
        ticks = np.arange(before, last + 1, dtype=np.float64)
        request = self._request(self._demand(speed[before : last + 1]))
        # breaks: times at which the request changes [periods]; gate: whether the valve is open until the next break
        edges = [edge[(edge >= before) & (edge <= last)] for edge in valve]
        breaks = np.unique(np.concatenate([ticks, *edges]))
        # leads may merge two stretches, or put an end before its beginning
        gate = np.searchsorted(begins, breaks[:-1], "right") > np.searchsorted(ends, breaks[:-1], "right")
        value = np.where(gate, request[breaks[:-1].astype(np.intp) - before], 0.0)
        if self.advance:
            amount = value * np.diff(breaks)
            mean = np.bincount(breaks[:-1].astype(np.intp) - before, amount, minlength=last - before)
            change = np.diff(mean, prepend=0.0)
            breaks = ticks[first - before :]
            value = (mean + self.advance / period * change)[first - before :]
        return breaks, np.clip(value, 0.0, self.limit)

    def notes(self, flow: Floats, period: float) -> tuple[str, ...]:
        """Return what to tell of a run with the flow of each period [mm³/s]: whether the syringe runs empty."""
        if self.syringe is None:
            return ()
        empty = np.flatnonzero(np.cumsum(flow) * period >= (1 - _EMPTY) * self.syringe.glue)
        if not empty.size:
            return ()
        return (f"the syringe of {self.syringe.glue:.4g} mm³ runs empty at t = {(empty[0] + 1) * period:.4g} s",)

    def open_share(self, dispense: ArrayLike, period: float) -> Floats:
        """Return the share of the period after each tick for which the valve is open, (n,); arguments as of `flows`."""
        on = np.asarray(dispense, bool)
        begins, ends = self._valve(on, period)
        edges = np.unique(np.concatenate([np.arange(on.size + 1, dtype=np.float64), begins, ends]))
        edges = edges[(edges >= 0) & (edges <= on.size)]
        # as in `flows`
        gate = np.searchsorted(begins, edges[:-1], "right") > np.searchsorted(ends, edges[:-1], "right")
        open_for = np.where(gate, np.diff(edges), 0.0)
        return np.bincount(edges[:-1].astype(np.intp), open_for, minlength=on.size).astype(np.float64)

    def check(self, setpoints: Setpoints) -> None:
        """Raise InputError where the start lead is longer than the time before the first dispensing."""
        self._valve(setpoints.dispense, setpoints.period)

    def held_back(self, setpoints: Setpoints) -> Setpoints:
        """Return the setpoints, delayed if the start lead is longer than the time before the first dispensing."""
        first = np.flatnonzero(setpoints.dispense)
        if not first.size:
            return setpoints
        return setpoints.wait(max(self.start_lead - float(first[0]) * setpoints.period, 0.0))

    def _demand(self, speed: Floats) -> Floats:
        """Return the flow while the dispenser is on, of the speed's shape [mm³/s]."""
        if self.area:
            return self.area * speed
        flow = self.flow if self._driven is None or not self.pressure else float(self._driven.flow(self.pressure))
        return np.full(speed.shape, flow)

    def _request(self, flow: Floats) -> Floats:
        """Return the request for a flow: the flow itself, or the pressure for it [kPa]."""
        return flow if self._driven is None else self._driven.pressure(flow)

    def _valve(self, on: NDArray[np.bool_], period: float) -> tuple[Floats, Floats]:
        """Return when the valve opens and closes, with the leads, (k,) each, ascending [periods]."""
        changes = np.flatnonzero(on[1:] != on[:-1]) + 1
        first = [0] if on.size and on[0] else []
        last = [on.size] if on.size and on[-1] else []
        edges = np.concatenate([first, changes, last]).astype(np.float64)
        begins = edges[::2] - self.start_lead / period
        ends = edges[1::2] - self.stop_lead / period
        if begins.size and begins[0] < -_EDGE:
            before = period * (begins[0] + self.start_lead / period)
            raise InputError(
                f"start_lead = {self.start_lead:g} s: must be at most {before:g} s, the time before the first "
                "dispensing; Setpoints.wait holds the motion back"
            )
        begins = _on_ticks(begins)
        ends = _on_ticks(ends)
        if on.size and on[-1]:
            ends[-1] = on.size  # the program has not closed the valve by the end of the record
        return begins, ends

    def _at_rest(self) -> Floats:
        """Return the state of the lag before the first tick, see `gantrysim.dispenser.lag`."""
        if self.syringe is None:
            return np.zeros(1)
        return np.array([0.0, ATMOSPHERE, self.syringe.glue, self.syringe.air])

    def _lagged(self, breaks: Floats, value: Floats, block: slice, period: float, state: Floats) -> Floats:
        """Return the mean flow over each period of a block for a request of `value` between `breaks` [periods]."""
        later = _on_ticks(breaks + self.dead_time / period)
        if breaks[0] == 0:  # none before
            later = np.concatenate([[0.0], later])
            value = np.concatenate([[0.0], value])
        edges = np.unique(np.concatenate([later, np.arange(block.start, block.stop + 1, dtype=np.float64)]))
        edges = edges[(edges >= block.start) & (edges <= block.stop)]
        which = np.minimum(np.searchsorted(later, edges[:-1], "right") - 1, value.size - 1)
        lag = (period * np.diff(edges), value[which], self.opening, self.closing)
        needle = self._driven
        syringe = self.syringe
        if needle is None:
            volume = lagged_volumes(*lag, state)
        else:
            law = (needle.yield_pressure, 1 / needle.index, *needle.shape)
            if syringe is None:
                volume = needle.conductance * driven_volumes(*lag, law, state)
            else:
                air = (syringe.rate, syringe.critical_ratio)
                volume = syringe_volumes(*lag, needle.conductance, law, air, state)
        return (
            np.bincount(edges[:-1].astype(np.intp) - block.start, volume, minlength=block.stop - block.start) / period
        )


def _on_ticks(time: Floats) -> Floats:
    """Return times in periods, snapped to a tick where they are off it by rounding alone."""
    near = np.round(time)
    return np.where(np.abs(time - near) < _EDGE * np.maximum(1.0, np.abs(near) * 1e-3), near, time)
