"""The moves of a program as a table of numbers, one row per move."""

from __future__ import annotations

import math
from array import array

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

LINE = 0.0
ARC = 1.0
DWELL = 2.0
EXACT_STOP, EXACT_PATH = -1.0, 0.0  # modes; above 0 a tolerance of rounded corners [mm]
PLANES = ((0, 1, 2), (2, 0, 1), (1, 2, 0))  # axes of the plane and its normal, of G17, G18, G19

# columns of a row
KIND = 0
END = 1
CENTRE = 4
PLANE = 6
ANGLE = 7
FEED = 8
MODE = 9
NAIVE = 10
GLUE = 11
SOURCE = 12
FLOW = 13
WIDTH = 14
_MOST = 5_000_000
_SAME = 1e-9  # relative to 1 rad


class Moves:
    """A growing table of moves.

    The columns are the kind; the end x, y, z [mm]; an arc's centre in its plane [mm]; the plane's index; the angle
    swept, counter-clockwise positive [rad]; the feed, 0 for a rapid move [mm/s], or the time of a dwell [s]; the mode
    and the tolerance of merged lines [mm]; whether glue is laid; the line; the material fed [mm].

    Args:
        start: initial position (x, y, z) [mm].
    """

    def __init__(self, start: tuple[float, float, float]) -> None:
        self.start = start
        self._numbers = array("d")

    def __len__(self) -> int:
        return len(self._numbers) // WIDTH

    def add(
        self,
        kind: float,
        end: list[float],
        feed: float,
        mode: float,
        naive: float,
        glue: bool,
        line: int,
        flow: float = 0.0,
        centre: tuple[float, float] = (0.0, 0.0),
        plane: int = 0,
        angle: float = 0.0,
    ) -> None:
        """Append a move."""
        x, y, z = end
        u, v = centre
        self._numbers.extend((kind, x, y, z, u, v, plane, angle, feed, mode, naive, glue, line, flow))
        if len(self._numbers) > _MOST * WIDTH:
            raise InputError(f"more than {_MOST} moves")

    @property
    def table(self) -> Floats:
        """The rows, (m, WIDTH)."""
        return np.frombuffer(self._numbers).reshape(-1, WIDTH)


def centre_by_radius(a: complex, b: complex, radius: float, clockwise: bool, tolerance: float) -> complex:
    """Return the centre of an arc from a to b by its radius, negative for more than half a circle."""
    chord = b - a
    if abs(chord) < 1e-9:
        raise InputError("arc by R that ends at its start: has no centre; use I, J, K")
    square = radius**2 - 0.25 * abs(chord) ** 2
    if square < 0 and 0.5 * abs(chord) - abs(radius) > tolerance:
        raise InputError(f"R = {radius:g} mm: must be at least half the chord, {0.5 * abs(chord):.6g} mm")
    # counter-clockwise, an arc of less than half a circle has its centre to the left of the chord
    side = 1.0 if (radius > 0) != clockwise else -1.0
    return a + 0.5 * chord + side * 1j * chord / abs(chord) * math.sqrt(max(square, 0.0))


def swept_angle(begin: complex, end: complex, clockwise: bool, turns: int) -> float:
    """Return the signed angle from one direction to another, a full turn if they are equal, plus more turns [rad]."""
    full = 2 * math.pi
    angle = (math.atan2(end.imag, end.real) - math.atan2(begin.imag, begin.real)) * (-1 if clockwise else 1) % full
    if angle < _SAME or full - angle < _SAME:
        angle = full
    angle += full * (turns - 1)
    return -angle if clockwise else angle
