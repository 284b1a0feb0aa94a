"""The abscissa that runs have in common: the requested path where all ask for the same one, else the time.

Two requested paths are the same where their points at the same arc length lie within `SAME_PLACE` of one another. Only
then is a place of one run a place of another, and the difference of their errors there a number of the process.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.metrics.analysis import Analysis, ErrorSize
from gantrysim.paths.path import Path

SAME_PLACE = 1e-3  # largest distance of two paths that are the same [mm]

_SAME_PLACE = 1e-6  # distance or time below which two places are one: rounding at the ends of a bead [mm or s]
_SPACING = 0.2  # of the points that are compared [mm]
_POINT_COUNTS = (500, 200_000)  # least and largest number of them


@dataclass(frozen=True)
class Parting:
    """Where a requested path leaves that of the first run.

    Attributes:
        run: number of the run, from 0.
        s: arc length up to which the paths are the same, about [mm].
        point: of the first run's path there, (x, y, z) [mm].
        lengths: of the first run's path and of this one [mm].
    """

    run: int
    s: float
    point: tuple[float, float, float]
    lengths: tuple[float, float]


def parting_of(first: Path, other: Path, number: int) -> Parting | None:
    """Return where a path leaves the first one; None where both are the same all the way."""
    common = min(first.length, other.length)
    count = int(np.clip(np.ceil(common / _SPACING), *_POINT_COUNTS)) + 1
    s = np.linspace(0.0, common, count)
    apart = np.linalg.norm(first.position(s) - other.position(s), axis=1) > SAME_PLACE
    if apart.any():
        place = float(s[max(int(apart.argmax()) - 1, 0)])
    elif abs(first.length - other.length) > SAME_PLACE:
        place = common
    else:
        return None
    x, y, z = first.position(place)[0].tolist()
    return Parting(number, place, (x, y, z), (float(first.length), float(other.length)))


def partings_of(paths: Sequence[Path]) -> tuple[Parting, ...]:
    """Return where the paths of later runs leave that of the first; empty where all are the same."""
    partings = (parting_of(paths[0], path, number) for number, path in enumerate(paths[1:], 1))
    return tuple(parting for parting in partings if parting is not None)


@dataclass(frozen=True, eq=False)
class Track:
    """A run against the common abscissa.

    Attributes:
        place: distance along the requested path [mm], or time [s], never falling, (m,).
        ticks: ticks of the run, ascending, (m,).
    """

    place: Floats
    ticks: NDArray[np.intp]

    @classmethod
    def of(cls, analysis: Analysis, by_path: bool) -> Track:
        """Return the track of a run while its dispenser is on.

        Args:
            analysis: of the run.
            by_path: whether the abscissa is the distance along the path, else the time.
        """
        if not by_path:
            return cls(analysis.run.time[analysis.ticks], analysis.ticks)
        # a nozzle that shakes moves its foot back and forth: the furthest foot so far is the place
        return cls(np.maximum.accumulate(analysis.nozzle.s), analysis.ticks)

    def at(self, places: Floats, values: Floats) -> Floats:
        """Return values between the samples of the run, linearly; NaN where it has none, (p,).

        Between two stretches of dispensing there is no value, nor before the first sample or after the last.

        Args:
            places: on the abscissa, (p,).
            values: at the samples of the run, (m,).
        """
        last = self.place.size - 1
        low = np.clip(np.searchsorted(self.place, places, side="right") - 1, 0, last)
        high = np.minimum(low + 1, last)
        step = self.place[high] - self.place[low]
        share = np.divide(places - self.place[low], step, out=np.zeros(places.size), where=step > 0)
        between = values[low] + share * (values[high] - values[low])
        exact = np.abs(places - self.place[low]) <= _SAME_PLACE
        inside = (places >= self.place[0]) & (places <= self.place[-1])
        joined = (self.ticks[high] - self.ticks[low] == 1) & inside
        return np.where(exact, values[low], np.where(joined, between, np.nan))


@dataclass(frozen=True)
class PlaceDifference(ErrorSize):
    """Difference of two runs' errors at the same places of one path [mm].

    Attributes:
        length: of the path, over which both have an error [mm].
    """

    length: float


def difference_at_places(tracks: tuple[Track, Track], errors: tuple[Floats, Floats]) -> PlaceDifference:
    """Return the difference of errors at the same places, the mean over the path's length, not over the time.

    Both are taken as straight between their samples, whose places are all that is needed: the same runs in the other
    order give the same numbers.

    Args:
        tracks: of the two runs, by the distance along the same path.
        errors: lateral and vertical, (m, 2) each [mm].
    """
    places = np.union1d(tracks[0].place, tracks[1].place)
    columns = []
    for direction in range(2):
        first, second = (track.at(places, error[:, direction]) for track, error in zip(tracks, errors, strict=True))
        columns.append(second - first)
    size = np.hypot(*columns)
    step = np.diff(places)
    known = ~np.isnan(size[1:]) & ~np.isnan(size[:-1])
    length = float(step[known].sum())
    if length <= 0:
        return PlaceDifference(np.nan, np.nan, 0.0)
    # of a straight piece from a to b the mean square is (a² + a·b + b²) / 3
    square = sum((column[:-1] ** 2 + column[:-1] * column[1:] + column[1:] ** 2)[known] / 3.0 for column in columns)
    mean = float(np.sum(square * step[known])) / length
    return PlaceDifference(float(np.sqrt(max(mean, 0.0))), float(np.nanmax(size)), length)
