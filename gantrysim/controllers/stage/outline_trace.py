"""An outline traced at constant speed relative to the work, its normal at the needle in a constant direction."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, plane_point, positive, whole_number
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.stage.stage_geometry import Complex, StageGeometry, Turning
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.limits import Derivatives, Limited, fastest, nodes, velocity_bound
from gantrysim.paths.profile import Constant
from gantrysim.record.setpoints import Setpoints

# Limits of the stage's axes.

Three = tuple[float, float, float]
Place = tuple[float, float]

AXES = ("th", "x", "y")
FREE = (math.inf, math.inf, math.inf)
_UNITS = ("deg", "mm", "mm")


def axis_limits(name: str, values: Three, unit: str) -> Three:
    """Return positive limits of th, x and y, inf for none, as floats, or raise InputError."""
    if len(values) != 3:
        raise InputError(f"{name} of {len(values)} values: must be three, of th, x and y")
    for axis, length, value in zip(AXES, _UNITS, values, strict=True):
        if value != math.inf:
            positive(f"{name} of {axis}", value, f"{length}/{unit}")
    th, x, y = (float(value) for value in values)
    return th, x, y


def travel(name: str, values: Place) -> Place:
    """Return a lower and an upper limit as floats [mm], or raise InputError."""
    if len(values) != 2 or not values[0] < values[1]:
        raise InputError(f"{name} = {tuple(values)} mm: must be a lower and an upper limit")
    return float(values[0]), float(values[1])


# The outline of a work piece: a polygon with rounded corners.

_ROUNDING = 1e-9  # [mm]
_STRAIGHT_TURN = 1e-6  # [rad]


def polygon(corners: Sequence[Sequence[float]]) -> Floats:
    """Return the corners of a polygon as complex numbers, (m,) [mm].

    Raises:
        InputError: fewer than three, coincident ones, no area, or crossing edges.
    """
    if len(corners) < 3:
        raise InputError(f"outline of {len(corners)} corners: must have at least 3")
    z = np.array([complex(*plane_point(f"outline corner {k + 1}", corner)) for k, corner in enumerate(corners)])
    edges = np.roll(z, -1) - z
    short = np.flatnonzero(np.abs(edges) < _ROUNDING)
    if short.size:
        raise InputError(f"outline: corners {short[0] + 1} and {(short[0] + 1) % z.size + 1} coincide")
    if abs(_area(z)) < _ROUNDING:
        raise InputError("outline: has no area: its corners must not be collinear, nor its edges cross")
    crossing = _crossing(z)
    if crossing is not None:
        raise InputError(f"outline: edges {crossing[0] + 1} and {crossing[1] + 1} cross: must not")
    return z


def _crossing(z: Floats) -> tuple[int, int] | None:
    """Two crossing edges, or None: each has the ends of the other on different sides."""

    def side(points: Floats) -> Floats:
        """Positive for points to the left of the edges, (edges, points)."""
        return (np.conj(np.roll(z, -1) - z)[:, None] * (points[None] - z[:, None])).imag

    apart = side(z) * side(np.roll(z, -1)) < 0
    crossing = np.argwhere(np.triu(apart & apart.T))
    return (int(crossing[0, 0]), int(crossing[0, 1])) if crossing.size else None


def _area(z: Floats) -> float:
    """Signed area, positive where the corners go counter-clockwise [mm²]."""
    return float(0.5 * np.sum((np.conj(z) * np.roll(z, -1)).imag))


def outline(z: Floats, radius: float) -> tuple[ArcChain, float]:
    """Return the closed path along a polygon's edges, each followed by the arc of the corner at its end.

    It begins at the start of the first edge, after its corner.

    Args:
        z: corners in the order of the motion, as complex numbers, (m,) [mm].
        radius: of the corners [mm].

    Returns:
        path: edges and arcs alternately, 2 m pieces.
        outward: side of the outside, 1 for left and -1 for right.

    Raises:
        InputError: edges that double back or cross, or an edge too short for the arcs at its ends.
    """
    edges = np.roll(z, -1) - z
    turn = np.angle(np.roll(edges, -1) / edges)  # at the end of each edge
    # an arc that turns by half a turn would need infinite room on its edges
    back = np.flatnonzero(np.abs(turn) > math.pi - _STRAIGHT_TURN)
    if back.size:
        raise InputError(f"outline: doubles back at corner {(back[0] + 1) % z.size + 1}")
    if abs(abs(turn.sum()) - 2 * math.pi) > _STRAIGHT_TURN:
        raise InputError(f"outline: turns by {math.degrees(turn.sum()):.0f} deg in total: must not cross itself")
    # of an edge at its end, from the corner to where the arc begins
    cut = radius * np.tan(0.5 * np.abs(turn))
    straight = np.abs(edges) - cut - np.roll(cut, 1)
    if straight.min() < -_ROUNDING:
        room = radius * np.abs(edges) / (cut + np.roll(cut, 1))
        k = int(room.argmin())
        raise InputError(
            f"corner_radius = {radius:g} mm: must be at most {room[k]:.6g} mm for edge {k + 1} of {abs(edges[k]):g} mm"
        )
    lengths = np.stack([np.maximum(straight, 0.0), radius * np.abs(turn)], axis=1).ravel()
    curvature = np.stack([np.zeros(z.size), np.sign(turn) / radius], axis=1).ravel()
    start = z[0] + np.roll(cut, 1)[0] * edges[0] / abs(edges[0])
    path = ArcChain((start.real, start.imag), math.atan2(edges[0].imag, edges[0].real), curvature, lengths)
    return path, -math.copysign(1.0, _area(z))


_NO_TRAVEL_LIMIT = (-math.inf, math.inf)
_NODE_DISTANCE = 0.05  # distance of the nodes for the axes' limits [mm]
_END_NUDGE = 1e-9  # from a piece's ends to its inside [mm]
_ZOOMS = 4  # each by 50
_SAMPLES = 101  # of a piece, for an axis' extreme
_MOST_PIECES = 10_000  # linear moves of a corner
_CONTINUOUS_DERIVATIVE = 1e-5  # largest jump of an axis' derivative taken as none


@dataclass(frozen=True)
class OutlineTrace(Controller):
    """Traces the outline of a work piece on an XY stage on top of a rotary table.

    The work piece is a polygon with rounded corners. Along an edge the table stands still and the stage moves at the
    path speed; in a corner of radius r the table turns at speed / r and the stage moves on an arc, so that the
    needle follows the outline at the path speed and the outward normal keeps its direction. With u and n on the
    outline and the geometry of `StageGeometry`,

        TH = angle(n_K) - angle(n),    S = sigma [C + R(-TH) (K - C) - W - u].

    Between edges and corners the velocities of all axes jump. With limited accelerations the stage stops there,
    unless `blend` smooths the table's motion: TH is then a moving average of the above. The needle stays on the
    outline; only the normal deviates, by up to an eighth of the corner's angle per millimetre times `blend`.

    Args:
        width: size along x of a rectangle about the work's origin [mm].
        height: size along y of that rectangle [mm].
        corners: corners of a polygon in the work frame, in the order of the motion, in place of the rectangle, (m, 2)
            [mm].
        corner_radius: radius of the rounded corners [mm].
        speed: speed of the needle relative to the work, LSP [mm/s].
        clockwise: direction in which a rectangle is traced, starting on its left edge, at the lower end if clockwise.
        needle: position K of the needle in the base frame [mm].
        centre: centre of rotation C in the base frame [mm].
        work_centre: position W of the work's origin with all axes at zero [mm].
        normal: direction n_K of the outline's outward normal at the needle, in the base frame.
        sigma: 1 if a positive stage move moves the work in the positive direction; -1 if in the negative one, so that
            the axes read the needle's position relative to the work.
        velocity: speed limits of the axes th, x, y [deg/s, mm/s, mm/s].
        acceleration: acceleration limits of the axes th, x, y [deg/s², mm/s², mm/s²].
        travel_x: software travel limits of the stage's x [mm].
        travel_y: software travel limits of the stage's y [mm].
        blend: length of the moving average over the table's angle; 0 stops between edges and corners [mm].
        corner_pieces: number of linear moves of all axes that replace each corner, for comparison; 0 for exact arcs.

    Raises:
        InputError: a value out of bounds, an edge too short for its arcs, or an outline beyond the stage's travel.
    """

    commands_axes: ClassVar[bool] = True
    ramp_arguments: ClassVar[tuple[str, ...]] = ("acceleration",)
    corner_argument: ClassVar[str | None] = "blend"

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
    travel_x: Place = _NO_TRAVEL_LIMIT
    travel_y: Place = _NO_TRAVEL_LIMIT
    blend: float = 0.0
    corner_pieces: int = 0

    def __post_init__(self) -> None:
        positive("width", self.width, "mm")
        positive("height", self.height, "mm")
        positive("corner_radius", self.corner_radius, "mm")
        positive("speed", self.speed, "mm/s")
        for name in ("needle", "centre", "work_centre", "normal"):
            object.__setattr__(self, name, plane_point(name, getattr(self, name)))
        if self.normal == (0.0, 0.0):
            raise InputError("normal = (0, 0): must have a direction")
        if self.sigma not in (-1, 1):
            raise InputError(f"sigma = {self.sigma}: must be 1 or -1")
        for name, unit in (("velocity", "s"), ("acceleration", "s²")):
            object.__setattr__(self, name, axis_limits(name, getattr(self, name), unit))
        for name in ("travel_x", "travel_y"):
            object.__setattr__(self, name, travel(name, getattr(self, name)))
        at_least("blend", self.blend, 0, "mm")
        if whole_number("corner_pieces", self.corner_pieces, 0) > _MOST_PIECES:
            raise InputError(
                f"corner_pieces = {self.corner_pieces}: must be at most {_MOST_PIECES}, or 0 for exact arcs"
            )
        if self.blend > 0 and self.corner_pieces > 0:
            raise InputError(
                f"blend = {self.blend:g} mm: must be 0 mm where corner_pieces is {self.corner_pieces}; "
                "linear pieces are not blended"
            )
        if self.blend > self.requested.length:
            raise InputError(
                f"blend = {self.blend:g} mm: must be at most the length of the outline, {self.requested.length:g} mm"
            )
        self._check_travel()

    @cached_property
    def _table(self) -> StageGeometry:
        return StageGeometry(complex(*self.needle), complex(*self.centre), complex(*self.work_centre), self.sigma)

    @cached_property
    def _outline(self) -> tuple[ArcChain, float]:
        corners = self.corners
        if corners is None:
            x = 0.5 * self.width
            y = 0.5 * self.height
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
        distinct = np.concatenate([[True], np.diff(ends) > _END_NUDGE])
        heading = path.heading(ends)
        first = math.atan2(self.normal[1], self.normal[0]) - (heading[0] + 0.5 * math.pi * outward)
        turned = math.remainder(first, 2 * math.pi) - (heading - heading[0])
        return Turning(ends[distinct], turned[distinct], self.blend)

    def coordinates(self, s: ArrayLike) -> Floats:
        """Positions of th, x and y at arc lengths of the outline, (n, 3) [deg, mm, mm]."""
        distance = np.atleast_1d(np.asarray(s, float))
        if self.corner_pieces == 0:
            return self._exact(distance)
        knots = self._knots
        values = self._exact(knots)
        return np.stack([np.interp(distance, knots, values[:, i]) for i in range(3)], axis=1)

    @cached_property
    def _knots(self) -> Floats:
        """Ends of the linear moves of `corner_pieces`, by arc length."""
        s = self.turning.s
        turns = np.diff(self.turning.angle) != 0
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
    def profile(self) -> Constant | Limited:
        """Speed profile along the outline."""
        if all(math.isinf(limit) for limit in (*self.velocity, *self.acceleration)):
            return Constant(self.requested.length, self.speed)
        breaks = self._knots if self.corner_pieces else np.concatenate([self.turning.s, self.turning.breaks])
        breaks = np.unique(np.clip(breaks, 0.0, self.requested.length))
        # pieces must be longer than the nudges from their ends to their insides
        breaks = breaks[np.diff(breaks, prepend=-1.0) > 2 * _END_NUDGE]
        ends = np.append(breaks[1:-1], self.requested.length)
        s, piece = nodes(ends, _NODE_DISTANCE)
        first, second = self._derivatives(s, piece, np.concatenate([[0.0], ends]))
        speed = np.minimum(self.speed, velocity_bound(s, first, self.velocity))
        if any(math.isfinite(limit) for limit in self.acceleration):
            jump = (np.diff(s) == 0) & (np.abs(np.diff(first, axis=0)).max(axis=1) > _CONTINUOUS_DERIVATIVE)
            # a jump of an axis' velocity needs an infinite acceleration: the stage stops there
            speed[:-1][jump] = 0.0
            speed[1:][jump] = 0.0
        return fastest(Derivatives(s, first, second), speed, self.velocity, self.acceleration)

    def _derivatives(self, s: Floats, piece: NDArray[np.intp], edges: Floats) -> list[Floats]:
        """First and second derivatives of th, x and y by the arc length, inside each piece, (m, 3)."""
        if self.corner_pieces:
            slope = np.diff(self._exact(edges), axis=0) / np.diff(edges)[:, None]
            return [slope[piece], np.zeros((s.size, 3))]
        inside = np.clip(s, edges[piece] + _END_NUDGE, edges[piece + 1] - _END_NUDGE)
        # at the ends of a piece the derivatives jump: those of its inside count
        theta = self.turning.value(inside)
        rate = self.turning.rate(inside)
        change = self.turning.change(inside)
        tangent = _complex(self.requested.tangent(inside))
        first = self._table.first(tangent, theta, rate)
        second = self._table.second(tangent, self.requested.curvature(inside), theta, rate, change)
        return [
            np.stack([np.degrees(table), stage.real, stage.imag], axis=1)
            for table, stage in ((rate, first), (change, second))
        ]

    @property
    def duration(self) -> float:
        return self.profile.duration

    @property
    def axes(self) -> tuple[str, ...]:
        return AXES

    @property
    def notes(self) -> tuple[str, ...]:
        """Effects of limits, blending and linear pieces."""
        notes = []
        ideal = self.requested.length / self.speed
        if isinstance(self.profile, Limited) and self.duration > ideal * (1 + 1e-6):
            slowest, where = self.profile.slowest
            lost = 100 * (1 - ideal / self.duration)
            notes.append(
                f"speed: the axes' limits increase the duration from {ideal:.3f} s to {self.duration:.3f} s and reduce "
                f"the mean speed by {lost:.0f} %; lowest speed {slowest:.3g} mm/s at {where:.1f} mm of the outline"
            )
        if self.blend > 0:
            s = np.concatenate([self.turning.s, np.linspace(0.0, self.requested.length, 20001)])
            off = self.turning.value(s) - Turning(self.turning.s, self.turning.angle).value(s)
            notes.append(f"blend: the normal at the needle deviates by up to {np.degrees(np.abs(off).max()):.2f} deg")
        if self.corner_pieces:
            step = np.diff(self.turning.angle)
            inward = self.corner_radius * self._outline[1] * np.sign(step) * _unit(self.normal)
            reach = np.abs(self._table.needle - self._table.centre - inward)
            sag = (reach * (1 - np.cos(0.5 * step / self.corner_pieces))).max()
            notes.append(f"corners: {self.corner_pieces} linear pieces each deviate from the arc by up to {sag:.4g} mm")
        return tuple(notes)

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        return {"speed": change(self.speed)}

    def setpoints(self, period: float) -> Setpoints:
        return Setpoints.along(self.requested, self.profile, period, axes=AXES, coordinates=self.coordinates)

    def _check_travel(self) -> None:
        edges = self.turning.s
        s = np.linspace(edges[:-1], edges[1:], _SAMPLES, axis=1)
        sampled = self.coordinates(s.ravel()).reshape(*s.shape, 3)
        # for extremes between two samples
        margin = np.abs(np.diff(sampled, 2, axis=1)).max()
        for piece, (begin, end) in enumerate(pairwise(edges)):
            for column, (low, high) in ((1, self.travel_x), (2, self.travel_y)):
                for side, limit in ((-1, low), (1, high)):
                    if (side * sampled[piece, :, column]).max() < side * limit - margin:
                        continue
                    extreme = self._extreme(column, side, begin, end)
                    th, *stage = self.coordinates(extreme)[0]
                    if side * (stage[column - 1] - limit) > _END_NUDGE:
                        x, y = self.needle
                        raise InputError(
                            f"outline piece {piece + 1} of {edges.size - 1}, at {extreme:.4g} mm: "
                            f"needle ({x:g}, {y:g}) mm needs stage {AXES[column]} = {stage[column - 1]:.6g} mm "
                            f"at th = {th:.4g} deg: must be from {low:g} to {high:g} mm; "
                            "move the needle, the work centre or the centre of rotation"
                        )

    def _extreme(self, column: int, side: int, begin: float, end: float) -> float:
        """Arc length within a piece of the outline at which an axis is furthest to one side [mm]."""
        for _ in range(_ZOOMS):
            s = np.linspace(begin, end, _SAMPLES)
            k = int((side * self.coordinates(s)[:, column]).argmax())
            begin = s[max(k - 1, 0)]
            end = s[min(k + 1, _SAMPLES - 1)]
        return float(s[k])


def _complex(vectors: Floats) -> Complex:
    return vectors[:, 0] + 1j * vectors[:, 1]


def _unit(direction: Place) -> complex:
    z = complex(*direction)
    return z / abs(z)
