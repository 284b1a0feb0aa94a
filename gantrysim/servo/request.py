"""The arguments of `Servo.derive`, checked and completed from the axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from inspect import signature
from typing import Any, NamedTuple

from gantrysim.base.errors import (
    InputError,
    at_least,
    between,
    finite,
    positive,
    unknown_text,
    whole_number,
    wrong_type,
)
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags
from gantrysim.servo.derivation import LoopTask
from gantrysim.servo.drive_settings import (
    DRIVE,
    DRIVE_PERIOD,
    FEEDBACKS,
    LOOPS,
    WORDS,
    DriveSettings,
    GivenDrives,
    drives_in_loops,
)
from gantrysim.servo.gains import FEED_FORWARD, GAIN_NAMES, GAINS, Gains, GivenGains
from gantrysim.servo.laws import LAW_PARAMETERS, LAWS, PD, PID, GivenLaws, LawValues
from gantrysim.servo.laws.selection import Laws, is_own, law_names, words
from gantrysim.servo.laws.user import LawName
from gantrysim.servo.notch import NOTCH, GivenNotches, Notch, without_notches
from gantrysim.servo.stability.motion import MODES

# What a servo is given: names, units and bounds of its values, one per axis or in common.

_LARGEST_GAIN = 1e18
DAMPINGS = (1e-3, 1e3)
LONGEST_PERIOD = 1.0  # [s]
SHORTEST_PERIOD = 1e-7  # [s]

MAX_FEEDBACK_DELAY = 16  # servo periods
LARGEST_BANDWIDTH = 1e5  # [Hz]
_WHOLE_NUMBER = 1e-6  # a whole number
LARGEST_SEED = 2**53

FOLLOWING_ERROR_LIMIT = 5.0  # [mm], between the 0.1 mm of a tuned gantry and the 10 mm of a jam

# what `Servo.derive` takes from the axes unless it is given
DERIVED_VALUES = (*GAINS, *NOTCH, *DRIVE, *LAW_PARAMETERS)


class GivenValues(GivenGains, GivenNotches, GivenDrives, GivenLaws, total=False):
    """Every parameter of `DERIVED_VALUES` as a keyword of `Servo.derive`: one value for all axes, or one per axis."""


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
    return tuple(checked_value(name, item) for item in values) if name in (*WORDS, "current_bandwidth") else values


def whole_ratio(ratio: float) -> bool:
    """Return whether a ratio is a whole number."""
    return round(ratio) >= 1 and abs(ratio - round(ratio)) < _WHOLE_NUMBER


def check_drive_period(drive_period: float, period: float, mode: Sequence[str]) -> None:
    """Raise InputError unless the period of loops in the drives divides that of the servo."""
    ratio = period / positive("drive_period", drive_period, "s", LONGEST_PERIOD)
    if LOOPS & set(mode) and not whole_ratio(ratio):
        raise InputError(
            f"drive_period = {drive_period:g} s: must be a whole fraction of the servo period, {period:g} s"
        )


def check_whole(name: str, value: float, most: int) -> None:
    """Raise InputError unless a value is a whole number from 0 to the most."""
    between(name, whole_number(name, value, 0), 0, most)


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


def checked_value(name: str, value: Any) -> Any:
    """Return a value of one axis, or raise InputError where it is out of its bounds."""
    if name in WORDS:
        if value not in WORDS[name]:
            raise InputError(f"servo {name} = {value!r}: must be one of {', '.join(map(repr, WORDS[name]))}")
        return value
    if name in _LAW_NAMES:
        return at_least(name, value, 0)
    if name in ("torque_limit", "following_error_limit"):
        return value if value == math.inf else positive(name, value, "N·m" if name == "torque_limit" else "")
    if name == "resolution":
        return at_least("encoder resolution", value, 0, "mm")
    if name in _DRIVE_NAMES:
        if name == "current_bandwidth":
            return between(name, value, 0, LARGEST_BANDWIDTH, "Hz")
        return between(name, value, 0, _LARGEST_GAIN)
    if abs(finite(name, value)) > _LARGEST_GAIN:
        raise InputError(f"{name} = {value:g}: must be at most {_LARGEST_GAIN:g}")
    return float(value)


_ROUNDING = 1e-6  # of margins computed of the same loop in two ways, relative


@dataclass(frozen=True)
class ServoRequest:
    """The arguments of `Servo.derive`, which see; `given` are those of `DERIVED_VALUES` that override."""

    axes: tuple[AxisDynamics, ...]
    period: float = 1e-3
    frequency: float | None = None
    damping: float = 1.0
    feedforward: float = 1.0
    integral_time: float = math.inf
    following_error_limit: float = FOLLOWING_ERROR_LIMIT
    delay: float = 0.0
    feedback: Any = FEEDBACKS[0]
    mode: Any = None
    feedback_delay: int = 0
    encoder_seed: int = 0
    law: Any = PID.name
    learning_repeats: int = Laws.learning_repeats
    drive_period: float | None = None
    velocity_bandwidth: float | None = None
    given: Mapping[str, Any] = field(default_factory=dict)

    def checked(self) -> ServoRequest:
        """Return the request with its numbers as floats, or raise InputError for a value out of its bounds."""
        if not self.axes:
            raise InputError("a servo must have at least one axis")
        check_period(self.period)
        for name in ("frequency", "velocity_bandwidth"):
            if getattr(self, name) is not None:
                finite(name, getattr(self, name), "Hz")
        damping = between("damping", self.damping, *DAMPINGS)
        feedforward = at_least("feedforward", self.feedforward, 0)
        time = self.integral_time
        if time != math.inf:
            time = finite("integral_time", time, "s")
        if not time > 0:
            raise InputError(f"integral_time = {time:g} s: must be greater than 0 s; inf for no integral term")
        at_least("integral_time", min(time, LONGEST_PERIOD), SHORTEST_PERIOD, "s")
        check_drive_period(self.inner_period, self.period, self.modes)
        _ = self.places, self.bandwidths
        check_whole("feedback_delay", self.feedback_delay, MAX_FEEDBACK_DELAY)
        _ = self.laws
        delay = at_least("servo delay", self.delay, 0, "s")
        if self.velocity_bandwidth is not None and "velocity" not in self.modes:
            width = positive("velocity_bandwidth", self.velocity_bandwidth, "Hz")
            raise InputError(f"velocity_bandwidth = {width:g} Hz: no drive is in mode 'velocity'")
        if self.laws != (PID.name,):
            check_modes(f"servo law = {words(self.laws)}", self.modes)
        return replace(self, damping=damping, feedforward=feedforward, integral_time=time, delay=delay)

    @cached_property
    def inner_period(self) -> float:
        """Period of loops in the drives [s]."""
        default = DRIVE_PERIOD if whole_ratio(self.period / DRIVE_PERIOD) else self.period
        return self.drive_period or default

    @cached_property
    def modes(self) -> tuple[str, ...]:
        """Mode of each axis' drive."""
        return per_axis("mode", self.mode or tuple(axis.mode for axis in self.axes), len(self.axes))

    @cached_property
    def places(self) -> tuple[str, ...]:
        """Place of each axis' encoder."""
        count = len(self.axes)
        counts = per_axis("resolution", self.given.get("resolution", [axis.resolution for axis in self.axes]), count)
        return tuple(
            "none" if mode == "stepper" and place == "motor" and not resolution else place
            for mode, place, resolution in zip(
                self.modes, per_axis("feedback", self.feedback, count), counts, strict=True
            )
        )

    @cached_property
    def bandwidths(self) -> tuple[float, ...]:
        """Bandwidth of each axis' current loop, 0 for none [Hz]."""
        return per_axis("current_bandwidth", self.given.get("current_bandwidth") or 0.0, len(self.axes))

    @cached_property
    def laws(self) -> tuple[LawName, ...]:
        """Names of the laws."""
        return law_names(self.law)

    @property
    def used_integral_time(self) -> float:
        """Integral time of the law, inf for one without an integral term [s]."""
        return math.inf if PD.name in self.laws else self.integral_time

    @property
    def task(self) -> LoopTask:
        """The loops to be designed."""
        settings = [
            DriveSettings(current_bandwidth=bandwidth, feedback=place, mode=mode)
            for bandwidth, place, mode in zip(self.bandwidths, self.places, self.modes, strict=True)
        ]
        drives = drives_in_loops(settings, self.inner_period)._replace(velocity=())
        lags = Lags(self.delay, self.feedback_delay, drives)
        notched = not without_notches(self.given.get("notch_frequency"))
        return LoopTask(self.axes, self.period, lags, self.damping, self.used_integral_time, self.laws, notched)

    @property
    def shaped(self) -> bool:
        """Whether a value that shapes the loops is given, so that they are not derived alone."""
        return self.frequency is not None or any(self.given.get(name) is not None for name in SHAPING)

    @property
    def keeps_margins(self) -> bool:
        """Whether all loops are derived, by laws of known response, so that they must keep their margins."""
        return not self.shaped and not is_own(self.laws[0])

    @property
    def gains_given(self) -> bool:
        """Whether all gains of the loops are given, so that none is taken from the derivation."""
        needed = {"kp"}
        if self.used_integral_time < math.inf:
            needed.add("ki")
        if set(self.modes) - {"velocity", "stepper"}:
            needed.add("kd")
        if "velocity" in self.modes:
            needed |= {"velocity_gain", "velocity_time"}
        return all(self.given.get(name) is not None for name in needed)


def check_keywords(given: Iterable[str], derive: Callable[..., Any]) -> None:
    """Raise TypeError, as Python does, for a keyword that `Servo.derive`, which is given, does not have."""
    derived = [parameter.name for parameter in DERIVED_VALUES]
    for name in given:
        if name not in derived:
            parameters = signature(derive).parameters.values()
            named = [parameter.name for parameter in parameters if parameter.kind is parameter.KEYWORD_ONLY]
            raise TypeError(f"Servo.derive: {unknown_text('keyword', name, [*named, *derived])}")


def axes_of(axes: Any) -> tuple[AxisDynamics, ...]:
    """Return the axes of a machine, or raise InputError for what is likely to be given instead: machine or name."""
    if isinstance(axes, str) or not isinstance(axes, Iterable):
        raise InputError(
            f"axes is of type {type(axes).__name__}: must be the axes of a machine; write Servo.derive(machine.axes)"
        )
    given = tuple(axes)
    for axis in given:
        if not hasattr(axis, "inertia"):
            raise wrong_type("axis", axis, "an axis of a machine", "write Servo.derive(machine.axes)")
    return given


# What a servo is made of, axis by axis, and its values by the keys of a job file.

_NOTCH = "notch_"  # before the keys of a notch
_OF_ALL_LAWS = ("law", "learning_repeats", "motions")  # keys


class Parts(NamedTuple):
    """Gains, drives, notches and laws of a servo.

    Attributes:
        gains: of each axis.
        drives: of each axis.
        notches: of each axis.
        laws: of all axes.
    """

    gains: tuple[Gains, ...]
    drives: tuple[DriveSettings, ...]
    notches: tuple[Notch, ...]
    laws: Laws

    @property
    def modes(self) -> tuple[str, ...]:
        """Command mode of each axis' drive."""
        return tuple(drive.mode for drive in self.drives)

    def completed(self) -> Parts:
        """Return the parts with every value checked, and with notches and laws where none are given.

        Raises:
            InputError: not as many values as there are axes, or a value out of its bounds.
        """
        axes = len(self.gains)
        if not axes:
            raise InputError("gains has 0 values: must be one per axis, at least one")
        notches = self.notches or (Notch(),) * axes
        parameters = self.laws.parameters or (LawValues(),) * axes
        for name, values in (("drives", self.drives), ("notches", notches), ("laws", parameters)):
            if len(values) != axes:
                raise InputError(f"{name} has {len(values)} values: must be {axes}, one per axis")
        return Parts(
            _checked_parts(self.gains),
            _checked_parts(self.drives),
            _checked_parts(notches, _NOTCH),
            replace(self.laws, parameters=_checked_parts(parameters)),
        )

    def check(self, period: float) -> None:
        """Raise InputError for values that contradict each other.

        Args:
            period: servo period [s].
        """
        for drive, gains in zip(self.drives, self.gains, strict=True):
            _check_drive(drive, gains)
        self.laws.check(period)
        base = self.laws.base
        for gains in self.gains:
            for name in base.without_term(gains):
                value = getattr(gains, name)
                raise InputError(f"{name} = {value:g}: has no effect in law {base.name!r}; use {PID.name!r}")

    def with_values(self, values: Mapping[str, Any]) -> Parts:
        """Return the parts with other values.

        Args:
            values: by key, one for all axes or one per axis.

        Raises:
            InputError: as many values as there are axes are needed, or a value is none of those allowed.
        """
        return Parts(
            _changed_parts(self.gains, values),
            _changed_parts(self.drives, values),
            _changed_parts(self.notches, values, _NOTCH),
            self._changed_laws(values),
        )

    def _changed_laws(self, values: Mapping[str, Any]) -> Laws:
        laws = self.laws
        parameters = _changed_parts(laws.parameters, values)
        return replace(
            laws,
            names=law_names(values.get("law", laws.names)),
            parameters=parameters,
            learning_repeats=values.get("learning_repeats", laws.learning_repeats),
            motions=tuple(values.get("motions", laws.motions)),
        )

    def per_axis(self, name: str) -> tuple[Any, ...]:
        """Return the values of all axes by key, or raise InputError for no key of an axis."""
        for parts, prefix in ((self.gains, ""), (self.drives, ""), (self.notches, _NOTCH), (self.laws.parameters, "")):
            field = name.removeprefix(prefix)
            if name.startswith(prefix) and field in parts[0]._fields:
                return tuple(getattr(part, field) for part in parts)
        raise InputError(unknown_text("value of the servo", name, sorted(KEYS_OF_AXES)))

    def values(self) -> dict[str, Any]:
        """Return all values by key: one per axis but for law, learning_repeats and motions."""
        return {
            **_values(self.gains),
            **_values(self.notches, _NOTCH),
            **_values(self.drives),
            **_values(self.laws.parameters),
            "law": self.laws.names,
            "learning_repeats": self.laws.learning_repeats,
            "motions": self.laws.motions,
        }


KEYS_OF_AXES = frozenset(
    (*Gains._fields, *DriveSettings._fields, *(_NOTCH + name for name in Notch._fields), *LawValues._fields)
)
KEYS = KEYS_OF_AXES.union(_OF_ALL_LAWS)


def check_keys(keys: Iterable[str], others: Sequence[str]) -> None:
    """Raise TypeError, as Python does, for a key that neither the parts of a servo nor its other values have."""
    known = KEYS.union(others)
    for key in keys:
        if key not in known:
            raise TypeError(f"Servo.with_values: {unknown_text('keyword', key, sorted(known))}")


def law_values(values: Mapping[str, float]) -> Any:
    """Return the parameters of one axis' laws, 0 for those that are not given."""
    return LawValues(**{parameter.name: values.get(parameter.name, 0.0) for parameter in LAW_PARAMETERS})


def _changed_parts(parts: tuple[Any, ...], values: Mapping[str, Any], prefix: str = "") -> tuple[Any, ...]:
    for name in parts[0]._fields:
        key = prefix + name
        if key in values:
            of_axes = per_axis(key, values[key], len(parts))
            parts = tuple(part._replace(**{name: value}) for part, value in zip(parts, of_axes, strict=True))
    return parts


def _values(parts: tuple[Any, ...], prefix: str = "") -> dict[str, tuple[Any, ...]]:
    return {prefix + name: tuple(getattr(part, name) for part in parts) for name in parts[0]._fields}


def _checked_parts(parts: tuple[Any, ...], prefix: str = "") -> tuple[Any, ...]:
    """Return the values of all axes, each checked; errors as of `checked`."""
    return tuple(
        type(part)(*(checked_value(prefix + name, value) for name, value in part._asdict().items())) for part in parts
    )


def _check_drive(drive: DriveSettings, gains: Gains) -> None:
    """Raise InputError for settings of a drive that contradict each other, or the gains."""
    error = max(drive.interpolation_error, drive.interpolation_error_twice)
    if error and not drive.signal_period:
        raise InputError(
            f"signal_period = {drive.signal_period:g} mm: must be greater than 0 mm where there is an interpolation "
            f"error, which is {error:g} mm"
        )
    if drive.feedback == "none" and drive.mode != "stepper":
        raise InputError(f"servo feedback = 'none': a drive in mode {drive.mode!r} needs it; use 'motor' or 'load'")
    for name, gain in gains._asdict().items():
        if gain and drive.mode == "stepper":
            raise InputError(f"{name} = {gain:g} in mode 'stepper': must be 0, nothing is fed back; use 'torque'")
    if bool(drive.velocity_gain) is not (drive.mode == "velocity"):
        need = "must be greater than 0" if drive.mode == "velocity" else "must be 0, only for mode 'velocity'"
        raise InputError(f"velocity_gain = {drive.velocity_gain:g} N·m·s/mm in mode {drive.mode!r}: {need}")
