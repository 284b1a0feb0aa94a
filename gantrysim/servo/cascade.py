"""Gains for every mode of the drives: of loops in the servo, in the drive, or in both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from gantrysim.base.errors import InputError, positive
from gantrysim.servo import notch
from gantrysim.servo.axis_dynamics import AxisDynamics, Lags, coupled_groups
from gantrysim.servo.axis_loop import LoopTask, are_kept, keeps_margins, margin_in_words, pd_gains
from gantrysim.servo.derivation import Loop, NoLoopError, loop
from gantrysim.servo.gains import Gains
from gantrysim.servo.laws import PID
from gantrysim.servo.laws.pid import compensator
from gantrysim.servo.stability.compensator import Compensator
from gantrysim.servo.stability.margins import Laws, Plant
from gantrysim.servo.stability.motion import MODES, Drives, Motion

_SLOWER = 0.97  # from one gain tried to the next
_SLOWEST = 1e-4  # relative to the first
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
    if mode == "position":  # the drive has law and encoder, at its own period
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
        kp *= _SLOWER
        if kp < _SLOWEST * first:
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
        self._plant = Plant(motion, task.period, task.lags.delay, self._drives)

    def keep(self, kp: float) -> bool:
        """Return whether all keep their margins."""
        return keeps_margins(self._plant, self._laws(kp))

    def trouble(self, kp: float) -> str:
        """Return which margin is too small, in words; empty if none is."""
        of_names = zip(self._names, self._plant.margins(self._laws(kp)), strict=True)
        return next((margin_in_words(name, margins) for name, margins in of_names if not are_kept(margins)), "")

    def _laws(self, kp: float) -> Laws:
        task = self._task
        law: Compensator = compensator(Gains(kp=kp, ki=kp / task.integral_time), task.period)
        late = law.delayed(task.lags.feedback)
        return Laws(task.period, task.lags.delay, (late,) * len(self._names), self._drives)


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
