"""The way along a path of SpeedOverride-v1: where the axes are by arc length, where it rests, where glue is laid."""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.engine.native.pointers import floats_at, octets_at, row_at, rows_at
from gantrysim.engine.positions import axis_positions
from gantrysim.machine.machine import Machine
from gantrysim.record.setpoints import Setpoints

# Between two knots positions are cubics through four of them: on an arc of the radius R they miss by less than
# spacing⁴ / (1944 R³), 1e-8 mm for R = 2 mm.
_SPACING = 0.1  # of the knots, at most [mm]
_NEAR_STOP = 1e-4  # distance from a stop at which it is reached [mm]
_SPAN_PARTS = 3  # of the span between two knots


@dataclass(frozen=True, eq=False)
class Track:
    """The way along a requested path.

    Attributes:
        knots: ascending arc lengths, (n + 1,) [mm].
        positions: of all the machine's axes, at the knots and at the thirds between them, (3 n + 1, axes) [mm or deg].
        stops: ascending arc lengths at which it comes to rest: the corners, and the end, (k,) [mm].
        switches: ascending arc lengths at which the dispenser is switched, (m,) [mm].
        starts_on: whether it is on at the start.
    """

    knots: Floats
    positions: Floats
    stops: Floats
    switches: Floats
    starts_on: bool

    @classmethod
    def of(cls, machine: Machine, setpoints: Setpoints, progress: Floats) -> Self:
        """Return the way along the requested path of setpoints.

        Axes that are no coordinates of the nozzle follow the setpoints.

        Args:
            machine: the machine.
            setpoints: of the program.
            progress: arc length for which each of them stands, (n,) [mm].

        Raises:
            InputError: a path out of the travel of an axis.
        """
        path = setpoints.requested
        joints = path.joints
        edges = np.union1d([0.0, path.length], joints) if joints.size else np.array([0.0, path.length])
        spans = [
            np.linspace(low, high, max(int(np.ceil((high - low) / _SPACING)), 1), endpoint=False)
            for low, high in itertools.pairwise(edges.tolist())
        ]
        knots = np.append(np.concatenate(spans), path.length)
        thirds = np.arange(_SPAN_PARTS) / _SPAN_PARTS
        s = np.append((knots[:-1, None] + np.diff(knots)[:, None] * thirds).ravel(), path.length)
        tip = path.position(s)
        columns = [
            tip[:, "xyz".index(name)] if name in "xyz" else np.interp(s, progress, setpoints.position[:, k])
            for k, name in enumerate(setpoints.axes)
        ]
        asked = Setpoints(setpoints.period, setpoints.axes, np.column_stack(columns), np.ones(len(s), bool), path)
        # the rows are no ticks: their speeds say nothing
        positions = axis_positions(machine, asked, is_checked=False)
        for a, axis in enumerate(machine.plain_axes):
            low, high = axis.travel
            if not (low <= positions[:, a].min() and positions[:, a].max() <= high):
                raise InputError(
                    f"{axis.name} = {positions[:, a].min():.4g} to {positions[:, a].max():.4g} {axis.unit} along the "
                    f"requested path: must lie in the travel {low:g} to {high:g} {axis.unit} of machine {machine.name}"
                )
        changes = 1 + np.flatnonzero(np.diff(setpoints.dispense.astype(np.int8)))
        corners = path.corners[path.corners > 0]
        stops = np.union1d(corners, [path.length]) if corners.size else np.array([path.length])
        return cls(knots, positions, stops, progress[changes], bool(setpoints.dispense[0]))

    def steepest(self) -> Floats:
        """Return the largest motion of each axis per arc length, (axes,) [mm or deg per mm]."""
        steps = np.repeat(np.diff(self.knots) / _SPAN_PARTS, _SPAN_PARTS)
        steepest: Floats = (np.abs(np.diff(self.positions, axis=0)) / steps[:, None]).max(axis=0)
        return steepest


class Tracks(NamedTuple):
    """The tracks of several places, each in the first entries of its rows.

    Attributes:
        knots: (places, n + 1) [mm].
        positions: (places, 3 n + 1, axes) [mm or deg].
        stops: (places, k) [mm].
        switches: (places, m) [mm].
        counts: number of knots, of stops and of switches, (places, 3).
        starts_on: (places,).
    """

    knots: Floats
    positions: Floats
    stops: Floats
    switches: Floats
    counts: NDArray[np.int64]
    starts_on: NDArray[np.bool_]

    @classmethod
    def empty(cls, places: int, axes: int) -> Tracks:
        """Return tracks without an entry."""
        counts = np.zeros((places, 3), np.int64)
        none = np.zeros((places, 0))
        return cls(none, np.zeros((places, 0, axes)), none, none, counts, np.zeros(places, bool))

    def with_track(self, place: int, track: Track) -> Tracks:
        """Put a track into a place; return these tracks, in larger arrays where it has more entries than any before."""
        columns = {"knots": track.knots, "positions": track.positions, "stops": track.stops, "switches": track.switches}
        larger = {}
        for name, values in columns.items():
            rows = getattr(self, name)
            if len(values) > rows.shape[1]:
                grown = np.zeros((len(rows), len(values), *rows.shape[2:]))
                grown[:, : rows.shape[1]] = rows
                larger[name] = grown
        tracks = self._replace(**larger)
        for name, values in columns.items():
            getattr(tracks, name)[place, : len(values)] = values
        tracks.counts[place] = len(track.knots), len(track.stops), len(track.switches)
        tracks.starts_on[place] = track.starts_on
        return tracks


class Commanded(NamedTuple):
    """What is commanded at several places in an interval, written by `command`.

    Attributes:
        s: arc length, (places,) [mm].
        speed: path speed, (places,) [mm/s].
        way: arc lengths at the ticks, (places, ticks) [mm].
        position: of all the machine's axes, (places, ticks, axes) [mm or deg].
        dispense: whether the dispenser is on, (places, ticks).
    """

    s: Floats
    speed: Floats
    way: Floats
    position: Floats
    dispense: NDArray[np.bool_]


@jit
def move(
    state: tuple[float, float], target: float, stops: Floats, acceleration: float, period: float, way: Floats
) -> tuple[float, float]:
    """Move along a path towards a speed, with limited acceleration, and come to rest at each stop for an instant.

    Args:
        state: arc length [mm] and speed [mm/s].
        target: speed wanted [mm/s].
        stops: ascending arc lengths, the last of them the path's length, (k,) [mm].
        acceleration: limit, in both directions [mm/s²].
        period: servo period [s].
        way: arc lengths after each period, (n,), to be written.

    Returns:
        Arc length and speed after the last period.
    """
    s, v = state
    most = acceleration * period
    for k in range(way.size):
        stop = stops[min(int(np.searchsorted(stops, s, "right")), len(stops) - 1)]
        distance = stop - s
        # from v at this tick, braking takes v period / 2 + v² / 2a
        stopping = most * (np.sqrt(0.25 + 2 * distance / (most * period)) - 0.5)
        v = max(min(min(max(target, v - most), v + most), stopping), 0.0)
        s = min(s + v * period, stop)
        if stop - s < _NEAR_STOP:
            s = stop
            v = 0.0
        way[k] = s
    return s, v


@jit
def command(
    tracks: Tracks,
    places: NDArray[np.intp],
    begins: NDArray[np.bool_],
    targets: Floats,
    limits: tuple[float, float],
    commanded: Commanded,
) -> None:
    """Command the next interval at some places.

    Args:
        tracks: of all places.
        places: that move, (n,).
        begins: whether the interval is the first of an episode, whose first tick is the start of the path, (places,).
        targets: speeds wanted, (places,) [mm/s].
        limits: acceleration [mm/s²] and servo period [s].
        commanded: of all places, to be updated.
    """
    acceleration, period = limits
    for place in places:
        knots = tracks.knots[place, : tracks.counts[place, 0]]
        stops = tracks.stops[place, : tracks.counts[place, 1]]
        switches = tracks.switches[place, : tracks.counts[place, 2]]
        positions = tracks.positions[place]
        way = commanded.way[place]
        first = 1 if begins[place] else 0
        way[:first] = 0.0
        state = (commanded.s[place], commanded.speed[place])
        commanded.s[place], commanded.speed[place] = move(
            state, targets[place], stops, acceleration, period, way[first:]
        )
        for k in range(way.size):
            span = min(max(int(np.searchsorted(knots, way[k], "right")) - 1, 0), len(knots) - 2)
            # Lagrange's cubic through the positions at 0, 1, 2 and 3
            u = _SPAN_PARTS * (way[k] - knots[span]) / (knots[span + 1] - knots[span])
            a = -(u - 1) * (u - 2) * (u - 3) / 6
            b = u * (u - 2) * (u - 3) / 2
            c = -u * (u - 1) * (u - 3) / 2
            d = u * (u - 1) * (u - 2) / 6
            row = _SPAN_PARTS * span
            for axis in range(positions.shape[1]):
                commanded.position[place, k, axis] = (
                    a * positions[row, axis]
                    + b * positions[row + 1, axis]
                    + c * positions[row + 2, axis]
                    + d * positions[row + 3, axis]
                )
            switched = np.searchsorted(switches, way[k], "right")
            commanded.dispense[place, k] = tracks.starts_on[place] != (switched % 2 == 1)


@jit
def write_setpoints(
    places: NDArray[np.intp],
    rows: NDArray[np.int64],
    spans: NDArray[np.void],
    written: NDArray[np.int64],
    commanded: Commanded,
) -> None:
    """Write what is commanded in an interval behind the setpoints written so far, at some places.

    Args:
        places: numbers of the places.
        rows: addresses of the servos' rows of all places, whose setpoints are written.
        spans: of all places, of `gantrysim.env.interval.SPAN`, whose progress and dispenser command are written.
        written: number of setpoints of all places.
        commanded: of all places.
    """
    for place in places:
        row = row_at(rows[place])
        position = rows_at(row.setpoints, row.ticks, row.axes)
        progress = floats_at(spans[place].progress)
        dispense = octets_at(spans[place].dispense)
        begin = written[place]
        for k in range(min(commanded.way.shape[1], row.ticks - begin)):
            for axis in range(row.axes):
                position[begin + k, axis] = commanded.position[place, k, axis]
            progress[begin + k] = commanded.way[place, k]
            dispense[begin + k] = commanded.dispense[place, k]
