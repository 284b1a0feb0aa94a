"""The sampled servo of a motion controller: period, gains, notch and limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

from gantrysim.controllers import notch
from gantrysim.controllers.derivation import NOTCH_DEPTH, NOTCH_WIDTH, AxisDynamics, loop, pd_gains
from gantrysim.controllers.law import GAIN_NAMES, GAINS, Parameter, compensator
from gantrysim.display import Shown
from gantrysim.errors import InputError, at_least, between, finite, positive
from gantrysim.stability.compensator import Compensator

_LARGEST_GAIN = 1e18
_DAMPINGS = (1e-3, 1e3)
_LONGEST_PERIOD = 1.0  # [s]
_SHORTEST_PERIOD = 1e-7  # [s]

FOLLOWING_ERROR_LIMIT = 5.0  # [mm], between the 0.1 mm of a tuned gantry and the 10 mm of a jam

NOTCH = (
    Parameter("notch_frequency", "Hz", "frequency of the notch on the torque demand, 0 for none"),
    Parameter("notch_width", "", "damping ratio of the notch's poles"),
    Parameter("notch_depth", "", "gain of the notch at its frequency"),
)

# what `Servo.derive` takes from the axes unless it is given
DERIVED = (
    *GAINS,
    *NOTCH,
    Parameter("torque_limit", "N·m", "largest torque demand, the drive's own"),
    Parameter("resolution", "u", "axis travel per encoder count, the machine's own; 0 for an exact encoder"),
)


@dataclass(frozen=True, repr=False)
class Servo(Shown):
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
        notch_frequency, notch_width, notch_depth: of the filter between law and clamp, by default none, see
            `gantrysim.controllers.notch`.
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
    notch_frequency: tuple[float, ...] = ()
    notch_width: tuple[float, ...] = ()
    notch_depth: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _check_period(self.period)
        for name, value in _NO_NOTCH.items():
            if not getattr(self, name):
                object.__setattr__(self, name, (value,) * len(self.kp))
        if at_least("servo delay", self.delay, 0, "s") > self.period:
            raise InputError(f"servo delay = {self.delay:g} s: must be at most the period, {self.period:g} s")
        for field in fields(self):
            if field.name in ("period", "delay"):
                continue
            values = tuple(getattr(self, field.name))
            if len(values) != len(self.kp) or not values:
                raise InputError(f"{field.name} has {len(values)} values: must be {len(self.kp)}, one per axis")
            object.__setattr__(self, field.name, tuple(_checked(field.name, value) for value in values))
        _ = self.filters

    def facts(self) -> dict[str, str]:
        shown = [p for p in DERIVED if p.name not in ("notch_width", "notch_depth") and any(getattr(self, p.name))]
        gains = {f"{p.name} [{p.unit}]": " ".join(f"{value:.4g}" for value in getattr(self, p.name)) for p in shown}
        return {"period": f"{1e3 * self.period:g} ms", "axes": str(self.axes), **gains}

    @property
    def axes(self) -> int:
        """Number of axes."""
        return len(self.kp)

    @cached_property
    def filters(self) -> tuple[notch.Coefficients, ...]:
        """The notch of each axis."""
        own = zip(self.notch_frequency, self.notch_width, self.notch_depth, strict=True)
        return tuple(notch.coefficients(frequency, width, depth, self.period) for frequency, width, depth in own)

    def compensators(self) -> tuple[Compensator, ...]:
        """Return law and notch of each axis as the stability of its loop depends on them."""
        gains = zip(*(getattr(self, name) for name in GAIN_NAMES), strict=True)
        return tuple(
            compensator(own, self.period).then(filter) for own, filter in zip(gains, self.filters, strict=True)
        )

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
        stays round: the highest one at which each axis keeps a gain margin of 2 and |S| <= 2, if need be with
        a notch at its mode, see `gantrysim.controllers.derivation`.

        Args:
            axes: the machine's axes.
            period: servo period [s].
            frequency: natural frequency w / 2 pi; by default the highest that keeps the margins [Hz].
            damping: damping ratio zeta.
            feedforward: share of the computed feed-forward, 0 to 1.
            integral_time: kp / ki [s].
            following_error_limit: for every axis [mm].
            delay: from sample to output [s].
            given: any of `DERIVED` to override, one value or one per axis.
        """
        axes = tuple(axes)
        if not axes:
            raise InputError("a servo must have at least one axis")
        _check_period(period)
        zeta = between("damping", damping, *_DAMPINGS)
        share = at_least("feedforward", feedforward, 0)
        if not integral_time > 0:
            raise InputError(f"integral_time = {integral_time:g} s: must be greater than 0 s; inf for no integral term")
        at_least("integral_time", min(integral_time, _LONGEST_PERIOD), _SHORTEST_PERIOD, "s")
        found = loop(axes, period, frequency, zeta, integral_time, at_least("servo delay", delay, 0, "s"))
        pd = [pd_gains(axis, found.frequency, zeta, integral_time) for axis in axes]
        derived: dict[str, list[float]] = {
            **{name: [own[name] for own in pd] for name in ("kp", "ki", "kd")},
            "velocity_ff": [share * axis.viscous for axis in axes],
            "acceleration_ff": [share * axis.inertia for axis in axes],
            "output_velocity": [0.0 for _ in axes],
            "torque_limit": [axis.peak_torque for axis in axes],
            "resolution": [axis.resolution for axis in axes],
            "notch_frequency": list(found.notches),
            "notch_width": [NOTCH_WIDTH for _ in axes],
            "notch_depth": [NOTCH_DEPTH for _ in axes],
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


_NO_NOTCH = {"notch_frequency": notch.NONE, "notch_width": NOTCH_WIDTH, "notch_depth": NOTCH_DEPTH}


def _check_period(period: float) -> None:
    if positive("servo period", period, "s", _LONGEST_PERIOD) < _SHORTEST_PERIOD:
        raise InputError(f"servo period = {period:g} s: must be at least {_SHORTEST_PERIOD:g} s")


def _checked(name: str, value: float) -> float:
    if name in ("torque_limit", "following_error_limit"):
        return value if value == math.inf else positive(name, value)
    if name == "resolution":
        return at_least("encoder resolution", value, 0, "mm")
    if abs(finite(name, value)) > _LARGEST_GAIN:
        raise InputError(f"{name} = {value:g}: must be at most {_LARGEST_GAIN:g}")
    return float(value)
