"""From the arguments of `Servo.derive` to the values of a servo that keeps its margins."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np

from gantrysim.base.errors import InputError, at_least, between, finite, positive
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags, coupled_groups
from gantrysim.servo.axis_loop import (
    LARGEST_PEAK,
    LEAST_GAIN_MARGIN,
    NOTCH_DEPTH,
    NOTCH_WIDTH,
    LoopTask,
    margin_in_words,
)
from gantrysim.servo.cascade import AxisGains, gains
from gantrysim.servo.derivation import NoLoopError, derived_laws, loop, natural_frequency, nominal_motions
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.servo.laws.parameters import (
    LAW_PARAMETERS,
    LEARNING,
    NOT_PD,
    PD,
    PID,
    PREVIEW,
    LawParameters,
    is_own,
    law_names,
    words,
)
from gantrysim.servo.laws.user import LawName
from gantrysim.servo.servo_values import (
    DAMPINGS,
    DRIVE,
    DRIVE_PERIOD,
    FEEDBACKS,
    FOLLOWING_ERROR_LIMIT,
    LONGEST_PERIOD,
    MAX_FEEDBACK_DELAY,
    SHAPING,
    SHORTEST_PERIOD,
    check_drive_period,
    check_modes,
    check_period,
    check_whole,
    drives_of,
    per_axis,
    whole_ratio,
)
from gantrysim.stability.margins import NO_LOOP, Laws, LinearLaw, Margins, Plant

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
    law: Any = PID
    learning_repeats: int = LawParameters.learning_repeats
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
        if self.laws != (PID,):
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
        return math.inf if PD in self.laws else self.integral_time

    @property
    def task(self) -> LoopTask:
        """The loops to be designed."""
        drives = drives_of(self.places, self.bandwidths, self.modes, self.inner_period)
        lags = Lags(self.delay, self.feedback_delay, drives)
        return LoopTask(self.axes, self.period, lags, self.damping, self.used_integral_time, self.laws)

    @property
    def shaped(self) -> bool:
        """Whether a value that shapes the loops is given, so that they are not derived alone."""
        return self.frequency is not None or any(self.given.get(name) is not None for name in SHAPING)

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


def designed(request: ServoRequest) -> dict[str, Any]:
    """Return the values of a servo, by the names of its fields.

    Raises:
        InputError: a value out of its bounds.
        NoLoopError: gains are to be derived, and no loop keeps its margins.
    """
    request = request.checked()
    gains_of_axes, laws_of_axes = _loops(request)
    values = _from_axes(request, gains_of_axes)
    values |= {parameter.name: [laws.get(parameter.name, 0.0) for laws in laws_of_axes] for parameter in LAW_PARAMETERS}
    _override(values, request)
    names = request.laws
    return {
        "period": request.period,
        "delay": request.delay,
        "feedback": request.places,
        "mode": request.modes,
        "feedback_delay": request.feedback_delay,
        "encoder_seed": request.encoder_seed,
        "law": names,
        "learning_repeats": request.learning_repeats,
        "motions": nominal_motions(request.axes) if PREVIEW in names or LEARNING in names else (),
        "drive_period": request.inner_period,
        **{name: tuple(value) for name, value in values.items()},
    }


def _loops(request: ServoRequest) -> tuple[tuple[AxisGains, ...], list[dict[str, float]]]:
    """Return the gains of each axis, and the parameters of its laws."""
    try:
        return _loops_at(request, request.frequency, request.velocity_bandwidth)
    except NoLoopError:
        if not request.gains_given:
            raise
    # none of these gains is used; parameters of laws follow from what the lags leave room for
    room = natural_frequency(request.task.lag, request.damping)
    return _loops_at(request, room, request.velocity_bandwidth or (room if "velocity" in request.modes else None))


def _loops_at(
    request: ServoRequest, frequency: float | None, velocity_bandwidth: float | None
) -> tuple[tuple[AxisGains, ...], list[dict[str, float]]]:
    task = request.task
    gains_of_axes, _ = gains(task, frequency, velocity_bandwidth)
    if task.law == (PID,):
        return gains_of_axes, [{} for _ in request.axes]
    return gains_of_axes, derived_laws(task, loop(task, frequency))


def _from_axes(request: ServoRequest, gains_of_axes: tuple[AxisGains, ...]) -> dict[str, list[float]]:
    """Return the gains, and what else follows from the axes, by name."""
    axes = request.axes
    share = 0.0 if PD in request.laws else request.feedforward
    takes_speed = [mode == "velocity" for mode in request.modes]
    return {
        **{name: [0.0 for _ in axes] for name in GAIN_NAMES},
        **{name: [getattr(own, name) for own in gains_of_axes] for name in ("kp", "ki", "kd")},
        "velocity_ff": [share * (1.0 if fast else axis.viscous) for axis, fast in zip(axes, takes_speed, strict=True)],
        "acceleration_ff": [
            share * (0.0 if fast else axis.inertia) for axis, fast in zip(axes, takes_speed, strict=True)
        ],
        "torque_limit": [axis.peak_torque for axis in axes],
        "resolution": [axis.resolution for axis in axes],
        "notch_frequency": [own.notch for own in gains_of_axes],
        "notch_width": [NOTCH_WIDTH for _ in axes],
        "notch_depth": [NOTCH_DEPTH for _ in axes],
        "following_error_limit": [request.following_error_limit for _ in axes],
        **{parameter.name: [0.0 for _ in axes] for parameter in DRIVE},
        "velocity_gain": [own.velocity_gain for own in gains_of_axes],
        "velocity_time": [own.velocity_time for own in gains_of_axes],
    }


def _override(values: dict[str, list[float]], request: ServoRequest) -> None:
    """Put the values that are given in place of those derived."""
    given = request.given
    for name, value in given.items():
        if PD in request.laws and name in NOT_PD and value is not None and np.any(value):
            raise InputError(f"{name} = {value}: must be 0 in law 'pd'; use 'pid'")
        if value is None:
            continue
        values[name] = list(per_axis(name, value, len(request.axes)))
    for name in GAIN_NAMES:
        if not isinstance(given.get(name), Iterable):
            of_modes = zip(values[name], request.modes, strict=True)
            values[name] = [0.0 if mode == "stepper" else value for value, mode in of_modes]


class DerivedServo(LinearLaw, Hashable, Protocol):
    """A servo with the modes of its drives."""

    @property
    def mode(self) -> tuple[str, ...]:
        """Of each drive."""


def check_margins(request: ServoRequest, servo: DerivedServo) -> None:
    """Raise NoLoopError unless a servo keeps its margins, with the loops of all axes that move each other closed.

    It is checked as it is, whatever it was derived from. A servo whose loops are in part given is not checked, nor is a
    user's own law.
    """
    if request.shaped or is_own(request.laws[0]):
        return
    for name, margins in zip([axis.name for axis in request.axes], _margins(request.axes, servo), strict=True):
        enough = min(margins.gain, margins.together) >= LEAST_GAIN_MARGIN * (1 - _ROUNDING)
        if not enough or margins.sensitivity > LARGEST_PEAK * (1 + _ROUNDING):
            raise NoLoopError(f"{margin_in_words(name, margins)} in the servo derived")


@lru_cache(maxsize=256)
def _margins(axes: tuple[AxisDynamics, ...], servo: DerivedServo) -> tuple[Margins, ...]:
    """Return the margins of each axis; those of axes of unknown motion are without bound."""
    groups = coupled_groups(axes)
    coupled = {a for members in groups for a in members}
    laws = servo.compensators()
    found: dict[int, Margins] = {}
    for members in [*groups, *([a] for a in range(len(axes)) if a not in coupled)]:
        axis = axes[members[0]]
        motion = axis.motion if axis.coupled is None else axis.coupled
        if motion is None:
            continue
        drives = servo.drives.of_axes(members)
        of_members = Laws(servo.period, servo.delay, tuple(laws[a] for a in members), drives)
        plant = Plant(motion, servo.period, servo.delay, drives)
        found |= zip(members, plant.margins(of_members), strict=True)
    return tuple(found.get(a, NO_LOOP) for a in range(len(axes)))
