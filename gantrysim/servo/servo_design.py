"""From the arguments of `Servo.derive` to the values of a servo that keeps its margins."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from gantrysim.base.errors import InputError, positive
from gantrysim.servo import notch
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags, coupled_groups
from gantrysim.servo.derivation import (
    LARGEST_PEAK,
    LEAST_GAIN_MARGIN,
    Loop,
    LoopTask,
    NoLoopError,
    are_kept,
    derived_laws,
    keeps_margins,
    loop,
    margin_in_words,
    natural_frequency,
    nominal_motions,
    pd_gains,
)
from gantrysim.servo.drive_settings import DriveSettings
from gantrysim.servo.gains import GAIN_NAMES, Gains
from gantrysim.servo.laws import PD, PID
from gantrysim.servo.laws.pid import compensator
from gantrysim.servo.laws.selection import Laws, added_laws, base_law
from gantrysim.servo.notch import Notch
from gantrysim.servo.request import Parts, ServoRequest, law_values, per_axis
from gantrysim.servo.stability import margins as stability
from gantrysim.servo.stability.linear_system import Compensator
from gantrysim.servo.stability.margins import NO_LOOP, Margins, UnheldLaws, plant_of
from gantrysim.servo.stability.motion import MODES, Drives, Motion

# Gains for every mode of the drives: of loops in the servo, in the drive, or in both.

_GAIN_STEP = 0.97  # from one gain tried to the next
_SLOWEST_GAIN = 1e-4  # relative to the first
_HIGHEST_BANDWIDTH = 1e5  # [Hz]


class AxisGains(NamedTuple):
    """The gains of an axis as its mode takes them, its notch, and those of a velocity loop in the drive.

    Attributes:
        gains: kp, ki and kd; the others are 0.
        notch: frequency, 0 for none [Hz].
        velocity_gain: K of the velocity loop [N·m·s/u].
        velocity_time: its integral time Ti [s].
    """

    gains: Gains = Gains()
    notch: float = notch.NONE
    velocity_gain: float = 0.0
    velocity_time: float = 0.0


@lru_cache(maxsize=256)
def gains(
    task: LoopTask, frequency: float | None = None, velocity_bandwidth: float | None = None
) -> tuple[tuple[AxisGains, ...], str]:
    """Return the gains of each axis, and what bounds them in words; axes of one mode get one frequency.

    Args:
        task: the machine's axes, with lags that hold the modes of the drives; its law is that of axes that take
            torques, its damping ratio that of loops with torque demands.
        frequency: natural frequency that is to be taken, of a loop around velocity loops kp / 2 pi; None for the
            highest that keeps the margins [Hz].
        velocity_bandwidth: of velocity loops, likewise [Hz].

    Raises:
        InputError: several modes of axes that move each other.
        NoLoopError: no loop keeps its margins.
    """
    axes = task.axes
    gains_of_axes: dict[int, AxisGains] = {}
    reasons = []
    _check_modes_of_groups(axes, task.lags.drives, frequency)
    for mode in MODES:
        places = [a for a in range(len(axes)) if task.lags.drives.mode_of(a) == mode]
        if not places:
            continue
        gains_of_mode, reason = _of_mode(mode, _part(task, places), frequency, velocity_bandwidth)
        gains_of_axes |= dict(zip(places, gains_of_mode, strict=True))
        names = ", ".join(axes[a].name for a in places)
        reasons.append(reason if len(places) == len(axes) else f"{names}: {reason}")
    return tuple(gains_of_axes[a] for a in range(len(axes))), "; ".join(reasons)


def _check_modes_of_groups(axes: Sequence[AxisDynamics], drives: Drives, frequency: float | None) -> None:
    """Raise InputError for several modes of axes that move each other: their margins together are not known."""
    if drives.mode and axes[0].chain is not None and len(set(drives.mode)) > 1:
        raise InputError("servo mode: the axes are coupled by a closed chain, all must have one mode")
    for members in coupled_groups(axes):
        modes = {drives.mode_of(a) for a in members}
        if len(modes) > 1 and frequency is None:
            names = ", ".join(axes[a].name for a in members)
            given = " and ".join(map(repr, sorted(modes)))
            raise InputError(f"servo mode: axes {names} move each other: must have one mode, not {given}")


def _part(task: LoopTask, places: Sequence[int]) -> LoopTask:
    """Return the task for some of its axes."""
    return task._replace(axes=tuple(task.axes[a] for a in places), lags=task.lags.of_axes(places))


def _of_mode(
    mode: str, task: LoopTask, frequency: float | None, velocity_bandwidth: float | None
) -> tuple[list[AxisGains], str]:
    """Return the gains of axes that all have one mode, and what bounds them in words."""
    if mode == "stepper":
        return [AxisGains() for _ in task.axes], "steppers in open loop have no gains"
    if mode == "velocity":
        return _around_velocity(task, frequency, velocity_bandwidth)
    drives = task.lags.drives
    plain = Drives(drives.load, drives.bandwidth)
    # the drive has law and encoder, at its own period
    if mode == "position":
        return _direct(task._replace(period=drives.period, lags=Lags(drives=plain), law=(PID.name,)), frequency)
    return _direct(task._replace(lags=task.lags._replace(drives=plain)), frequency)


def _direct(task: LoopTask, frequency: float | None) -> tuple[list[AxisGains], str]:
    """Return the gains of loops that demand torques at a period."""
    design = loop(task, frequency)
    axis_gains = [
        AxisGains(pd_gains(axis, design.frequency, task.damping, task.integral_time), notch=mode)
        for axis, mode in zip(task.axes, design.notches, strict=True)
    ]
    return axis_gains, design.reason


def velocity_loop(axes: tuple[AxisDynamics, ...], drives: Drives, bandwidth: float | None) -> Loop:
    """Return the velocity loops of drives as loops of positions.

    K (w - v + 1 / Ti integral) is the law kd = K, kp = K / Ti of the integral of the error of velocity. With
    K = 2 J w and Ti = 2 / w, both poles of a rigid axis are at w, and the bandwidth K / J is 2 w: the highest that
    keeps a gain margin of 2 and |S| <= 2, without notches.

    Args:
        axes: of the drives.
        drives: their properties; the encoder of the velocity is on the motor.
        bandwidth: K / J to be taken; None for the highest [Hz].

    Raises:
        NoLoopError: no velocity loop keeps its margins.
    """
    frequency = None if bandwidth is None else 0.5 * positive("velocity_bandwidth", bandwidth, "Hz", _HIGHEST_BANDWIDTH)
    lags = Lags(drives=Drives(bandwidth=drives.bandwidth))
    return loop(LoopTask(axes, drives.period, lags, notched=False), frequency)


def _around_velocity(task: LoopTask, frequency: float | None, bandwidth: float | None) -> tuple[list[AxisGains], str]:
    """Return the gains of velocity loops and of the loops around them: the fastest that keep their margins."""
    drives = task.lags.drives
    inner = velocity_loop(task.axes, drives, bandwidth)
    w = 2 * math.pi * inner.frequency
    inner_gains = [pd_gains(axis, inner.frequency, 1.0, math.inf) for axis in task.axes]
    velocity = tuple((gains.kd, gains.kp / gains.kd) for gains in inner_gains)
    task = task._replace(lags=task.lags._replace(drives=drives._replace(velocity=velocity)))
    speed = f"velocity loops of {2 * inner.frequency:.3g} Hz"
    if frequency is None:
        kp, limit = _fastest_around(task, w, speed)
    else:
        kp = 2 * math.pi * positive("frequency", frequency, "Hz", _HIGHEST_BANDWIDTH)
        limit = "as given"
    reason = f"kp {kp:.3g} 1/s, {limit}; {speed} in the drives, of {inner.reason}"
    axis_gains = [
        AxisGains(Gains(kp=kp, ki=kp / task.integral_time), velocity_gain=gains.kd, velocity_time=2 / w)
        for gains in inner_gains
    ]
    return axis_gains, reason


def _fastest_around(task: LoopTask, first: float, speed: str) -> tuple[float, str]:
    """Return the highest kp around velocity loops that keeps the margins [1/s], and what bounds it in words.

    Args:
        task: with the gains of the velocity loops.
        first: the highest that is tried [1/s].
        speed: of the velocity loops, in words.

    Raises:
        NoLoopError: none keeps them.
    """
    parts = _nominal_parts(task)
    too_fast = None
    kp = first
    while not all(part.keep(kp) for part in parts):
        too_fast = kp
        kp *= _GAIN_STEP
        if kp < _SLOWEST_GAIN * first:
            raise NoLoopError(
                f"around {speed}, with kp {first:.3g} 1/s {_trouble(parts, first)}, with kp {too_fast:.3g} 1/s "
                f"{_trouble(parts, too_fast)}"
            )
    if too_fast is None:
        return kp, "that of the velocity loops"
    return kp, f"at more, {_trouble(parts, too_fast)}"


class _Outer:
    """The loops around the velocity loops of axes that move each other, or of one axis that moves no other."""

    def __init__(self, task: LoopTask, members: Sequence[int], motion: Motion) -> None:
        self._task = task
        self._names = [task.axes[a].name for a in members]
        self._drives = task.lags.drives.of_axes(members)
        self._plant = plant_of(motion, task.period, task.lags.delay, self._drives)

    def keep(self, kp: float) -> bool:
        """Return whether all keep their margins."""
        return keeps_margins(self._plant, self._laws(kp))

    def trouble(self, kp: float) -> str:
        """Return which margin is too small, in words; empty if none is."""
        of_names = zip(self._names, self._plant.margins(self._laws(kp)), strict=True)
        return next((margin_in_words(name, margins) for name, margins in of_names if not are_kept(margins)), "")

    def _laws(self, kp: float) -> UnheldLaws:
        task = self._task
        law: Compensator = compensator(Gains(kp=kp, ki=kp / task.integral_time), task.period)
        late = law.delayed(task.lags.feedback)
        return UnheldLaws(task.period, task.lags.delay, (late,) * len(self._names), self._drives)


def _nominal_parts(task: LoopTask) -> list[_Outer]:
    """Return the loops of all axes whose motion is known."""
    groups = coupled_groups(task.axes)
    coupled = {a for members in groups for a in members}
    members_of = sorted([*groups, *([a] for a in range(len(task.axes)) if a not in coupled)])
    parts = []
    for members in members_of:
        axis = task.axes[members[0]]
        motion = axis.motion if axis.coupled is None else axis.coupled
        if motion is not None:
            parts.append(_Outer(task, members, motion))
    return parts


def _trouble(parts: Sequence[_Outer], kp: float) -> str:
    """Return which margin is too small around the velocity loops, in words."""
    return next(filter(None, (part.trouble(kp) for part in parts)), "")


_ROUNDING = 1e-6  # of margins computed of the same loop in two ways, relative


def designed_parts(request: ServoRequest) -> Parts:
    """Return gains, drives, notches and laws of a servo: loop design, laws, overrides.

    Args:
        request: checked.

    Raises:
        InputError: a value out of its bounds.
        NoLoopError: gains are to be derived, and no loop keeps its margins.
    """
    axis_gains, law_values_of_axes = _loops(request)
    laws = _laws(request, law_values_of_axes)
    derived = Parts(_gains(request, axis_gains), _drives(request, axis_gains), _notches(axis_gains), laws)
    return derived.with_values(_overrides(request))


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
    if task.law == (PID.name,):
        return gains_of_axes, [{} for _ in request.axes]
    return gains_of_axes, derived_laws(task, loop(task, frequency))


def _gains(request: ServoRequest, axis_gains: Sequence[AxisGains]) -> tuple[Gains, ...]:
    """Return the gains: those of the loops, and the feed-forward for inertia and viscous friction."""
    share = 0.0 if PD.name in request.laws else request.feedforward
    gains_of_axes = []
    for axis, mode, loop_gains in zip(request.axes, request.modes, axis_gains, strict=True):
        takes_speed = mode == "velocity"
        gains_of_axis = loop_gains.gains._replace(
            velocity_ff=share * (1.0 if takes_speed else axis.viscous),
            acceleration_ff=share * (0.0 if takes_speed else axis.inertia),
        )
        gains_of_axes.append(Gains() if mode == "stepper" else gains_of_axis)
    return tuple(gains_of_axes)


def _drives(request: ServoRequest, axis_gains: Sequence[AxisGains]) -> tuple[DriveSettings, ...]:
    """Return the settings of drives and encoders, those of the machine."""
    return tuple(
        DriveSettings(
            velocity_gain=loop_gains.velocity_gain,
            velocity_time=loop_gains.velocity_time,
            torque_limit=axis.peak_torque,
            resolution=axis.resolution,
            feedback=place,
            mode=mode,
        )
        for axis, place, mode, loop_gains in zip(request.axes, request.places, request.modes, axis_gains, strict=True)
    )


def _notches(axis_gains: Sequence[AxisGains]) -> tuple[Notch, ...]:
    return tuple(Notch(loop_gains.notch) for loop_gains in axis_gains)


def _laws(request: ServoRequest, values_of_axes: Sequence[Mapping[str, float]]) -> Laws:
    """Return the laws with their derived parameters."""
    inverting = any(law.inverts_machine for law in added_laws(request.laws))
    return Laws(
        request.laws,
        tuple(law_values(values) for values in values_of_axes),
        request.learning_repeats,
        nominal_motions(request.axes) if inverting else (),
    )


def _overrides(request: ServoRequest) -> dict[str, Any]:
    """Return the values that are given, one per axis each, in place of those derived."""
    overrides = {}
    base = base_law(request.laws)
    for name, value in request.given.items():
        if name in base.unused_gains and value is not None and np.any(value):
            raise InputError(f"{name} = {value}: must be 0 in law {base.name!r}; use {PID.name!r}")
        if value is None:
            continue
        values = per_axis(name, value, len(request.axes))
        # one for all axes that take gains
        if name in GAIN_NAMES and not isinstance(value, Iterable):
            values = tuple(0.0 if mode == "stepper" else gain for gain, mode in zip(values, request.modes, strict=True))
        overrides[name] = values
    return overrides


def check_margins(request: ServoRequest, margins_of_axes: Sequence[Margins]) -> None:
    """Raise NoLoopError unless each axis has the margins that derived loops keep.

    Args:
        request: what the servo was derived from.
        margins_of_axes: of the servo that follows from it.
    """
    for axis, margins in zip(request.axes, margins_of_axes, strict=True):
        enough = margins.least_gain >= LEAST_GAIN_MARGIN * (1 - _ROUNDING)
        if not enough or margins.sensitivity > LARGEST_PEAK * (1 + _ROUNDING):
            raise NoLoopError(f"{margin_in_words(axis.name, margins)} in the servo derived")


@lru_cache(maxsize=256)
def margins_at(axes: tuple[AxisDynamics, ...], servo: stability.LinearLaw) -> tuple[Margins, ...]:
    """Return the margins of each axis, with the loops of all axes that move each other closed.

    Those of axes of unknown motion are without bound.
    """
    groups = coupled_groups(axes)
    coupled = {a for members in groups for a in members}
    laws = servo.compensators()
    margins_of_axes: dict[int, Margins] = {}
    for members in [*groups, *([a] for a in range(len(axes)) if a not in coupled)]:
        axis = axes[members[0]]
        motion = axis.motion if axis.coupled is None else axis.coupled
        if motion is None:
            continue
        drives = servo.loop_drives.of_axes(members)
        of_members = stability.UnheldLaws(servo.period, servo.delay, tuple(laws[a] for a in members), drives)
        plant = plant_of(motion, servo.period, servo.delay, drives)
        margins_of_axes |= zip(members, plant.margins(of_members), strict=True)
    return tuple(margins_of_axes.get(a, NO_LOOP) for a in range(len(axes)))
