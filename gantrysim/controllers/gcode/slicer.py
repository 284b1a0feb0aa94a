"""The dialect of slicers and of the firmware of 3D printers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from gantrysim.base.errors import at_least, positive, unknown
from gantrysim.controllers.gcode.dialects import (
    ADVANCE_WORDS,
    SLICER,
    Firmware,
    GCodeDialect,
    firmware_of,
    stated_filament,
)
from gantrysim.controllers.gcode.extruder import LONGEST_ADVANCE
from gantrysim.controllers.gcode.extrusion import AdvanceLaw
from gantrysim.controllers.gcode.gcode_program import GCode


@dataclass(frozen=True, kw_only=True)
class Program(GCode):
    """G-code in the dialect of slicers for 3D printers.

    G0 and G1 move at the feed F; I and J give the centre of G2 and G3. E feeds material, absolute (M82) or relative
    (M83), and G92 sets its value. Moves that feed no material are travel, without glue; in a program that feeds none at
    all, G0 is. Moves of E alone take their time at standstill. Temperatures, fans, homing and all other M and G codes
    have no effect, but are counted.

    Args:
        text: text of the program.
        placement: placement of the program on the work.
        start: initial position [mm].
        rapid: speed limit of each axis in the rapid moves of G30; an assumption [mm/min].
        acceleration: acceleration along the path where the program sets none by M204 or SET_VELOCITY_LIMIT; an
            assumption [mm/s²].
        cycle: period in which the velocity may jump at a corner that is not rounded; an assumption [s].
        feed_override: factor applied to all feeds.
        dispense: when glue is laid; by default in moves that feed material, and in a program without them as elsewhere.
        arc_tolerance: accepted difference between an arc's radius at its end and at its start; larger ones are accepted
            up to a thousandth of the radius, at most 100 times this value [mm].
        block_skip: whether lines that begin with a slash are skipped.
        skip_axes: letters of axes that the machine lacks, whose words are counted and skipped.
        max_steps: largest number of lines executed, loops included.
        flow_output: word whose value is the set point of a pump's flow, which `dispenser.per_output` multiplies: "S" of
            the spindle, "M106" (S of a fan, 255 without) or, with its number, "M67 E0" (Q of M67 and M68); by default
            none.
        axis_speeds: speed limits of x, y and z in all moves; if a job gives none and the program exceeds the machine's,
            the machine's apply [mm/s].
        corner_tolerance: largest deviation of rounded corners from the path, where the program sets no speed or
            deviation by M205 or SET_VELOCITY_LIMIT; an assumption [mm].
        firmware: that reads the program, which decides what G90, G91, M207 and M208 mean for E; "auto" for the one that
            a comment of the slicer states, or whose words the program has, else Marlin.
        pressure_advance: pressure advance of the firmware's configuration, in force until the program sets another; in
            Klipper averaged over 0.04 s [s].
        advance_law: law of the non-linear pressure advance, OFFSET and VELOCITY of SET_PRESSURE_ADVANCE, which the
            firmware's configuration states: "tanh" or "reciprocal".

    Raises:
        InputError: a line that is refused, or a parameter out of bounds.
    """

    dialect: ClassVar[GCodeDialect] = SLICER
    suffixes: ClassVar[tuple[str, ...]] = (".gcode",)
    corner_argument: ClassVar[str | None] = "corner_tolerance"

    arc_tolerance: float = 0.05
    corner_tolerance: float = 0.05
    firmware: Literal["auto", "marlin", "klipper", "reprapfirmware"] = "auto"
    pressure_advance: float = 0.0
    advance_law: AdvanceLaw = "tanh"

    def __post_init__(self) -> None:
        super().__post_init__()
        firmwares = ("auto", "marlin", "klipper", "reprapfirmware")
        if self.firmware not in firmwares:
            raise unknown("firmware", self.firmware, firmwares)
        at_least("pressure_advance", self.pressure_advance, 0, "s", LONGEST_ADVANCE)
        if self.advance_law not in ("tanh", "reciprocal"):
            raise unknown("advance_law", self.advance_law, ("tanh", "reciprocal"))
        positive("corner_tolerance", self.corner_tolerance, "mm")

    @property
    def path_mode(self) -> float:
        return self.corner_tolerance

    @property
    def _firmware(self) -> Firmware:
        return firmware_of(self.text) if self.firmware == "auto" else self.firmware

    @property
    def _pressure_advance(self) -> float:
        return self.pressure_advance

    def with_advance(self, time: float) -> dict[str, Any] | None:
        # one that the program sets overrides that of the configuration
        is_free = self.feeds_material and not self.program.sets_advance
        return {"pressure_advance": time} if is_free else None

    @property
    def advance_words(self) -> str:
        return ADVANCE_WORDS[self._firmware].format(self.pressure_advance)

    @property
    def _advance_law(self) -> AdvanceLaw:
        return self.advance_law

    @property
    def filament(self) -> float | None:
        return self.program.filament or stated_filament(self.text)

    @property
    def _remedy(self) -> str:
        return "A larger corner_tolerance passes corners faster."
