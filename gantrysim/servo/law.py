"""The law of a motion controller's servo: position error in, torque demand out, once per servo period."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.servo.gains import Gains
from gantrysim.stability.compensator import Compensator


def law(
    error: float,
    error_sum: float,
    error_change: float,
    demand_velocity: float,
    demand_acceleration: float,
    measured_velocity: float,
    gains: Gains,
) -> float:
    """Return the torque demand of one axis at one servo tick [N·m].

        out = kp E + ki T sum(E) + kd dE/T + velocity_ff dDPOS/T + acceleration_ff ddDPOS/T^2
              + output_velocity dMPOS/T,        E = DPOS - MPOS

    d is the change since the last tick, T the servo period. This is the law of Trio's servo (P_GAIN,
    I_GAIN, D_GAIN, VFF_GAIN, OV_GAIN) in units of length and time instead of edges and ticks, with an
    acceleration term.

    Args:
        error: following error E [mm].
        error_sum: T times the sum of E over all ticks so far [mm·s].
        error_change: dE/T [mm/s].
        demand_velocity: dDPOS/T [mm/s].
        demand_acceleration: ddDPOS/T^2 [mm/s²].
        measured_velocity: dMPOS/T [mm/s].
        gains: of the axis.
    """
    return (
        gains.kp * error
        + gains.ki * error_sum
        + gains.kd * error_change
        + gains.velocity_ff * demand_velocity
        + gains.acceleration_ff * demand_acceleration
        + gains.output_velocity * measured_velocity
    )


class Terms(NamedTuple):
    """Torque demand of `law` per unit of each of its inputs; margins, preview and sampling follow from these."""

    error: float
    error_sum: float
    error_change: float
    demand_velocity: float
    demand_acceleration: float
    measured_velocity: float


def terms(gains: Gains) -> Terms:
    """Return what the law makes of one unit of each input alone, which is all of it, as it is linear."""
    return Terms(
        error=law(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, gains),
        error_sum=law(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, gains),
        error_change=law(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, gains),
        demand_velocity=law(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, gains),
        demand_acceleration=law(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, gains),
        measured_velocity=law(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, gains),
    )


def compensator(gains: Gains, period: float, contour_gain: float = 0.0) -> Compensator:
    """Return the law as it answers to a position alone, with all demands at zero.

    Args:
        gains: of the axis.
        period: servo period [s].
        contour_gain: of cross-coupling where the path runs across the axis: by so much the error counts more.
    """
    more = 1.0 + contour_gain
    per_unit = terms(gains)
    # with all demands at zero, the measured velocity is -dE/T
    kd = more * per_unit.error_change - per_unit.measured_velocity
    return Compensator.pid(more * per_unit.error, more * per_unit.error_sum, kd, period)


@dataclass(frozen=True)
class Tick:
    """Inputs of a user's own law at one servo tick.

    Attributes:
        time: time of the tick [s].
        period: servo period T [s].
        commanded: DPOS, (axes,) [mm].
        measured: MPOS, quantised by the encoder, (axes,) [mm].
        error: following error DPOS - MPOS, (axes,) [mm].
        demand_velocity: dDPOS/T, (axes,) [mm/s].
        demand_acceleration: ddDPOS/T^2, (axes,) [mm/s²].
        measured_velocity: dMPOS/T, (axes,) [mm/s].
    """

    time: float
    period: float
    commanded: Floats
    measured: Floats
    error: Floats
    demand_velocity: Floats
    demand_acceleration: Floats
    measured_velocity: Floats


class PlainLaw(Protocol):
    """A law in plain Python: returns the torque demands of all axes at one tick, (axes,) [N·m]."""

    def __call__(self, tick: Tick, /) -> ArrayLike: ...
