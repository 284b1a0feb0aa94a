"""Coordinate systems: work offsets with a turn, G92, tool length, units; the parameters that show them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gantrysim.base.errors import InputError

Three = list[float]
_SYSTEMS = 9
INCH = 25.4  # [mm]

# first numbers of the numbered parameters that show the frames
_STORED_POSITIONS = {"G28": 5161, "G30": 5181}
_SHIFT = 5211
_SYSTEM = 5220
_OFFSETS = 5221  # 20 numbers for each system
_TURN = 9  # place of the turn among the 20
_TOOL = 5403
_POSITION = 5420


@dataclass
class CoordinateSystems:
    """The coordinate systems of a program, in millimetres and degrees.

    The nozzle's tip is at the program's coordinates plus G92, turned, plus the work offset; the tool length moves
    the spindle only.

    Attributes:
        here: position of the tip in the machine's coordinates.
        start: the first one.
        unit: of the program's lengths.
        absolute: whether coordinates are (G90).
        diameter: whether X is one (G7).
        system: number of the work offset in force.
        offsets, turns: of each system.
        shift: of G92 and G52.
        suspended_shift: the shift that G92.2 suspends and G92.3 brings back.
        tool: length in force.
        tools: lengths by number.
        stored: positions that G28.1 and G30.1 stored, by G28 and G30; those of the start before.
    """

    here: Three
    unit: float = 1.0
    absolute: bool = True
    diameter: bool = False
    system: int = 1
    offsets: list[Three] = field(default_factory=lambda: [[0.0] * 3 for _ in range(_SYSTEMS + 1)])
    turns: Three = field(default_factory=lambda: [0.0] * (_SYSTEMS + 1))
    shift: Three = field(default_factory=lambda: [0.0] * 3)
    suspended_shift: Three = field(default_factory=lambda: [0.0] * 3)
    tool: float = 0.0
    tools: dict[int, float] = field(default_factory=dict)
    stored: dict[str, Three] = field(default_factory=dict)
    start: Three = field(init=False)

    def __post_init__(self) -> None:
        self.start = list(self.here)

    def axis(self, i: int, value: float) -> float:
        """Return a word of an axis in millimetres."""
        return value * self.unit * (0.5 if self.diameter and i == 0 else 1.0)

    def machine(self, program: Three) -> Three:
        """Return a point of the program in the machine's coordinates."""
        shift = self.shift
        x = program[0] + shift[0]
        y = program[1] + shift[1]
        z = program[2] + shift[2]
        offset_x, offset_y, offset_z = self.offsets[self.system]
        turn = self.turns[self.system]
        if not turn:
            return [x + offset_x, y + offset_y, z + offset_z]
        c, s = _cosine_and_sine(turn)
        return [c * x - s * y + offset_x, s * x + c * y + offset_y, z + offset_z]

    def program(self, machine: Three, shifted: bool = True) -> Three:
        """Return a point of the machine in the program's coordinates, with or without G92."""
        offset = self.offsets[self.system]
        x = machine[0] - offset[0]
        y = machine[1] - offset[1]
        z = machine[2] - offset[2]
        turn = self.turns[self.system]
        if turn:
            c, s = _cosine_and_sine(turn)
            turned = c * y - s * x
            x = c * x + s * y
            y = turned
        if not shifted:
            return [x, y, z]
        shift = self.shift
        return [x - shift[0], y - shift[1], z - shift[2]]

    def end(self, values: dict[str, float], in_machine: bool) -> Three:
        """Take the axis words of a move and return its end in the machine's coordinates."""
        # G53 places the spindle, from which the tip hangs lower by the tool's length
        place = [self.here[0], self.here[1], self.here[2] + self.tool] if in_machine else self.program(self.here)
        is_absolute = self.absolute or in_machine
        for i, letter in enumerate("XYZ"):
            if letter in values:
                value = self.axis(i, values.pop(letter))
                place[i] = value if is_absolute else place[i] + value
        if "@" in values or "^" in values:
            self._polar(values, place)
        return [place[0], place[1], place[2] - self.tool] if in_machine else self.machine(place)

    def _polar(self, values: dict[str, float], place: Three) -> None:
        """Take the words @, distance from the origin, and ^, angle, of a place in X and Y."""
        distance = math.hypot(place[0], place[1])
        angle = math.degrees(math.atan2(place[1], place[0]))
        if "@" in values:
            word = values.pop("@") * self.unit
            distance = word if self.absolute else distance + word
        if "^" in values:
            word = values.pop("^")
            angle = word if self.absolute else angle + word
        c, s = _cosine_and_sine(angle)
        place[0] = distance * c
        place[1] = distance * s

    @property
    def system_name(self) -> str:
        """Code of the work offset in force, G54 to G59.3."""
        return f"G{53 + self.system}" if self.system <= 6 else f"G59.{self.system - 6}"

    def set_offset(self, number: float, values: dict[str, float], current: bool) -> None:
        """Set a work offset, G10 L2, or so that the current position has the given coordinates, G10 L20."""
        k = int(number) or self.system
        if not 1 <= k <= _SYSTEMS or number != int(number):
            raise InputError(f"G10 P{number:g}: must be a coordinate system, 0 to {_SYSTEMS}")
        if "R" in values:
            if current:
                raise InputError("G10 L20 with R: must not have it")
            self.turns[k] = values.pop("R")
        coordinates = {i: self.axis(i, values.pop(letter)) for i, letter in enumerate("XYZ") if letter in values}
        if not current:
            for i, value in coordinates.items():
                self.offsets[k][i] = value
            return
        # move the system by the distance from where its coordinates lie to where the tip is
        in_force = self.system
        self.system = k
        place = self.program(self.here)
        reached = self.machine([coordinates.get(i, place[i]) for i in range(3)])
        self.offsets[k] = [
            offset + here - there for offset, here, there in zip(self.offsets[k], self.here, reached, strict=True)
        ]
        self.system = in_force

    def set_shift(self, values: dict[str, float], local: bool) -> None:
        """Set the shift so that the current position has the given coordinates, G92, or as given, G52."""
        place = self.program(self.here, shifted=False)
        for i, letter in enumerate("XYZ"):
            if letter in values:
                value = self.axis(i, values.pop(letter))
                self.shift[i] = value if local else place[i] - value
        self.suspended_shift = list(self.shift)

    def shown(self, key: float | str) -> float | None:
        """Return a parameter that shows the frames; None for others."""
        return self._named_parameter(key) if isinstance(key, str) else self._numbered_parameter(int(key))

    def _named_parameter(self, key: str) -> float | None:
        if key in ("_x", "_y", "_z"):
            return self.program(self.here)["xyz".index(key[1])] / self.unit
        if key in ("_abs_x", "_abs_y", "_abs_z"):
            return self.here["xyz".index(key[5])] / self.unit
        flags = {
            "_metric": self.unit == 1.0,
            "_imperial": self.unit != 1.0,
            "_absolute": self.absolute,
            "_incremental": not self.absolute,
            "_lathe_diameter_mode": self.diameter,
            "_lathe_radius_mode": not self.diameter,
            # ten times the code, of G54 to G59 and then of G59.1 to G59.3
            "_coord_system": 540 + 10 * (self.system - 1) if self.system <= 6 else 584 + self.system,
        }
        return float(flags[key]) if key in flags else None

    def _numbered_parameter(self, number: int) -> float | None:
        if _POSITION <= number < _POSITION + 3:
            return self.program(self.here)[number - _POSITION] / self.unit
        if number == _SYSTEM:
            return float(self.system)
        if _OFFSETS <= number < _OFFSETS + 20 * _SYSTEMS:
            k, i = divmod(number - _OFFSETS, 20)
            if i < 3:
                return self.offsets[k + 1][i] / self.unit
            return self.turns[k + 1] if i == _TURN else None
        if _SHIFT <= number < _SHIFT + 3:
            return self.suspended_shift[number - _SHIFT] / self.unit
        if number == _TOOL:
            return self.tool / self.unit
        for name, first in _STORED_POSITIONS.items():
            if first <= number < first + 3:
                return self.stored.get(name, self.start)[number - first] / self.unit
        return None


def _cosine_and_sine(degrees: float) -> tuple[float, float]:
    """Rounded, so that those of quarter turns are exact."""
    angle = math.radians(degrees)
    return round(math.cos(angle), 15), round(math.sin(angle), 15)
