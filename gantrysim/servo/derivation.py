"""Gains that follow from the axes: from inertia, lags, and the mode in which each axis swings on its drive."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

from gantrysim.base.errors import InputError, between, positive
from gantrysim.servo import notch
from gantrysim.servo.axis_dynamics import AxisDynamics
from gantrysim.servo.axis_loop import (
    LARGEST_PEAK,
    LEAST_GAIN_MARGIN,
    AxisLoop,
    CoupledLoops,
    LoopTask,
)
from gantrysim.servo.stability.motion import Motion

FREQUENCIES = (1e-3, 1e5)  # natural frequencies that can be given [Hz]

_SLOWER = 0.97  # from one frequency tried to the next
_SLOWEST = 1e-3  # relative to what the lags leave room for


class NoLoopError(InputError):
    """Axes of which no loop keeps its margins, at whatever natural frequency.

    Attributes:
        trouble: which margins the loops tried leave too small, in words.
    """

    def __init__(self, trouble: str) -> None:
        super().__init__(
            f"servo: no loop keeps a gain margin of {LEAST_GAIN_MARGIN:g} and a peak of |S| of at most "
            f"{LARGEST_PEAK:g} on every axis: {trouble}"
        )
        self.trouble = trouble


class Loop(NamedTuple):
    """The natural frequency of all axes and the notch of each.

    Attributes:
        frequency: [Hz].
        notches: frequency of each axis' notch, 0 for none [Hz].
        reason: what bounds the frequency, and why there are notches, in words.
    """

    frequency: float
    notches: tuple[float, ...]
    reason: str


@lru_cache(maxsize=256)
def loop(task: LoopTask, frequency: float | None = None) -> Loop:
    """Return the fastest loop that keeps a gain margin of 2 and |S| <= 2 on every axis.

    The lags of winding, sampling and output leave room for a natural frequency, see `natural_frequency`. An axis that
    would not keep the margins at it, for it swings on its drive, gets a notch at that mode. Where a notch does not do,
    or the mode is too near half the servo's frequency, all axes are slowed down until they keep the margins. So are
    axes that move each other until each keeps them with all loops closed, and all together a gain margin of 2.

    Slower is not always safer: with an integral term a loop slower than about 1 / integral_time is unstable, and one
    on the load may be held back by its mode at any speed. The slowest loop tried has a thousandth of what the lags
    leave room for.

    Args:
        task: the axes, and the shape of their loops.
        frequency: natural frequency that is to be taken, whatever the margins are; None for the fastest [Hz].

    Raises:
        NoLoopError: no loop keeps the margins.
    """
    loops = [AxisLoop(task, a) for a in range(len(task.axes))]
    if frequency is None:
        chosen, reason = _fastest(task, loops)
    else:
        chosen = between("frequency", frequency, *FREQUENCIES, "Hz")
        reason = f"natural frequency {frequency:.4g} Hz, as given"
    notches = tuple(axis_loop.notch_at(chosen) or notch.NONE for axis_loop in loops)
    for axis_loop, mode in zip(loops, notches, strict=True):
        if mode != notch.NONE:
            name = axis_loop.axis.name
            reason += f"; notch of {name} at its mode of {mode:.0f} Hz, without it {axis_loop.trouble(chosen)}"
    return Loop(chosen, notches, reason)


def _fastest(task: LoopTask, loops: Sequence[AxisLoop]) -> tuple[float, str]:
    """Return the highest natural frequency at which all axes keep their margins [Hz], and what bounds it in words."""
    groups = CoupledLoops.of(task, loops)
    room = natural_frequency(task.lag, task.damping)
    too_fast = None
    slowest_first = list(loops)
    for frequency in _tried_frequencies(room):
        failing = _failing(slowest_first, frequency)
        if failing is None and all(group.keep(frequency) for group in groups):
            break
        too_fast = frequency
        # it is likely to fail at the next frequency too, which saves trying the others
        if failing is not None:
            slowest_first = [failing, *(axis_loop for axis_loop in loops if axis_loop is not failing)]
    else:
        slowest = _failing(loops, frequency)
        at_slowest = slowest.trouble(frequency) if slowest else _trouble(loops, groups, frequency)
        raise NoLoopError(f"at {room:.3g} Hz {_trouble(loops, groups, room)}, at {frequency:.3g} Hz {at_slowest}")
    reason = f"natural frequency {frequency:.3g} Hz: "
    if too_fast is not None:
        bound = _trouble(loops, groups, too_fast)
        return frequency, f"{reason}at more, {bound}; the lags alone leave room for {room:.3g} Hz"
    lags = f"the lags of sampling, output and winding, {1e3 * task.lag:.3g} ms, leave room for no more"
    return frequency, reason + lags


def _tried_frequencies(room: float) -> Iterator[float]:
    """Yield natural frequencies from the highest that the lags leave room for to the slowest [Hz]."""
    frequency = room
    while frequency > _SLOWEST * room:
        yield frequency
        frequency *= _SLOWER


def _failing(loops: Sequence[AxisLoop], frequency: float) -> AxisLoop | None:
    """Return the first loop that no notch helps to keep its margins, None if all keep them."""
    return next((axis_loop for axis_loop in loops if axis_loop.notch_at(frequency) is None), None)


def _trouble(loops: Sequence[AxisLoop], groups: Sequence[CoupledLoops], frequency: float) -> str:
    """Return which margin is too small at a natural frequency, in words."""
    failing = _failing(loops, frequency)
    if failing is not None:
        return failing.limit(frequency)
    return next(filter(None, (group.trouble(frequency) for group in groups)), "")


def derived_laws(task: LoopTask, design: Loop) -> list[dict[str, float]]:
    """Return the parameters of each axis' laws, by name.

    Args:
        task: the axes, and the shape of their loops.
        design: of their loops.
    """
    return [AxisLoop(task, a).law_values(design.frequency, mode) for a, mode in enumerate(design.notches)]


def nominal_motions(axes: Sequence[AxisDynamics]) -> tuple[Motion, ...]:
    """Return the motion of each axis alone, or of all axes in one where a chain couples them; none if unknown."""
    if axes[0].chain is not None:
        return (axes[0].chain,)
    return tuple(axis.motion for axis in axes if axis.motion is not None)


def natural_frequency(lag: float, damping: float, phase_share: float = 2 / 3) -> float:
    """Return the natural frequency at which a PD loop with a lag keeps a share of its phase margin [Hz].

    The loop L(s) = (2 zeta w s + w^2) / s^2 crosses over at wc = w c, c^2 = 2 zeta^2 + sqrt(4 zeta^4 + 1),
    with the phase margin atan(2 zeta c): 76 degrees where zeta is 1. A lag tau takes wc tau of it, so that
    w = (1 - share) atan(2 zeta c) / (c tau). For a sampled servo tau is the drive's time constant plus one
    period: half of it for the hold and half for the difference that stands for the derivative.

    Args:
        lag: tau [s].
        damping: damping ratio zeta.
        phase_share: share of the phase margin that remains.
    """
    zeta = positive("damping", damping)
    c = math.sqrt(2 * zeta**2 + math.sqrt(4 * zeta**4 + 1))
    return (1 - phase_share) * math.atan(2 * zeta * c) / (c * positive("lag", lag, "s")) / (2 * math.pi)
