"""The motion group: its speeds, ramps and limits, and what one command overrides of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

from gantrysim.controllers.setpoints import Supervision
from gantrysim.errors import InputError, at_least, finite, positive, unknown, whole

ProfileType = Literal["trapezoid", "sine", "trapezoidal acceleration", "constant", "smooth"]

PROFILE_TYPES: dict[int, ProfileType] = {
    0: "trapezoid",
    1: "sine",
    2: "trapezoidal acceleration",
    3: "constant",
    -1: "smooth",
}

_SMOOTHEST = 100


@dataclass(frozen=True, kw_only=True)
class Nodal:
    """Properties of the group that one command overrides, for itself alone; None leaves the group's own.

    Args:
        velocity: Vtran or VCruise [mm/s].
        acceleration: Acc [mm/s²].
        deceleration: Dec [mm/s²].
        jerk: Jerk [mm/s³].
        profile: PrfType.
        smooth: Smooth; counts where the profile is "smooth" only.
        absolute: Abs.
        dispense: whether glue is laid during this command; not softMC's, where a program sets an output.
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
                object.__setattr__(self, name, positive(name, value, unit))
        if self.profile is not None:
            _check_profile(self.profile)
        if self.smooth is not None:
            object.__setattr__(self, "smooth", _checked_smooth(self.smooth))


@dataclass(frozen=True)
class Group:
    """A group of axes that move together; the names of MC-Basic stand in brackets.

    What the manual leaves open is chosen here: rotation limits, the time in which a move must settle, and that
    "trapezoidal acceleration" takes its jerk from `jerk`.

    Args:
        velocity: path speed asked for (Vtran) [mm/s].
        vmax: largest path speed, to which the one asked for is capped without a word (VMax) [mm/s].
        acceleration: along the path (Acc) [mm/s²].
        deceleration: along the path; the acceleration by default (Dec) [mm/s²].
        jerk: of the profiles "trapezoidal acceleration" and "smooth" with -1 (Jerk) [mm/s³].
        profile: shape of the ramps (PrfType): "trapezoid" of the speed 0, "sine" acceleration 1, "trapezoidal
            acceleration" 2, "constant" velocity without ramps 3, "smooth" as `smooth` says -1.
        smooth: 0 is a trapezoid, 1 to 100 ever smoother, -1 takes the jerk (Smooth).
        vrot: largest speed of the orientation axis r [deg/s].
        arot: its largest acceleration [deg/s²].
        absolute: whether coordinates are absolute, or from where the command begins (Abs).
        position_error: largest group error, the root of the sum of the squares of the linear axes' (PEMax) [mm].
        position_error_delay: age of the command that is compared with the measured position, in servo periods
            (PositionErrorDelay).
        settle_error: error of every axis within which a command has settled; inf does not wait (PESettle) [mm or
            deg].
        settle_time: for which it must stay within (TimeSettle) [s].
        settle_timeout: within which it must have settled [s].
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
                object.__setattr__(self, name, positive(name, getattr(self, name), unit))
        for name, unit in _BOUNDS.items():
            value = getattr(self, name)
            object.__setattr__(self, name, math.inf if value == math.inf else positive(name, value, unit))
        _check_profile(self.profile)
        for name, number in (
            ("smooth", _checked_smooth(self.smooth)),
            ("position_error_delay", whole("position_error_delay", self.position_error_delay, 0)),
            ("settle_time", at_least("settle_time", self.settle_time, 0, "s")),
            ("settle_timeout", positive("settle_timeout", self.settle_timeout, "s")),
        ):
            object.__setattr__(self, name, number)
        _ = self.supervision  # raises where its values do not fit together

    @property
    def supervision(self) -> Supervision:
        """What the controller watches while the group moves."""
        return Supervision(
            self.position_error,
            self.position_error_delay,
            self.settle_error,
            self.settle_time,
            self.settle_timeout,
            self.velocity_safety_limit,
        )

    def overridden(self, command: Nodal) -> Group:
        """Return the group with what the command overrides."""
        names = [field.name for field in fields(Nodal) if field.name != "dispense"]
        given = {name: value for name in names if (value := getattr(command, name)) is not None}
        group = replace(self, **given)
        if "smooth" in given and group.profile != "smooth":
            raise InputError(
                f"smooth = {group.smooth} with the profile {group.profile!r}: must be the profile 'smooth', PrfType=-1"
            )
        return group


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


def _check_profile(profile: str) -> None:
    if profile not in get_args(ProfileType):
        raise unknown("profile", str(profile), get_args(ProfileType))


def _checked_smooth(value: float) -> int:
    number = finite("smooth", value)
    if number != int(number) or not -1 <= number <= _SMOOTHEST:
        raise InputError(f"smooth = {number:g}: must be a whole number, 0 to {_SMOOTHEST}, or -1 for the jerk's")
    return int(number)
