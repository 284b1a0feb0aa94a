"""The arguments of `Servo.derive`, checked and completed from the axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from inspect import signature
from typing import Any

from gantrysim.base.errors import InputError, at_least, between, finite, positive, unknown_text
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags
from gantrysim.servo.axis_loop import LoopTask
from gantrysim.servo.drive_settings import DRIVE_PERIOD, FEEDBACKS, DriveSettings, drives_in_loops
from gantrysim.servo.laws import PD, PID
from gantrysim.servo.laws.selection import Laws, is_own, law_names, words
from gantrysim.servo.laws.user import LawName
from gantrysim.servo.notch import without_notches
from gantrysim.servo.servo_values import (
    DAMPINGS,
    DERIVED,
    FOLLOWING_ERROR_LIMIT,
    LONGEST_PERIOD,
    MAX_FEEDBACK_DELAY,
    SHAPING,
    SHORTEST_PERIOD,
    check_drive_period,
    check_modes,
    check_period,
    check_whole,
    per_axis,
    whole_ratio,
)

_ROUNDING = 1e-6  # of margins computed of the same loop in two ways, relative


@dataclass(frozen=True)
class ServoRequest:
    """The arguments of `Servo.derive`, which see; `given` are those of `DERIVED` that override."""

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
    derived = [parameter.name for parameter in DERIVED]
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
    return tuple(axes)
