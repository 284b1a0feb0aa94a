"""The sampled servo law of a motion controller: position error in, torque demand out, once per period."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, at_least, finite, positive

FOLLOWING_ERROR_LIMIT = 5.0  # [mm], between the 0.1 mm of a tuned gantry and the 10 mm of a jam


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

# what `Servo.derive` takes from the axes unless it is given
DERIVED = (
    *GAINS,
    Parameter("torque_limit", "N·m", "largest torque demand, the drive's own"),
    Parameter("resolution", "u", "axis travel per encoder count, the machine's own; 0 for an exact encoder"),
)


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


class AxisDynamics(Protocol):
    """What the derivation of gains needs to know of an axis."""

    @property
    def inertia(self) -> float:
        """Motor torque per acceleration of the axis [N·m·s²/mm]."""

    @property
    def viscous(self) -> float:
        """Motor torque per speed of the axis [N·m·s/mm]."""

    @property
    def lag(self) -> float:
        """Time constant from torque demand to torque [s]."""

    @property
    def peak_torque(self) -> float:
        """Largest torque the drive delivers [N·m]."""

    @property
    def resolution(self) -> float:
        """Axis travel per encoder count, 0 for an exact measurement [mm]."""


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


@dataclass(frozen=True)
class Servo:
    """Period, gains and limits of a sampled servo; every gain has one value per axis.

    The output is computed once per period from the quantised position, takes effect `delay` later and is
    held until the next. It is clamped to the torque limit; the error sum is frozen while the output is
    clamped on the side to which the error drives it (anti-windup).

    Attributes:
        period: servo period T [s].
        kp, ki, kd, velocity_ff, acceleration_ff, output_velocity: as in `GAINS`.
        torque_limit, resolution: as in `DERIVED`.
        following_error_limit: error at which the drives are disabled [mm].
        delay: time from the sample to the output, at most one period [s].
    """

    period: float
    kp: tuple[float, ...]
    ki: tuple[float, ...]
    kd: tuple[float, ...]
    velocity_ff: tuple[float, ...]
    acceleration_ff: tuple[float, ...]
    output_velocity: tuple[float, ...]
    torque_limit: tuple[float, ...]
    resolution: tuple[float, ...]
    following_error_limit: tuple[float, ...]
    delay: float = 0.0

    def __post_init__(self) -> None:
        positive("servo period", self.period, "s")
        if at_least("servo delay", self.delay, 0, "s") > self.period:
            raise InputError(f"servo delay = {self.delay:g} s: must be at most the period, {self.period:g} s")
        for field in fields(self):
            if field.name in ("period", "delay"):
                continue
            values = tuple(getattr(self, field.name))
            if len(values) != len(self.kp) or not values:
                raise InputError(f"{field.name} has {len(values)} values: must be {len(self.kp)}, one per axis")
            object.__setattr__(self, field.name, tuple(_checked(field.name, value) for value in values))

    @property
    def axes(self) -> int:
        """Number of axes."""
        return len(self.kp)

    @classmethod
    def derive(
        cls,
        axes: Iterable[AxisDynamics],
        period: float = 1e-3,
        *,
        frequency: float | None = None,
        damping: float = 1.0,
        feedforward: float = 1.0,
        integral_time: float = math.inf,
        following_error_limit: float = FOLLOWING_ERROR_LIMIT,
        delay: float = 0.0,
        **given: float | Sequence[float] | None,
    ) -> Servo:
        """Return a servo whose gains follow from the axes' inertia, a natural frequency and a damping ratio.

        With the inertia J at the motor, kp = J w^2 and kd = 2 zeta J w place the poles of the continuous
        loop at the natural frequency w; ki = kp / integral_time. Feed-forward supplies the torque for the
        inertia and the viscous friction. All axes get one frequency, so that their lags match and a circle
        stays round.

        Args:
            axes: the machine's axes.
            period: servo period [s].
            frequency: natural frequency w / 2 pi; by default the one that `natural_frequency` gives [Hz].
            damping: damping ratio zeta.
            feedforward: share of the computed feed-forward, 0 to 1.
            integral_time: kp / ki [s].
            following_error_limit: for every axis [mm].
            delay: from sample to output [s].
            given: any of `DERIVED` to override, one value or one per axis.
        """
        axes = list(axes)
        if not axes:
            raise InputError("a servo must have at least one axis")
        positive("servo period", period, "s")
        zeta = positive("damping", damping)
        share = at_least("feedforward", feedforward, 0)
        if not integral_time > 0:
            raise InputError(f"integral_time = {integral_time:g} s: must be greater than 0 s; inf for no integral term")
        if frequency is None:
            lag = max(axis.lag for axis in axes)
            frequency = natural_frequency(lag + period + at_least("servo delay", delay, 0, "s"), zeta)
        w = 2 * math.pi * positive("frequency", frequency, "Hz")
        derived = {
            "kp": [axis.inertia * w**2 for axis in axes],
            "ki": [axis.inertia * w**2 / integral_time for axis in axes],
            "kd": [2 * zeta * axis.inertia * w for axis in axes],
            "velocity_ff": [share * axis.viscous for axis in axes],
            "acceleration_ff": [share * axis.inertia for axis in axes],
            "output_velocity": [0.0 for _ in axes],
            "torque_limit": [axis.peak_torque for axis in axes],
            "resolution": [axis.resolution for axis in axes],
            "following_error_limit": [following_error_limit for _ in axes],
        }
        for name, value in given.items():
            if name not in derived:
                raise TypeError(f"unknown argument {name!r}; known: {', '.join(derived)}")
            if value is None:
                continue
            derived[name] = list(value) if isinstance(value, Iterable) else [value] * len(axes)
            if len(derived[name]) != len(axes):
                raise InputError(f"{name} has {len(derived[name])} values: must be one or {len(axes)}, one per axis")
        return cls(period=period, delay=delay, **{name: tuple(values) for name, values in derived.items()})


def natural_frequency(lag: float, damping: float, kept: float = 2 / 3) -> float:
    """Return the natural frequency at which a PD loop with a lag keeps a share of its phase margin [Hz].

    The loop L(s) = (2 zeta w s + w^2) / s^2 crosses over at wc = w c, c^2 = 2 zeta^2 + sqrt(4 zeta^4 + 1),
    with the phase margin atan(2 zeta c): 76 degrees where zeta is 1. A lag tau takes wc tau of it, so that
    w = (1 - kept) atan(2 zeta c) / (c tau). For a sampled servo tau is the drive's time constant plus one
    period: half of it for the hold and half for the difference that stands for the derivative.

    Args:
        lag: tau [s].
        damping: damping ratio zeta.
        kept: share of the phase margin that remains.
    """
    zeta = positive("damping", damping)
    c = math.sqrt(2 * zeta**2 + math.sqrt(4 * zeta**4 + 1))
    return (1 - kept) * math.atan(2 * zeta * c) / (c * positive("lag", lag, "s")) / (2 * math.pi)


def _checked(name: str, value: float) -> float:
    if name in ("torque_limit", "following_error_limit"):
        return value if value == math.inf else positive(name, value)
    if name == "resolution":
        return at_least("encoder resolution", value, 0, "mm")
    return finite(name, value)
