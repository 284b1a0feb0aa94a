"""Glue under pressure between a motor and a needle: what is displaced, stored, leaks back, and flows out.

With the displaced rate q, the stored volume x, the pressure p = x / C, the leak g and the needle's flow Q,

    dx/dt = q - g p - Q(p),  Q(-p) = -Q(p),  C = C0 + V / B,

where C0 is the compliance of the walls and V the volume of glue of the bulk modulus B that is still there. Below the
pressure of a vacuum the glue tears, so that p stays there while x falls. A motor that stalls holds the pressure at its
limit. What is drawn back through the needle leaves a gap at its tip, which is filled before glue flows out again.

Steps of a tenth of the time constant are taken in two implicit stages, at g and 1 of the step with g = 1 - 1/sqrt(2)
and the weights 1 - g and g, of second order as (1 - g) g + g = 1/2; in a line so stiff that these were too many, longer
ones by the implicit Euler method, which overshoots nothing. The equations of the stages are monotonic, and solved in a
bracket. The volume through the needle is what the balance leaves, so that nothing is lost.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.glue.dispenser.lag import NeedleLaw, needle_flow
from gantrysim.glue.dispenser.syringe import ATMOSPHERE

_GAMMA = 1 - math.sqrt(0.5)
_TIME_STEP = 0.1  # of the time constant
_MOST_STEPS = 50  # in a period
_ITERATIONS = 60
_ROUNDING = 1e-13  # relative


class Line(NamedTuple):
    """The line between motor and needle.

    Attributes:
        conductance: of the needle, C [mm³/s].
        compliance: of the walls, C0 [mm³/kPa].
        leak: back to the inlet, g [mm³/(s·kPa)].
        limit: pressure at which the motor stalls; inf for none [kPa].
        glue: volume at the start; 0 where it is refilled [mm³].
        modulus: bulk modulus of the glue, B; inf for a stiff one [kPa].
    """

    conductance: float
    compliance: float
    leak: float
    limit: float
    glue: float
    modulus: float


class Flowed(NamedTuple):
    """What flows out of a line.

    Attributes:
        flow: mean over the period after each tick, (n,) [mm³/s].
        pressure: at the end of each period, (n,) [kPa].
        lost: volume that a stalled motor has not displaced, over each period, (n,) [mm³].
    """

    flow: Floats
    pressure: Floats
    lost: Floats


def flowed(rate: Floats, period: float, line: Line, law: NeedleLaw) -> Flowed:
    """Return what flows out of a line that is at rest before the first tick.

    Args:
        rate: displaced over the period after each tick, (n,) [mm³/s].
        period: servo period [s].
        line: between motor and needle.
        law: of the needle.
    """
    result = Flowed(*np.zeros((3, rate.size)))
    _integrate(rate, period, line, law, result)
    return result


@jit
def _pressure(stored: float, compliance: float) -> float:
    return max(stored / compliance, -ATMOSPHERE)


@jit
def _outflow(pressure: float, line: Line, law: NeedleLaw) -> float:
    """Return what leaves the line through needle and leak [mm³/s]."""
    through = line.conductance * needle_flow(abs(pressure), law)
    return line.leak * pressure + (through if pressure > 0.0 else -through)


@jit
def _stage(base: float, step: float, rate: float, compliance: float, line: Line, law: NeedleLaw) -> float:
    """Return x = base + step f(x), with f(x) = rate - outflow, which falls with x."""
    slope = rate - _outflow(_pressure(base, compliance), line, law)
    other = base + step * slope
    low = min(base, other)
    high = max(base, other)
    # regula falsi by Dowell and Jarratt (Illinois)
    at_low = low - base - step * (rate - _outflow(_pressure(low, compliance), line, law))
    at_high = high - base - step * (rate - _outflow(_pressure(high, compliance), line, law))
    side = 0
    x = high
    for _ in range(_ITERATIONS):
        if at_high <= at_low or high - low <= _ROUNDING * (abs(low) + abs(high)):
            break
        x = (low * at_high - high * at_low) / (at_high - at_low)
        value = x - base - step * (rate - _outflow(_pressure(x, compliance), line, law))
        if abs(value) <= _ROUNDING * (abs(base) + abs(x)):
            break
        if value > 0.0:
            high = x
            at_high = value
            if side == 1:
                at_low *= 0.5
            side = 1
        else:
            low = x
            at_low = value
            if side == -1:
                at_high *= 0.5
            side = -1
    return x


@jit
def _integrate(rate: Floats, period: float, line: Line, law: NeedleLaw, result: Flowed) -> None:
    """Fill in what flows out; arguments as of `flowed`."""
    stored = 0.0
    gap = 0.0
    glue = line.glue
    for k in range(rate.size):
        q = rate[k]
        compliance = line.compliance + max(glue, 0.0) / line.modulus
        p = _pressure(stored, compliance)
        # an upper bound of the slope of the outflow, at the larger of the pressures before and after
        ahead = _pressure(_stage(stored, period, q, compliance, line, law), compliance)
        largest = max(abs(p), abs(ahead))
        slope = line.leak
        if largest > 0.0:
            slope += (law.power + 1.0) * line.conductance * needle_flow(largest, law) / largest
        needed = period * slope / (compliance * _TIME_STEP)
        is_stiff = needed > _MOST_STEPS
        steps = int(max(math.ceil(min(needed, _MOST_STEPS)), 1.0))
        h = period / steps
        for _ in range(steps):
            compliance = line.compliance + max(glue, 0.0) / line.modulus
            if is_stiff:
                # the pressure follows its motor at once, and must not pass it
                second = _stage(stored, h, q, compliance, line, law)
                leaked = line.leak * h * _pressure(second, compliance)
            else:
                first = _stage(stored, _GAMMA * h, q, compliance, line, law)
                base = stored + (1.0 - _GAMMA) / _GAMMA * (first - stored)
                second = _stage(base, _GAMMA * h, q, compliance, line, law)
                mean = (1.0 - _GAMMA) * _pressure(first, compliance) + _GAMMA * _pressure(second, compliance)
                leaked = line.leak * h * mean
            displaced = q * h
            if second > line.limit * compliance:
                # held at the limit: the rest of the stroke is lost
                second = line.limit * compliance
                out = h * _outflow(line.limit, line, law)
                leaked = h * line.leak * line.limit
                held = out + second - stored
                result.lost[k] += max(displaced - held, 0.0)
                displaced = min(displaced, held)
            through = displaced - leaked - (second - stored)
            stored = second
            glue -= displaced
            if through < 0.0:
                gap -= through
                through = 0.0
            filled = min(gap, through)
            gap -= filled
            result.flow[k] += (through - filled) / period
        result.pressure[k] = _pressure(stored, line.compliance + max(glue, 0.0) / line.modulus)
