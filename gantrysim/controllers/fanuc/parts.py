"""The parts of a program between its stops: what they command at every time, and for how long."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.controllers.fanuc.legs import PathLeg
from gantrysim.controllers.fanuc.speed import Feeding, Planner
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Vector
from gantrysim.paths.profile import Constant, PointToPoint, Profile

_ROUNDING = 1e-9  # of an arc length [mm]


@dataclass(frozen=True)
class Part:
    """A part of the program: motions without a stop, the rotary axis alone, or a stop.

    Attributes:
        duration: [s].
        sample: from times since its start, (n,), to x, y, z, the rotary axis and the progress along the requested path,
            (n, 5), and whether glue is laid, (n,).
        lines: from those times to the lines of the text that run, 0 for those of another file, (n,).
        flow: from those times to the set point of the flow, (n,).
    """

    duration: float
    sample: Callable[[Floats], tuple[Floats, NDArray[np.bool_]]]
    lines: Callable[[Floats], NDArray[np.intp]]
    flow: Callable[[Floats], Floats]


def stretch(legs: list[PathLeg], feeding: Feeding, begun: float, reached: float) -> Part:
    """Return motions without a stop between them.

    Args:
        legs: the motions.
        feeding: their feeds.
        begun: time at which they begin [s].
        reached: arc length of the requested path there [mm].
    """
    chain = Chain(leg.piece for leg in legs if leg.piece is not None)
    profile = Planner(legs, chain, feeding).profile(begun)
    rotary = np.array([leg.rotary for leg in legs])
    glue = np.array([leg.dispense for leg in legs])
    source = np.array([leg.source.line for leg in legs], np.intp)
    set_points = np.array([leg.source.flow for leg in legs])

    def index(s: Floats) -> NDArray[np.intp]:
        # a leg ends where it should, whatever rounding makes of the place
        return np.clip(np.searchsorted(chain.ends, s + _ROUNDING, side="right"), 0, len(legs) - 1)

    def lines(t: Floats) -> NDArray[np.intp]:
        return source[index(profile.position(t))]

    def flow(t: Floats) -> Floats:
        return set_points[index(profile.position(t))]

    def sample(t: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        s = profile.position(t)
        k = index(s)
        place = np.empty((s.size, 5))
        place[:, 3] = rotary[k, 0]
        place[:, 4] = reached + s
        if np.ptp(rotary):
            place[:, :3], share = chain.position_and_share(s)
            place[:, 3] += share * np.diff(rotary, axis=1)[k, 0]
        else:
            place[:, :3] = chain.position(s)
        return place, glue[k]

    return Part(profile.duration, sample, lines, flow)


def in_place(leg: PathLeg, here: Vector, feeding: Feeding, reached: float) -> Part:
    """A stop, or a motion of the rotary axis alone, at a place and an arc length of the requested path [mm]."""
    first, last = leg.rotary
    speed = min(leg.feed, feeding.rotary_velocity)
    profile: Profile | None = None
    if first != last and math.isfinite(feeding.rotary_acceleration):
        profile = PointToPoint(abs(last - first), speed, feeding.rotary_acceleration)
    elif first != last:
        profile = Constant(abs(last - first), speed)

    def sample(t: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        turned = np.zeros(t.shape) if profile is None else profile.position(t)
        angle = first + math.copysign(1.0, last - first) * turned
        place = np.column_stack([np.tile(here, (t.size, 1)), angle, np.full(t.shape, reached)])
        return place, np.full(t.shape, leg.dispense)

    def lines(t: Floats) -> NDArray[np.intp]:
        return np.full(t.shape, leg.source.line, np.intp)

    def flow(t: Floats) -> Floats:
        return np.full(t.shape, leg.source.flow)

    return Part(leg.dwell if profile is None else profile.duration, sample, lines, flow)


def averaged_places(place: Floats, dispense: NDArray[np.bool_], window: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Moving average over `window` ticks, by which it is longer; the dispenser is delayed by half of them."""
    padded = np.concatenate([np.repeat(place[:1], window, axis=0), place, np.repeat(place[-1:], window, axis=0)])
    origin = padded[0].copy()
    # small numbers: sums of large ones would lose digits
    summed = np.cumsum(padded - origin, axis=0)
    mean = origin + (summed[window:] - summed[:-window]) / window
    late = np.zeros(len(mean), bool)
    late[window // 2 : window // 2 + len(dispense)] = dispense
    return mean, late
