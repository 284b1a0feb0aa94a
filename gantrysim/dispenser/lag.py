"""Compiled integrals of a lagged flow or pressure, over pieces of constant request.

A law is that of a needle: its yield pressure p_y [kPa], 1/n, a and b; see `Needle`.
"""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.dispenser.syringe import ATMOSPHERE, exchanged

_MOST_PIECES = 40  # time constants after which a lag has settled
_SHORT = 0.05  # step in a syringe, of its time constant
_BRIEF = 0.1  # the same of a lag
_MOST_STEPS = 100  # in a syringe between two changes of the request
_SETTLED = 1e-9  # deviation of a pressure that has settled, of the pressure
_GAUSS = np.polynomial.legendre.leggauss(6)
# from 0 to 1
_NODES = 0.5 * (_GAUSS[0] + 1)
_WEIGHTS = 0.5 * _GAUSS[1]

Law = tuple[float, float, float, float]


@jit
def lagged_volumes(duration: Floats, request: Floats, opening: float, closing: float, state: Floats) -> Floats:
    """Return the integrals of the first-order lag over pieces of constant request, (k,).

    Args:
        duration: of the pieces, (k,).
        request: in each, (k,).
        opening: time constant of a rise.
        closing: likewise of a fall.
        state: the lagged value before the first piece, (1,), replaced by that after the last.
    """
    volume = np.empty(duration.size)
    y = state[0]
    for k in range(duration.size):
        r = request[k]
        h = duration[k]
        constant = opening if r > y else closing
        if constant > 0.0:
            share = -math.expm1(-h / constant)  # of the step towards r
            volume[k] = r * h + (y - r) * constant * share
            y += (r - y) * share
        else:
            volume[k] = r * h
            y = r
    state[0] = y
    return volume


@jit
def _flow(pressure: float, law: Law) -> float:
    """Return the flow over the needle's conductance at a pressure of at least 0 [kPa]."""
    least, power, a, b = law
    if least == 0.0:
        return pressure**power
    x = pressure - least
    if x <= 0.0:
        return 0.0
    return x ** (power + 1.0) * (x * x + 2.0 * a * x * least + b * least * least) / pressure**3


@jit
def driven_volumes(
    duration: Floats,
    request: Floats,
    opening: float,
    closing: float,
    law: Law,
    state: Floats,
) -> Floats:
    """Return the integrals of `_flow` of the lagged state over pieces of constant request, (k,); see above."""
    volume = np.empty(duration.size)
    least = law[0]
    y = state[0]
    for k in range(duration.size):
        r = request[k]
        h = duration[k]
        constant = opening if r > y else closing
        if constant <= 0.0 or y == r:
            volume[k] = h * _flow(r, law)
            y = r
            continue
        # of the flow, which the yield stress stops
        begin = 0.0
        end = h
        if max(y, r) <= least:
            begin = h
        elif y < least:
            begin = min(constant * math.log((r - y) / (r - least)), h)
        elif r < least:
            end = min(constant * math.log((y - r) / (least - r)), h)
        # one quadrature per time constant; after many the state is at the request
        moving = max(min(end, _MOST_PIECES * constant) - begin, 0.0)
        total = (end - begin - moving) * _flow(r, law)
        pieces = math.ceil(moving / constant)
        step = moving / max(pieces, 1)
        for piece in range(pieces):
            for i in range(_NODES.size):
                value = r + (y - r) * math.exp(-(begin + (piece + _NODES[i]) * step) / constant)
                total += step * _WEIGHTS[i] * _flow(max(value, 0.0), law)
        volume[k] = total
        y += (r - y) * -math.expm1(-h / constant)
    state[0] = y
    return volume


@jit
def syringe_volumes(
    duration: Floats,
    request: Floats,
    opening: float,
    closing: float,
    conductance: float,
    law: Law,
    syringe: tuple[float, float],
    state: Floats,
) -> Floats:
    """Return the volumes of glue over pieces of constant request, (k,) [mm³].

    In a step the air first follows the valve for half of it, then makes room for the glue, then follows for the other
    half; the glue's volume is Simpson's over the three pressures.

    Args:
        duration: of the pieces, (k,) [s].
        request: pressure, (k,) [kPa].
        opening: time constant of the valve [s].
        closing: likewise.
        conductance: of the needle [mm³/s].
        law: of the needle.
        syringe: C p0 [mm³/s] and critical pressure ratio b.
        state: before the first piece, replaced by that after the last: valve pressure and absolute pressure of the air
            [kPa], volumes of glue and air [mm³], (4,).
    """
    rate, ratio = syringe
    volume = np.zeros(duration.size)
    y, pressure, left, air = state
    for k in range(duration.size):
        r = request[k]
        h = duration[k]
        lag = opening if r > y else closing
        if lag <= 0.0 or abs(y - r) <= _SETTLED * pressure:
            y = r
        least = 1.0
        if y != r:
            least = max(h / (_SHORT * air / rate), h / (_BRIEF * lag))
        elif abs(pressure - y - ATMOSPHERE) > _SETTLED * pressure:
            least = h / (_SHORT * air / rate)
        steps = math.ceil(max(min(least, _MOST_STEPS), 1.0))
        for _ in range(steps):
            d = h / steps
            fraction = math.exp(-0.25 * d / lag) if y != r else 0.0
            constant = air / rate
            before = conductance * _flow(max(pressure - ATMOSPHERE, 0.0), law)
            early = r + (y - r) * fraction
            pressure = exchanged(pressure, early + ATMOSPHERE, 0.5 * d, constant, ratio)
            middle = conductance * _flow(max(pressure - ATMOSPHERE, 0.0), law)
            late = r + (y - r) * fraction**3
            after = exchanged(pressure, late + ATMOSPHERE, 0.5 * d, constant, ratio)
            used = (before + 4.0 * middle + conductance * _flow(max(after - ATMOSPHERE, 0.0), law)) * d / 6.0
            used = min(used, left)
            left -= used
            volume[k] += used
            pressure = after * air / (air + used)
            air += used
            y = r + (y - r) * fraction**4
    state[0], state[1], state[2], state[3] = y, pressure, left, air
    return volume
