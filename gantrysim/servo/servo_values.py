"""What a servo is given: names, units and bounds of its values, one per axis or in common."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from gantrysim.base.errors import InputError, at_least, between, finite, positive, whole
from gantrysim.servo import notch
from gantrysim.servo.axis_loop import NOTCH_DEPTH, NOTCH_WIDTH
from gantrysim.servo.gains import FEED_FORWARD, GAIN_NAMES, GAINS, Parameter
from gantrysim.servo.laws.parameters import LAW_PARAMETERS
from gantrysim.stability.motion import MODES, Drives

_LARGEST_GAIN = 1e18
DAMPINGS = (1e-3, 1e3)
LONGEST_PERIOD = 1.0  # [s]
SHORTEST_PERIOD = 1e-7  # [s]

MAX_FEEDBACK_DELAY = 16  # servo periods
LARGEST_BANDWIDTH = 1e5  # [Hz]
_ALMOST = 1e-6  # a whole number
LARGEST_SEED = 2**53

FOLLOWING_ERROR_LIMIT = 5.0  # [mm], between the 0.1 mm of a tuned gantry and the 10 mm of a jam

NOTCH = (
    Parameter("notch_frequency", "Hz", "frequency of the notch on the torque demand, 0 for none"),
    Parameter("notch_width", "", "damping ratio of the notch's poles"),
    Parameter("notch_depth", "", "gain of the notch at its frequency"),
)

DRIVE = (
    Parameter("current_bandwidth", "Hz", "bandwidth of the drive's current loop, 0 for none: the winding's own lag"),
    Parameter("encoder_noise", "u", "white noise of the encoder, rms per sample"),
    Parameter("interpolation_error", "u", "amplitude of the encoder's error once per signal period"),
    Parameter("interpolation_error_twice", "u", "amplitude of the encoder's error twice per signal period"),
    Parameter("signal_period", "u", "axis travel per signal period of the encoder"),
    Parameter("velocity_gain", "N·m·s/u", "torque per error of velocity, of a velocity loop in the drive"),
    Parameter("velocity_time", "s", "integral time of a velocity loop in the drive, 0 for no integral term"),
)
LOOPS = {"velocity", "position"}  # modes of drives that close loops themselves
DRIVE_PERIOD = 1.25e-4  # [s]
FEEDBACKS = ("motor", "load", "none")

# what `Servo.derive` takes from the axes unless it is given
DERIVED = (
    *GAINS,
    *NOTCH,
    *DRIVE,
    *LAW_PARAMETERS,
    Parameter("torque_limit", "N·m", "largest torque demand, the drive's own"),
    Parameter("resolution", "u", "axis travel per encoder count, the machine's own; 0 for an exact encoder"),
)

# gains, of which one that is given makes a loop that is no longer the derived one
LOOP_GAINS = (
    *(name for name in GAIN_NAMES if name not in FEED_FORWARD),
    "notch_frequency",
    "notch_width",
    "notch_depth",
    "velocity_gain",
    "velocity_time",
)
# so does a parameter of a law that feeds back position
SHAPING = (
    *LOOP_GAINS,
    "observer_bandwidth",
    "observer_inertia",
    "observer_viscous",
    "observer_lag",
    "contour_gain",
)

UNLESS_GIVEN: dict[str, float | str] = {
    "notch_frequency": notch.NONE,
    "notch_width": NOTCH_WIDTH,
    "notch_depth": NOTCH_DEPTH,
    **{parameter.name: 0.0 for parameter in (*DRIVE, *LAW_PARAMETERS)},
    "feedback": FEEDBACKS[0],
    "mode": MODES[0],
}
COMMON = ("period", "delay", "drive_period", "feedback_delay", "encoder_seed", "law", "learning_repeats", "motions")
_LAW_NAMES = frozenset(parameter.name for parameter in LAW_PARAMETERS)
_WORDS = {"feedback": FEEDBACKS, "mode": MODES}
_DRIVE_NAMES = frozenset(parameter.name for parameter in DRIVE)


def per_axis(name: str, value: Any, axes: int) -> tuple[Any, ...]:
    """Return a value for each axis, from one for all or one per axis."""
    single = isinstance(value, str) or not isinstance(value, Iterable)
    values = (value,) * axes if single else tuple(value)
    if len(values) != axes:
        raise InputError(f"{name} has {len(values)} values: must be one or {axes}, one per axis")
    return tuple(checked(name, one) for one in values) if name in (*_WORDS, "current_bandwidth") else values


def drives_of(feedback: Sequence[str], bandwidth: Sequence[float], mode: Sequence[str], period: float) -> Drives:
    """Return what of the drives lies in the loops, given feedback, current bandwidth and mode of every axis.

    Gains of velocity loops are left out.
    """
    load = tuple(place == "load" for place in feedback)
    return Drives(
        load if any(load) else (),
        tuple(bandwidth) if any(bandwidth) else (),
        tuple(mode) if set(mode) != {MODES[0]} else (),
        period=period if LOOPS & set(mode) else 0.0,
    )


def whole_ratio(ratio: float) -> bool:
    """Return whether a ratio is a whole number."""
    return round(ratio) >= 1 and abs(ratio - round(ratio)) < _ALMOST


def check_drive_period(own: float, period: float, mode: Sequence[str]) -> None:
    """Raise InputError unless the period of loops in the drives divides that of the servo."""
    ratio = period / positive("drive_period", own, "s", LONGEST_PERIOD)
    if LOOPS & set(mode) and not whole_ratio(ratio):
        raise InputError(f"drive_period = {own:g} s: must be a whole fraction of the servo period, {period:g} s")


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


def checked(name: str, value: Any) -> Any:
    """Return a value of one axis, or raise InputError where it is out of its bounds."""
    if name in _WORDS:
        if value not in _WORDS[name]:
            raise InputError(f"servo {name} = {value!r}: must be one of {', '.join(map(repr, _WORDS[name]))}")
        return value
    if name in _LAW_NAMES:
        return at_least(name, value, 0)
    if name in _DRIVE_NAMES:
        return between(name, value, 0, LARGEST_BANDWIDTH if name == "current_bandwidth" else _LARGEST_GAIN)
    if name in ("torque_limit", "following_error_limit"):
        return value if value == math.inf else positive(name, value)
    if name == "resolution":
        return at_least("encoder resolution", value, 0, "mm")
    if abs(finite(name, value)) > _LARGEST_GAIN:
        raise InputError(f"{name} = {value:g}: must be at most {_LARGEST_GAIN:g}")
    return float(value)
