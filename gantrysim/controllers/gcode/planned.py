"""The plan of a program: its requested path, its commanded path, and the speed along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.corners import SHARPEST_TURN, Corners, Rounded, merged_points, rounded_track
from gantrysim.controllers.gcode.interpret import Interpreted
from gantrysim.controllers.gcode.motion_limits import (
    ALONG,
    INWARD,
    PieceLimits,
    PlanSettings,
    jump_speed,
    junction_speed,
    limits_of,
    planned_profile,
    shares,
    turning_speed,
)
from gantrysim.controllers.gcode.move_table import (
    ANALOGUE,
    ANGLE,
    ARC,
    CENTRE,
    DWELL,
    END,
    EXACT_PATH,
    FEED,
    KIND,
    LINE,
    MODE,
    NAIVE,
    PLANE,
    PLANES,
    SOURCE,
)
from gantrysim.controllers.placement import Placement
from gantrysim.paths.limits import Limited
from gantrysim.paths.track import Track

_SHORTEST_MOVE = 1e-6  # length of a move that is kept; less is rounding of coordinates [mm]
_STOP = 0.1  # share of the feed below which a corner is a stop


@dataclass(frozen=True)
class Dwells:
    """The dwells of a program, (d,) each.

    Attributes:
        begin: time of the profile, which has none of them, at which each begins [s].
        times: of each [s].
        rows: of the moves.
        pieces: first piece of the path after each.
    """

    begin: Floats
    times: Floats
    rows: NDArray[np.intp]
    pieces: NDArray[np.intp]


@dataclass(frozen=True)
class PathPlan:
    """A planned program.

    Attributes:
        requested: path of all moves, in the work frame.
        path: the commanded one.
        profile: speed along it, without dwells.
        rows: of the moves, for every piece of `requested`, (r,).
        progress: arc length of `requested` at the ends of the pieces of `path`, see `_progress`, (n + 1,) [mm].
        source: row of the moves for every piece of `path`, (n,).
        program: with the moves.
        dwells: between the pieces.
        corners: where pieces of the requested path meet.
        axis_speeds: largest speeds that the feeds ask of x, y and z, (3,) [mm/s].
    """

    requested: Track
    path: Rounded
    profile: Limited
    rows: NDArray[np.intp]
    progress: Floats
    source: NDArray[np.intp]
    program: Interpreted
    dwells: Dwells
    corners: Corners
    axis_speeds: Floats

    @property
    def duration(self) -> float:
        """Of the motion with its dwells [s]."""
        return self.profile.duration + float(self.dwells.times.sum())

    def at(self, t: ArrayLike) -> tuple[Floats, NDArray[np.bool_], Floats]:
        """Return points (n, 3) [mm], whether glue is laid, (n,), and the progress, (n,) [mm], at times (n,) [s]."""
        s, row = self._rows(np.asarray(t, float))
        return self.path.position(s), self.program.glue[row], np.interp(s, self.path.ends, self.progress)

    def analogue(self, t: ArrayLike) -> Floats:
        """Return the set point of the flow at times, (n,)."""
        _, row = self._rows(np.asarray(t, float))
        return self.program.moves[row, ANALOGUE]

    def lines(self, t: ArrayLike) -> NDArray[np.intp]:
        """Return the program's lines that run at times, (n,)."""
        _, row = self._rows(np.asarray(t, float))
        return self.program.moves[row, SOURCE].astype(np.intp)

    def _rows(self, t: Floats) -> tuple[Floats, NDArray[np.intp]]:
        """Arc lengths, and rows of the moves or dwells, at times."""
        dwells = self.dwells
        if not dwells.times.size:
            s = np.asarray(self.profile.position(t))
            return s, self.source[self.path.locate(s)]
        # before each dwell, and in all
        waited = np.concatenate([[0.0], np.cumsum(dwells.times)])
        begun = dwells.begin + waited[:-1]
        k = np.searchsorted(begun, t, side="right") - 1
        after = k >= 0
        k = np.maximum(k, 0)
        # a dwell after the last piece lasts until the end, whatever rounding makes of its time
        waiting = after & ((t - begun[k] < dwells.times[k]) | (dwells.pieces[k] == self.source.size))
        moving = np.where(after, np.maximum(dwells.begin[k], t - waited[k + 1]), t)  # time of the profile
        s = np.asarray(self.profile.position(moving))
        # the last piece before a dwell and the first after it meet at one place
        edges = np.concatenate([[0], dwells.pieces, [self.source.size]])
        piece = np.clip(self.path.locate(s), edges[k + after], edges[k + after + 1] - 1)
        return s, np.where(waiting, dwells.rows[k], self.source[np.minimum(piece, self.source.size - 1)])


@dataclass(frozen=True)
class _Base:
    """The path before its corners are rounded.

    Attributes:
        track: the path.
        rows: of the moves, for every piece, (m,).
        halts: whether the motion halts before each piece, as in a dwell of any time, and at the end, (m + 1,).
    """

    track: Track
    rows: NDArray[np.intp]
    halts: NDArray[np.bool_]


def requested_track(program: Interpreted, placement: Placement) -> tuple[Track, NDArray[np.intp]]:
    """Return the path of a program's moves, and the row of each piece.

    Raises:
        InputError: no move.
    """
    table = program.moves
    points = np.empty((len(table) + 1, 3))
    points[0] = program.start
    points[1:] = table[:, END : END + 3]
    arc = table[:, KIND] == ARC
    # the scale of the placement may make a long move of a short one
    moved = np.abs(np.diff(points, axis=0)).max(axis=1, initial=0.0) > _SHORTEST_MOVE / min(placement.scale, 1.0)
    moving = np.flatnonzero((table[:, KIND] != DWELL) & (arc | moved))
    if not moving.size:
        raise InputError(f"program: moves none of x, y, z; {program.without_moves}")
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


def plan(program: Interpreted, placement: Placement, settings: PlanSettings) -> PathPlan:
    """Plan a program."""
    requested, rows = requested_track(program, placement)
    table = program.moves
    halt_rows = np.flatnonzero(table[:, KIND] == DWELL)
    halts = np.zeros(rows.size + 1, bool)
    halts[np.searchsorted(rows, halt_rows)] = True
    dwell_rows = halt_rows[table[halt_rows, FEED] > 0]
    moves_before = np.searchsorted(rows, dwell_rows)
    base = _simplified_base(_Base(requested, rows, halts), program)
    limits = limits_of(base.track, table, base.rows, program.limits, settings)
    axis_speeds = (limits.speed[:, None] * shares(base.track)).max(axis=0)
    path, joint, corners = _rounded_corners(base, table, limits, settings)
    profile, source = _profile(path, joint, limits, base.rows)
    pieces = _pieces_after(path, base.rows, rows, moves_before)
    begin = np.array([profile.time_at(float(s)) if s > 0 else 0.0 for s in path.ends[pieces]])
    return PathPlan(
        requested=requested,
        path=path,
        profile=profile,
        rows=rows,
        progress=_progress(path, base, requested, rows),
        source=source,
        program=program,
        dwells=Dwells(begin, table[dwell_rows, FEED], dwell_rows, pieces),
        corners=corners,
        axis_speeds=axis_speeds,
    )


def _progress(path: Rounded, base: _Base, requested: Track, rows: NDArray[np.intp]) -> Floats:
    """Return the arc length of the requested path that each end of a piece of the commanded path stands for, (n + 1,).

    A line that replaces several moves ends with the last of them; an arc stands for the ends of the two legs that it
    joins, its middle for their corner.

    Args:
        path: the commanded path.
        base: the path before its corners are rounded.
        requested: the path of all moves.
        rows: of the moves, for every piece of `requested`.
    """
    begun = np.concatenate([[0.0], base.track.ends])
    at_base = begun[path.piece] + path.begin
    arcs = np.flatnonzero(path.arc >= 0)
    at_base[arcs] = at_base[arcs - 1] + path.lengths[arcs - 1]
    at_base = np.maximum.accumulate(np.append(at_base, begun[-1]))
    last = np.searchsorted(rows, base.rows)
    return np.interp(at_base, begun, np.concatenate([[0.0], requested.ends[last]]))


def _rounded_corners(
    base: _Base, table: Floats, limits: PieceLimits, settings: PlanSettings
) -> tuple[Rounded, Floats, Corners]:
    """Round the corners of a path; its many intermediate arrays end here, before the profile takes as much memory.

    Args:
        base: the path.
        table: the moves.
        limits: of each piece.
        settings: of the planner.
    """
    feed = table[base.rows, FEED]
    speed = limits.speed
    turning = np.minimum(limits.turning[:-1], limits.turning[1:])
    # where two moves meet, the stricter of their modes holds
    mode = np.minimum(table[base.rows[:-1], MODE], table[base.rows[1:], MODE])
    deviation = np.fmin(limits.deviation[:-1], limits.deviation[1:])
    by_firmware = np.isfinite(deviation) & (mode > EXACT_PATH)
    mode[by_firmware] = EXACT_PATH
    halted = base.halts[1:-1]
    lengths = np.diff(base.track.ends, prepend=0.0)
    tolerance = np.where(halted | (mode <= EXACT_PATH), 0.0, mode)
    # an arc that admits the slower of the two speeds is wide enough: v^2 / r is at most its share of the acceleration
    needed = np.minimum(speed[:-1], speed[1:])
    widest = needed**2 / (turning * INWARD)
    path, angle, distance = rounded_track(base.track, tolerance, widest)
    joint = np.minimum(needed, jump_speed(angle, turning, settings.cycle))
    reach = 0.5 * np.minimum(lengths[:-1], lengths[1:])
    passed = junction_speed(angle, deviation, turning, reach)
    joint[by_firmware] = np.minimum(needed, passed)[by_firmware]
    joint[halted | (mode < EXACT_PATH)] = 0.0
    stopped = (feed[:-1] > 0) & (feed[1:] > 0) & ~halted & (joint < _STOP * needed)
    sizes = lengths[:-1][stopped]
    small = float(np.median(sizes)) if sizes.size else 0.0
    cut = float(distance[np.isinf(mode)].max(initial=0.0))
    bends = stopped & (angle < SHARPEST_TURN)
    roundable = bends & ~by_firmware & ~base.track.coil[:-1] & ~base.track.coil[1:]
    corners = Corners(
        stops=int(stopped.sum()),
        roundable=int(roundable.sum()),
        by_firmware=int((bends & by_firmware).sum()),
        small=small,
        cut=cut,
    )
    return path, joint, corners


def _pieces_after(
    path: Rounded, base_rows: NDArray[np.intp], rows: NDArray[np.intp], moves_before: NDArray[np.intp]
) -> NDArray[np.intp]:
    """The first piece of the path after each dwell, from the number of moves before the dwell."""
    last = np.searchsorted(base_rows, rows[np.maximum(moves_before - 1, 0)], side="right") - 1  # piece of the base
    # an arc lies between the pieces that it joins
    order = path.piece + 0.5 * (path.arc >= 0)
    return np.where(moves_before > 0, np.searchsorted(order, last, side="right"), 0)


def _simplified_base(base: _Base, program: Interpreted) -> _Base:
    """Merge lines within the tolerance of G64 Q."""
    rows = base.rows
    table = program.moves[rows]
    naive = table[:, NAIVE]
    if not naive.any():
        return base
    joined = np.zeros(rows.size + 1, bool)
    alike = np.column_stack([table[:, [FEED, MODE, NAIVE]], program.glue[rows]])
    same = (alike[:-1] == alike[1:]).all(axis=1)
    line = (table[:, KIND] == LINE) & (table[:, FEED] > 0)
    joined[1:-1] = same & line[:-1] & line[1:] & ~base.halts[1:-1] & (naive[:-1] > 0)
    points = base.track.points
    corner = merged_points(points, joined, np.append(naive, 0.0))
    # pieces that end at a point that stays
    last = np.flatnonzero(corner[1:])
    p = base.track.parameters()
    track = Track(p["start"], points[last + 1], p["angle"][last], p["centre"][last], p["plane"][last], p["frames"])
    return _Base(track, rows[last], base.halts[np.flatnonzero(corner)])


def _profile(
    path: Rounded, joint: Floats, limits: PieceLimits, rows: NDArray[np.intp]
) -> tuple[Limited, NDArray[np.intp]]:
    """Speed along the rounded path, and the row of the moves of each of its pieces.

    Args:
        path: with its arcs.
        joint: largest speeds at the corners of the base [mm/s].
        limits: of each piece of the base.
        rows: of the moves, for every piece of the base.
    """
    speed = limits.speed
    arcs = path.arc >= 0
    top = speed[path.piece]
    change = limits.acceleration[path.piece]
    k = path.piece[arcs]
    turning = np.minimum(limits.turning[k], limits.turning[k + 1])
    top[arcs] = np.minimum(np.minimum(speed[k], speed[k + 1]), turning_speed(path.radius[path.arc[arcs]], turning))
    change[arcs] = ALONG * turning
    # an arc belongs to the move after the corner
    source = rows[path.piece + arcs]
    meet = np.full(arcs.size - 1, np.inf)
    plain = ~arcs[:-1] & ~arcs[1:]
    meet[plain] = joint[path.piece[:-1][plain]]
    return planned_profile(path.lengths, top, change, meet), source
