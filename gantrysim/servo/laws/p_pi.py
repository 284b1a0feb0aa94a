"""P-PI: a position loop that gives a speed, and a PI velocity loop inside it."""

from __future__ import annotations

from typing import Any

from gantrysim.servo.gains import GAIN_NAMES, Gains
from gantrysim.servo.laws import pid
from gantrysim.servo.laws.law import BaseLaw
from gantrysim.servo.stability.linear_system import Compensator


def cascaded_torque(
    error: float,
    speed_sum: float,
    demand_velocity: float,
    demand_acceleration: float,
    measured_velocity: float,
    gains: Gains,
    period: float,
) -> tuple[float, float]:
    """Return the torque demand of one axis at one servo tick [N·m], and the sum after it.

        e_v = Kv E + dDPOS/T - dMPOS/T,        Kv = kp / kd
        out = kd (e_v + T sum(e_v) / Ti) + velocity_ff dDPOS/T + acceleration_ff ddDPOS/T^2
              + output_velocity dMPOS/T,        1 / Ti = ki / kp

    Position loop and velocity loop run at every tick; the speed is fed forward in full. E = DPOS - MPOS.

    Args:
        error: following error E [u].
        speed_sum: T sum(kd e_v) after the last tick [N·m·s].
        demand_velocity: dDPOS/T [u/s].
        demand_acceleration: ddDPOS/T^2 [u/s²].
        measured_velocity: dMPOS/T [u/s].
        gains: of the axis.
        period: servo period T [s].
    """
    demand = gains.kp * error + gains.kd * (demand_velocity - measured_velocity)
    rate = gains.ki / gains.kp if gains.kp != 0.0 else 0.0
    added = speed_sum + period * demand
    torque = (
        demand
        + rate * added
        + gains.velocity_ff * demand_velocity
        + gains.acceleration_ff * demand_acceleration
        + gains.output_velocity * measured_velocity
    )
    return torque, added


def as_pid(gains: Gains) -> Gains:
    """Return the gains of the PID law that answers to a position as P-PI does.

    As T sum(dMPOS/T) is MPOS, the velocity loop's integral is one of E with ki, and a proportional part kd / Ti.
    """
    if gains.kp == 0.0:
        return gains._replace(ki=0.0)
    return gains._replace(kp=gains.kp + gains.kd * gains.ki / gains.kp)


def without_term(gains: Gains) -> tuple[str, ...]:
    """Return the names of gains that are not 0 and for which P-PI has no term."""
    torque = _torque(Gains(*(1.0 for _ in GAIN_NAMES)))
    return tuple(
        name
        for name, value in zip(GAIN_NAMES, gains, strict=True)
        if value and _torque(Gains(*(2.0 if other == name else 1.0 for other in GAIN_NAMES))) == torque
    )


def _torque(gains: Gains) -> float:
    """Return the torque to inputs that are all different, so that no two terms cancel."""
    torque, _ = cascaded_torque(1.0, 0.5, 3.0, 0.125, 0.25, gains, 1.0)
    return torque


def tick(row: Any, axis: int, gains: Gains) -> tuple[float, float]:
    """Return the torque demand and the velocity loop's sum after it, see `BaseLaw.tick`."""
    return cascaded_torque(
        row.law_error[axis],
        row.integral[axis],
        row.demand_velocity[axis],
        row.demand_acceleration[axis],
        row.measured_velocity[axis],
        gains,
        row.period,
    )


class PPi(BaseLaw):
    """The law as one of the ladder."""

    name = "p-pi"
    meaning = "a position loop that gives a speed, and a PI velocity loop inside it"
    answers_to_position = True
    tick = staticmethod(tick)

    def compensator(self, gains: Gains, period: float, error_gain: float = 1.0) -> Compensator:
        alike = as_pid(gains)
        # the velocity loop has no error of position that a law could multiply, only the position loop has
        kp = alike.kp + (error_gain - 1) * gains.kp
        return pid.compensator(alike._replace(kp=kp, ki=error_gain * alike.ki), period)

    def without_term(self, gains: Gains) -> tuple[str, ...]:
        return without_term(gains)


P_PI = PPi()
