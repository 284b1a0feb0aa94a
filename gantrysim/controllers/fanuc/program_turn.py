"""Programmable mirror image, G51.1, and rotation of the coordinates, G68: what a program's place is on the work.

A place is mirrored first and turned afterwards.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field

from gantrysim.controllers.fanuc.blocks import PLANES, Plane

_EXACT = 15  # decimals of a turn, which make those of quarter turns exact


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
        self.turn = complex(round(turn.real, _EXACT), round(turn.imag, _EXACT))
        self.plane = plane
        self.centre = centre

    def end_turn(self) -> None:
        """Leave the plane as programmed."""
        self.turn = 1.0 + 0j

    def place(self, programmed: list[float]) -> list[float]:
        """Return where a programmed place lies [mm]."""
        place = [
            2 * self.mirrors[axis] - value if axis in self.mirrors else value for axis, value in enumerate(programmed)
        ]
        return self._turned(place, self.turn)

    def programmed(self, place: list[float]) -> list[float]:
        """Return the programmed place that lies at a place [mm]."""
        turned = self._turned(place, self.turn.conjugate())
        return [2 * self.mirrors[axis] - value if axis in self.mirrors else value for axis, value in enumerate(turned)]

    def _turned(self, place: list[float], turn: complex) -> list[float]:
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
