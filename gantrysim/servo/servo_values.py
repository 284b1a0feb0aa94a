"""What a servo is given: names, units and bounds of its values, one per axis or in common."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from gantrysim.base.errors import InputError, at_least, between, finite, positive, whole
from gantrysim.servo.drive_settings import DRIVE, LOOPS, WORDS, GivenDrives
from gantrysim.servo.gains import FEED_FORWARD, GAIN_NAMES, GAINS, GivenGains
from gantrysim.servo.laws import LAW_PARAMETERS, LAWS, GivenLaws
from gantrysim.servo.notch import NOTCH, GivenNotches
from gantrysim.servo.stability.motion import MODES

_LARGEST_GAIN = 1e18
DAMPINGS = (1e-3, 1e3)
LONGEST_PERIOD = 1.0  # [s]
SHORTEST_PERIOD = 1e-7  # [s]

MAX_FEEDBACK_DELAY = 16  # servo periods
LARGEST_BANDWIDTH = 1e5  # [Hz]
_ALMOST = 1e-6  # a whole number
LARGEST_SEED = 2**53

FOLLOWING_ERROR_LIMIT = 5.0  # [mm], between the 0.1 mm of a tuned gantry and the 10 mm of a jam

# what `Servo.derive` takes from the axes unless it is given
DERIVED = (*GAINS, *NOTCH, *DRIVE, *LAW_PARAMETERS)


class GivenValues(GivenGains, GivenNotches, GivenDrives, GivenLaws, total=False):
    """Every parameter of `DERIVED` as a keyword of `Servo.derive`: one value for all axes, or one per axis."""


# A loop is no longer the derived one where one of these is given: gains that act on the position, ...
LOOP_GAINS = (
    *(name for name in GAIN_NAMES if name not in FEED_FORWARD),
    *(parameter.name for parameter in NOTCH),
    "velocity_gain",
    "velocity_time",
)
# ... and parameters of laws that feed it back
SHAPING = (*LOOP_GAINS, *(p.name for law in LAWS if law.answers_to_position for p in law.parameters))

_LAW_NAMES = frozenset(parameter.name for parameter in LAW_PARAMETERS)
_DRIVE_NAMES = frozenset(parameter.name for parameter in DRIVE)


def per_axis(name: str, value: Any, axes: int) -> tuple[Any, ...]:
    """Return a value for each axis, from one for all or one per axis."""
    single = isinstance(value, str) or not isinstance(value, Iterable)
    values = (value,) * axes if single else tuple(value)
    if len(values) != axes:
        raise InputError(f"{name} has {len(values)} values: must be one or {axes}, one per axis")
    return tuple(checked(name, item) for item in values) if name in (*WORDS, "current_bandwidth") else values


def whole_ratio(ratio: float) -> bool:
    """Return whether a ratio is a whole number."""
    return round(ratio) >= 1 and abs(ratio - round(ratio)) < _ALMOST


def check_drive_period(drive_period: float, period: float, mode: Sequence[str]) -> None:
    """Raise InputError unless the period of loops in the drives divides that of the servo."""
    ratio = period / positive("drive_period", drive_period, "s", LONGEST_PERIOD)
    if LOOPS & set(mode) and not whole_ratio(ratio):
        raise InputError(
            f"drive_period = {drive_period:g} s: must be a whole fraction of the servo period, {period:g} s"
        )


def check_whole(name: str, value: float, most: int) -> None:
    """Raise InputError unless a value is a whole number from 0 to the most."""
    between(name, whole(name, value, 0), 0, most)


def check_modes(what: str, modes: Sequence[str]) -> None:
    """Raise InputError unless all drives take torques, which something needs, named in words."""
    if set(modes) != {MODES[0]}:
        raise InputError(
            f"{what}: servo mode = {', '.join(map(repr, modes))}, with other gains or none; only for 'torque'"
        )


def check_period(period: float) -> None:
    """Raise InputError for a period out of bounds."""
    if positive("servo period", period, "s", LONGEST_PERIOD) < SHORTEST_PERIOD:
        raise InputError(f"servo period = {period:g} s: must be at least {SHORTEST_PERIOD:g} s")


def check_timing(period: float, delay: float, feedback_delay: int) -> None:
    """Raise InputError for a period or delays out of bounds: delay [s], feedback_delay [servo periods]."""
    check_period(period)
    if at_least("servo delay", delay, 0, "s") > period:
        raise InputError(f"servo delay = {delay:g} s: must be at most the period, {period:g} s")
    check_whole("feedback_delay", feedback_delay, MAX_FEEDBACK_DELAY)


def checked(name: str, value: Any) -> Any:
    """Return a value of one axis, or raise InputError where it is out of its bounds."""
    if name in WORDS:
        if value not in WORDS[name]:
            raise InputError(f"servo {name} = {value!r}: must be one of {', '.join(map(repr, WORDS[name]))}")
        return value
    if name in _LAW_NAMES:
        return at_least(name, value, 0)
    if name in ("torque_limit", "following_error_limit"):
        return value if value == math.inf else positive(name, value)
    if name == "resolution":
        return at_least("encoder resolution", value, 0, "mm")
    if name in _DRIVE_NAMES:
        return between(name, value, 0, LARGEST_BANDWIDTH if name == "current_bandwidth" else _LARGEST_GAIN)
    if abs(finite(name, value)) > _LARGEST_GAIN:
        raise InputError(f"{name} = {value:g}: must be at most {_LARGEST_GAIN:g}")
    return float(value)
