"""Compiled integrals of a lagged flow or pressure, over pieces of constant request."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.glue.dispenser.syringe import ATMOSPHERE, exchanged_pressure

_MOST_PIECES = 40  # time constants after which a lag has settled
_STEP_OF_AIR = 0.05  # largest step in a syringe, relative to its time constant
_STEP_OF_LAG = 0.1  # largest step in a syringe, relative to the valve's time constant
_MOST_STEPS = 100  # in a syringe between two changes of the request
_SETTLED_PRESSURE = 1e-9  # deviation of a settled pressure, relative to the pressure
_GAUSS = np.polynomial.legendre.leggauss(6)
# from 0 to 1
_NODES = 0.5 * (_GAUSS[0] + 1)
_WEIGHTS = 0.5 * _GAUSS[1]


class Lag(NamedTuple):
    """Time constants of the lag [s].

    Attributes:
        opening: of a rise.
        closing: of a fall.
    """

    opening: float
    closing: float


class NeedleLaw(NamedTuple):
    """Flow of a needle over pressure, with the letters of `Needle`.

    Attributes:
        conductance: C [mm³/s].
        yield_pressure: p_y [kPa].
        power: 1/n.
        a, b: constants of the index.
    """

    conductance: float
    yield_pressure: float
    power: float
    a: float
    b: float


def lagged_volumes(duration: Floats, request: Floats, lag: Lag, state: Floats) -> Floats:
    """Return the integrals of the first-order lag over pieces of constant request, (k,).

    Args:
        duration: of the pieces, (k,).
        request: in each, (k,).
        lag: time constants.
        state: the lagged value before the first piece, (1,), replaced by that after the last.
    """
    volume = np.empty(duration.size)
    _lag(duration, request, lag, state, volume)
    return volume


@jit
def _lag(duration: Floats, request: Floats, lag: Lag, state: Floats, volume: Floats) -> None:
    """Write the volumes; arguments as of `lagged_volumes`."""
    y = state[0]
    for k in range(duration.size):
        r = request[k]
        h = duration[k]
        constant = lag.opening if r > y else lag.closing
        if constant > 0.0:
            share = -math.expm1(-h / constant)  # of the step towards r
            volume[k] = r * h + (y - r) * constant * share
            y += (r - y) * share
        else:
            volume[k] = r * h
            y = r
    state[0] = y


@jit
def needle_flow(pressure: float, law: NeedleLaw) -> float:
    """Return Q / C at a pressure of at least 0 [kPa]."""
    p_y = law.yield_pressure
    if p_y == 0.0:
        return pressure**law.power
    x = pressure - p_y
    if x <= 0.0:
        return 0.0
    # `Needle.flow` with phi = p_y / p and 1 - phi = x / p
    return x ** (law.power + 1.0) * (x * x + 2.0 * law.a * x * p_y + law.b * p_y * p_y) / pressure**3


@jit
def driven_volumes(duration: Floats, request: Floats, lag: Lag, law: NeedleLaw, state: Floats) -> Floats:
    """Return the integrals of Q / C at the lagged pressure over pieces of constant request, (k,).

    Arguments as of `lagged_volumes`, request and state in kPa; a change of pressure is integrated by Gauss and
    Legendre, six points per time constant.
    """
    volume = np.empty(duration.size)
    p_y = law.yield_pressure
    y = state[0]
    for k in range(duration.size):
        r = request[k]
        h = duration[k]
        constant = lag.opening if r > y else lag.closing
        if constant <= 0.0 or y == r:
            volume[k] = h * needle_flow(r, law)
            y = r
            continue
        # begin and end of the flow, which the yield stress stops
        begin = 0.0
        end = h
        if max(y, r) <= p_y:
            begin = h
        elif y < p_y:
            begin = min(constant * math.log((r - y) / (r - p_y)), h)
        elif r < p_y:
            end = min(constant * math.log((y - r) / (p_y - r)), h)
        # one quadrature per time constant; after many the state is at the request
        moving = max(min(end, _MOST_PIECES * constant) - begin, 0.0)
        total = (end - begin - moving) * needle_flow(r, law)
        pieces = math.ceil(moving / constant)
        step = moving / max(pieces, 1)
        for piece in range(pieces):
            for i in range(_NODES.size):
                value = r + (y - r) * math.exp(-(begin + (piece + _NODES[i]) * step) / constant)
                total += step * _WEIGHTS[i] * needle_flow(max(value, 0.0), law)
        volume[k] = total
        y += (r - y) * -math.expm1(-h / constant)
    state[0] = y
    return volume


@jit
def syringe_volumes(
    duration: Floats, request: Floats, lag: Lag, law: NeedleLaw, air_supply: tuple[float, float], state: Floats
) -> Floats:
    """Return the volumes of glue over pieces of constant request, (k,) [mm³].

    In a step the air first follows the valve for half of it, then makes room for the glue, then follows for the other
    half; the glue's volume is Simpson's over the three pressures.

    Args:
        duration: of the pieces, (k,) [s].
        request: pressure, (k,) [kPa].
        lag: time constants of the valve.
        law: of the needle.
        air_supply: C p0 [mm³/s] and critical pressure ratio b of the syringe.
        state: before the first piece, replaced by that after the last: valve pressure and absolute pressure of the air
            [kPa], volumes of glue and air [mm³], (4,).
    """
    rate, ratio = air_supply
    conductance = law.conductance
    volume = np.zeros(duration.size)
    y, pressure, glue, air = state
    for k in range(duration.size):
        r = request[k]
        h = duration[k]
        valve_constant = lag.opening if r > y else lag.closing
        if valve_constant <= 0.0 or abs(y - r) <= _SETTLED_PRESSURE * pressure:
            y = r
        steps_needed = 1.0
        if y != r:
            steps_needed = max(h / (_STEP_OF_AIR * air / rate), h / (_STEP_OF_LAG * valve_constant))
        elif abs(pressure - y - ATMOSPHERE) > _SETTLED_PRESSURE * pressure:
            steps_needed = h / (_STEP_OF_AIR * air / rate)
        steps = math.ceil(max(min(steps_needed, _MOST_STEPS), 1.0))
        for _ in range(steps):
            d = h / steps
            fraction = math.exp(-0.25 * d / valve_constant) if y != r else 0.0
            constant = air / rate
            before = conductance * needle_flow(max(pressure - ATMOSPHERE, 0.0), law)
            early = r + (y - r) * fraction
            pressure = exchanged_pressure(pressure, early + ATMOSPHERE, 0.5 * d, constant, ratio)
            middle = conductance * needle_flow(max(pressure - ATMOSPHERE, 0.0), law)
            late = r + (y - r) * fraction**3
            after = exchanged_pressure(pressure, late + ATMOSPHERE, 0.5 * d, constant, ratio)
            used = (before + 4.0 * middle + conductance * needle_flow(max(after - ATMOSPHERE, 0.0), law)) * d / 6.0
            used = min(used, glue)
            glue -= used
            volume[k] += used
            # isothermal, in the room of the glue
            pressure = after * air / (air + used)
            air += used
            y = r + (y - r) * fraction**4
    state[0] = y
    state[1] = pressure
    state[2] = glue
    state[3] = air
    return volume
