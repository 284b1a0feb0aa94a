"""Stretches of a program's path to which it can give a speed of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.record.setpoints import Setpoints


@dataclass(frozen=True)
class Stretches:
    """Consecutive stretches of a program's requested path.

    Attributes:
        ends: arc length of the requested path at which each stretch ends, ascending, (m,) [mm].
        places: where the program states the speed of each: a line of its text, or a number of its own, (m,).
        speeds: programmed path speed of each, 0 where no speed is stated, as for a rapid move, (m,) [mm/s].
    """

    ends: Floats
    places: NDArray[np.intp]
    speeds: Floats

    @classmethod
    def of(cls, lengths: Sequence[float], places: Sequence[int], speeds: Sequence[float]) -> Stretches:
        """Return stretches of some lengths [mm]."""
        return cls(np.cumsum(np.asarray(lengths, float)), np.array(places, np.intp), np.array(speeds, float))

    @classmethod
    def of_lines(cls, setpoints: Setpoints, lines: NDArray[np.intp], speeds: Mapping[int, float]) -> Stretches:
        """Return the stretches along which the lines of a text are active.

        Args:
            setpoints: of the program, with their progress.
            lines: active at every setpoint, (n,).
            speeds: stated path speeds by line [mm/s].
        """
        assert setpoints.progress is not None
        last = np.flatnonzero(np.append(np.diff(lines) != 0, True))
        ends = np.maximum.accumulate(setpoints.progress)[last]
        ends[-1:] = setpoints.requested.length
        places = lines[last]
        return cls(ends, places, np.array([speeds.get(line, 0.0) for line in places.tolist()]))

    def at(self, s: Floats) -> NDArray[np.intp]:
        """Return the index of the stretch at arc lengths of the requested path, (n,)."""
        return np.minimum(np.searchsorted(self.ends, s), self.ends.size - 1)

    @property
    def lengths(self) -> Floats:
        """Lengths of the stretches, (m,) [mm]."""
        return np.diff(self.ends, prepend=0.0)
