"""The moves of a program as a table of numbers, one row per move, and when the valve is open in them."""

from __future__ import annotations

import math
from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.valve import SAME_PLACE, Motions, Outputs, Valve

# kinds
LINE = 0.0
ARC = 1.0
DWELL = 2.0
# modes of corners; above 0 a tolerance of rounded corners [mm]
EXACT_STOP = -1.0
EXACT_PATH = 0.0
PLANES = ((0, 1, 2), (2, 0, 1), (1, 2, 0))  # axes of the plane and its normal, of G17, G18, G19


class MoveRow(NamedTuple):
    """A row of the table.

    Attributes:
        kind: `LINE`, `ARC` or `DWELL`.
        x: of the end [mm].
        y: of the end [mm].
        z: of the end [mm].
        u: of an arc's centre, along the plane's first axis [mm].
        v: of an arc's centre, along the plane's second axis [mm].
        plane: its index.
        angle: swept by an arc, positive counter-clockwise [rad].
        feed: path speed, 0 for a rapid move [mm/s], or the time of a dwell [s].
        mode: of the corner at its end [mm].
        naive: tolerance of merged lines [mm].
        work: whether it is a move at feed, or a dwell at the bottom of a cycle.
        source: line of the program.
        flow: material fed [mm].
        limits: index of the limits in force.
        outputs: index of the outputs that are on, as of `Outputs`.
        advance: index of the pressure advance in force.
        analogue: set point of the flow.
    """

    kind: float
    x: float
    y: float
    z: float
    u: float = 0.0
    v: float = 0.0
    plane: float = 0
    angle: float = 0.0
    feed: float = 0.0
    mode: float = EXACT_PATH
    naive: float = 0.0
    work: float = 0.0
    source: float = 0
    flow: float = 0.0
    limits: float = 0.0
    outputs: float = 0.0
    advance: float = 0.0
    analogue: float = 0.0


# columns of the table
KIND = MoveRow._fields.index("kind")
END = MoveRow._fields.index("x")
CENTRE = MoveRow._fields.index("u")
PLANE = MoveRow._fields.index("plane")
ANGLE = MoveRow._fields.index("angle")
FEED = MoveRow._fields.index("feed")
MODE = MoveRow._fields.index("mode")
NAIVE = MoveRow._fields.index("naive")
WORK = MoveRow._fields.index("work")
SOURCE = MoveRow._fields.index("source")
FLOW = MoveRow._fields.index("flow")
LIMITS = MoveRow._fields.index("limits")
OUTPUTS = MoveRow._fields.index("outputs")
ADVANCE = MoveRow._fields.index("advance")
ANALOGUE = MoveRow._fields.index("analogue")
WIDTH = len(MoveRow._fields)
_MOST_MOVES = 5_000_000  # moves, of 144 bytes each
_SAME_ANGLE = 1e-9  # relative to 1 rad
_E_ROUNDING = 1e-6  # of sums of E [mm]


class MoveTable:
    """A growing table of moves.

    Args:
        start: initial position (x, y, z) [mm].
    """

    def __init__(self, start: tuple[float, float, float]) -> None:
        self.start = start
        self._numbers = array("d")

    def __len__(self) -> int:
        return len(self._numbers) // WIDTH

    def add(self, move: MoveRow) -> None:
        """Append a move."""
        self._numbers.extend(move)
        if len(self._numbers) > _MOST_MOVES * WIDTH:
            raise InputError(f"more than {_MOST_MOVES} moves")

    def row(self, index: int) -> MoveRow:
        """Return a move that was added."""
        return MoveRow(*self._numbers[index * WIDTH : (index + 1) * WIDTH])

    def change(self, index: int, move: MoveRow) -> None:
        """Replace a move that was added."""
        self._numbers[index * WIDTH : (index + 1) * WIDTH] = array("d", move)

    @property
    def table(self) -> Floats:
        """The rows, (m, WIDTH)."""
        return np.frombuffer(self._numbers).reshape(-1, WIDTH)


def valve_of(moves: Floats, start: tuple[float, float, float], outputs: Outputs, upward: float) -> Valve:
    """Return when the valve is open.

    Args:
        moves: rows of a `MoveTable`, (m, WIDTH).
        start: initial position [mm].
        outputs: of the program.
        upward: 1 where z rises upwards, -1 where it is a depth.
    """
    flow = moves[:, FLOW]
    # the most that the extruder has fed so far
    furthest = np.maximum.accumulate(np.maximum(np.cumsum(flow), 0.0))
    # at rest, what is fed up to where the material was pulled back undoes that, and more of it lays a dot
    leaves = np.diff(furthest, prepend=0.0) > _E_ROUNDING
    places = np.concatenate([[start], moves[:, END : END + 3]])
    ways = np.diff(places, axis=0)
    is_dwell = moves[:, KIND] == DWELL
    stands_in_plan_view = (moves[:, KIND] == LINE) & (np.abs(ways[:, :2]).max(axis=1, initial=0.0) <= SAME_PLACE)
    motions = Motions(
        work=(moves[:, WORK] != 0) & ~stands_in_plan_view,
        dwell=is_dwell & (moves[:, FEED] > 0),
        rise=upward * ways[:, 2],
        upright=stands_in_plan_view & (np.abs(ways[:, 2]) > SAME_PLACE),
        feeds=(flow > 0) & (leaves | ~is_dwell),
        is_on=lambda output: _is_on(moves, outputs, output),
    )
    return outputs.valve(motions)


def _is_on(moves: Floats, outputs: Outputs, output: str) -> NDArray[np.bool_]:
    """Whether an output is on in moves and dwells, (m,)."""
    on = np.array([output in state for state in outputs.states])
    return np.asarray(on[moves[:, OUTPUTS].astype(np.intp)])


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
    if angle < _SAME_ANGLE or full - angle < _SAME_ANGLE:
        angle = full
    angle += full * (turns - 1)
    return -angle if clockwise else angle
