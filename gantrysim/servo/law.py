"""The law of a motion controller's servo: position error in, torque demand out, once per servo period."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from numpy.typing import ArrayLike

from gantrysim.base.arrays import Floats
from gantrysim.stability.compensator import Compensator


class Parameter(NamedTuple):
    """A parameter of the servo that has one value per axis.

    Attributes:
        name: field of `Servo`, key of a job file's [servo].
        unit: in which u is the axis' own, mm or deg.
        meaning: in a few words.
    """

    name: str
    unit: str
    meaning: str


# The gains, in the order in which `law` takes them. All other lists of gains follow from this one.
GAINS = (
    Parameter("kp", "N·m/u", "torque per following error"),
    Parameter("ki", "N·m/(u·s)", "torque per integral of the following error"),
    Parameter("kd", "N·m·s/u", "torque per rate of change of the following error"),
    Parameter("velocity_ff", "N·m·s/u", "torque per demand velocity"),
    Parameter("acceleration_ff", "N·m·s²/u", "torque per demand acceleration"),
    Parameter("output_velocity", "N·m·s/u", "torque per measured velocity, 0; damps where negative"),
)
GAIN_NAMES = tuple(gain.name for gain in GAINS)


def law(
    error: float,
    error_sum: float,
    error_change: float,
    demand_velocity: float,
    demand_acceleration: float,
    measured_velocity: float,
    gains: tuple[float, ...],
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
        gains: in the order of `GAINS`.
    """
    kp, ki, kd, velocity_ff, acceleration_ff, output_velocity = gains
    return (
        kp * error
        + ki * error_sum
        + kd * error_change
        + velocity_ff * demand_velocity
        + acceleration_ff * demand_acceleration
        + output_velocity * measured_velocity
    )


def compensator(gains: tuple[float, ...], period: float) -> Compensator:
    """Return the law as it answers to a position alone, with all demands at zero.

    Args:
        gains: in the order of `GAINS`.
        period: servo period [s].
    """
    kp = law(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, gains)
    ki = law(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, gains)
    kd = law(0.0, 0.0, 1.0, 0.0, 0.0, -1.0, gains)
    return Compensator.pid(kp, ki, kd, period)


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
