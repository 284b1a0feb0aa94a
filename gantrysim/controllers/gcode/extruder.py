"""The extruder while a program runs: what E feeds, firmware retraction, and the pressure advance in force."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from gantrysim.base.errors import InputError, at_least
from gantrysim.controllers.gcode.dialects import Firmware

_MOST_ADVANCES = 10_000  # settings of a program
_LONGEST_SMOOTHING = 0.2  # Klipper's [s]
LONGEST_ADVANCE = 10.0  # of the firmware of printers [s]
SMOOTH_TIME = 0.04  # Klipper's, where a program states none [s]


class PressureAdvance(NamedTuple):
    """Pressure advance in force.

    Attributes:
        advance: feed ahead, per speed of the filament [s].
        smooth_time: of Klipper, over which the feed is averaged [s].
        offset: of the non-linear laws: feed ahead at a high speed, on top of that [mm].
        velocity: of the non-linear laws: speed of the filament above which the offset grows no further [mm/s].
    """

    advance: float = 0.0
    smooth_time: float = 0.0
    offset: float = 0.0
    velocity: float = 1.0


@dataclass
class Retraction:
    """What G10 and G11 feed.

    Attributes:
        length: that G10 pulls back; None where the program states none [mm].
        extra: that G11 feeds on top of it [mm].
        speed: of G10; 0 for the feed in force [mm/s].
        recover_speed: of G11; 0 for the feed in force [mm/s].
        is_on: whether the filament is pulled back.
    """

    length: float | None = None
    extra: float = 0.0
    speed: float = 0.0
    recover_speed: float = 0.0
    is_on: bool = False


class Extruder:
    """The extruder of a program that runs.

    Args:
        firmware: that reads the program.
        advance: pressure advance of its configuration [s].

    Attributes:
        position: E of the program.
        is_relative: whether E is relative by M83, and in Marlin by G91.
        factor: on all that E feeds (M221).
        filament: diameter by which E is a volume, in mm³ (M200); 0 where E is a length [mm].
        retraction: what G10 and G11 feed.
        advances: pressure advances that were in force, to which moves refer by `index`.
        index: of the present one.
        sets_advance: whether the program has set one.
        is_overridden: whether G90 has ended what M83 set, as in Marlin.
        lost: words E that were read as absolute since.
    """

    def __init__(self, firmware: Firmware, advance: float = 0.0) -> None:
        self.firmware = firmware
        self.position = 0.0
        self.is_relative = False
        self.factor = 1.0
        self.filament = 0.0
        self.retraction = Retraction()
        is_averaged = advance > 0 and firmware == "klipper"
        self.advances = [PressureAdvance(advance, SMOOTH_TIME if is_averaged else 0.0)]
        self.index = 0
        self.sets_advance = False
        self.is_overridden = False
        self.lost = 0
        self._is_set = False

    def set_relative(self, relative: bool) -> None:
        """Apply M82 or M83."""
        self.is_relative = self._is_set = relative
        self.is_overridden = False

    def set_distances(self, *, absolute: bool) -> None:
        """Apply G90 or G91: in Marlin the last of them, M82 and M83 holds, elsewhere M82 and M83 are E's own."""
        if self.firmware == "marlin":
            self.is_relative = not absolute
            self.is_overridden = absolute and self._is_set

    def fed(self, e: float, unit: float, *, absolute: bool) -> float:
        """Return the length of filament that a word E feeds, and set the position [mm].

        Args:
            e: the word.
            unit: of the program's lengths [mm].
            absolute: whether coordinates are (G90); in Klipper E is relative where they are not.
        """
        is_relative = self.is_relative or (self.firmware == "klipper" and not absolute)
        self.lost += self.is_overridden
        fed = e if is_relative else e - self.position
        self.position = self.position + e if is_relative else e
        fed *= self.factor
        # a volume stays one in a program in inches
        return fed / (0.25 * math.pi * self.filament**2) if self.filament else fed * unit

    @property
    def advance(self) -> PressureAdvance:
        """The pressure advance in force."""
        return self.advances[self.index]

    def set_advance(self, **values: float) -> None:
        """Change the pressure advance, by the names of `PressureAdvance`.

        Raises:
            InputError: a value out of bounds, or too many settings.
        """
        at_least("pressure advance", values.get("advance", 0.0), 0, "s", LONGEST_ADVANCE)
        if values.get("velocity") == 0:
            raise InputError("velocity of the pressure advance = 0 mm/s: must be greater than 0 mm/s")
        if values.get("smooth_time", 0.0) > _LONGEST_SMOOTHING:
            raise InputError(
                f"SMOOTH_TIME = {values['smooth_time']:g} s: must be at most {_LONGEST_SMOOTHING:g} s, as in Klipper"
            )
        self.sets_advance = True
        changed = self.advance._replace(**values)
        if changed not in self.advances:
            if len(self.advances) >= _MOST_ADVANCES:
                raise InputError(f"more than {_MOST_ADVANCES} pressure advances")
            self.advances.append(changed)
        self.index = self.advances.index(changed)
