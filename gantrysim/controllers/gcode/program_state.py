"""The state of a program that runs: modes, coordinate systems, valve and extruder, and the moves so far."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from gantrysim.base.errors import InputError, positive
from gantrysim.controllers.gcode.coordinate_systems import CoordinateSystems
from gantrysim.controllers.gcode.cutter_compensation import CutterCompensation
from gantrysim.controllers.gcode.dialects import Firmware, GCodeDialect
from gantrysim.controllers.gcode.extruder import Extruder
from gantrysim.controllers.gcode.motion_limits import MotionLimits, check_limit
from gantrysim.controllers.gcode.move_table import DWELL, EXACT_STOP, LINE, MoveRow, MoveTable
from gantrysim.controllers.valve import Dispense, Outputs

# The tools of a program: which one is in the spindle, and their diameters.


@dataclass
class Tools:
    """The tools of a machine that runs a program.

    Attributes:
        diameters: by number [mm].
        selected: number of the last T.
        in_spindle: number of the tool that M6 or M61 put there; 0 without.
        without_diameter: tools of cutter compensation whose diameter nobody gave.
        without_length: tools of G43 whose length nobody gave.
    """

    diameters: dict[int, float] = field(default_factory=dict)
    selected: int = 0
    in_spindle: int = 0
    without_diameter: set[int] = field(default_factory=set)
    without_length: set[int] = field(default_factory=set)

    def diameter(self, number: int) -> float:
        """Return the diameter of a tool; 0, and noted, where nobody gave it [mm]."""
        if number not in self.diameters:
            self.without_diameter.add(number)
        return self.diameters.get(number, 0.0)


def tool_number(word: str, value: float) -> int:
    """Return the number of a tool that a word states, or raise InputError where it is none."""
    if value < 0 or value != int(value):
        raise InputError(f"{word}{value:g}: must be the number of a tool")
    return int(value)


# The limits that a program of printers' firmware has set so far.

_MOST_SETTINGS = 10_000  # settings of a program, which may set them anew at every line


class LimitsInForce:
    """Limits of speed, acceleration and corners while a program runs.

    Attributes:
        rows: limits that were in force, to which moves refer by their index.
    """

    def __init__(self) -> None:
        self.rows = [MotionLimits()]
        self._numbers = {self.rows[0]: 0}
        self._now = MotionLimits()
        self._printing: float | None = None
        self._travel: float | None = None
        self._index = {True: 0, False: 0}

    @property
    def now(self) -> MotionLimits:
        """The limits in force, without the accelerations along the path."""
        return self._now

    def index(self, feeds: bool) -> int:
        """Return the index of the limits of a move that feeds material or not."""
        return self._index[feeds]

    def change(self, **values: Any) -> None:
        """Set limits by their names, as of `MotionLimits`."""
        for name, value in values.items():
            check_limit(name, value)
        self._now = self._now._replace(**values)
        self._enter()

    def accelerate(self, printing: float | None, travel: float | None) -> None:
        """Set the acceleration along the path of moves that feed material, and of others; None leaves it [mm/s²]."""
        if printing is not None:
            self._printing = positive("acceleration", printing, "mm/s²")
        if travel is not None:
            self._travel = positive("acceleration", travel, "mm/s²")
        self._enter()

    def _enter(self) -> None:
        for feeds, acceleration in ((True, self._printing), (False, self._travel)):
            limits = self._now._replace(acceleration=acceleration)
            if limits not in self._numbers and len(self.rows) < _MOST_SETTINGS:
                self._numbers[limits] = len(self.rows)
                self.rows.append(limits)
            self._index[feeds] = self._numbers.get(limits, self._index[feeds])


# A NURBS whose control points are being read.


@dataclass
class OpenCurve:
    """A NURBS whose control points are being read, as x + iy of the plane's axes.

    Attributes:
        name: code of its control points.
        order: one more than its degree.
        points: control points [mm].
        weights: of the points.
        knots: of its own.
    """

    name: str
    order: int
    points: list[complex] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)
    knots: list[float] = field(default_factory=list)

    def add(self, point: complex, weight: float) -> None:
        """Add a control point."""
        self.points.append(point)
        self.weights.append(weight)


FARTHEST_COORDINATE = 1e7  # of a coordinate [mm]
UNSTATED_FEED = 1500.0  # of printers' firmware before the first F, Klipper's [mm/min]
_STANDSTILL = 1e-6  # of a move of E alone, whose axes' words are where they are [mm]
_LOWEST_FEED = 1e-9  # by inverse time, of a move without length [mm/s]


@dataclass(frozen=True)
class ProgramSetup:
    """What a program is run with.

    Attributes:
        dialect: of the program.
        dispense: when glue is laid.
        arc_tolerance: of an arc's radius at its end [mm].
        path_mode: initial mode of corners, as of `MoveTable` [mm].
        skip_axes: letters of axes that the machine lacks, which are counted and skipped.
        tools: lengths of tools by number [mm].
        diameters: of tools by number [mm].
        parameters: values that the machine provides, by name.
        upward: sign of the program's z on the work, -1 where it is a depth.
        firmware: that reads the program, in a dialect that extrudes.
        pressure_advance: of the firmware's configuration [s].
        flow_output: word whose value is the set point of the flow, as `GCode.flow_output`.
        laser: when S in a move is the power of a laser, which changes with the motion: never, with M4, or always.
    """

    dialect: GCodeDialect
    dispense: Dispense
    arc_tolerance: float
    path_mode: float
    skip_axes: str = ""
    tools: dict[int, float] = field(default_factory=dict)
    diameters: dict[int, float] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    upward: float = 1.0
    firmware: Firmware = "marlin"
    pressure_advance: float = 0.0
    flow_output: str = ""
    laser: Literal["", "M4", "always"] = ""


@dataclass
class Modes:
    """The modes that M70 saves.

    Attributes:
        plane: index, of G17, G18, G19.
        path: mode of `MoveTable` [mm].
        naive: tolerance of merged lines [mm].
        centres: whether I, J, K are absolute (G90.1).
        feed_mode: "G93", "G94" or "G95".
        feed: F as programmed.
        spindle: S.
    """

    plane: int = 0
    path: float = math.inf
    naive: float = 0.0
    centres: bool = False
    feed_mode: str = "G94"
    feed: float = 0.0
    spindle: float = 0.0

    def blend(self, tolerance: float) -> None:
        """Round corners within a tolerance and merge lines within it; inf rounds as far as the lines reach [mm]."""
        self.path = tolerance
        self.naive = 0.0 if math.isinf(tolerance) else tolerance


@dataclass
class WordBlock:
    """A line of words that runs. Handlers take the words that they use from `values`.

    Attributes:
        values: of the letters but G and M.
        arguments: of a command of firmware, as written.
        fed: material that the block feeds [mm].
        in_machine: whether coordinates are the machine's (G53).
        keeps_words: whether the words beside M codes belong to a move, not to the codes, in a dialect that extrudes.
        ends: whether the program ends here.
    """

    values: dict[str, float] = field(default_factory=dict)
    arguments: str = ""
    fed: float = 0.0
    in_machine: bool = False
    keeps_words: bool = False
    ends: bool = False

    def drop(self, letters: str) -> None:
        """Remove words without an effect on the path."""
        for letter in letters:
            self.values.pop(letter, None)

    def argument(self, name: str) -> str | None:
        """Return an argument of a command of firmware, as in ADVANCE=0.05; None without it."""
        given = dict(word.split("=", 1) for word in self.arguments.split() if "=" in word)
        return given.get(name)

    def named_numbers(self, names: Sequence[str], least: float = -math.inf) -> dict[str, float]:
        """Return the arguments of a command of firmware that have these names, as numbers.

        Raises:
            InputError: an argument that is no number, or less than the least.
        """
        values = {}
        for name in names:
            text = self.argument(name)
            if text is None:
                continue
            try:
                values[name] = float(text)
            except ValueError:
                raise InputError(f"{name} = {text:.40}: must be a number") from None
            if not least <= values[name] < math.inf:
                raise InputError(f"{name} = {text:.40}: must be finite and at least {least:g}")
        return values


@dataclass(frozen=True)
class _Saved:
    """Modes that M70 or M73 saved."""

    modes: Modes
    unit: float
    absolute: bool


@dataclass
class CycleSeries:
    """Canned cycles one after the other.

    Attributes:
        level: coordinate across the plane before the first of them [mm].
        name: code of the last one.
        words: its words that stay in force [mm or s].
    """

    level: float
    name: str = ""
    words: dict[str, float] = field(default_factory=dict)


class ProgramState:
    """The state of a program that runs.

    Args:
        moves: to which moves are added.
        setup: what the program is run with.

    Attributes:
        frames: the coordinate systems.
        modes: the modes.
        motion: name of the code of motion in force.
        outputs: that M codes switch.
        extruder: what E feeds.
        flow_value: set point of the flow.
        unused_set_points: values of the words that might set the flow, but do not.
        spline_control: last control point of the cubic spline before, from its end, as x + iy; None after other moves.
        line: of the program's text, from 1.
        depth: of the calls of subroutines.
        ignored: words without an effect on the path, and how often they were met.
        cycle: series of canned cycles; None after other motions.
        curve: NURBS whose control points are being read.
        retracts_to_r: whether canned cycles end at R (G99).
        without_feed: moves of printers' firmware before the first F.
        assumed_feeds: names of the machine's feeds that the program reads and that nobody gave.
        limits: that the program sets.
        compensation: adds the moves, beside their paths where the program asks for it.
        tools: of the machine.
        halt_lines: lines at which the motion stops for a code that is no dwell.
        power_stops: moves before which it stops for their S.
    """

    def __init__(self, moves: MoveTable, setup: ProgramSetup) -> None:
        self.moves = moves
        self.setup = setup
        self.dialect = setup.dialect
        self.frames = CoordinateSystems(list(moves.start), tools=setup.tools)
        self.modes = Modes()
        self.modes.blend(setup.path_mode)
        if setup.dialect.extrudes:
            # printers merge no lines
            self.modes.naive = 0.0
        # LinuxCNC begins without a motion
        self.motion = "G1" if setup.dialect.extrudes else "G80"
        self.outputs = Outputs(setup.dispense, has_pins=setup.dialect.extrudes)
        self.flow_value = 0.0
        self.unused_set_points: dict[str, set[float]] = {}
        self.extruder = Extruder(setup.firmware, setup.pressure_advance)
        self.spline_control: complex | None = None
        self.cycle: CycleSeries | None = None
        self.curve: OpenCurve | None = None
        self.retracts_to_r = False
        self.line = 0
        self.depth = 0
        self.ignored: Counter[str] = Counter()
        self.without_feed = 0
        self.assumed_feeds: set[str] = set()
        self.limits = LimitsInForce()
        self.compensation = CutterCompensation(moves)
        self.tools = Tools(dict(setup.diameters))
        self.halt_lines: set[int] = set()
        self.power_stops = 0
        self._saved: dict[int, _Saved] = {}  # by the depth of calls
        # depths at whose end the saved modes come back
        self._restored: set[int] = set()

    def feed_at(self, length: float) -> float:
        """Return the path speed of a move at feed, of a length [mm], in mm/s."""
        modes = self.modes
        if modes.feed <= 0 and self.dialect.extrudes:
            self.without_feed += 1
            return UNSTATED_FEED / 60
        if modes.feed <= 0:
            raise InputError("a motion at feed must have an F above 0, in its block or before")
        # F is the inverse of the move's time [1/min]
        if modes.feed_mode == "G93":
            return max(modes.feed * length / 60, _LOWEST_FEED)
        feed = self.feed_per_minute
        if modes.feed_mode == "G95":
            if modes.spindle == 0:
                raise InputError("G95: feed per revolution must have a spindle speed S")
            return feed * abs(modes.spindle)
        return feed

    @property
    def feed_per_minute(self) -> float:
        """F as lengths per minute [mm/s]."""
        return self.modes.feed * self.frames.unit / 60

    def material_fed(self, e: float) -> float:
        """Return the material that a word E feeds, and set the extruder [mm]."""
        return self.extruder.fed(e, self.frames.unit, absolute=self.frames.absolute)

    def feed_material(self, fed: float, speed: float = 0.0) -> None:
        """Feed material at standstill, for as long as it takes at a speed, by default the feed in force [mm, mm/s]."""
        if fed:
            self.pause(abs(fed) / (speed or self.feed_at(abs(fed))), fed=fed)

    def set_flow(self, word: str, value: float) -> bool:
        """Take the value of a word as the set point of the flow, if it is that; return whether it is."""
        if word != self.setup.flow_output:
            self.unused_set_points.setdefault(word, set()).add(value)
            return False
        self.flow_value = value
        return True

    def line_to(self, end: list[float], feed: float, fed: float = 0.0, *, at_work: bool = True) -> None:
        """Add a line at feed.

        Args:
            end: in the machine's coordinates [mm].
            feed: path speed [mm/s].
            fed: material [mm].
            at_work: whether glue is laid in it, if nothing switches the valve.
        """
        self._line_to(end, feed, fed, at_work)

    def rapid_to(self, end: list[float]) -> None:
        """Add a rapid move to a place of the machine [mm]."""
        self._line_to(end, 0.0, 0.0, False)

    def add(self, move: MoveRow) -> None:
        """Add a programmed move, beside its path under cutter compensation, and go to its end."""
        self.compensation.add(move, self.frames.here)
        self.frames.here = [move.x, move.y, move.z]  # as programmed

    def take_place(self) -> None:
        """Take the nozzle's place as the programmed one: after cutter compensation it is beside that."""
        if len(self.moves):
            last = self.moves.row(len(self.moves) - 1)
            self.frames.here = [last.x, last.y, last.z]

    def _line_to(self, end: list[float], feed: float, fed: float, at_work: bool) -> None:
        x, y, z = end
        here = self.frames.here
        if fed and max(abs(x - here[0]), abs(y - here[1]), abs(z - here[2])) <= _STANDSTILL:
            # no axis moves: E does, at the feed
            self.feed_material(fed, feed)
            return
        if not (abs(x) <= FARTHEST_COORDINATE and abs(y) <= FARTHEST_COORDINATE and abs(z) <= FARTHEST_COORDINATE):
            raise InputError(f"end at {[round(v, 3) for v in end]} mm: must be within {FARTHEST_COORDINATE:g} mm")
        modes = self.modes
        limits = self.limits.index(fed > 0)
        outputs = self.outputs.index
        self.add(
            MoveRow(
                kind=LINE,
                x=x,
                y=y,
                z=z,
                feed=feed,
                mode=modes.path,
                naive=modes.naive,
                work=at_work,
                source=self.line,
                flow=fed,
                limits=limits,
                outputs=outputs,
                advance=self.extruder.index,
                analogue=self.flow_value,
            )
        )

    def pause(self, time: float, *, at_work: bool = False, fed: float = 0.0) -> None:
        """Add a dwell [s], at the bottom of a cycle that lays dots or elsewhere, in which material is fed [mm]."""
        x, y, z = self.frames.here
        outputs = self.outputs.index
        self.add(
            MoveRow(
                kind=DWELL,
                x=x,
                y=y,
                z=z,
                feed=time,
                mode=EXACT_STOP,
                work=at_work,
                source=self.line,
                flow=fed,
                outputs=outputs,
                advance=self.extruder.index,
                analogue=self.flow_value,
            )
        )

    def halt(self) -> None:
        """Come to rest, if the program moves: what follows waits for the moves before it."""
        if len(self.moves) and self.moves.row(len(self.moves) - 1).kind != DWELL:
            self.halt_lines.add(self.line)
            self.pause(0.0)

    def save_modes(self, restored: bool) -> None:
        """Save the modes, and have them come back at the subroutine's end or not."""
        self._saved[self.depth] = _Saved(replace(self.modes), self.frames.unit, self.frames.absolute)
        self._restored.discard(self.depth)
        if restored:
            self._restored.add(self.depth)

    def forget_modes(self) -> None:
        """Drop the saved modes of this subroutine."""
        self._saved.pop(self.depth, None)

    def restore_modes(self) -> None:
        """Return to the saved modes of this subroutine."""
        if self.depth not in self._saved:
            raise InputError("M72: must follow M70 or M73 in the same subroutine")
        saved = self._saved[self.depth]
        self.modes = replace(saved.modes)
        self.frames.unit = saved.unit
        self.frames.absolute = saved.absolute

    def subprogram_ends(self, depth: int) -> None:
        """Note that a subroutine ends, at the depth of its call."""
        self.depth = depth
        if depth in self._restored and depth in self._saved:
            self.restore_modes()
        self._restored.discard(depth)
        self._saved.pop(depth, None)
