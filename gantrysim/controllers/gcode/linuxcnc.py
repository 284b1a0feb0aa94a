"""LinuxCNC's dialect of G-code."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np

from gantrysim.base.errors import InputError, finite, positive
from gantrysim.controllers.gcode.dialects import LINUXCNC, GCodeDialect
from gantrysim.controllers.gcode.gcode_program import GCode, Library
from gantrysim.controllers.gcode.interpret import Interpreted
from gantrysim.controllers.gcode.move_table import ARC, CENTRE, DWELL, END, KIND, PLANE, PLANES, SOURCE, WORK
from gantrysim.controllers.valve import SAME_PLACE

# What grbl, whose programs are read as LinuxCNC's, refuses of them.

# grbl 1.1, gcode.c: differences of the radii at an arc's ends
_GRBL_TOLERANCE = 0.005  # [mm]
_MOST_TOLERANCE = 0.5  # [mm]
_RELATIVE = 1e-3  # of the radius at the start
_MOST_LINES = 3  # that a note names
# in laser mode, where grbl changes S with the motion of its block: gcode.c, spindle speed
_LASER_MODE = re.compile(r"^\s*\$32\s*=\s*([01])\b", re.MULTILINE)
_LASER = ", and grbl's S in a move if a line $32=1, laser mode, begins the program"


def refused_by_grbl(program: Interpreted) -> tuple[str, ...]:
    """Return a note on the arcs whose ends are so far off their circles that grbl refuses them, by the worst."""
    table = program.moves
    rows = np.flatnonzero(table[:, KIND] == ARC)
    if not rows.size:
        return ()
    places = np.concatenate([[program.start], table[:, END : END + 3]])
    axes = np.array(PLANES)[table[rows, PLANE].astype(int), :2]
    centre = table[rows, CENTRE : CENTRE + 2]
    start = np.take_along_axis(places[rows], axes, axis=1)
    end = np.take_along_axis(places[rows + 1], axes, axis=1)
    radius = np.hypot(*(start - centre).T)
    off = np.abs(np.hypot(*(end - centre).T) - radius)
    refused = (off > _MOST_TOLERANCE) | ((off > _GRBL_TOLERANCE) & (off > _RELATIVE * radius))
    if not refused.any():
        return ()
    worst = int(np.where(refused, off, 0.0).argmax())
    is_one = refused.sum() == 1
    ends = "1 arc ends off its circle," if is_one else f"{refused.sum()} arcs end off their circles, at most"
    them = "it" if is_one else "them"
    return (
        f"{ends} by {off[worst]:.3g} mm in line {table[rows[worst], SOURCE]:.0f}: "
        f"run as LinuxCNC runs {them}, but grbl refuses more than {_GRBL_TOLERANCE:g} mm and {100 * _RELATIVE:g} % of "
        "the radius.",
    )


def halts_at_work(program: Interpreted) -> tuple[str, ...]:
    """Return a note on the codes between two moves at feed, not straight up or down, for which the motion stops."""
    table = program.moves
    moves = np.flatnonzero(table[:, KIND] != DWELL)
    places = np.concatenate([[program.start], table[:, END : END + 3]])
    level = np.abs(places[moves + 1, :2] - places[moves, :2]).max(axis=1, initial=0.0) > SAME_PLACE
    at_work = (table[moves, WORK] != 0) & (level | (table[moves, KIND] == ARC))
    # moves at feed with a halt, but no dwell of the program, between them
    is_dwell = table[:, KIND] == DWELL
    is_halt = is_dwell & np.isin(table[:, SOURCE], list(program.halt_lines))
    between = np.add.reduceat(is_dwell & ~is_halt, moves, dtype=int) if moves.size else moves
    halts = at_work[:-1] & at_work[1:] & (np.diff(moves) > 1) & (between[:-1] == 0)
    if not halts.any():
        return ()
    # a loop stops at the same line again and again
    lines = list(dict.fromkeys(table[moves[:-1][halts] + 1, SOURCE].astype(int).tolist()))
    named = ", ".join(map(str, lines[:_MOST_LINES])) + (", ..." if len(lines) > _MOST_LINES else "")
    times = "once" if halts.sum() == 1 else f"{halts.sum()} times"
    return (
        f"Between moves at feed, the motion stops {times} for a code (line {named}): LinuxCNC and grbl carry out M3 to "
        "M9, M64, M65, M68, another S, and changes of the origin (G43, G54 to G59, G92) at rest; LinuxCNC's M62, M63 "
        f"and M67 switch in motion{_LASER if program.power_stops else ''}.",
    )


# words that no other controller of hobby machines reads
_LINUXCNC_ALONE = re.compile(r"[#<]|\bO\s*\d|\bG\s*64", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Program(GCode):
    """A program in LinuxCNC's dialect of G-code.

    It supports lines, arcs, splines, dwells and canned cycles, coordinate systems and tool lengths, subroutines,
    branches and loops by O words, cutter compensation, numbered and named parameters, and expressions; docs/g-code.md
    lists the words. Lathe cycles, probing and motion synchronised with the spindle are refused by name.

    In G64, corners between straight moves are rounded by arcs within the tolerance P; without P, an arc takes at most
    half of each move. Lines within Q of a longer line are merged. Elsewhere the velocity may jump by acceleration x
    cycle. The tool length moves the spindle, not the nozzle's tip.

    Args:
        text: text of the program.
        placement: placement of the program on the work.
        start: initial position, also that of G28 and G30 [mm].
        rapid: speed limit of each axis in rapid moves, G0; an assumption [mm/min].
        acceleration: acceleration limit of every axis; an assumption [mm/s²].
        cycle: period of the trajectory planner, in which the velocity may jump at a corner; an assumption [s].
        feed_override: factor applied to all feeds.
        dispense: when glue is laid; by default in moves at feed, but only between the program's codes for the valve if
            it has any.
        arc_tolerance: accepted difference between an arc's radius at its end and at its start; larger ones are accepted
            up to a thousandth of the radius, at most 100 times this value; 2.54 times as much in inches [mm].
        block_skip: whether lines that begin with a slash are skipped.
        skip_axes: letters of axes that the machine lacks, such as "A", whose words are counted and skipped; by default
            they are refused.
        subprograms: texts of subroutines kept in separate files, by file name without suffix.
        tool_lengths: tool lengths by the number H, as {"1": 50.0}; 0, with a note, for other tools [mm].
        tool_diameters: tool diameters for cutter compensation by the number D, as {"1": 0.8}; 0, with a note, for other
            tools [mm].
        parameters: values of named parameters that the machine provides, as {"_hal[feed]": 900.0}.
        max_steps: largest number of lines executed, loops included.
        flow_output: word whose value is the set point of a pump's flow, which `dispenser.per_output` multiplies: "S" of
            the spindle, "M106" (S of a fan, 255 without) or, with its number, "M67 E0" (Q of M67 and M68); by default
            none.
        axis_speeds: speed limits of x, y and z in all moves; if a job gives none and the program exceeds the machine's,
            the machine's apply [mm/s].
        corner_tolerance: P of G64 where the program begins, which a machine's startup code may state, and where it has
            G64 without P; inf, as in LinuxCNC, rounds corners as far as the lines reach [mm].

    Raises:
        InputError: a line that is refused, or a parameter out of bounds.
    """

    dialect: ClassVar[GCodeDialect] = LINUXCNC
    suffixes: ClassVar[tuple[str, ...]] = (".ngc", ".nc", ".tap")
    corner_argument: ClassVar[str | None] = "corner_tolerance"

    subprograms: dict[str, str] = field(default_factory=dict)
    tool_lengths: dict[str, float] = field(default_factory=dict)
    tool_diameters: dict[str, float] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    corner_tolerance: float = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.corner_tolerance != math.inf:
            positive("corner_tolerance", self.corner_tolerance, "mm")
        for name in ("tool_lengths", "tool_diameters"):
            for number, size in getattr(self, name).items():
                if not number.isdigit():
                    raise InputError(f"{name} {number!r}: must be the number of a tool")
                finite(f"{name} {number}", size, "mm")
        for parameter, value in self.parameters.items():
            finite(f"parameters {parameter}", value)

    @property
    def called_files(self) -> frozenset[str]:
        return frozenset(name for name in self.subprograms if name.lower() in self.program.called_files)

    @property
    def _library(self) -> Library:
        return Library(
            {name.lower(): text for name, text in self.subprograms.items()},
            {int(number): length for number, length in self.tool_lengths.items()},
            {int(number): diameter for number, diameter in self.tool_diameters.items()},
            {name.strip("#<>").lower(): value for name, value in self.parameters.items()},
        )

    @property
    def path_mode(self) -> float:
        return self.corner_tolerance

    @property
    def laser(self) -> Literal["", "M4", "always"]:
        """When S in a move is the power of a laser: in grbl's laser mode, which is `$32=1`, or goes with M4."""
        stated = _LASER_MODE.findall(self.text)
        if stated:
            return "always" if stated[-1] == "1" else ""
        return "" if _LINUXCNC_ALONE.search(self.text) else "M4"

    @property
    def notes(self) -> tuple[str, ...]:
        notes = (*super().notes, *self.program.unclosed, *halts_at_work(self.program))
        if _LINUXCNC_ALONE.search(self.text):
            return notes
        return (*notes, *refused_by_grbl(self.program))

    @property
    def _remedy(self) -> str:
        return "G64 P0.05 rounds corners between lines within 0.05 mm, Q0.01 merges lines."
