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
from gantrysim.engine.native.pointers import floats_at
from gantrysim.env.decision import Entry

# points over which the direction of the path is taken: 0.3 to 0.8 mm on the drawn spirals of all tasks, 0.4 mm on a
# straight path
_DIRECTION_POINTS = 8


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
        points: along the path, (m, 3), by columns [mm].
    """

    points: Floats

    @cached_property
    def s(self) -> Floats:
        """Arc length of the points, (m,) [mm]."""
        return _arc_lengths(self.points)

    @cached_property
    def reversals(self) -> Floats:
        """Arc lengths at which an axis reverses, (k,) [mm]."""
        return np.unique(_reversals(self.points, self.s))

    def curvature(self, s: ArrayLike) -> Floats:
        """Return the curvature in the XY plane, positive to the left, of the shape of s [1/mm].

        It is the slope of the heading, the direction from one point to the eighth after it, at the middle of the two;
        before the first middle and after the last it is constant. Between the points it is interpolated.
        """
        place = np.asarray(s, float)
        x, y, _ = self.points.T
        curvature: Floats = np.array([_curvature_at(x, y, self.s, here) for here in place.ravel()])
        return curvature.reshape(place.shape)

    def prepare(self) -> None:
        """Compute all of it, which is then remembered."""
        _ = self.s, self.reversals

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
def _curvature_at(x: Floats, y: Floats, s: Floats, place: float) -> float:
    """Return the curvature at an arc length, between the points around it."""
    last = len(s) - 1
    if place <= s[0]:
        return _curvature_of(x, y, s, 0)
    if place >= s[last]:
        return _curvature_of(x, y, s, last)
    k = int(np.searchsorted(s, place, "right")) - 1
    before = _curvature_of(x, y, s, k)
    after = _curvature_of(x, y, s, k + 1)
    return before + (after - before) * (place - s[k]) / (s[k + 1] - s[k])


@jit
def _curvature_of(x: Floats, y: Floats, s: Floats, point: int) -> float:
    """Return the curvature at a point, interpolated between the middles before and after it."""
    place = s[point]
    last = len(s) - _DIRECTION_POINTS - 1
    if place <= _middle(s, 0):
        return _slope(x, y, s, 0)
    if place >= _middle(s, last):
        return _slope(x, y, s, last)
    # evenly spaced points have their middle four points before them
    k = min(max(point - _DIRECTION_POINTS // 2, 0), last - 1)
    while _middle(s, k) > place:
        k -= 1
    while _middle(s, k + 1) <= place:
        k += 1
    share = (place - _middle(s, k)) / (_middle(s, k + 1) - _middle(s, k))
    before = _slope(x, y, s, k)
    return before + share * (_slope(x, y, s, k + 1) - before)


@jit
def _middle(s: Floats, k: int) -> float:
    """Return the arc length between a point and the eighth after it."""
    return 0.5 * (s[k] + s[k + _DIRECTION_POINTS])


@jit
def _slope(x: Floats, y: Floats, s: Floats, k: int) -> float:
    """Return the slope of the heading at a middle, that of the parabola through three of them."""
    last = len(s) - _DIRECTION_POINTS - 1
    if k == 0:
        return _turned_heading(x, y, 0) / (_middle(s, 1) - _middle(s, 0))
    if k == last:
        return _turned_heading(x, y, k - 1) / (_middle(s, k) - _middle(s, k - 1))
    before = _middle(s, k) - _middle(s, k - 1)
    after = _middle(s, k + 1) - _middle(s, k)
    slope_before = _turned_heading(x, y, k - 1) / before
    slope_after = _turned_heading(x, y, k) / after
    return (after * slope_before + before * slope_after) / (before + after)


@jit
def _turned_heading(x: Floats, y: Floats, k: int) -> float:
    """Return by how much the heading turns from one point to the next, at most half a turn."""
    turned = _heading(x, y, k + 1) - _heading(x, y, k)
    return turned - 2.0 * np.pi * np.rint(turned / (2.0 * np.pi))


@jit
def _heading(x: Floats, y: Floats, k: int) -> float:
    return np.arctan2(y[k + _DIRECTION_POINTS] - y[k], x[k + _DIRECTION_POINTS] - x[k])


@jit
def _reversals(points: Floats, s: Floats) -> Floats:
    """Return the arc lengths at which an axis reverses, one axis after the other."""
    reversals = np.empty(points.size)
    count = 0
    for axis in range(points.shape[1]):
        direction = 0.0
        end = 0
        for k in range(1, len(points)):
            step = points[k, axis] - points[k - 1, axis]
            if step == 0.0:
                continue
            if step * direction < 0.0:
                # where the last step in the other direction has ended
                reversals[count] = s[end]
                count += 1
            direction = 1.0 if step > 0.0 else -1.0
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
        self._slope = np.diff(self._v) / np.diff(self._t)

    @property
    def length(self) -> float:
        return float(self._s[-1])

    @property
    def duration(self) -> float:
        return float(self._t[-1])

    def _parts(self, t: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
        """Return arc length and speed at the begin of the stretches, the time since then, and their acceleration."""
        time = np.clip(np.asarray(t, float), 0.0, self.duration)
        k = np.searchsorted(self._t[1:-1], time, "right")
        return self._s[k], self._v[k], time - self._t[k], self._slope[k]

    def position(self, t: ArrayLike) -> Floats:
        s, v, since, slope = self._parts(t)
        return s + since * (v + 0.5 * slope * since)

    def velocity(self, t: ArrayLike) -> Floats:
        _, v, since, slope = self._parts(t)
        return v + slope * since


DISTANCES_AHEAD = (2.0, 5.0, 10.0)  # distances at which the curvature ahead is observed [mm]
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
    places = [("", "here"), *((f"_{distance:g}", f"{distance:g} mm ahead") for distance in DISTANCES_AHEAD)]
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


# what lies ahead at a place, with the addresses of its arrays
_PATH_AHEAD = np.dtype(
    [
        ("points", np.int64),  # along the path, (count, 3), by columns [mm]
        ("s", np.int64),  # arc lengths of the points, (count,) [mm]
        ("count", np.int64),
        ("reversals", np.int64),  # arc lengths at which an axis reverses, (turns,) [mm]
        ("turns", np.int64),
    ]
)


class PathsAhead:
    """What lies ahead at several places, each on a path of its own.

    Args:
        places: number of places, without a path at first.
    """

    def __init__(self, places: int) -> None:
        self._ahead = np.zeros(places, _PATH_AHEAD)
        # kept alive, as there are addresses of their arrays
        self._looks: list[LookAhead | None] = [None] * places

    def put(self, place: int, look: LookAhead) -> None:
        """Put a path into a place."""
        points = np.asfortranarray(look.points)
        self._looks[place] = look if points is look.points else LookAhead(points)
        ahead = self._ahead[place]
        ahead["points"] = points.ctypes.data
        ahead["s"] = look.s.ctypes.data
        ahead["count"] = len(look.s)
        ahead["reversals"] = look.reversals.ctypes.data
        ahead["turns"] = len(look.reversals)

    def s(self, feet: NDArray[np.int64]) -> Floats:
        """Return the arc lengths of points of the paths, by their numbers, 0 without a path, (places,) [mm]."""
        s = np.zeros(len(feet))
        _find_s(self._ahead, feet, s)
        return s

    def to_reversal(self, s: Floats) -> Floats:
        """Return the distances to the next reversal of an axis and since the last, inf without one, (places, 2) [mm].

        Args:
            s: arc lengths of the nozzle, (places,) [mm].
        """
        distances = np.empty((len(s), 2))
        _find_reversals(self._ahead, s, distances)
        return distances

    def values(self, s: Floats, speeds: Sequence[Floats]) -> Floats:
        """Return the values of `ahead_entries`, zero where there is no path, (places, entries).

        Args:
            s: arc lengths of the nozzle, (places,) [mm].
            speeds: as in `ahead_entries`, (places,) each [mm/s].
        """
        curvature = np.zeros((len(s), len(_CURVATURE_PLACES)))
        _find_curvatures(self._ahead, s, curvature)
        has_path = self._ahead["count"] > 0
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


_CURVATURE_PLACES = np.array([0.0, *DISTANCES_AHEAD])  # where the curvature is observed, ahead of the nozzle [mm]


@jit
def _find_s(ahead: NDArray[np.void], feet: NDArray[np.int64], s: Floats) -> None:
    """Write the arc lengths of points, (places,) [mm]."""
    for place in range(len(feet)):
        if ahead[place].count:
            s[place] = floats_at(ahead[place].s)[max(feet[place], 0)]


@jit
def _find_curvatures(ahead: NDArray[np.void], nozzle: Floats, curvature: Floats) -> None:
    """Write the curvatures at the nozzle and ahead of it, (places, distances) [1/mm]."""
    for place in range(len(nozzle)):
        count = ahead[place].count
        if count:
            points = floats_at(ahead[place].points)
            x = points[:count]
            y = points[count : 2 * count]
            s = floats_at(ahead[place].s)[:count]
            for k in range(len(_CURVATURE_PLACES)):
                curvature[place, k] = _curvature_at(x, y, s, nozzle[place] + _CURVATURE_PLACES[k])


@jit
def _find_reversals(ahead: NDArray[np.void], nozzle: Floats, distances: Floats) -> None:
    """Write the distances to the next reversal and since the last, inf without one, (places, 2) [mm]."""
    for place in range(len(nozzle)):
        s = nozzle[place]
        count = ahead[place].turns
        reversals = floats_at(ahead[place].reversals)[:count]
        after = np.searchsorted(reversals, s, "right")
        distances[place, 0] = reversals[after] - s if after < count else np.inf
        distances[place, 1] = s - reversals[after - 1] if after > 0 else np.inf
