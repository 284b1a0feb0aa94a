"""PID with feed-forward, the law of a motion controller's servo: position error in, torque demand out."""

from __future__ import annotations

from typing import Any, NamedTuple

from gantrysim.servo.gains import Gains
from gantrysim.servo.laws.law import BaseLaw
from gantrysim.servo.stability.linear_system import Compensator


def torque_demand(
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
    """Torque demand per unit of each input of `torque_demand`; margins, preview and sampling follow from these."""

    error: float
    error_sum: float
    error_change: float
    demand_velocity: float
    demand_acceleration: float
    measured_velocity: float


def terms(gains: Gains) -> Terms:
    """Return what the law makes of one unit of each input alone, which is all of it, as it is linear."""
    return Terms(
        error=torque_demand(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, gains),
        error_sum=torque_demand(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, gains),
        error_change=torque_demand(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, gains),
        demand_velocity=torque_demand(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, gains),
        demand_acceleration=torque_demand(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, gains),
        measured_velocity=torque_demand(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, gains),
    )


def compensator(gains: Gains, period: float, error_gain: float = 1.0) -> Compensator:
    """Return the law as it answers to a position alone, with all demands at zero; see `BaseLaw.compensator`."""
    per_unit = terms(gains)
    # with all demands at zero, the measured velocity is -dE/T
    kd = error_gain * per_unit.error_change - per_unit.measured_velocity
    return Compensator.pid(error_gain * per_unit.error, error_gain * per_unit.error_sum, kd, period)


def tick(row: Any, axis: int, gains: Gains) -> tuple[float, float]:
    """Return the torque demand and the integral after it, see `BaseLaw.tick`."""
    error = row.law_error[axis]
    error_sum = row.integral[axis] + error * row.period
    torque = torque_demand(
        error,
        error_sum,
        row.law_change[axis],
        row.demand_velocity[axis],
        row.demand_acceleration[axis],
        row.measured_velocity[axis],
        gains,
    )
    return torque, error_sum


class Pid(BaseLaw):
    """The law as one of the ladder."""

    name = "pid"
    meaning = "position error, its integral and its change, with feed-forward of velocity and acceleration"
    answers_to_position = True
    tick = staticmethod(tick)

    def compensator(self, gains: Gains, period: float, error_gain: float = 1.0) -> Compensator:
        return compensator(gains, period, error_gain)


PID = Pid()
