"""The modal state of a program of blocks: what is in force from block to block."""

from __future__ import annotations

import cmath
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from gantrysim.controllers.fanuc.blocks import PLANES, Plane, Words
from gantrysim.controllers.valve import Dispense, Outputs
from gantrysim.paths.pieces import Vector

# Programmable mirror image, G51.1, and rotation of the coordinates, G68: what a program's place is on the work.
#
# A place is mirrored first and turned afterwards.

_TURN_DECIMALS = 15  # decimals of a turn, which make those of quarter turns exact


@dataclass
class ProgramTurn:
    """The mirror image and the turn in force.

    Attributes:
        mirrors: places of the mirrors, by the axis that they mirror [mm].
        plane: in which the program is turned.
        centre: of the turn, as x + iy of the plane's axes [mm].
        turn: unit number by which the plane is multiplied; 1 without a turn.
    """

    mirrors: dict[int, float] = field(default_factory=dict)
    plane: Plane = "xy"
    centre: complex = 0j
    turn: complex = 1.0 + 0j

    @property
    def is_plain(self) -> bool:
        """Whether places are as programmed."""
        return self.turn == 1 and not self.mirrors

    def turn_by(self, degrees: float, plane: Plane, centre: complex) -> None:
        """Turn the plane about a centre, counter-clockwise."""
        turn = cmath.rect(1.0, math.radians(degrees))
        self.turn = complex(round(turn.real, _TURN_DECIMALS), round(turn.imag, _TURN_DECIMALS))
        self.plane = plane
        self.centre = centre

    def end_turn(self) -> None:
        """Leave the plane as programmed."""
        self.turn = 1.0 + 0j

    def turned_point(self, programmed: list[float]) -> list[float]:
        """Return where a programmed place lies [mm]."""
        place = [
            2 * self.mirrors[axis] - value if axis in self.mirrors else value for axis, value in enumerate(programmed)
        ]
        return self._turn_point(place, self.turn)

    def programmed_point(self, place: list[float]) -> list[float]:
        """Return the programmed place that lies at a place [mm]."""
        turned = self._turn_point(place, self.turn.conjugate())
        return [2 * self.mirrors[axis] - value if axis in self.mirrors else value for axis, value in enumerate(turned)]

    def _turn_point(self, place: list[float], turn: complex) -> list[float]:
        first, second, _ = PLANES[self.plane]
        turned = list(place)
        arm = self.centre + turn * (complex(place[first], place[second]) - self.centre)
        turned[first] = arm.real
        turned[second] = arm.imag
        return turned

    def direction(self, programmed: complex, plane: Plane) -> complex:
        """Return a displacement in the plane of an arc, as x + iy of its axes [mm]."""
        first, second, _ = PLANES[plane]
        mirrored = complex(self.sign(first) * programmed.real, self.sign(second) * programmed.imag)
        return self.turn * mirrored if plane == self.plane else mirrored

    def sign(self, axis: int) -> float:
        """Return -1 for an axis that is mirrored, 1 for others."""
        return -1.0 if axis in self.mirrors else 1.0

    def sense(self, plane: Plane) -> float:
        """Return -1 where the mirror image exchanges left and right in a plane, 1 elsewhere."""
        first, second, _ = PLANES[plane]
        return self.sign(first) * self.sign(second)

    def covers(self, axis: int) -> bool:
        """Whether the turn moves an axis."""
        return self.turn != 1 and axis in PLANES[self.plane][:2]


ENDS = "XYZ"
SYSTEMS = 6  # coordinate systems of G54 to G59


@dataclass
class ModalState:
    """The modal state.

    Attributes:
        here: end of the block before, in the machine's coordinates [mm].
        offsets: cutter compensation by its number D [mm].
        rotary: letter of the rotary axis.
        home: position of G28 [mm].
        upward: sign of the program's z on the work, -1 where it is a depth.
        system: index of the coordinate system in force.
        systems: zero of each coordinate system [mm].
        shift: of G52 and G92 [mm].
        turn: mirror image and rotation of the program.
        contoured: whether the program switches the look-ahead, by G05.1 or G08.
        look_ahead: whether it is on.
        angle: of the rotary axis [deg].
        motion: name of the code of motion in force.
        plane: of arcs and of the compensation.
        absolute: whether ends are (G90).
        unit: of lengths [mm].
        side: of the cutter compensation: 1 left, -1 right, 0 off.
        offset: of the cutter compensation [mm].
        offset_number: D, its number.
        exact_stop: whether motions stop at their ends (G61).
        continuous: whether the program asks for G64.
        in_machine: whether the coordinates of this block are the machine's (G53).
        feed: F; None before the first [mm/min].
        spindle: S.
        outputs: that M codes switch.
        zero_height: whether the block's arc has a height per turn of 0, as K0 in G17.
        ignored: words without an effect on the path, and how often they were met.
    """

    here: list[float]
    offsets: Mapping[str, float]
    rotary: str
    home: Vector
    upward: float = 1.0
    system: int = 0
    systems: list[list[float]] = field(default_factory=lambda: [[0.0] * 3 for _ in range(SYSTEMS)])
    shift: list[float] = field(default_factory=lambda: [0.0] * 3)
    turn: ProgramTurn = field(default_factory=ProgramTurn)
    contoured: bool = False
    look_ahead: bool = False
    angle: float = 0.0
    motion: str = "G00"
    plane: Plane = "xy"
    absolute: bool = True
    unit: float = 1.0
    side: int = 0
    offset: float = 0.0
    offset_number: str = "0"
    exact_stop: bool = False
    continuous: bool = False
    in_machine: bool = False
    feed: float | None = None
    spindle: float = 0.0
    outputs: Outputs = field(default_factory=lambda: Outputs(Dispense()))
    zero_height: bool = False
    ignored: Counter[str] = field(default_factory=Counter)

    @property
    def idle(self) -> bool:
        """Whether cutter compensation is on without an offset."""
        return self.side != 0 and self.offset == 0

    @property
    def halting(self) -> bool:
        """Whether motions stop at their ends although G61 is off."""
        return self.contoured and not self.look_ahead and not self.exact_stop

    def controller_variable(self, key: float | str) -> float | None:
        """Return a variable of the controller, as the position at the end of the block before; None for others."""
        if isinstance(key, str):
            return None
        if 5001 <= key <= 5003:
            return self.turn.programmed_point(self.program_place)[int(key) - 5001] / self.unit
        if 5041 <= key <= 5043:
            return self.here[int(key) - 5041] / self.unit
        return None

    def zero(self, axis: int) -> float:
        """Return the position of the program's zero [mm]."""
        return self.systems[self.system][axis] + self.shift[axis]

    @property
    def program_place(self) -> list[float]:
        """Position from the program's zero [mm]."""
        return [here - self.zero(axis) for axis, here in enumerate(self.here)]

    def ends(self, values: list[float | None]) -> list[float | None]:
        """Return where the words X, Y and Z of a block lead [mm]; None for an axis that stays."""
        if self.turn.is_plain:
            return [self.end(value, axis) for axis, value in enumerate(values)]
        place = self.turn.programmed_point(self.program_place)
        for axis, value in enumerate(values):
            if value is not None:
                place[axis] = value if self.absolute else place[axis] + value
        moves = [value is not None for value in values]
        turns = any(moved and self.turn.covers(axis) for axis, moved in enumerate(moves))
        return [
            value + self.zero(axis) if moves[axis] or (turns and self.turn.covers(axis)) else None
            for axis, value in enumerate(self.turn.turned_point(place))
        ]

    def end(self, value: float | None, axis: int) -> float | None:
        """Return where a word of an axis leads [mm]; None without one."""
        if value is None:
            return None
        return value + (self.zero(axis) if self.absolute else self.here[axis])

    def required_feed(self, words: Words) -> float:
        """Return F, or raise the alarm of a block without one."""
        if self.feed is None:
            raise words.fail(11, "a motion at feed must have an F, in its block or before")
        return self.feed
