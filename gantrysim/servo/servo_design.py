"""From the arguments of `Servo.derive` to the values of a servo that keeps its margins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from gantrysim.base.errors import InputError
from gantrysim.servo.axis_dynamics import AxisDynamics, coupled_groups
from gantrysim.servo.axis_loop import LARGEST_PEAK, LEAST_GAIN_MARGIN, margin_in_words
from gantrysim.servo.cascade import AxisGains, gains
from gantrysim.servo.derivation import NoLoopError, derived_laws, loop, natural_frequency, nominal_motions
from gantrysim.servo.drive_settings import DriveSettings
from gantrysim.servo.gains import GAIN_NAMES, Gains
from gantrysim.servo.laws import PD, PID
from gantrysim.servo.laws.linear import added_laws, base_law
from gantrysim.servo.laws.selection import Laws
from gantrysim.servo.notch import Notch
from gantrysim.servo.parts import Parts, law_values
from gantrysim.servo.request import ServoRequest
from gantrysim.servo.servo_values import (
    per_axis,
)
from gantrysim.servo.stability import margins as stability
from gantrysim.servo.stability.margins import NO_LOOP, Margins, Plant

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
        if name in GAIN_NAMES and not isinstance(value, Iterable):  # one for all axes that take gains
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
        of_members = stability.Laws(servo.period, servo.delay, tuple(laws[a] for a in members), drives)
        plant = Plant(motion, servo.period, servo.delay, drives)
        margins_of_axes |= zip(members, plant.margins(of_members), strict=True)
    return tuple(margins_of_axes.get(a, NO_LOOP) for a in range(len(axes)))
