"""The path speed of a stretch of motions, and the parts of a program between its stops: what they command, how long."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, positive
from gantrysim.controllers.fanuc.legs import PathLeg
from gantrysim.paths.chain import Chain
from gantrysim.paths.limits import LIMIT_MARGIN, Derivatives, Limited, fastest, nodes
from gantrysim.paths.pieces import Coil, Line, Vector
from gantrysim.paths.profile import Constant, PointToPoint, Profile

_ROUNDING = 1e-9  # of an arc length [mm]


# The parameters of the path speed, the feed clamp by radius, and spliced speed profiles.


@dataclass(frozen=True)
class Clamp:
    """Feed clamp by the radius of an arc: sqrt(r / radius) feed, at least the floor (1731, 1730, 1732).

    Args:
        radius: reference radius Rp [mm].
        feed: feed Vp allowed at the reference radius [mm/min].
        floor: lowest feed to which the clamp reduces F [mm/min].
    """

    radius: float
    feed: float
    floor: float

    def __post_init__(self) -> None:
        positive("clamp radius", self.radius, "mm")
        positive("clamp feed", self.feed, "mm/min")
        positive("clamp floor", self.floor, "mm/min")

    def limit(self, r: ArrayLike) -> Floats:
        """Return the largest feed at radii, (n,) [mm/min]."""
        # at sqrt(r / Rp) Vp the acceleration towards the centre, F^2 / r, is that of Vp at Rp
        return np.maximum(self.feed * np.sqrt(np.asarray(r, float) / self.radius), self.floor)


@dataclass(frozen=True)
class Feeding:
    """The arguments of a `Program` that determine the path speed, by the same names."""

    acceleration: float
    clamp: Clamp | None
    feed_in_space: bool
    blend_time: float
    dry_run: float | None
    dry_run_from: float
    dry_run_until: float
    rotary_velocity: float
    rotary_acceleration: float


class Spliced:
    """Speed profiles, each replacing the one before.

    Args:
        profiles: one or more, of distances from the start of the path.
        times: at which each begins [s].
    """

    def __init__(self, profiles: list[Limited], times: list[float]) -> None:
        self._profiles = profiles
        self._times = np.array(times)

    @property
    def length(self) -> float:
        return self._profiles[-1].length

    @property
    def duration(self) -> float:
        return float(self._times[-1] + self._profiles[-1].duration)

    def _samples(self, t: ArrayLike, name: str) -> Floats:
        time = np.asarray(t, float)
        k = np.clip(np.searchsorted(self._times, time, side="right") - 1, 0, len(self._profiles) - 1)
        values = np.empty(time.shape)
        for index, profile in enumerate(self._profiles):
            chosen = k == index
            values[chosen] = getattr(profile, name)(time[chosen] - self._times[index])
        return values

    def position(self, t: ArrayLike) -> Floats:
        return self._samples(t, "position")

    def velocity(self, t: ArrayLike) -> Floats:
        return self._samples(t, "velocity")


_NODE_DISTANCES = (0.02, 2.0)  # smallest and largest distance of nodes [mm]
_TURN = 0.05  # largest turn between nodes [rad]
_TANGENT = 1e-4  # largest corner taken as none [rad]
_DIFFERENCE_STEP = 1e-3  # of the differences for second derivatives [mm]
_CONICAL = 5e-7  # error of a cone's squared speed between two nodes, with F in the plane
_RAMP = (1.0, 0.25, 0.0625)  # shares of a ramp's length with additional nodes
_STRAIGHT_BEND = 1e-12  # largest second derivative taken as zero [1/mm]
_DISTINCT_NODES = 1e-9  # distance of distinct nodes [mm]
_BRAKING_SHARES = (0.99, 0.9, 0.75, 0.5, 0.25, 0.1, 0.03, 0.01)  # shares of the acceleration
PER_MINUTE = 60.0


class Planner:
    """Plans the speed along consecutive motions without programmed stops.

    Args:
        legs: motions, each with a path.
        chain: of their paths.
        feeding: parameters of the speed.
    """

    def __init__(self, legs: list[PathLeg], chain: Chain, feeding: Feeding) -> None:
        self._legs = legs
        self._chain = chain
        self._feeding = feeding
        # share of the accelerations for the pieces: blending leaves the other half for the corners
        share = 1.0 if feeding.blend_time == 0 else 0.5
        self._limit = share * feeding.acceleration
        self._rotary_limit = share * feeding.rotary_acceleration
        s, piece = nodes(chain.ends, [_step(leg) for leg in legs])
        self._nodes = s, piece
        if math.isfinite(feeding.acceleration):
            self._nodes = self._with_ramps(s, piece)

    def profile(self, begun: float) -> Spliced:
        """Return the speed profile, given the time of the program at its start [s]."""
        feeding = self._feeding
        if feeding.dry_run is None:
            return Spliced([self._plan(False)], [0.0])
        dry = feeding.dry_run_from <= begun < feeding.dry_run_until
        profiles = [self._plan(dry)]
        times = [0.0]
        for switch, after in ((feeding.dry_run_from - begun, True), (feeding.dry_run_until - begun, False)):
            here = switch - times[-1]
            if 0 < here < profiles[-1].duration and math.isfinite(switch):
                profile, late = self._with_switch(profiles[-1], here, after)
                profiles.append(profile)
                times.append(switch + late)
        return Spliced(profiles, times)

    def _with_switch(self, profile: Limited, time: float, dry: bool) -> tuple[Limited, float]:
        """Return the profile after a switch of dry run, and the delay until it applies [s].

        There is none, except where the motion already brakes as hard as it can: then until a node ahead.
        """
        place = float(profile.position(time))
        for s in (place, *self._nodes[0][self._nodes[0] > place + _DISTINCT_NODES]):
            late = 0.0 if s == place else profile.time_at(float(s)) - time
            if profile.length - s <= _DISTINCT_NODES:
                break
            # brake to a lower feed with the largest share that the axes allow along the curve
            for braking in _BRAKING_SHARES:
                with suppress(InputError):
                    return self._plan(dry, float(s), float(profile.velocity(time + late)), braking), late
        return profile, -time

    def _with_ramps(self, s: Floats, piece: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
        """The nodes, with additional ones along ramps from and to rest at the ends of the pieces."""
        edges = np.concatenate([[0.0], self._chain.ends])
        fastest_feed = np.array([max(leg.feed, (self._feeding.dry_run or 0.0) / PER_MINUTE) for leg in self._legs])
        k = np.arange(len(self._legs))
        all_nodes = [s]
        all_pieces = [piece]
        for edge, inward in ((edges[:-1], 1.0), (edges[1:], -1.0)):
            steepest = np.abs(self._chain.tangent(self._within(edge, k))).max(axis=1)
            # v^2 / 2 a, with the acceleration that the axis with the greatest share of the motion leaves
            ramp = fastest_feed**2 * steepest / (2 * self._limit * (1 - LIMIT_MARGIN))
            for share in _RAMP:
                inside = share * ramp < np.diff(edges)
                all_nodes.append((edge + inward * share * ramp)[inside])
                all_pieces.append(k[inside])
        s = np.concatenate(all_nodes)
        piece = np.concatenate(all_pieces)
        order = np.lexsort((s, piece))
        return s[order], piece[order]

    def _plan(self, dry: bool, begin: float = 0.0, speed: float = 0.0, braking: float = 0.0) -> Limited:
        """Plan from a place and a speed there, with or without dry run.

        From a speed above the feed the motion brakes with a share of the acceleration, at corners in any case.
        """
        s, piece = self._nodes
        if begin > 0:
            ahead = s > begin + _DISTINCT_NODES
            s = np.concatenate([[begin], s[ahead]])
            piece = np.concatenate([piece[ahead][:1], piece[ahead]])
        rotary = self._rotary(s, piece)
        top = self._feed(s, piece, dry, np.abs(rotary[0]))
        a = self._feeding.acceleration
        if math.isinf(a):
            return fastest(Derivatives(s, np.ones((s.size, 1)), np.zeros((s.size, 1))), top, [math.inf], [a])
        braked = np.sqrt(np.maximum(speed**2 - 2 * braking * self._limit * (s - begin), 0.0))
        top = self._at_corners(s, np.maximum(top, braked))
        linear = self._derivatives(s, piece)
        first, second = (np.column_stack(pair) for pair in zip(linear, rotary, strict=True))
        limits = np.array([self._limit] * 3 + [self._rotary_limit])
        return fastest(Derivatives(s, first, second), top, np.full(4, math.inf), limits, begin=speed)

    def _feed(self, s: Floats, piece: NDArray[np.intp], dry: bool, turning: Floats) -> Floats:
        """Largest path speed at the nodes, where the rotary axis turns so much along the path [mm/s, deg/mm]."""
        legs = self._legs
        feeding = self._feeding
        at_feed = np.array([not leg.rapid for leg in legs])
        feeds = np.array([leg.feed for leg in legs])
        if dry and feeding.dry_run is not None:
            feeds = np.where(at_feed, feeding.dry_run / PER_MINUTE, feeds)
        feed = feeds[piece]
        coil = np.array([isinstance(leg.piece, Coil) for leg in legs])[piece]
        inner = self._within(s, piece)[coil]
        if feeding.clamp is not None and coil.any():
            limit = feeding.clamp.limit(self._radius(inner, piece[coil])) / PER_MINUTE
            feed[coil] = np.minimum(feed[coil], limit)
        if not feeding.feed_in_space and coil.any():
            # F is the speed in the plane: along the path it is greater by 1 / cos of the climb
            feed[coil] /= np.sqrt(np.maximum(1 - self._chain.climb(inner) ** 2, 1e-12))
        if math.isfinite(feeding.rotary_velocity):
            # the path slows where the rotary axis turns faster along it than it can in time
            feed = np.minimum(feed, feeding.rotary_velocity / np.maximum(turning, 1e-200))
        return feed

    def _within(self, s: Floats, piece: NDArray[np.intp]) -> Floats:
        """The nodes, moved inside their pieces."""
        ends = np.concatenate([[0.0], self._chain.ends])
        nudge = 1e-9 * self._chain.length
        return np.clip(s, ends[piece] + nudge, ends[piece + 1] - nudge)

    def _radius(self, s: Floats, piece: NDArray[np.intp]) -> Floats:
        centre = np.array([getattr(leg.piece, "centre", (0.0, 0.0, 0.0)) for leg in self._legs])[piece]
        arm = self._chain.position(s) - centre
        plane = self._chain.frame(s)[:, :2]
        return np.linalg.norm(np.einsum("ijk,ik->ij", plane, arm), axis=1)

    def _at_corners(self, s: Floats, top: Floats) -> Floats:
        """The speeds, limited to stops between motions, or by blending."""
        if len(self._legs) < 2:
            return top
        ends = self._chain.ends[:-1]
        k = np.arange(len(self._legs) - 1)
        before = self._within(ends, k)
        after = self._within(ends, k + 1)
        corner = np.linalg.norm(self._chain.tangent(after) - self._chain.tangent(before), axis=1)
        turning = np.abs(self._rotary(after, k + 1)[0] - self._rotary(before, k)[0])
        if self._feeding.blend_time > 0:
            reach = float(top.max()) * self._feeding.blend_time
            limit = np.minimum(
                self._blended_speeds(ends, corner, self._limit, reach),
                self._blended_speeds(ends, turning, self._rotary_limit, reach),
            )
            limit[[leg.exact_stop for leg in self._legs[:-1]]] = 0.0
        else:
            # without blending an axis that does not stop would have to change its velocity at once
            stops = np.array(
                [
                    first.exact_stop or first.spiral or second.spiral or first.rapid != second.rapid
                    for first, second in pairwise(self._legs)
                ]
            )
            jumps = (turning > _TANGENT) & math.isfinite(self._rotary_limit)
            limit = np.where(stops | (corner > _TANGENT) | jumps, 0.0, math.inf)
        capped = top.copy()
        # the first of the two nodes there
        k = np.searchsorted(s, ends)
        for node in (k, k + 1):
            inside = (node < s.size) & (np.abs(s[np.minimum(node, s.size - 1)] - ends) < 1e-9)
            capped[node[inside]] = np.minimum(capped[node[inside]], limit[inside])
        return capped

    def _blended_speeds(self, ends: Floats, jump: Floats, acceleration: float, reach: float) -> Floats:
        """Speeds at which the moving average keeps the accelerations from jumps of a derivative below a limit.

        Args:
            ends: arc lengths at which motions meet [mm].
            jump: of the derivative there.
            acceleration: the limit.
            reach: largest distance in the time of the average [mm].
        """
        summed = np.concatenate([[0.0], np.cumsum(jump)])
        last = np.searchsorted(ends, ends + reach, side="right")
        first = np.searchsorted(ends, ends - reach)
        # all jumps within one window
        near = summed[last] - summed[first]
        change = acceleration * self._feeding.blend_time
        return np.divide(change, near, out=np.full(near.shape, math.inf), where=jump > _TANGENT)

    def _rotary(self, s: Floats, piece: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """First and second derivative of the rotary axis by the arc length inside each piece, (m,) [deg/mm, deg/mm²].

        It turns with the angle of a coil, on which ds = m d(theta), m^2 = rho^2 + b^2 + k^2; m' = b rho / m^2.
        """
        turned = np.array([leg.rotary[1] - leg.rotary[0] for leg in self._legs])
        first = (turned / np.diff(self._chain.ends, prepend=0.0))[piece]
        second = np.zeros(s.size)
        coil = np.array([isinstance(leg.piece, Coil) for leg in self._legs]) & (turned != 0)
        here = coil[piece]
        if here.any():
            shape = np.array([_per_radian(leg.piece) for leg in self._legs])
            angle, growth, rise = shape[piece[here]].T
            rho = self._radius(self._within(s, piece)[here], piece[here])
            m = np.sqrt(rho**2 + growth**2 + rise**2)
            first[here] = turned[piece[here]] / (angle * m)
            second[here] = -first[here] * growth * rho / m**3
        return first, second

    def _derivatives(self, s: Floats, piece: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """First and second derivatives of x, y and z by the arc length inside each piece, (m, 3)."""
        tangent = self._chain.tangent(self._within(s, piece))
        ends = np.concatenate([[0.0], self._chain.ends])
        low = np.maximum(s - _DIFFERENCE_STEP, ends[piece] + 1e-9)
        high = np.minimum(s + _DIFFERENCE_STEP, ends[piece + 1] - 1e-9)
        reach = np.maximum(high - low, 1e-12)[:, None]
        second = (self._chain.tangent(high) - self._chain.tangent(low)) / reach
        return tangent, np.where(np.abs(second) < _STRAIGHT_BEND, 0.0, second)


def _step(leg: PathLeg) -> float:
    """Largest distance of the nodes on a motion [mm]."""
    if not isinstance(leg.piece, Coil):
        return _NODE_DISTANCES[1]
    radius = min(leg.piece.radius)
    step = _TURN * radius
    # the second derivative of v^2 = F^2 (1 + k^2 / rho^2) by the arc length is about 6 (F k b)^2 / rho^6
    _, growth, rise = _per_radian(leg.piece)
    if rise * growth != 0:
        step = min(step, radius**3 * math.sqrt(8 * _CONICAL / 6) / abs(rise * growth))
    return float(np.clip(step, *_NODE_DISTANCES))


def _per_radian(coil: Line | Coil | None) -> tuple[float, float, float]:
    """Angle swept by a coil, and the changes of radius b and height k per radian; zero for a line."""
    if not isinstance(coil, Coil):
        return 0.0, 0.0, 0.0
    angle = abs(coil.angle)
    return angle, (coil.radius[1] - coil.radius[0]) / angle, coil.rise / angle


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
