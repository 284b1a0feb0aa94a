"""The plan of a program: its requested path, its commanded path, and the speed along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.interpret import Interpreted
from gantrysim.controllers.gcode.lookahead import ALONG, jump_speed, planned, turning_speed
from gantrysim.controllers.gcode.moves import (
    ANGLE,
    ARC,
    CENTRE,
    DWELL,
    END,
    EXACT_PATH,
    FEED,
    GLUE,
    KIND,
    LINE,
    MODE,
    NAIVE,
    PLANE,
    PLANES,
    SOURCE,
)
from gantrysim.controllers.gcode.rounding import Rounded, merged, rounded
from gantrysim.controllers.placement import Placement
from gantrysim.paths.limits import Limited
from gantrysim.paths.track import Track

_SHORTEST = 1e-6  # length of a move that is kept; less is rounding of coordinates [mm]
_STOP = 0.1  # share of the feed below which a corner is a stop


@dataclass(frozen=True)
class Settings:
    """What a program is planned with.

    Attributes:
        rapid: largest speed of each axis [mm/s].
        acceleration: of each axis [mm/s²].
        cycle: period in which the velocity may jump by acceleration x cycle at a corner that is not rounded [s].
        override: factor on the feeds.
    """

    rapid: float
    acceleration: float
    cycle: float
    override: float


@dataclass(frozen=True)
class Plan:
    """A planned program.

    Attributes:
        requested: path of all moves, in the work frame.
        path: the commanded one.
        profile: speed along it, without dwells.
        source: row of the moves for every piece of `path`, (n,).
        moves: the rows.
        waits: times of the profile at which the program dwells, and the times of the dwells, (d,) each [s].
        wait_rows: row of the moves of each dwell, (d,).
        wait_pieces: first piece of `path` after each dwell, (d,).
        stops: corners between moves at feed passed at less than a tenth of the feed.
        small: median length of the moves before those corners; 0 without [mm].
        cut: largest distance of the path from corners that are rounded without a tolerance; 0 without [mm].
    """

    requested: Track
    path: Rounded
    profile: Limited
    source: NDArray[np.intp]
    moves: Floats
    waits: tuple[Floats, Floats]
    wait_rows: NDArray[np.intp]
    wait_pieces: NDArray[np.intp]
    stops: int
    small: float
    cut: float

    @property
    def duration(self) -> float:
        """Of the motion with its dwells [s]."""
        return self.profile.duration + float(self.waits[1].sum())

    def at(self, t: ArrayLike) -> tuple[Floats, NDArray[np.bool_]]:
        """Return points (n, 3) [mm], and whether glue is laid, (n,), at times (n,) [s]."""
        s, row = self._rows(np.asarray(t, float))
        return self.path.position(s), self.moves[row, GLUE] != 0

    def lines(self, t: ArrayLike) -> NDArray[np.intp]:
        """Return the program's lines that run at times, (n,)."""
        _, row = self._rows(np.asarray(t, float))
        return self.moves[row, SOURCE].astype(np.intp)

    def _rows(self, t: Floats) -> tuple[Floats, NDArray[np.intp]]:
        """Arc lengths, and rows of the moves or dwells, at times."""
        moving, times = self.waits
        if not times.size:
            s = np.asarray(self.profile.position(t))
            return s, self.source[self.path.locate(s)]
        before = np.concatenate([[0.0], np.cumsum(times)])
        begun = moving + before[:-1]
        k = np.searchsorted(begun, t, side="right") - 1
        after = k >= 0
        k = np.maximum(k, 0)
        waiting = after & ((t - begun[k] < times[k]) | (self.wait_pieces[k] == self.source.size))
        s = np.asarray(self.profile.position(np.where(after, np.maximum(moving[k], t - before[k + 1]), t)))
        # the last piece before a dwell and the first after it meet at one place
        edges = np.concatenate([[0], self.wait_pieces, [self.source.size]])
        piece = np.clip(self.path.locate(s), edges[k + after], edges[k + after + 1] - 1)
        return s, np.where(waiting, self.wait_rows[k], self.source[np.minimum(piece, self.source.size - 1)])


def requested_track(program: Interpreted, placement: Placement) -> tuple[Track, NDArray[np.intp]]:
    """Return the path of a program's moves, and the row of each piece.

    Raises:
        InputError: no move.
    """
    table = program.moves
    points = np.concatenate([[program.start], table[:, END : END + 3]]) if len(table) else np.array([program.start])
    arc = table[:, KIND] == ARC
    moved = np.abs(np.diff(points, axis=0)).max(axis=1, initial=0.0) > _SHORTEST / min(placement.scale, 1.0)
    moving = np.flatnonzero((table[:, KIND] != DWELL) & (arc | moved))
    if not moving.size:
        raise InputError("program: moves none of x, y, z; must have a block that does")
    plane = table[moving, PLANE].astype(np.intp)
    begin = np.concatenate([[program.start], points[moving[:-1] + 1]])
    centre = begin.copy()
    for index, (u, v, _) in enumerate(PLANES):
        chosen = plane == index
        centre[chosen, u] = table[moving[chosen], CENTRE]
        centre[chosen, v] = table[moving[chosen], CENTRE + 1]
    frames = np.array([np.eye(3)[list(axes)] for axes in PLANES])
    turned = placement.direction(frames) / placement.scale
    start = placement.point([program.start])[0]
    end = placement.point(points[moving + 1])
    return Track(start, end, table[moving, ANGLE], placement.point(centre), plane, turned), moving


def plan(program: Interpreted, placement: Placement, settings: Settings) -> Plan:
    """Plan a program."""
    requested, rows = requested_track(program, placement)
    table = program.moves
    halts, waits, wait_rows = _halts(table, rows)
    base, base_rows, halts = _simplified(requested, rows, table, halts)
    mode = np.minimum(table[base_rows[:-1], MODE], table[base_rows[1:], MODE])
    speed, acceleration = _limits(base, table[base_rows, FEED], settings)
    smooth = np.where(halts[1:-1] | (mode <= EXACT_PATH), 0.0, mode)
    need = np.minimum(speed[:-1], speed[1:])
    widest = need**2 / (settings.acceleration * np.sqrt(0.75))
    path, angle, distance = rounded(base, smooth, widest)
    joint = np.minimum(need, jump_speed(angle, settings.acceleration, settings.cycle))
    joint[halts[1:-1] | (mode < EXACT_PATH)] = 0.0
    profile, source = _profile(path, joint, speed, acceleration, base_rows, settings)
    pieces, moving = _waits(path, profile, base_rows, rows, waits[0])
    at_feed = (table[base_rows[:-1], FEED] > 0) & (table[base_rows[1:], FEED] > 0) & ~halts[1:-1]
    stopped = at_feed & (joint < _STOP * need)
    sizes = np.diff(base.ends, prepend=0.0)[:-1][stopped]
    small = float(np.median(sizes)) if sizes.size else 0.0
    cut = float(distance[np.isinf(mode)].max(initial=0.0))
    dwells = (moving, waits[1]), wait_rows, pieces
    return Plan(requested, path, profile, source, table, *dwells, int(stopped.sum()), small, cut)


def _halts(
    table: Floats, rows: NDArray[np.intp]
) -> tuple[NDArray[np.bool_], tuple[NDArray[np.intp], Floats], NDArray[np.intp]]:
    """Whether a dwell halts the motion before each piece and at the end; of each dwell, pieces before, time and row."""
    dwell = np.flatnonzero(table[:, KIND] == DWELL)
    before = np.searchsorted(rows, dwell)
    halts = np.zeros(rows.size + 1, bool)
    times = table[dwell, FEED]
    halts[before[times > 0]] = True
    real = times > 0
    return halts, (before[real], times[real]), dwell[real]


def _waits(
    path: Rounded, profile: Limited, base_rows: NDArray[np.intp], rows: NDArray[np.intp], before: NDArray[np.intp]
) -> tuple[NDArray[np.intp], Floats]:
    """The first piece after each dwell, and the moving time at it, from the number of moves before it."""
    last = np.searchsorted(base_rows, rows[np.maximum(before - 1, 0)], side="right") - 1  # piece of the base
    order = path.piece + 0.5 * (path.arc >= 0)
    pieces = np.where(before > 0, np.searchsorted(order, last, side="right"), 0)
    moving = np.array([profile.reached(float(s)) if s > 0 else 0.0 for s in path.ends[pieces]])
    return pieces, moving


def _simplified(
    track: Track, rows: NDArray[np.intp], table: Floats, halts: NDArray[np.bool_]
) -> tuple[Track, NDArray[np.intp], NDArray[np.bool_]]:
    """Merge lines within the tolerance of G64 Q; return the track, the rows and the halts of what remains."""
    naive = table[rows, NAIVE]
    if not naive.any():
        return track, rows, halts
    joined = np.zeros(rows.size + 1, bool)
    same = (table[rows[:-1]][:, [FEED, GLUE, MODE, NAIVE]] == table[rows[1:]][:, [FEED, GLUE, MODE, NAIVE]]).all(axis=1)
    line = (table[rows, KIND] == LINE) & (table[rows, FEED] > 0)
    joined[1:-1] = same & line[:-1] & line[1:] & ~halts[1:-1] & (naive[:-1] > 0)
    points = track.points
    corner = merged(points, joined, np.append(naive, 0.0))
    last = np.flatnonzero(corner[1:])  # pieces that end at a point that stays
    p = track.parameters()
    simple = Track(p["start"], points[last + 1], p["angle"][last], p["centre"][last], p["plane"][last], p["frames"])
    return simple, rows[last], halts[np.flatnonzero(corner)]


def _limits(track: Track, feed: Floats, settings: Settings) -> tuple[Floats, Floats]:
    """Largest speed and acceleration of every piece."""
    first, _ = track.end_tangents()
    steepest = np.where(track.coil, 1.0, np.maximum(np.abs(first).max(axis=1), 1e-9))
    speed = np.where(
        feed > 0, np.minimum(feed * settings.override, settings.rapid / steepest), settings.rapid / steepest
    )
    acceleration = settings.acceleration / steepest
    tightest = track.tightest
    round_ = np.isfinite(tightest)
    speed[round_] = np.minimum(speed[round_], turning_speed(np.maximum(tightest[round_], 1e-9), settings.acceleration))
    acceleration[round_] = ALONG * settings.acceleration
    return speed, acceleration


def _profile(
    path: Rounded, joint: Floats, speed: Floats, acceleration: Floats, rows: NDArray[np.intp], settings: Settings
) -> tuple[Limited, NDArray[np.intp]]:
    arcs = path.arc >= 0
    top = speed[path.piece]
    change = acceleration[path.piece]
    k = path.piece[arcs]
    top[arcs] = np.minimum(
        np.minimum(speed[k], speed[k + 1]), turning_speed(path.radius[path.arc[arcs]], settings.acceleration)
    )
    change[arcs] = ALONG * settings.acceleration
    source = rows[path.piece + arcs]  # an arc belongs to the move after the corner
    meet = np.full(arcs.size - 1, np.inf)
    plain = ~arcs[:-1] & ~arcs[1:]
    meet[plain] = joint[path.piece[:-1][plain]]
    return planned(path.lengths, top, change, meet), source
