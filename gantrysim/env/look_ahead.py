"""Look-ahead along a path: curvature and reversals of the axes; and a speed profile with limits along the path.

The paths of the places of a batch differ in length: they are rows of one array, each followed by zeros.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.jit import jit
from gantrysim.env.decision import Entry

_DIRECTION_POINTS = 8  # points over which the direction of the path is taken


class Rows:
    """Rows of numbers of different lengths, each followed by zeros.

    Args:
        places: number of rows, empty at first.

    Attributes:
        values: (places, longest + 1): the last column is zero.
        counts: lengths, (places,).
    """

    def __init__(self, places: int) -> None:
        self.values: Floats = np.zeros((places, 1))
        self.counts: NDArray[np.int64] = np.zeros(places, np.int64)

    def put(self, place: int, row: Floats) -> None:
        """Replace a row."""
        count = len(row)
        if count >= self.values.shape[1]:
            larger = np.zeros((len(self.values), count + 1))
            larger[:, : self.values.shape[1]] = self.values
            self.values = larger
        self.values[place, :count] = row
        # behind it nothing but the row before can be left
        self.values[place, count : self.counts[place]] = 0.0
        self.counts[place] = count

    def at(self, columns: NDArray[np.int64]) -> Floats:
        """Return the value of each row in a column of its own, zero behind its end, (places,)."""
        values: Floats = self.values[np.arange(len(columns)), np.minimum(columns, self.values.shape[1] - 1)]
        return values


@dataclass(frozen=True, eq=False)
class LookAhead:
    """Curvature and reversals along a path.

    An axis reverses where its coordinate of the path's direction changes its sign.

    Args:
        points: along the path, (m, 3) [mm].
    """

    points: Floats

    @cached_property
    def s(self) -> Floats:
        """Arc length of the points, (m,) [mm]."""
        return _arc_lengths(self.points)

    @cached_property
    def curvature(self) -> Floats:
        """Curvature in the XY plane at the points, positive to the left, (m,) [1/mm].

        It is the slope of the heading, the direction from one point to the eighth after it, at the middle of the two;
        before the first middle and after the last it is constant.
        """
        return _curvatures(self.points, self.s)

    @cached_property
    def reversals(self) -> Floats:
        """Arc lengths at which an axis reverses, (k,) [mm]."""
        return np.unique(_reversals(self.points, self.s))

    def prepare(self) -> None:
        """Compute all of it, which is then remembered."""
        _ = self.s, self.curvature, self.reversals

    def to_reversal(self, s: ArrayLike) -> tuple[Floats, Floats]:
        """Return the distances to the next reversal and since the last, of the shape of s, inf without one [mm]."""
        place = np.asarray(s, float)
        edges = np.concatenate([[-np.inf], self.reversals, [np.inf]])
        after = np.searchsorted(edges, place, "right")
        return edges[after] - place, place - edges[after - 1]


@jit
def _arc_lengths(points: Floats) -> Floats:
    s = np.zeros(len(points))
    for k in range(1, len(points)):
        x = points[k, 0] - points[k - 1, 0]
        y = points[k, 1] - points[k - 1, 1]
        z = points[k, 2] - points[k - 1, 2]
        s[k] = s[k - 1] + np.sqrt(x * x + y * y + z * z)
    return s


@jit
def _curvatures(points: Floats, s: Floats) -> Floats:
    count = len(points) - _DIRECTION_POINTS
    middle = 0.5 * (s[_DIRECTION_POINTS:] + s[:count])
    heading = np.empty(count)
    for k in range(count):
        x = points[k + _DIRECTION_POINTS, 0] - points[k, 0]
        y = points[k + _DIRECTION_POINTS, 1] - points[k, 1]
        heading[k] = np.arctan2(y, x)
        if k > 0:
            # without jumps of whole turns
            heading[k] -= 2.0 * np.pi * np.rint((heading[k] - heading[k - 1]) / (2.0 * np.pi))
    slope = np.empty(count)
    slope[0] = (heading[1] - heading[0]) / (middle[1] - middle[0])
    slope[-1] = (heading[-1] - heading[-2]) / (middle[-1] - middle[-2])
    for k in range(1, count - 1):
        # of the parabola through three points
        before = middle[k] - middle[k - 1]
        after = middle[k + 1] - middle[k]
        slope_before = (heading[k] - heading[k - 1]) / before
        slope_after = (heading[k + 1] - heading[k]) / after
        slope[k] = (after * slope_before + before * slope_after) / (before + after)
    return np.interp(s, middle, slope)


@jit
def _reversals(points: Floats, s: Floats) -> Floats:
    """Return the arc lengths at which an axis reverses, one axis after the other."""
    reversals = np.empty(points.size)
    count = 0
    for axis in range(points.shape[1]):
        direction = 0.0
        end = 0
        for k in range(1, len(points)):
            step = np.sign(points[k, axis] - points[k - 1, axis])
            if step == 0.0:
                continue
            if step == -direction:
                # where the last step in the other direction has ended
                reversals[count] = s[end]
                count += 1
            direction = step
            end = k
    return reversals[:count]


class LimitedSpeed:
    """From rest to rest along a path, as fast as a limit of the speed along it and the acceleration allow.

    Between two points the acceleration is constant.

    Args:
        s: ascending arc lengths from 0 to the path's length, (m,) [mm].
        limit: of the speed there, (m,) [mm/s].
        acceleration: largest, in both directions [mm/s²].
    """

    def __init__(self, s: Floats, limit: Floats, acceleration: float) -> None:
        square = np.minimum(limit, np.inf) ** 2
        square[[0, -1]] = 0.0
        # v² changes by no more than 2 a ds: the least of v² + 2 a |s - s'| over all s'
        rise = 2 * acceleration * s
        square = np.minimum.accumulate(square - rise) + rise
        square = (np.minimum.accumulate((square + rise)[::-1]) - rise[::-1])[::-1]
        self._s = s
        self._v = np.sqrt(np.maximum(square, 0.0))
        self._t = np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / (self._v[1:] + self._v[:-1]))])

    @property
    def length(self) -> float:
        return float(self._s[-1])

    @property
    def duration(self) -> float:
        return float(self._t[-1])

    def _parts(self, t: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
        """Return arc length and speed at the begin of the stretches, the time since then, and their acceleration."""
        time = np.clip(np.asarray(t, float), 0.0, self.duration)
        k = np.clip(np.searchsorted(self._t, time, "right") - 1, 0, len(self._t) - 2)
        slope = (self._v[k + 1] - self._v[k]) / (self._t[k + 1] - self._t[k])
        return self._s[k], self._v[k], time - self._t[k], slope

    def position(self, t: ArrayLike) -> Floats:
        s, v, since, slope = self._parts(t)
        return s + since * (v + 0.5 * slope * since)

    def velocity(self, t: ArrayLike) -> Floats:
        _, v, since, slope = self._parts(t)
        return v + slope * since


AHEAD = (2.0, 5.0, 10.0)  # distances at which the curvature ahead is observed [mm]
_SPEED_UNIT = 100.0  # [mm/s]
_SPEED_RANGE = 10.0  # of these units
_CURVATURE_UNIT = 0.1  # [1/mm]
_CURVATURE_RANGE = 10.0  # of these units
_REVERSAL = 10.0  # range of distances to reversals [mm]


def ahead_entries(speeds: Mapping[str, str]) -> list[Entry]:
    """Return the entries of the observation for speed, curvature and reversals ahead.

    Args:
        speeds: names and meanings of the speeds among them.
    """
    places = [("", "here"), *((f"_{distance:g}", f"{distance:g} mm ahead") for distance in AHEAD)]
    return [
        *(Entry(name, 0.0, _SPEED_RANGE, "100 mm/s", meaning) for name, meaning in speeds.items()),
        *(
            Entry(
                f"curvature{name}",
                -_CURVATURE_RANGE,
                _CURVATURE_RANGE,
                "0.1/mm",
                f"path curvature {where}, positive to the left",
            )
            for name, where in places
        ),
        Entry("to_reversal", 0.0, 1.0, "10 mm", "distance to the next reversal of an axis, at most 10 mm"),
        Entry("since_reversal", 0.0, 1.0, "10 mm", "distance since the last reversal of an axis, at most 10 mm"),
    ]


class PathsAhead:
    """What lies ahead at several places, each on a path of its own.

    Args:
        places: number of places, without a path at first.
    """

    def __init__(self, places: int) -> None:
        self._s = Rows(places)
        self._curvature = Rows(places)
        self._reversals = Rows(places)

    def put(self, place: int, look: LookAhead) -> None:
        """Put a path into a place."""
        self._s.put(place, look.s)
        self._curvature.put(place, look.curvature)
        self._reversals.put(place, look.reversals)

    def s(self, feet: NDArray[np.int64]) -> Floats:
        """Return the arc lengths of points of the paths, by their numbers, (places,) [mm]."""
        return self._s.at(np.maximum(feet, 0))

    def to_reversal(self, s: Floats) -> Floats:
        """Return the distances to the next reversal of an axis and since the last, inf without one, (places, 2) [mm].

        Args:
            s: arc lengths of the nozzle, (places,) [mm].
        """
        distances = np.empty((len(s), 2))
        _find_reversals(self._reversals.values, self._reversals.counts, s, distances)
        return distances

    def values(self, s: Floats, speeds: Sequence[Floats]) -> Floats:
        """Return the values of `ahead_entries`, zero where there is no path, (places, entries).

        Args:
            s: arc lengths of the nozzle, (places,) [mm].
            speeds: as in `ahead_entries`, (places,) each [mm/s].
        """
        curvature = np.zeros((len(s), len(_PLACES)))
        _find_curvatures(self._s.values, self._curvature.values, self._s.counts, s, curvature)
        has_path = self._s.counts > 0
        reversal = np.where(has_path[:, None], self.to_reversal(s) / _REVERSAL, 0.0)
        speed = np.where(has_path[:, None], np.column_stack(speeds), 0.0)
        return np.concatenate(
            [
                np.clip(speed / _SPEED_UNIT, 0.0, _SPEED_RANGE),
                np.clip(curvature / _CURVATURE_UNIT, -_CURVATURE_RANGE, _CURVATURE_RANGE),
                np.minimum(reversal, 1.0),
            ],
            1,
        )


_PLACES = np.array([0.0, *AHEAD])  # where the curvature is observed, ahead of the nozzle [mm]


@jit
def _find_curvatures(s: Floats, curvature: Floats, counts: NDArray[np.int64], nozzle: Floats, ahead: Floats) -> None:
    """Write the curvatures at the nozzle and ahead of it, (places, distances) [1/mm]."""
    for place in range(len(nozzle)):
        count = counts[place]
        if count:
            ahead[place] = np.interp(nozzle[place] + _PLACES, s[place, :count], curvature[place, :count])


@jit
def _find_reversals(reversals: Floats, counts: NDArray[np.int64], nozzle: Floats, distances: Floats) -> None:
    """Write the distances to the next reversal and since the last, inf without one, (places, 2) [mm]."""
    for place in range(len(nozzle)):
        s = nozzle[place]
        count = counts[place]
        after = np.searchsorted(reversals[place, :count], s, "right")
        distances[place, 0] = reversals[place, after] - s if after < count else np.inf
        distances[place, 1] = s - reversals[place, after - 1] if after > 0 else np.inf
