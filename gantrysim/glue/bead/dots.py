"""Dots: glue that a program switches while the needle rests, as solder paste on a pad.

A dot is a spherical cap on the work. With its volume V and the contact angle theta, its radius a on the work and its
height h are

    V = pi h (3 a^2 + h^2) / 6,        h = a tan(theta / 2),

and where its height is given, a^2 = (6 V / (pi h) - h^2) / 3, up to that of a hemisphere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, lengths, spans
from gantrysim.base.columns import blocks
from gantrysim.glue.bead.section import BeadSettings
from gantrysim.record.run import Run

_SHARE_AT_REST = 0.5  # share, which is exceeded, of a dot's demand at rest; of its time, if nothing is demanded there
_STANDSTILL_WAY = 1e-9  # commanded way in a tick; more is motion [mm]
_CLEAR_HEIGHT = 0.1  # of a dot's height, by which a needle that has left it is above its top


@dataclass(frozen=True)
class Cap:
    """A spherical cap.

    Attributes:
        radius: on the work [mm].
        height: at its middle [mm].
    """

    radius: float
    height: float

    @classmethod
    def of(cls, volume: float, settings: BeadSettings) -> Cap:
        """Return the cap of a volume [mm³], of the contact angle or the height of `settings`."""
        if volume <= 0:
            return cls(0.0, 0.0)
        hemisphere = (1.5 * volume / math.pi) ** (1 / 3)
        if settings.dot_height is not None:
            height = min(settings.dot_height, hemisphere)
            return cls(math.sqrt((6 * volume / (math.pi * height) - height**2) / 3), height)
        slope = math.tan(0.5 * math.radians(settings.contact_angle))
        radius = (6 * volume / (math.pi * slope * (3 + slope**2))) ** (1 / 3)
        return cls(radius, slope * radius)

    def profile(self, distance: Floats) -> Floats:
        """Return its height at distances from its middle [mm], of the same shape."""
        if self.height <= 0:
            return np.zeros_like(distance)
        sphere = (self.radius**2 + self.height**2) / (2 * self.height)
        heights = np.sqrt(np.maximum(sphere**2 - distance**2, 0.0)) - (sphere - self.height)
        return np.where(distance <= self.radius, np.maximum(heights, 0.0), 0.0)


@dataclass(frozen=True)
class Dot:
    """A dot as it was laid.

    Attributes:
        stretch: first tick of the dispenser's command, and the first after it.
        share: first tick of the time up to the neighbouring stretches, whose glue is the dot's, and the first after it.
        asked: place at which the needle is commanded to rest, (x, y, z) [mm].
        place: middle of its glue, (x, y, z) [mm].
        volume: laid while the needle is at it [mm³].
        demand: that the program requests; 0 where it requests none at rest [mm³].
        string: that flows after the needle has left it, or before it comes, which draws a string [mm³].
        cap: its shape on the work.
        foot: middle of the cap on the work, (x, y, z) [mm].
    """

    stretch: tuple[int, int]
    share: tuple[int, int]
    asked: tuple[float, float, float]
    place: tuple[float, float, float]
    volume: float
    demand: float
    string: float
    cap: Cap
    foot: tuple[float, float, float]

    @property
    def diameter(self) -> float:
        """Diameter on the work [mm]."""
        return 2 * self.cap.radius

    @property
    def place_error(self) -> float:
        """Distance from the commanded place in plan view [mm]."""
        return math.dist(self.asked[:2], self.place[:2])

    @property
    def string_percent(self) -> float:
        """Glue drawn into a string, of all glue of the dot [%]."""
        total = self.volume + self.string
        return 100 * self.string / total if total > 0 else 0.0

    def volume_error_percent(self, target: float | None) -> float:
        """Return its volume beyond a target, by default the demand, over that; nan where none is requested [%]."""
        wanted = self.demand if target is None else target
        return 100 * (self.volume / wanted - 1) if wanted > 0 else math.nan


def dots_of(run: Run, settings: BeadSettings, gap: float) -> tuple[Dot, ...]:
    """Return the dots of a run, in their order.

    A stretch of dispensing is a dot where more than half of its glue is requested at rest, and the commanded way does
    not leave the dot: in plan view it extends less than the dot is wide, or than the needle's face. It is none where a
    bead begins or ends in it, as a pump gets going before the needle moves: it belongs to that bead.

    Args:
        run: the run.
        settings: shape of the dots.
        gap: height of the nozzle above the work on the requested path [mm].
    """
    stretches = spans(run.dispense).tolist()
    last = len(run.time) - 1
    middles = [(before[1] + after[0]) // 2 for before, after in pairwise(stretches)]
    edges = [0, *middles, last] if stretches else []
    demands = [_rest_demand(run, settings, begin, min(after, last)) for begin, after in stretches]
    dots = []
    for number, (stretch, share, demand) in enumerate(zip(stretches, pairwise(edges), demands, strict=True)):
        if demand is None:
            continue
        begin, after = stretch
        dot = _dot(run, settings, gap, (begin, after), share, demand)
        # where the beads beside it begin or end
        ends = []
        if number and demands[number - 1] is None:
            ends.append(stretches[number - 1][1])
        if number + 1 < len(stretches) and demands[number + 1] is None:
            ends.append(stretches[number + 1][0])
        reach = max(dot.cap.radius, 0.5 * run.face)
        if all(math.dist(run.commanded_tip[min(tick, last), :2], dot.asked[:2]) > reach for tick in ends):
            dots.append(dot)
    return tuple(dots)


def _rest_demand(run: Run, settings: BeadSettings, begin: int, after: int) -> float | None:
    """Return the volume that a stretch of dispensing requests [mm³], None where it is no dot."""
    if after <= begin:
        return None
    total = 0.0
    at_rest = 0.0
    resting = 0
    low = high = run.commanded_tip[begin, :2]
    widest = _widest(run, settings, begin, after)
    for block in blocks(after - begin):
        ticks = slice(begin + block.start, begin + block.stop)
        tips = run.commanded_tip[ticks.start : ticks.stop + 1]
        # column by column, which is several times as fast
        low = np.minimum(low, [tips[:, 0].min(), tips[:, 1].min()])
        high = np.maximum(high, [tips[:, 0].max(), tips[:, 1].max()])
        if float((high - low).max()) > widest:
            return None
        still = lengths(np.diff(tips, axis=0)) <= _STANDSTILL_WAY
        demand = run.flow_demand[ticks] * run.period
        total += float(demand.sum())
        at_rest += float(demand[still].sum())
        resting += int(np.count_nonzero(still))
    shares = (at_rest, total) if total > 0 and at_rest > 0 else (resting, after - begin)
    if shares[0] <= _SHARE_AT_REST * shares[1]:
        return None
    # a flow in proportion to the speed is requested in the last tick of a motion alone
    return total if at_rest > 0 else 0.0


def _widest(run: Run, settings: BeadSettings, begin: int, after: int) -> float:
    """Return the diameter of all glue that a stretch requests as one dot, or the needle's face if larger [mm]."""
    volume = sum(
        float(run.flow_demand[begin + block.start : begin + block.stop].sum()) for block in blocks(after - begin)
    )
    return max(2 * Cap.of(volume * run.period, settings).radius, run.face)


def _dot(
    run: Run, settings: BeadSettings, gap: float, stretch: tuple[int, int], share: tuple[int, int], demand: float
) -> Dot:
    ticks = slice(*share)
    asked = run.commanded_tip[stretch[1] - 1]
    glue = run.flow[ticks] * run.period
    total = float(glue.sum())
    whole = Cap.of(total, settings)
    nozzle = run.nozzle[ticks]
    rise = nozzle[:, 2] - asked[2]
    aside = np.hypot(nozzle[:, 0] - asked[0], nozzle[:, 1] - asked[1])
    is_near = (aside <= max(whole.radius, 0.5 * run.face)) & (
        gap + rise <= max(whole.height, gap) + _CLEAR_HEIGHT * whole.height
    )
    laid = np.where(is_near, glue, 0.0)
    volume = float(laid.sum())
    x, y, z = (laid @ nozzle / volume if volume > 0 else asked).tolist()
    asked_x, asked_y, asked_z = asked.tolist()
    return Dot(
        stretch=stretch,
        share=share,
        asked=(asked_x, asked_y, asked_z),
        place=(x, y, z),
        volume=volume,
        demand=demand,
        string=total - volume,
        cap=Cap.of(volume, settings),
        foot=(x, y, asked_z - gap),
    )


def dotted_ticks(dots: tuple[Dot, ...], ticks: int) -> NDArray[np.bool_]:
    """Return whether ticks belong to dots, (n,)."""
    dotted = np.zeros(ticks, bool)
    for dot in dots:
        dotted[slice(*dot.share)] = True
    return dotted
