"""An outline traced at constant speed relative to the work, its normal held in one direction at the needle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.arrays import Floats
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.limits import Limited, fastest, nodes
from gantrysim.controllers.paths.arcs import ArcChain
from gantrysim.controllers.profile import Constant
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.controllers.stage.bounds import AXES, FREE, Place, Three, axis_limits, held, travel
from gantrysim.controllers.stage.outline import outline, polygon
from gantrysim.controllers.stage.table import Complex, Table
from gantrysim.controllers.stage.turning import Turning
from gantrysim.errors import InputError, at_least, point, positive, whole

_ANYWHERE = (-math.inf, math.inf)
_STEP = 0.05  # of the way between places where the limits are looked at [mm]
_NUDGE = 1e-9  # [mm], into a piece from its ends
_ZOOMS = 4  # each by 50
_LOOKS = 101  # on a piece, for its furthest place
_JUMP = 1e-5  # of an axis' rate, that is none


@dataclass(frozen=True)
class OutlineTrace(Controller):
    """Traces the outline of a work piece on an XY stage that rides on a rotary table.

    The work piece is a polygon with rounded corners. Along an edge the table stands and the stage moves at the path
    speed; in a corner of radius r the table turns at speed / r while the stage runs on an arc, so that the needle's
    place on the work goes round the corner at the path speed and the outward normal keeps its direction at the
    needle. With u and n on the outline and the geometry of `Table`,

        TH = angle(n_K) - angle(n),    S = sigma [C + R(-TH) (K - C) - W - u].

    Where edge meets corner the velocities of all axes jump. Where an acceleration is limited the stage stops there,
    unless `blend` eases the table into the corner: TH is then the mean of the above over that length of the
    way. The needle stays on the outline, whatever TH; only the normal is off, by up to an eighth of the corner's angle
    per millimetre times the length.

    Args:
        width: along x, and
        height: along y, of a rectangle about the work's origin; or else
        corners: of any polygon in the work frame, in the order of the motion (m, 2) [mm].
        corner_radius: [mm].
        speed: of the needle relative to the work, LSP [mm/s].
        clockwise: sense in which a rectangle is run; it begins on its left edge, given clockwise at its lower end.
        needle: K in the base frame [mm].
        centre: of the rotation, C, in the base frame [mm].
        work_centre: place of the work's origin when all axes are at zero, W [mm].
        normal: direction in the base frame of the outline's outward normal at the needle, n_K.
        sigma: 1 where a positive stage move moves the work in the positive direction, -1 where it reads the needle
            relative to the work.
        velocity: limits of the axes th, x, y [deg/s, mm/s, mm/s].
        acceleration: limits of the axes th, x, y [deg/s², mm/s², mm/s²].
        travel_x: software limits of the stage's x [mm].
        travel_y: software limits of the stage's y [mm].
        blend: length of the way over which the table's turning is eased, 0 to stop where edge meets corner [mm].
        corner_pieces: for comparison, number of pieces that each corner is cut into, with all axes moving linearly
            in each; 0 for the exact arcs.

    Raises:
        InputError: a value out of its bounds, an edge too short for its arcs, or a place that the stage cannot reach.
    """

    width: float = 100.0
    height: float = 60.0
    corners: tuple[Place, ...] | None = None
    corner_radius: float = 10.0
    speed: float = 50.0
    clockwise: bool = True
    needle: Place = (-200.0, 0.0)
    centre: Place = (0.0, 0.0)
    work_centre: Place = (0.0, 0.0)
    normal: Place = (-1.0, 0.0)
    sigma: int = -1
    velocity: Three = FREE
    acceleration: Three = FREE
    travel_x: Place = _ANYWHERE
    travel_y: Place = _ANYWHERE
    blend: float = 0.0
    corner_pieces: int = 0

    def __post_init__(self) -> None:
        positive("width", self.width, "mm")
        positive("height", self.height, "mm")
        positive("corner_radius", self.corner_radius, "mm")
        positive("speed", self.speed, "mm/s")
        for name in ("needle", "centre", "work_centre", "normal"):
            object.__setattr__(self, name, point(name, getattr(self, name)))
        if self.normal == (0.0, 0.0):
            raise InputError("normal = (0, 0): must have a direction")
        if self.sigma not in (-1, 1):
            raise InputError(f"sigma = {self.sigma}: must be 1 or -1")
        for name, unit in (("velocity", "s"), ("acceleration", "s²")):
            object.__setattr__(self, name, axis_limits(name, getattr(self, name), unit))
        for name in ("travel_x", "travel_y"):
            object.__setattr__(self, name, travel(name, getattr(self, name)))
        at_least("blend", self.blend, 0, "mm")
        whole("corner_pieces", self.corner_pieces, 0)
        if self.blend > 0 and self.corner_pieces > 0:
            raise InputError(
                f"blend = {self.blend:g} mm: must be 0 mm where corner_pieces is {self.corner_pieces}; "
                "linear pieces are not eased"
            )
        if self.blend > self.requested.length:
            raise InputError(f"blend = {self.blend:g} mm: must be at most the outline, {self.requested.length:g} mm")
        self._check_travel()

    @cached_property
    def _table(self) -> Table:
        return Table(complex(*self.needle), complex(*self.centre), complex(*self.work_centre), self.sigma)

    @cached_property
    def _outline(self) -> tuple[ArcChain, float]:
        corners = self.corners
        if corners is None:
            x, y = 0.5 * self.width, 0.5 * self.height
            corners = ((-x, -y), (-x, y), (x, y), (x, -y))
            if not self.clockwise:
                corners = (corners[1], corners[0], *corners[:1:-1])
        return outline(polygon(corners), self.corner_radius)

    @property
    def requested(self) -> ArcChain:
        """The outline in the work frame."""
        return self._outline[0]

    @cached_property
    def turning(self) -> Turning:
        """Angle of the table along the outline [rad]."""
        path, outward = self._outline
        ends = np.concatenate([[0.0], path.ends])
        kept = np.concatenate([[True], np.diff(ends) > _NUDGE])
        heading = path.heading(ends)
        first = math.atan2(self.normal[1], self.normal[0]) - (heading[0] + 0.5 * math.pi * outward)
        turned = math.remainder(first, 2 * math.pi) - (heading - heading[0])
        return Turning(ends[kept], turned[kept], self.blend)

    def coordinates(self, s: ArrayLike) -> Floats:
        """Positions of th, x and y at arc lengths of the outline, (n, 3) [deg, mm, mm]."""
        at = np.atleast_1d(np.asarray(s, float))
        if self.corner_pieces == 0:
            return self._exact(at)
        knots = self._knots
        values = self._exact(knots)
        return np.stack([np.interp(at, knots, values[:, i]) for i in range(3)], axis=1)

    @cached_property
    def _knots(self) -> Floats:
        """Arc lengths between which the linear variant runs straight."""
        s, turns = self.turning.s, np.diff(self.turning.angle) != 0
        parts = [
            np.linspace(low, high, (self.corner_pieces if turned else 1) + 1)[:-1]
            for low, high, turned in zip(s[:-1], s[1:], turns, strict=True)
        ]
        return np.concatenate([*parts, s[-1:]])

    def _exact(self, s: Floats) -> Floats:
        theta = self.turning.value(s)
        stage = self._table.stage(_complex(self.requested.position(s)), theta)
        return np.stack([np.degrees(theta), stage.real, stage.imag], axis=1)

    @cached_property
    def law(self) -> Constant | Limited:
        """Way along the outline over time."""
        if all(math.isinf(limit) for limit in (*self.velocity, *self.acceleration)):
            return Constant(self.requested.length, self.speed)
        breaks = self._knots if self.corner_pieces else np.concatenate([self.turning.s, self.turning.breaks])
        breaks = np.unique(np.clip(breaks, 0.0, self.requested.length))
        breaks = breaks[np.diff(breaks, prepend=-1.0) > 2 * _NUDGE]
        ends = np.append(breaks[1:-1], self.requested.length)
        s, piece = nodes(ends, _STEP)
        rate, bend = self._derivatives(s, piece, np.concatenate([[0.0], ends]))
        speed = np.minimum(self.speed, held(s, rate, self.velocity))
        if any(math.isfinite(limit) for limit in self.acceleration):
            jump = (np.diff(s) == 0) & (np.abs(np.diff(rate, axis=0)).max(axis=1) > _JUMP)
            speed[:-1][jump] = speed[1:][jump] = 0.0
        return fastest(s, speed, rate, bend, self.velocity, self.acceleration)

    def _derivatives(self, s: Floats, piece: np.ndarray[tuple[int], np.dtype[np.intp]], edges: Floats) -> list[Floats]:
        """First and second derivatives of th, x and y over the way, from within each piece, (m, 3)."""
        if self.corner_pieces:
            slope = np.diff(self._exact(edges), axis=0) / np.diff(edges)[:, None]
            return [slope[piece], np.zeros((s.size, 3))]
        at = np.clip(s, edges[piece] + _NUDGE, edges[piece + 1] - _NUDGE)
        theta, turning, change = self.turning.value(at), self.turning.rate(at), self.turning.change(at)
        tangent = _complex(self.requested.tangent(at))
        rate = self._table.rate(tangent, theta, turning)
        bend = self._table.bend(tangent, self.requested.curvature(at), theta, turning, change)
        return [
            np.stack([np.degrees(first), second.real, second.imag], axis=1)
            for first, second in ((turning, rate), (change, bend))
        ]

    @property
    def duration(self) -> float:
        """Time of the motion [s]."""
        return self.law.duration

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes that move."""
        return AXES

    @property
    def notes(self) -> tuple[str, ...]:
        """What limits and blending cost, in words."""
        said = []
        ideal = self.requested.length / self.speed
        if isinstance(self.law, Limited) and self.duration > ideal * (1 + 1e-6):
            slowest, where = self.law.slowest
            place = f"down to {slowest:.3g} mm/s at {where:.1f} mm of the outline"
            said.append(
                f"speed: the axes' limits make it {self.duration:.3f} s instead of {ideal:.3f} s, "
                f"{100 * (1 - ideal / self.duration):.0f} % of the mean speed lost, {place}"
            )
        if self.blend > 0:
            s = np.concatenate([self.turning.s, np.linspace(0.0, self.requested.length, 20001)])
            off = self.turning.value(s) - Turning(self.turning.s, self.turning.angle).value(s)
            said.append(f"blend: the normal at the needle is off by up to {np.degrees(np.abs(off).max()):.2f} deg")
        if self.corner_pieces:
            step = np.diff(self.turning.angle)
            inward = self.corner_radius * self._outline[1] * np.sign(step) * _unit(self.normal)
            reach = np.abs(self._table.needle - self._table.centre - inward)
            sag = (reach * (1 - np.cos(0.5 * step / self.corner_pieces))).max()
            said.append(f"corners: {self.corner_pieces} linear pieces each are off the arc by up to {sag:.4g} mm")
        return tuple(said)

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        return {"speed": change(self.speed)}

    def setpoints(self, period: float) -> Setpoints:
        """Return the commanded positions of the axes th, x and y at every servo period [s]."""
        return Setpoints.along(self.requested, self.law, period, axes=AXES, coordinates=self.coordinates)

    def _check_travel(self) -> None:
        edges = self.turning.s
        ways = np.linspace(edges[:-1], edges[1:], _LOOKS, axis=1)
        seen = self.coordinates(ways.ravel()).reshape(*ways.shape, 3)
        margin = np.abs(np.diff(seen, 2, axis=1)).max()  # of what lies between two looks
        for piece, (begin, end) in enumerate(pairwise(edges)):
            for column, (low, high) in ((1, self.travel_x), (2, self.travel_y)):
                for side, limit in ((-1, low), (1, high)):
                    if (side * seen[piece, :, column]).max() < side * limit - margin:
                        continue
                    s = self._furthest(column, side, begin, end)
                    th, *stage = self.coordinates(s)[0]
                    if side * (stage[column - 1] - limit) > _NUDGE:
                        x, y = self.needle
                        raise InputError(
                            f"outline piece {piece + 1} of {edges.size - 1}, at {s:.4g} mm: "
                            f"needle ({x:g}, {y:g}) mm needs stage {AXES[column]} = {stage[column - 1]:.6g} mm "
                            f"at th = {th:.4g} deg: must lie in {low:g} to {high:g} mm; "
                            "move the needle, the work centre or the centre of rotation"
                        )

    def _furthest(self, column: int, side: int, begin: float, end: float) -> float:
        """Place within a piece of the outline where an axis stands furthest to one side [mm]."""
        for _ in range(_ZOOMS):
            s = np.linspace(begin, end, _LOOKS)
            k = int((side * self.coordinates(s)[:, column]).argmax())
            begin, end = s[max(k - 1, 0)], s[min(k + 1, _LOOKS - 1)]
        return float(s[k])


def _complex(vectors: Floats) -> Complex:
    return np.asarray(vectors[:, 0] + 1j * vectors[:, 1], np.complex128)


def _unit(direction: Place) -> complex:
    z = complex(*direction)
    return z / abs(z)
