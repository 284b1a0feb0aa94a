"""P-PI: a position loop that gives a speed, and a PI velocity loop inside it."""

from __future__ import annotations


def cascaded(
    error: float,
    speed_sum: float,
    demand_velocity: float,
    demand_acceleration: float,
    measured_velocity: float,
    gains: tuple[float, ...],
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
        gains: in the order of `GAINS`.
        period: servo period T [s].
    """
    kp, ki, kd, velocity_ff, acceleration_ff, output_velocity = gains
    demand = kp * error + kd * (demand_velocity - measured_velocity)
    rate = ki / kp if kp != 0.0 else 0.0
    added = speed_sum + period * demand
    torque = (
        demand
        + rate * added
        + velocity_ff * demand_velocity
        + acceleration_ff * demand_acceleration
        + output_velocity * measured_velocity
    )
    return torque, added


def as_pid(gains: tuple[float, ...]) -> tuple[float, ...]:
    """Return the gains of the PID law that answers to a position as P-PI does.

    As T sum(dMPOS/T) is MPOS, the velocity loop's integral is one of E with ki, and a proportional part kd / Ti.
    """
    kp, ki, kd, *rest = gains
    return (kp + (kd * ki / kp if kp else 0.0), ki if kp else 0.0, kd, *rest)
