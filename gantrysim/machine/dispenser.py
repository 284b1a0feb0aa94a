"""The dispenser: from the program's command to the glue that leaves the nozzle.

    command --lead--> valve --compensation--> request --dead time--> lag --needle--> flow

Its time constants are told apart by the direction in which the flow, or the pressure behind the needle, moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.errors import InputError, at_least, positive, unknown
from gantrysim.jit import jit
from gantrysim.machine.needle import Needle

VOLUMETRIC, TIME_PRESSURE = "volumetric", "time-pressure"

_MOST_PIECES = 40  # time constants after which a lag is over
_MOST = 1e9  # of flow, area and pressure
_EDGE = 1e-9  # of a servo period, within which an edge is at the tick


@dataclass(frozen=True)
class Dispenser:
    """A dispenser with valve and pump or pressure vessel; `Dispenser()` lays nothing.

    While the program asks for glue the request r(t) is a fixed flow, an area times the commanded path speed (as a
    controller with an analogue speed output asks for), or a fixed pressure. With a time-pressure dispenser a flow is
    asked for by the pressure that drives it through the needle. The state y, the flow of a volumetric dispenser or
    the pressure of a time-pressure one, follows with

        dy/dt = (r(t - dead_time) - y) / T,  T = opening where y rises, closing where it falls,

    solved exactly between the edges of r, which lie at any time and not at the servo's ticks alone.

    The leads move the valve against the program's on and off, not the speed that `area` multiplies. With `advance`
    the controller asks at every servo tick k for

        c(k) = r(k) + advance (r(k) - r(k-1)) / period,  0 <= c <= limit,

    r(k) being the mean over the period. With advance = T a ramp is followed without lag, and after an opening the
    volume that the lag withheld is made good; after a closing nothing can be, as no flow is below 0: that takes
    `stop_lead`. (Klipper's pressure advance adds the same term to the filament's way.)

    Attributes:
        flow: asked for while the dispenser is on [mm³/s].
        area: of the section that is asked for, instead of `flow`: the flow is area * path speed [mm²].
        pressure: asked for instead of a flow, of a time-pressure dispenser [kPa].
        metering: "volumetric" (a pump or screw meters the flow) or "time-pressure" (a pressure drives the needle).
        needle: of a time-pressure dispenser.
        dead_time: from the command to the first change [s].
        opening: time constant T of a rising flow or pressure [s].
        closing: time constant T of a falling one [s].
        start_lead: of the valve's opening before the program's on [s].
        stop_lead: of its closing before the program's off [s].
        advance: compensation of the lag [s].
        limit: largest command, of the flow [mm³/s] or of a time-pressure dispenser's pressure [kPa]; inf for none.

    Raises:
        InputError: more than one of flow, area and pressure, or a value out of its bounds.
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

    def __post_init__(self) -> None:
        asked = {"flow": "mm³/s", "area": "mm²", "pressure": "kPa"}
        for name, unit in asked.items():
            if at_least(name, getattr(self, name), 0, unit) > _MOST:
                raise InputError(f"{name} = {getattr(self, name):g} {unit}: must be at most {_MOST:g} {unit}")
        given = [f"{name} = {getattr(self, name):g} {unit}" for name, unit in asked.items() if getattr(self, name)]
        if len(given) > 1:
            raise InputError(f"{' and '.join(given)}: only one of flow, area and pressure can be asked for")
        for name in ("dead_time", "opening", "closing", "start_lead", "stop_lead", "advance"):
            at_least(name, getattr(self, name), 0, "s")
        if self.metering not in (VOLUMETRIC, TIME_PRESSURE):
            raise unknown("metering", self.metering, (VOLUMETRIC, TIME_PRESSURE))
        if self.metering == TIME_PRESSURE and self.needle is None:
            raise InputError("metering time-pressure: needs a needle, which turns pressure into flow")
        if self.metering == VOLUMETRIC and self.needle is not None:
            raise InputError("metering volumetric: meters the flow whatever the needle; a needle needs time-pressure")
        if self.pressure and self.metering == VOLUMETRIC:
            raise InputError(f"{given[0]}: metering volumetric meters flow or area; pressure needs time-pressure")
        if self.pressure and self.needle is not None:
            with np.errstate(over="ignore"):
                flow = float(self.needle.flow(self.pressure))
            if not flow <= _MOST:
                raise InputError(
                    f"{given[0]}: drives {flow:g} mm³/s through the needle, must be at most {_MOST:g} mm³/s"
                )
        if self.limit != math.inf:
            limit = positive("limit", self.limit, self._unit)
            most = float(self._request(np.array([self.flow]))[0]) if self.flow else self.pressure
            if most > limit:
                raise InputError(
                    f"limit = {limit:g} {self._unit}: must be at least {most:g} {self._unit}, what is asked for"
                )

    @property
    def _unit(self) -> str:
        return "kPa" if self.metering == TIME_PRESSURE else "mm³/s"

    def flow_demand(self, dispense: ArrayLike, speed: ArrayLike) -> Floats:
        """Return the flow that the program asks for, without leads and lags, over each tick's period, (n,) [mm³/s].

        Args:
            dispense: dispenser command from each tick to the next, (n,).
            speed: commanded path speed, the mean over that period, (n,) [mm/s].
        """
        on = np.asarray(dispense, bool)
        return np.where(on, self._asked_flow(np.asarray(speed, float)), 0.0)

    def flows(self, dispense: ArrayLike, speed: ArrayLike, period: float) -> Floats:
        """Return the flow out of the nozzle, the mean over the period that follows each tick, (n,) [mm³/s].

        Before the first tick the dispenser is at rest; after the last nothing is said.

        Args:
            dispense: dispenser command from each tick to the next, (n,).
            speed: commanded path speed, the mean over that period, (n,) [mm/s].
            period: servo period [s].

        Raises:
            InputError: a start lead longer than the time before the first dispensing, or arrays that are not of one
                shape, (n,), or not of finite numbers.
        """
        on, speeds = np.asarray(dispense, bool), np.asarray(speed, float)
        positive("period", period, "s")
        if on.ndim != 1 or speeds.shape != on.shape:
            raise InputError(f"speed of shape {speeds.shape}: must be that of dispense, (n,), here {on.shape}")
        if not np.isfinite(speeds).all() or (speeds < 0).any():
            wrong = int(np.flatnonzero(~(np.isfinite(speeds) & (speeds >= 0)))[0])
            raise InputError(f"speed = {speeds[wrong]:g} mm/s at tick {wrong}: must be finite and at least 0 mm/s")
        begins, ends = self._valve(on, period)
        if not begins.size or not (self.flow or self.area or self.pressure):
            return np.zeros(on.size)
        request = self._request(self._asked_flow(speeds))
        ticks = np.arange(on.size + 1, dtype=np.float64)
        # breaks: where the request changes, in periods; gate: whether the valve is open from each to the next
        breaks = np.unique(np.concatenate([ticks, begins, ends]))
        breaks = breaks[(breaks >= 0) & (breaks <= on.size)]
        # leads may bring two stretches together, or an end before its beginning
        gate = np.searchsorted(begins, breaks[:-1], "right") > np.searchsorted(ends, breaks[:-1], "right")
        value = np.where(gate, request[breaks[:-1].astype(np.intp)], 0.0)
        if self.advance:
            amount = np.concatenate([[0.0], np.cumsum(value * np.diff(breaks))])
            mean = np.diff(np.interp(ticks, breaks, amount))
            breaks, value = ticks, mean + self.advance / period * np.diff(mean, prepend=0.0)
        value = np.clip(value, 0.0, self.limit)
        return self._lagged(breaks, value, on.size, period)

    def check(self, setpoints: Setpoints) -> None:
        """Raise InputError where the start lead is longer than the time before the first dispensing."""
        self._valve(setpoints.dispense, setpoints.period)

    def held_back(self, setpoints: Setpoints) -> Setpoints:
        """Return the setpoints, held back where the start lead is longer than what they wait before the first glue."""
        first = np.flatnonzero(setpoints.dispense)
        if not first.size:
            return setpoints
        return setpoints.wait(max(self.start_lead - float(first[0]) * setpoints.period, 0.0))

    def _asked_flow(self, speed: Floats) -> Floats:
        if self.area:
            return self.area * speed
        flow = self.flow if self.needle is None or not self.pressure else float(self.needle.flow(self.pressure))
        return np.full(speed.shape, flow)

    def _request(self, flow: Floats) -> Floats:
        """What is asked of the valve for a flow: the same, or the pressure for it [kPa]."""
        if self.metering == VOLUMETRIC or self.needle is None:
            return flow
        return self.needle.pressure(flow)

    def _valve(self, on: NDArray[np.bool_], period: float) -> tuple[Floats, Floats]:
        """Return when the valve opens and closes, the leads taken off, (k,) each, in periods, ascending."""
        edges = np.diff(np.concatenate([[0], on.astype(np.int8), [0]]))
        begins = np.flatnonzero(edges == 1).astype(np.float64) - self.start_lead / period
        ends = np.flatnonzero(edges == -1).astype(np.float64) - self.stop_lead / period
        if begins.size and begins[0] < -_EDGE:
            first = period * (begins[0] + self.start_lead / period)
            raise InputError(
                f"start_lead = {self.start_lead:g} s: must be at most {first:g} s, the time before the first "
                "dispensing; Setpoints.wait holds the motion back"
            )
        begins, ends = _on_ticks(begins), _on_ticks(ends)
        if on.size and on[-1]:
            ends[-1] = on.size  # where the record ends the program has not yet closed the valve
        return begins, ends

    def _lagged(self, breaks: Floats, value: Floats, ticks: int, period: float) -> Floats:
        """Return the mean flow over each period, given a request of `value` between `breaks`, in periods."""
        delay = self.dead_time / period
        later = np.concatenate([[0.0], _on_ticks(breaks + delay)])
        value = np.concatenate([[0.0], value])
        edges = np.unique(np.concatenate([later, np.arange(ticks + 1, dtype=np.float64)]))
        edges = edges[edges <= ticks]
        which = np.minimum(np.searchsorted(later, edges[:-1], "right") - 1, value.size - 1)
        duration = period * np.diff(edges)
        if self.metering == VOLUMETRIC or self.needle is None:
            volume = _volumes(duration, value[which], self.opening, self.closing)
        else:
            power = 1 / self.needle.index
            volume = self.needle.conductance * _power_volumes(
                duration, value[which], self.opening, self.closing, power, *_gauss()
            )
        total = np.bincount(edges[:-1].astype(np.intp), volume, minlength=ticks)
        return total / period


def _on_ticks(time: Floats) -> Floats:
    """Return times in periods, those that rounding has put beside a tick at the tick."""
    near = np.round(time)
    return np.where(np.abs(time - near) < _EDGE * np.maximum(1.0, np.abs(near) * 1e-3), near, time)


def _gauss() -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss' quadrature over 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    return 0.5 * (nodes + 1), 0.5 * weights


@jit
def _volumes(duration: Floats, request: Floats, opening: float, closing: float) -> Floats:
    """Integrals of the first-order lag over pieces of constant request, (k,)."""
    volume = np.empty(duration.size)
    y = 0.0
    for k in range(duration.size):
        r, h = request[k], duration[k]
        constant = opening if r > y else closing
        if constant > 0.0:
            left = -math.expm1(-h / constant)  # share of the way to r
            volume[k] = r * h + (y - r) * constant * left
            y += (r - y) * left
        else:
            volume[k] = r * h
            y = r
    return volume


@jit
def _power_volumes(
    duration: Floats,
    request: Floats,
    opening: float,
    closing: float,
    power: float,
    nodes: Floats,
    weights: Floats,
) -> Floats:
    """Integrals of the lagged state to a power over pieces of constant request, (k,)."""
    volume = np.empty(duration.size)
    y = 0.0
    for k in range(duration.size):
        r, h = request[k], duration[k]
        constant = opening if r > y else closing
        if constant <= 0.0 or y == r:
            volume[k] = h * r**power
            y = r
            continue
        # the quadrature takes a time constant at a time; what is left after many is at the request
        moving = min(h, _MOST_PIECES * constant)
        pieces = math.ceil(moving / constant)
        step = moving / pieces
        total = (h - moving) * r**power
        for piece in range(pieces):
            for i in range(nodes.size):
                state = r + (y - r) * math.exp(-(piece + nodes[i]) * step / constant)
                total += step * weights[i] * max(state, 0.0) ** power
        volume[k] = total
        y += (r - y) * -math.expm1(-h / constant)
    return volume
