"""Gains for every mode of the drives: of loops in the servo, in the drive, or in both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from gantrysim.controllers import notch
from gantrysim.controllers.derivation import (
    LARGEST_PEAK,
    LEAST_GAIN_MARGIN,
    AxisDynamics,
    Lags,
    Loop,
    kept,
    loop,
    pd_gains,
)
from gantrysim.controllers.law import GAIN_NAMES, compensator
from gantrysim.controllers.laws.parameters import PID
from gantrysim.controllers.laws.user import LawName
from gantrysim.errors import InputError, positive
from gantrysim.stability.margins import Laws, Plant
from gantrysim.stability.motion import MODES, Drives

_SLOWER = 0.97  # from one gain tried to the next
_SLOWEST = 1e-4  # relative to the first
_HIGHEST_BANDWIDTH = 1e5  # [Hz]


class AxisGains(NamedTuple):
    """The gains of an axis: kp, ki, kd as its mode takes them, its notch, and those of a velocity loop in the drive.

    Attributes:
        kp, ki, kd: see `gantrysim.Servo`.
        notch: frequency, 0 for none [Hz].
        velocity_gain: K of the velocity loop [N·m·s/u].
        velocity_time: its integral time Ti [s].
    """

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    notch: float = notch.NONE
    velocity_gain: float = 0.0
    velocity_time: float = 0.0


@lru_cache(maxsize=256)
def gains(
    axes: tuple[AxisDynamics, ...],
    period: float,
    frequency: float | None,
    damping: float,
    integral_time: float,
    lags: Lags,
    velocity_bandwidth: float | None,
    law: tuple[LawName, ...] = (PID,),
) -> tuple[tuple[AxisGains, ...], str]:
    """Return the gains of each axis, and what bounds them in words; axes of one mode get one frequency.

    Args:
        axes: the machine's axes.
        period: servo period [s].
        frequency: natural frequency that is to be taken, of a loop around velocity loops kp / 2 pi; None for the
            highest that keeps the margins [Hz].
        damping: damping ratio zeta of loops with torque demands.
        integral_time: kp / ki [s].
        lags: what makes the loops late, with the modes of the drives.
        velocity_bandwidth: of velocity loops, likewise [Hz].
        law: names of the laws of axes that take torques.

    Raises:
        InputError: several modes in a closed chain, or a velocity loop around which no loop keeps its margins.
    """
    found: dict[int, AxisGains] = {}
    reasons = []
    if lags.drives.mode and axes[0].chain is not None and len(set(lags.drives.mode)) > 1:
        raise InputError("servo mode: the axes are coupled by a closed chain, all must have one mode")
    for mode in MODES:
        places = [a for a in range(len(axes)) if lags.drives.mode_of(a) == mode]
        chosen, drives = tuple(axes[a] for a in places), lags.drives.of_axes(places)
        plain = Drives(drives.load, drives.bandwidth)
        if not places or mode == "stepper":
            own, why = [AxisGains() for _ in places], "steppers in open loop have no gains"
        elif mode == "velocity":
            own, why = _around_velocity(chosen, period, frequency, integral_time, lags, drives, velocity_bandwidth)
        elif mode == "position":
            own, why = _direct(chosen, drives.period, frequency, damping, integral_time, Lags(drives=plain))
        else:
            own, why = _direct(chosen, period, frequency, damping, integral_time, lags._replace(drives=plain), law)
        found |= dict(zip(places, own, strict=True))
        if places:
            names = ", ".join(axis.name for axis in chosen)
            reasons.append(why if len(places) == len(axes) else f"{names}: {why}")
    return tuple(found[a] for a in range(len(axes))), "; ".join(reasons)


def _direct(
    axes: tuple[AxisDynamics, ...],
    period: float,
    frequency: float | None,
    damping: float,
    integral_time: float,
    lags: Lags,
    law: tuple[LawName, ...] = (PID,),
) -> tuple[list[AxisGains], str]:
    """Return the gains of loops that demand torques at a period."""
    found = loop(axes, period, frequency, damping, integral_time, lags, law)
    each = [
        AxisGains(**pd_gains(axis, found.frequency, damping, integral_time), notch=mode)
        for axis, mode in zip(axes, found.notches, strict=True)
    ]
    return each, found.reason


def velocity_loop(axes: tuple[AxisDynamics, ...], drives: Drives, bandwidth: float | None) -> Loop:
    """Return the velocity loops of drives as loops of positions.

    K (w - v + 1 / Ti integral) is the law kd = K, kp = K / Ti of the integral of the error of velocity. With
    K = 2 J w and Ti = 2 / w, both poles of a rigid axis are at w, and the bandwidth K / J is 2 w: the highest that
    keeps a gain margin of 2 and |S| <= 2, without notches.

    Args:
        axes: of the drives.
        drives: their properties; the encoder of the velocity is on the motor.
        bandwidth: K / J to be taken; None for the highest [Hz].
    """
    frequency = None if bandwidth is None else 0.5 * positive("velocity_bandwidth", bandwidth, "Hz", _HIGHEST_BANDWIDTH)
    lags = Lags(drives=Drives(bandwidth=drives.bandwidth))
    return loop(axes, drives.period, frequency, 1.0, math.inf, lags, notched=False)


def _around_velocity(
    axes: tuple[AxisDynamics, ...],
    period: float,
    frequency: float | None,
    integral_time: float,
    lags: Lags,
    drives: Drives,
    bandwidth: float | None,
) -> tuple[list[AxisGains], str]:
    """Return the gains of velocity loops and of the loops around them: the fastest that keep their margins."""
    inner = velocity_loop(axes, drives, bandwidth)
    w = 2 * math.pi * inner.frequency
    each = [pd_gains(axis, inner.frequency, 1.0, math.inf) for axis in axes]
    drives = drives._replace(velocity=tuple((one["kd"], one["kp"] / one["kd"]) for one in each))
    kp = w if frequency is None else 2 * math.pi * positive("frequency", frequency, "Hz", _HIGHEST_BANDWIDTH)
    bound, first = "", kp
    while frequency is None and (trouble := _trouble(axes, period, lags, drives, kp, integral_time)):
        bound, kp = trouble, kp * _SLOWER
        if kp < _SLOWEST * first:
            raise InputError(
                f"velocity loops of {2 * inner.frequency:.3g} Hz: {trouble}; give a lower velocity_bandwidth"
            )
    limit = f"at more, {bound}" if bound else "as given" if frequency else "that of the velocity loops"
    why = f"kp {kp:.3g} 1/s, {limit}; velocity loops of {2 * inner.frequency:.3g} Hz in the drives, of {inner.reason}"
    return [AxisGains(kp=kp, ki=kp / integral_time, velocity_gain=one["kd"], velocity_time=2 / w) for one in each], why


def _trouble(
    axes: Sequence[AxisDynamics], period: float, lags: Lags, drives: Drives, kp: float, integral_time: float
) -> str:
    """Return which margin is too small around the velocity loops, in words; empty if none is."""
    gain = dict.fromkeys(GAIN_NAMES, 0.0) | {"kp": kp, "ki": kp / integral_time}
    law = compensator(tuple(gain[name] for name in GAIN_NAMES), period).delayed(lags.feedback)
    chain = axes[0].chain
    parts = (
        [(axes, chain, drives)]
        if chain
        else [([axis], axis.motion, drives.of_axes([a])) for a, axis in enumerate(axes)]
    )
    for together, motion, own in parts:
        if motion is None:
            continue
        laws = Laws(period, lags.delay, (law,) * len(together), own)
        found_of = Plant(motion, period, lags.delay, own).margins(laws)
        for axis, found in zip(together, found_of, strict=True):
            if not kept(found) or found.together < LEAST_GAIN_MARGIN:
                return (
                    f"{axis.name} has a gain margin of {min(found.gain, found.together):.3g} (at least "
                    f"{LEAST_GAIN_MARGIN:g}) and a peak of |S| of {found.sensitivity:.4g} (at most {LARGEST_PEAK:g})"
                )
    return ""
