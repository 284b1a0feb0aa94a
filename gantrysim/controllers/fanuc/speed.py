"""The path speed of a stretch of motions: feed, stops or blending at corners, limits of the axes, dry run."""

from __future__ import annotations

import math
from contextlib import suppress
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.controllers.fanuc.feeding import Feeding, Spliced
from gantrysim.controllers.fanuc.legs import Leg
from gantrysim.controllers.limits import MARGIN, Limited, fastest, nodes
from gantrysim.controllers.paths.chain import Chain
from gantrysim.controllers.paths.pieces import Coil, Line
from gantrysim.errors import InputError

_STEP = (0.02, 2.0)  # of the way between places where the limits are looked at [mm]
_TURN = 0.05  # at most, from one to the next [rad]
_TANGENT = 1e-4  # corner that is none [rad]
_REACH = 1e-3  # of the differences that stand for a second derivative [mm]
_CONICAL = 5e-7  # error of a cone's squared speed between two nodes, where F counts in the plane
_RAMP = (1.0, 0.25, 0.0625)  # of the way of a ramp, looked at as well
_STRAIGHT = 1e-12  # [1/mm], of a bend that is none
_APART = 1e-9  # [mm], of nodes that are two
_BRAKING = (0.99, 0.9, 0.75, 0.5, 0.25, 0.1, 0.03, 0.01)  # shares of the acceleration
PER_MINUTE = 60.0


class Planner:
    """Plans the speed along a stretch of motions without a stop between them that is not of its own making.

    Args:
        legs: motions, each with a path.
        chain: of their paths.
        feeding: how the speed is set.
    """

    def __init__(self, legs: list[Leg], chain: Chain, feeding: Feeding) -> None:
        self._legs, self._chain, self._feeding = legs, chain, feeding
        s, piece = nodes(chain.ends, [_step(leg) for leg in legs])
        self._nodes = s, piece
        if math.isfinite(feeding.acceleration):
            self._nodes = self._with_ramps(s, piece)

    def law(self, begun: float) -> Spliced:
        """Return the law of a stretch that begins at a time of the program [s]."""
        feeding = self._feeding
        if feeding.dry_run is None:
            return Spliced([self._plan(False)], [0.0])
        dry = feeding.dry_from <= begun < feeding.dry_until
        laws, times = [self._plan(dry)], [0.0]
        for switch, after in ((feeding.dry_from - begun, True), (feeding.dry_until - begun, False)):
            here = switch - times[-1]
            if 0 < here < laws[-1].duration and math.isfinite(switch):
                law, late = self._taking_over(laws[-1], here, after)
                laws.append(law)
                times.append(switch + late)
        return Spliced(laws, times)

    def _taking_over(self, law: Limited, time: float, dry: bool) -> tuple[Limited, float]:
        """Return the law after a switch of dry run, and how much later it takes over [s].

        That is at once, or at a node close ahead where the motion brakes so hard for a stop that it has no choice.
        """
        place = float(law.position(time))
        for s in (place, *self._nodes[0][self._nodes[0] > place + _APART]):
            late = 0.0 if s == place else law.reached(float(s)) - time
            if law.length - s <= _APART:
                break
            # down to a lower feed as fast as the axes allow, and so no faster where the path bends
            for braking in _BRAKING:
                with suppress(InputError):
                    return self._plan(dry, float(s), float(law.velocity(time + late)), braking), late
        return law, -time

    @property
    def _limit(self) -> float:
        """Acceleration that is left for the pieces [mm/s²]."""
        return self._feeding.acceleration * (1.0 if self._feeding.blend_time == 0 else 0.5)

    @property
    def _rotary_limit(self) -> float:
        """The same of the rotary axis [deg/s²]."""
        return self._feeding.rotary_acceleration * (1.0 if self._feeding.blend_time == 0 else 0.5)

    def _with_ramps(self, s: Floats, piece: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
        """The nodes, and those at which ramps from rest or to rest at the ends of the pieces are over."""
        edges = np.concatenate([[0.0], self._chain.ends])
        fastest_feed = np.array([max(leg.feed, (self._feeding.dry_run or 0.0) / PER_MINUTE) for leg in self._legs])
        k = np.arange(len(self._legs))
        added, of = [s], [piece]
        for edge, inward in ((edges[:-1], 1.0), (edges[1:], -1.0)):
            steepest = np.abs(self._chain.tangent(self._within(edge, k))).max(axis=1)
            way = fastest_feed**2 * steepest / (2 * self._limit * (1 - MARGIN))
            for share in _RAMP:
                inside = share * way < np.diff(edges)
                added.append((edge + inward * share * way)[inside])
                of.append(k[inside])
        ways, pieces = np.concatenate(added), np.concatenate(of)
        order = np.lexsort((ways, pieces))
        return ways[order], pieces[order]

    def _plan(self, dry: bool, begin: float = 0.0, speed: float = 0.0, braking: float = 0.0) -> Limited:
        """Plan from a place on, where the speed is given, with or without dry run.

        From a speed above the feed the motion brakes with a share of the acceleration, but no later at corners.
        """
        s, piece = self._nodes
        if begin > 0:
            ahead = s > begin + _APART
            s, piece = np.concatenate([[begin], s[ahead]]), np.concatenate([piece[ahead][:1], piece[ahead]])
        top = self._feed(s, piece, dry)
        a = self._feeding.acceleration
        if math.isinf(a):
            return fastest(s, top, np.ones((s.size, 1)), np.zeros((s.size, 1)), [math.inf], [a])
        coming = np.sqrt(np.maximum(speed**2 - 2 * braking * self._limit * (s - begin), 0.0))
        top = self._at_corners(s, np.maximum(top, coming))
        rate, bend = self._derivatives(s, piece)
        turning, change = self._rotary(s, piece)
        rate, bend = np.column_stack([rate, turning]), np.column_stack([bend, change])
        limits = np.array([self._limit] * 3 + [self._rotary_limit])
        return fastest(s, top, rate, bend, np.full(4, math.inf), limits, begin=speed)

    def _feed(self, s: Floats, piece: NDArray[np.intp], dry: bool) -> Floats:
        """Largest path speed at the nodes [mm/s]."""
        legs, feeding = self._legs, self._feeding
        at_feed = np.array([not leg.rapid for leg in legs])
        asked = np.array([leg.feed for leg in legs])
        if dry and feeding.dry_run is not None:
            asked = np.where(at_feed, feeding.dry_run / PER_MINUTE, asked)
        feed: Floats = asked[piece]
        coil = np.array([isinstance(leg.piece, Coil) for leg in legs])[piece]
        inner = self._within(s, piece)[coil]
        if feeding.clamp is not None and coil.any():
            limit = feeding.clamp.limit(self._radius(inner, piece[coil])) / PER_MINUTE
            feed[coil] = np.minimum(feed[coil], limit)
        if not feeding.in_space and coil.any():
            feed[coil] /= np.sqrt(np.maximum(1 - self._chain.climb(inner) ** 2, 1e-12))
        if math.isfinite(feeding.rotary_velocity):
            turning = np.abs(self._rotary(s, piece)[0])
            feed = np.minimum(feed, feeding.rotary_velocity / np.maximum(turning, 1e-300))
        return feed

    def _within(self, s: Floats, piece: NDArray[np.intp]) -> Floats:
        """The nodes, moved off the ends of their pieces."""
        ends = np.concatenate([[0.0], self._chain.ends])
        nudge = 1e-9 * self._chain.length
        return np.clip(s, ends[piece] + nudge, ends[piece + 1] - nudge)

    def _radius(self, s: Floats, piece: NDArray[np.intp]) -> Floats:
        centre = np.array([getattr(leg.piece, "centre", (0.0, 0.0, 0.0)) for leg in self._legs])[piece]
        arm = self._chain.position(s) - centre
        plane = self._chain.frame(s)[:, :2]
        return np.linalg.norm(np.einsum("ijk,ik->ij", plane, arm), axis=1)

    def _at_corners(self, s: Floats, top: Floats) -> Floats:
        """The speeds, with the stops between motions, or what blending leaves of them."""
        if len(self._legs) < 2:
            return top
        ends, k = self._chain.ends[:-1], np.arange(len(self._legs) - 1)
        before, after = self._within(ends, k), self._within(ends, k + 1)
        corner = np.linalg.norm(self._chain.tangent(after) - self._chain.tangent(before), axis=1)
        turning = np.abs(self._rotary(after, k + 1)[0] - self._rotary(before, k)[0])
        if self._feeding.blend_time > 0:
            reach = float(top.max()) * self._feeding.blend_time
            limit = np.minimum(
                self._blended(ends, corner, self._limit, reach), self._blended(ends, turning, self._rotary_limit, reach)
            )
            limit[[leg.exact_stop for leg in self._legs[:-1]]] = 0.0
        else:
            stops = np.array(
                [
                    first.exact_stop or first.spiral or second.spiral or first.rapid != second.rapid
                    for first, second in pairwise(self._legs)
                ]
            )
            jumps = (turning > _TANGENT) & math.isfinite(self._rotary_limit)
            limit = np.where(stops | (corner > _TANGENT) | jumps, 0.0, math.inf)
        capped = top.copy()
        k = np.searchsorted(s, ends)  # the first of the two nodes there
        for node in (k, k + 1):
            inside = (node < s.size) & (np.abs(s[np.minimum(node, s.size - 1)] - ends) < 1e-9)
            capped[node[inside]] = np.minimum(capped[node[inside]], limit[inside])
        return capped

    def _blended(self, ends: Floats, jump: Floats, acceleration: float, reach: float) -> Floats:
        """Speeds at which the moving average turns the jumps of a rate into no more than an acceleration.

        Args:
            ends: ways at which motions meet [mm].
            jump: of the rate there.
            acceleration: what may come of it.
            reach: longest way in the time of the average [mm].
        """
        summed = np.concatenate([[0.0], np.cumsum(jump)])
        last, first = np.searchsorted(ends, ends + reach, side="right"), np.searchsorted(ends, ends - reach)
        near = summed[last] - summed[first]  # all jumps that fall into one window
        most = acceleration * self._feeding.blend_time
        return np.divide(most, near, out=np.full(near.shape, math.inf), where=jump > _TANGENT)

    def _rotary(self, s: Floats, piece: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """First and second derivative of the rotary axis over the way, from within each piece, (m,) [deg/mm, deg/mm²].

        It turns with the angle of a coil, on which ds = m d(theta), m^2 = rho^2 + b^2 + k^2; m' = b rho / m^2.
        """
        turned = np.array([leg.rotary[1] - leg.rotary[0] for leg in self._legs])
        rate, bend = (turned / np.diff(self._chain.ends, prepend=0.0))[piece], np.zeros(s.size)
        coil = np.array([isinstance(leg.piece, Coil) for leg in self._legs]) & (turned != 0)
        here = coil[piece]
        if here.any():
            shape = np.array(
                [_per_radian(leg.piece) if isinstance(leg.piece, Coil) else (1.0, 0.0, 0.0) for leg in self._legs]
            )
            angle, growth, rise = shape[piece[here]].T
            rho = self._radius(self._within(s, piece)[here], piece[here])
            m = np.sqrt(rho**2 + growth**2 + rise**2)
            rate[here] = turned[piece[here]] / (angle * m)
            bend[here] = -rate[here] * growth * rho / m**3
        return rate, bend

    def _derivatives(self, s: Floats, piece: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """First and second derivatives of x, y and z over the way, from within each piece, (m, 3)."""
        tangent = self._chain.tangent(self._within(s, piece))
        ends = np.concatenate([[0.0], self._chain.ends])
        low = np.maximum(s - _REACH, ends[piece] + 1e-9)
        high = np.minimum(s + _REACH, ends[piece + 1] - 1e-9)
        reach = np.maximum(high - low, 1e-12)[:, None]
        bend: Floats = (self._chain.tangent(high) - self._chain.tangent(low)) / reach
        return tangent, np.where(np.abs(bend) < _STRAIGHT, 0.0, bend)


def _step(leg: Leg) -> float:
    """Distance of the nodes on a motion [mm]."""
    if not isinstance(leg.piece, Coil):
        return _STEP[1]
    radius = min(leg.piece.radius)
    step = _TURN * radius
    # of v^2 = F^2 (1 + k^2 / rho^2) the second derivative over the way is about 6 (F k b)^2 / rho^6
    _, growth, rise = _per_radian(leg.piece)
    if rise * growth != 0:
        step = min(step, radius**3 * math.sqrt(8 * _CONICAL / 6) / abs(rise * growth))
    return float(np.clip(step, *_STEP))


def _per_radian(coil: Line | Coil | None) -> tuple[float, float, float]:
    """Angle swept, and the change of radius b and of height k per radian of it; of what is no coil, nothing."""
    if not isinstance(coil, Coil):
        return 0.0, 0.0, 0.0
    angle = abs(coil.angle)
    return angle, (coil.radius[1] - coil.radius[0]) / angle, coil.rise / angle
