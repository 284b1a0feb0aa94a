"""The motion group: its speeds, ramps and limits, and their overrides by single commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

from gantrysim.base.errors import InputError, at_least, finite, positive, unknown, whole_number
from gantrysim.paths.profile import Constant, Jerk, PointToPoint, Profile, Ramp, Shape, Sine
from gantrysim.record.setpoints import Supervision

ProfileType = Literal["trapezoid", "sine", "trapezoidal acceleration", "constant", "smooth"]

PROFILE_TYPES: dict[int, ProfileType] = {
    0: "trapezoid",
    1: "sine",
    2: "trapezoidal acceleration",
    3: "constant",
    -1: "smooth",
}

_MAX_SMOOTH = 100
# Bounds of speeds, accelerations and jerks in their units: products and roots of them are then numbers. A motion at the
# least of them takes years, and is refused for its duration.
_LEAST_LIMIT = 1e-12
_LARGEST_LIMIT = 1e15


@dataclass(frozen=True, kw_only=True)
class Nodal:
    """Properties of the group that a command overrides for itself; None for the group's own.

    Args:
        velocity: Vtran or VCruise [mm/s].
        acceleration: Acc [mm/s²].
        deceleration: Dec [mm/s²].
        jerk: Jerk [mm/s³].
        profile: PrfType.
        smooth: Smooth; with the profile "smooth" only.
        absolute: Abs.
        dispense: whether glue is laid during this command; an addition to the language, where a program sets an output.
    """

    velocity: float | None = None
    acceleration: float | None = None
    deceleration: float | None = None
    jerk: float | None = None
    profile: ProfileType | None = None
    smooth: int | None = None
    absolute: bool | None = None
    dispense: bool | None = None

    def __post_init__(self) -> None:
        for name, unit in _UNITS.items():
            value = getattr(self, name, None)
            if value is not None:
                object.__setattr__(self, name, _rate(name, value, unit))
        if self.profile is not None:
            _check_profile(self.profile)
        if self.smooth is not None:
            object.__setattr__(self, "smooth", _checked_smooth(self.smooth))


@dataclass(frozen=True)
class Group:
    """A group of axes that move together; the names of MC-Basic stand in brackets.

    The manual leaves open the rotation limits, the settling timeout, and the jerk of "trapezoidal acceleration";
    the choices here are assumptions.

    Args:
        velocity: programmed path speed (Vtran) [mm/s].
        vmax: maximum path speed, to which the programmed one is silently capped (VMax) [mm/s].
        acceleration: acceleration along the path (Acc) [mm/s²].
        deceleration: deceleration along the path, by default the acceleration (Dec) [mm/s²].
        jerk: jerk of the profiles "trapezoidal acceleration" and "smooth" with -1 (Jerk) [mm/s³].
        profile: shape of the ramps (PrfType): "trapezoid" (0), "sine" acceleration (1), "trapezoidal acceleration" (2),
            "constant" velocity without ramps (3), or "smooth" (-1), which `smooth` sets.
        smooth: smoothness of the profile (Smooth): 0 is a trapezoid, 1 to 100 increasingly smooth, -1 uses the jerk.
        vrot: speed limit of the orientation axis r [deg/s].
        arot: acceleration limit of the orientation axis r [deg/s²].
        absolute: whether coordinates are absolute, or relative to the command's start (Abs).
        position_error: limit of the group error, the root sum of squares of the linear axes' errors (PEMax) [mm].
        position_error_delay: age of the command compared with the measured position, in servo periods
            (PositionErrorDelay).
        settle_error: largest error at which an axis counts as settled; inf for no wait (PESettle) [mm or deg].
        settle_time: time for which the error must stay within `settle_error` (TimeSettle) [s].
        settle_timeout: longest wait for settling [s].
        velocity_safety_limit: speed of a linear axis above which its drive is disabled (VelocitySafetyLimit) [mm/s].
    """

    velocity: float = 100.0
    vmax: float = math.inf
    acceleration: float = 3000.0
    deceleration: float | None = None
    jerk: float = 1e5
    profile: ProfileType = "trapezoid"
    smooth: int = 0
    vrot: float = 360.0
    arot: float = 3600.0
    absolute: bool = True
    position_error: float = math.inf
    position_error_delay: int = 0
    settle_error: float = math.inf
    settle_time: float = 0.0
    settle_timeout: float = 1.0
    velocity_safety_limit: float = math.inf

    def __post_init__(self) -> None:
        for name, unit in _UNITS.items():
            if name != "deceleration" or self.deceleration is not None:
                object.__setattr__(self, name, _rate(name, getattr(self, name), unit))
        for name, unit in _BOUNDS.items():
            value = getattr(self, name)
            object.__setattr__(self, name, math.inf if value == math.inf else positive(name, value, unit))
        _check_profile(self.profile)
        for name, number in (
            ("smooth", _checked_smooth(self.smooth)),
            ("position_error_delay", whole_number("position_error_delay", self.position_error_delay, 0)),
            ("settle_time", at_least("settle_time", self.settle_time, 0, "s")),
            ("settle_timeout", positive("settle_timeout", self.settle_timeout, "s")),
        ):
            object.__setattr__(self, name, number)
        # raises where its values do not fit together
        _ = self.supervision

    @property
    def supervision(self) -> Supervision:
        """What the controller monitors during motion."""
        return Supervision(
            self.position_error,
            self.position_error_delay,
            self.settle_error,
            self.settle_time,
            self.settle_timeout,
            self.velocity_safety_limit,
        )

    def with_overrides(self, command: Nodal) -> Group:
        """Return the group with a command's overrides."""
        names = [field.name for field in fields(Nodal) if field.name != "dispense"]
        given = {name: value for name in names if (value := getattr(command, name)) is not None}
        group = replace(self, **given)
        if "smooth" in given and group.profile != "smooth":
            raise InputError(
                f"smooth = {group.smooth} with the profile {group.profile!r}: must be the profile 'smooth', PrfType=-1"
            )
        return group

    def along(self, length: float, rotation: float) -> Profile:
        """Return the speed profile along a path, slowed to what the orientation axis can follow.

        Over the length L [mm] the axis turns by dr [deg], so that v <= vrot L / |dr|; acceleration and jerk likewise.
        """
        speed = min(self.velocity, self.vmax)
        down = self.acceleration if self.deceleration is None else self.deceleration
        if not rotation:
            return self._profile(length, speed, self.acceleration, down, self.jerk)
        ratio = length / abs(rotation)
        vrot = self.vrot * ratio
        arot = self.arot * ratio
        jrot = self._rotary_jerk * ratio
        speed = min(speed, vrot)
        up = min(self.acceleration, arot)
        down = min(down, arot)
        jerk = min(self.jerk, jrot)
        return self._profile(length, speed, up, down, jerk)

    def in_place(self, rotation: float) -> Profile:
        """Return the profile of the orientation axis alone [deg]."""
        return self._profile(abs(rotation), self.vrot, self.arot, self.arot, self._rotary_jerk)

    @property
    def _rotary_jerk(self) -> float:
        """Jerk that builds up `arot` in the time in which `jerk` builds up the acceleration [deg/s³]."""
        return self.jerk * self.arot / self.acceleration

    def _profile(self, length: float, speed: float, up: float, down: float, jerk: float) -> Profile:
        if self.profile == "constant":
            return Constant(length, speed)
        return PointToPoint(length, speed, up, down, self._shape(jerk))

    def _shape(self, jerk: float) -> Shape:
        if self.profile == "sine":
            return Sine()
        if self.profile == "trapezoidal acceleration" or (self.profile == "smooth" and self.smooth < 0):
            return Jerk(jerk)
        return _smoothed_ramp(self.smooth) if self.profile == "smooth" else Ramp()


def _smoothed_ramp(n: int) -> Ramp:
    """Return the ramp of Smooth = n, 0 to 100, whose time is (1 + 2 n / 100) V / A.

    Up to 50 the acceleration rises to A ever more slowly; above, it is a triangle with a falling peak.
    """
    longer = 1 + 2 * n / 100
    return Ramp(1 - 1 / longer) if longer <= 2 else Ramp(0.5, 2 / longer)


_UNITS = {
    "velocity": "mm/s",
    "acceleration": "mm/s²",
    "deceleration": "mm/s²",
    "jerk": "mm/s³",
    "vrot": "deg/s",
    "arot": "deg/s²",
}
_BOUNDS = {
    "vmax": "mm/s",
    "position_error": "mm",
    "settle_error": "mm",
    "velocity_safety_limit": "mm/s",
}


def _rate(name: str, value: float, unit: str) -> float:
    """Return a speed, acceleration or jerk, or raise InputError where it is not positive or out of bounds."""
    return at_least(name, positive(name, value, unit, _LARGEST_LIMIT), _LEAST_LIMIT, unit)


def _check_profile(profile: str) -> None:
    if profile not in get_args(ProfileType):
        raise unknown("profile", str(profile), get_args(ProfileType))


def _checked_smooth(value: float) -> int:
    number = finite("smooth", value)
    if number != int(number) or not -1 <= number <= _MAX_SMOOTH:
        raise InputError(f"smooth = {number:g}: must be a whole number, 0 to {_MAX_SMOOTH}, or -1 to use the jerk")
    return int(number)
