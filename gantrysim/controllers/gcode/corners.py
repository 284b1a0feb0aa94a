"""Corners of a program that nearly stop it, and what would pass them faster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, dot
from gantrysim.base.jit import jit
from gantrysim.base.quantity import counted
from gantrysim.paths.track import Track


class Corners(NamedTuple):
    """The corners of a path.

    Attributes:
        stops: corners between moves at feed passed at less than a tenth of the feed.
        roundable: those of them that a rounding passes faster: they join lines, and do not turn back.
        by_firmware: those of them whose speed the program sets by words of a printer's firmware.
        small: median length of the moves before the stops; 0 without [mm].
        cut: largest distance of the path from corners that are rounded without a tolerance; 0 without [mm].
    """

    stops: int
    roundable: int
    by_firmware: int
    small: float
    cut: float

    def note(self, remedy: str) -> str:
        """Return a note on the stops, with what passes them faster; empty without stops.

        Args:
            remedy: sentence on the rounding of corners between lines, which may pass some of them faster.
        """
        if not self.stops:
            return ""
        remedies = []
        if self.by_firmware:
            remedies.append(
                f"The program itself limits {self.by_firmware} of them, by M205 or SQUARE_CORNER_VELOCITY: a larger "
                "value there passes them faster, and the job's rounding does not act."
            )
        if self.roundable:
            remedies.append(remedy)
        others = self.stops - self.by_firmware - self.roundable
        if others:
            turning = "1 of them turns back or joins" if others == 1 else f"{others} of them turn back or join"
            if self.stops == 1:
                turning = "It turns back or joins"
            remedies.append(f"{turning} an arc, which no rounding passes faster.")
        passed = f"is passed at less than a tenth of the feed; the move before it is {self.small:.3g} mm long"
        if self.stops > 1:
            before = f"the moves before them are {self.small:.3g} mm long at the median"
            passed = f"are passed at less than a tenth of the feed; {before}"
        return f"{counted(self.stops, 'corner')} between moves at feed {passed}. {' '.join(remedies)}"


# Rounded corners: consecutive lines joined by arcs within a tolerance; short lines merged within another.
#
# At a corner of the angle theta between the tangents, an arc that begins and ends at the distance l from the corner has
# the radius l / tan(theta / 2) and is l tan(theta / 4) away from the corner.

_SMALLEST_RADIUS = 1e-6  # radius of an arc [mm]
_SLIGHTEST_TURN = 1e-7  # corner that is none [rad]
SHARPEST_TURN = 3.1  # corner that is rounded [rad]
_CHAINED = 100  # lines merged into one: each of them is checked against every longer chord


@dataclass(frozen=True)
class Rounded:
    """A path with rounded corners.

    Attributes:
        base: the path with its corners.
        ends: arc length at the start of every piece and the end of the last, (n + 1,) [mm].
        piece: of the base, (n,); that before the corner for an arc.
        begin: distance from the start of the piece of the base at which a piece begins, (n,) [mm].
        arc: index of the arc, -1 for a part of the base, (n,).
        centre, u, v: of the arcs: centre, and directions to the start and along the path there, (a, 3) [mm].
        radius: of the arcs, (a,) [mm].
    """

    base: Track
    ends: Floats
    piece: NDArray[np.intp]
    begin: Floats
    arc: NDArray[np.intp]
    centre: Floats
    u: Floats
    v: Floats
    radius: Floats

    @property
    def lengths(self) -> Floats:
        """Lengths of the pieces, (n,) [mm]."""
        return np.diff(self.ends)

    def locate(self, s: ArrayLike) -> NDArray[np.intp]:
        """Return the pieces at arc lengths, (n,)."""
        return np.clip(np.searchsorted(self.ends, s, side="right") - 1, 0, self.piece.size - 1)

    def position(self, s: Floats) -> Floats:
        """Return the points at arc lengths, (n, 3) [mm]."""
        k = self.locate(s)
        distance = s - self.ends[k]
        points = self.base.points_at(self.piece[k], distance + self.begin[k])
        on_arc = self.arc[k] >= 0
        if on_arc.any():
            arc = self.arc[k[on_arc]]
            phi = distance[on_arc] / self.radius[arc]
            turned = np.cos(phi)[:, None] * self.u[arc] + np.sin(phi)[:, None] * self.v[arc]
            points[on_arc] = self.centre[arc] + self.radius[arc][:, None] * turned
        return points


def corners(track: Track) -> tuple[Floats, Floats, Floats]:
    """Return the angles between the tangents where pieces meet, (m - 1,), and the tangents before and after."""
    first, last = track.end_tangents()
    before = last[:-1]
    after = first[1:]
    apart = np.sqrt(((after - before) ** 2).sum(axis=1))
    return 2 * np.arctan2(apart, np.sqrt(((after + before) ** 2).sum(axis=1))), before, after


def rounded_track(track: Track, tolerance: Floats, widest: Floats) -> tuple[Rounded, Floats, Floats]:
    """Round the corners of a path between lines.

    Args:
        track: the path.
        tolerance: largest distance of the arc from each corner; 0 for none, (m - 1,) [mm].
        widest: radius that is large enough, (m - 1,) [mm].

    Returns:
        path: with arcs that take at most half of each line.
        angle: of the corners that remain, (m - 1,) [rad].
        distance: of the path from each corner, (m - 1,) [mm].
    """
    angle, before, after = corners(track)
    lines = ~track.coil
    lengths = np.diff(track.ends, prepend=0.0)
    tangent = np.tan(0.5 * angle)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.minimum(0.5 * np.minimum(lengths[:-1], lengths[1:]), tolerance / np.tan(0.25 * angle))
        reach = np.minimum(reach, widest * tangent)
        rounds = lines[:-1] & lines[1:] & (tolerance > 0) & (angle > _SLIGHTEST_TURN) & (angle < SHARPEST_TURN)
        rounds &= reach > _SMALLEST_RADIUS * tangent
    reach = np.where(rounds, reach, 0.0)
    k = np.flatnonzero(rounds)
    radius = reach[k] / tangent[k]
    inward = after[k] - before[k]
    inward /= np.sqrt(dot(inward, inward))[:, None]
    corner = track.points[k + 1]
    centre = corner + (radius / np.cos(0.5 * angle[k]))[:, None] * inward
    u = (corner - reach[k][:, None] * before[k] - centre) / radius[:, None]

    count = lengths.size
    # at the start of each piece
    trimmed = np.concatenate([[0.0], reach])
    parts = np.maximum(lengths - trimmed - np.append(reach, 0.0), 0.0)
    place = np.arange(count) + np.concatenate([[0], np.cumsum(rounds)])
    total = count + k.size
    piece = np.empty(total, np.intp)
    arc = np.full(total, -1, np.intp)
    begin = np.zeros(total)
    size = np.empty(total)
    piece[place] = np.arange(count)
    begin[place] = trimmed
    size[place] = parts
    # an arc follows the line before its corner
    arc_place = place[k] + 1
    piece[arc_place] = k
    arc[arc_place] = np.arange(k.size)
    size[arc_place] = radius * angle[k]
    ends = np.concatenate([[0.0], np.cumsum(size)])
    path = Rounded(track, ends, piece, begin, arc, centre, u, before[k], radius)
    return path, np.where(rounds, 0.0, angle), reach * np.tan(0.25 * angle)


@jit
def merged_points(points: Floats, joined: NDArray[np.bool_], tolerance: Floats) -> NDArray[np.bool_]:
    """Return which points between consecutive lines stay, (m + 1,), of (m + 1, 3).

    From the last point that stays the line is extended as long as all points between stay within the tolerance of it.

    Args:
        points: ends of the lines [mm].
        joined: whether the point may be dropped, (m + 1,).
        tolerance: at each point, (m + 1,) [mm].
    """
    stays = np.ones(points.shape[0], np.bool_)
    first = 0
    for k in range(1, points.shape[0] - 1):
        if not joined[k]:
            first = k
            continue
        ahead = points[k + 1] - points[first]
        square = ahead[0] ** 2 + ahead[1] ** 2 + ahead[2] ** 2
        inside = k - first < _CHAINED and square > 0.0
        last = 0.0
        for j in range(first + 1, k + 1):
            if not inside:
                break
            arm = points[j] - points[first]
            along = (arm[0] * ahead[0] + arm[1] * ahead[1] + arm[2] * ahead[2]) / square
            offset = 0.0
            for i in range(3):
                offset += (arm[i] - along * ahead[i]) ** 2
            inside = offset <= tolerance[j] ** 2 and last <= along <= 1.0
            last = along
        if inside:
            stays[k] = False
        else:
            first = k
    return stays
