"""The base of the controllers that read G-code: text in, setpoints out."""

from __future__ import annotations

import math
import re
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import blocks, by_blocks
from gantrysim.base.errors import InputError, at_least, positive, space_point, whole_number
from gantrysim.base.memory import give_back
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.gcode.coordinate_systems import INCH
from gantrysim.controllers.gcode.dialects import Firmware, GCodeDialect
from gantrysim.controllers.gcode.extrusion import AdvanceLaw, Extrusion, extrusion_of
from gantrysim.controllers.gcode.interpret import Interpreted, interpret
from gantrysim.controllers.gcode.motion_limits import UNLIMITED, MotionLimits, PlanSettings
from gantrysim.controllers.gcode.move_table import ARC, END, FEED, FLOW, KIND, LINE, SOURCE
from gantrysim.controllers.gcode.o_words import ProgramText
from gantrysim.controllers.gcode.planned import PathPlan, plan
from gantrysim.controllers.gcode.program_state import UNSTATED_FEED, ProgramSetup
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.speeds import Stretches, with_feed_words, with_flow_words
from gantrysim.controllers.valve import Dispense, Valve, unused_set_points
from gantrysim.paths.track import Track
from gantrysim.record.setpoints import Setpoints, SetpointTable, ticks

# The needle lifted in dry moves, in the text of a program that never moves z.

_COMMENT = r"\([^)]*\)|;.*"
_HEIGHT = re.compile(r"Z|G91(?![.\d])|G17\.1|G18|G19", re.IGNORECASE)  # words with which z is not the one of the start
_RAPID = re.compile(r"\s*(N\d+\s*)?G0?0(?!\d)", re.IGNORECASE)
_FEED = re.compile(r"F\s*[0-9.]+", re.IGNORECASE)


def lifted_program(text: str, valve: Valve, start: float, height: float) -> str | None:
    """Return a program whose needle is lifted in its dry moves; None for one that sets z itself.

    The needle is lifted after the valve closes and lowered before it opens. A rapid move in the plane that lays no glue
    is one to a new place, before which the needle is lifted.

    Args:
        text: of the program.
        valve: what opens it.
        start: height of the program's start, at which it lays its bead [mm].
        height: by which the needle is lifted [mm].
    """
    bare = re.sub(_COMMENT, "", text)
    if _HEIGHT.search(bare):
        return None
    up = f"G0 Z{start + height:g}"
    down = f"G0 Z{start:g}"
    lines = []
    is_open = not valve.output
    for line in text.splitlines():
        words = re.sub(_COMMENT, "", line).upper()
        before = []
        after = []
        if _has(words, valve.off):
            after.append(up)
            is_open = False
        elif _has(words, valve.on):
            before.append(down)
            is_open = True
        is_dry = valve.at_work or not valve.output
        if is_dry and _RAPID.match(words) is not None and re.search("[XY]", words) is not None:
            # some firmware runs rapid moves at the feed
            feed = _FEED.search(words)
            before.append(f"{up} {feed[0]}" if feed else up)
            if is_open:
                after.append(down)
        lines += [*before, line, *after]
    return "\n".join(lines) + "\n"


def _has(words: str, codes: tuple[str, ...]) -> bool:
    """Return whether a line has one of the M codes, with its P."""
    patterns = [r".*?".join(rf"{word[0]}\s*0*{word[1:]}(?![.\d])" for word in code.upper().split()) for code in codes]
    return any(re.search(pattern, words) for pattern in patterns)


PER_MINUTE = 60.0
_INCHES = r"G\s*0*20(?![0-9.])"
_MILLIMETRES = r"G\s*0*21(?![0-9.])"
_FLOW_OUTPUT = re.compile(r"S|M106|M67 E\d+")
_NOTED_SLOWING = 1e-6  # share of the duration by which a cap of speeds is noted
_NOTED_CUT = 0.05  # distance of a rounded corner that is noted [mm]
_UNEVEN_EXTRUSION = 1.1  # amount of E per length, of the least, from which one section does not describe a bead


@dataclass(frozen=True)
class Library:
    """What a program finds on its machine.

    Attributes:
        subprograms: texts by name.
        tools: lengths by number [mm].
        diameters: of tools by number [mm].
        parameters: values by name.
    """

    subprograms: dict[str, str] = field(default_factory=dict)
    tools: dict[int, float] = field(default_factory=dict)
    diameters: dict[int, float] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class GCode(Controller):
    """A program of G-code; the subclasses' docstrings describe the arguments."""

    speed_scaling: ClassVar[str] = "feed_override, a factor on all feeds F; rapid moves stay"
    dialect: ClassVar[GCodeDialect]
    ramp_arguments: ClassVar[tuple[str, ...]] = ("acceleration",)

    text: str
    placement: Placement = field(default_factory=Placement)
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rapid: float = 6000.0
    acceleration: float = 1000.0
    cycle: float = 0.001
    feed_override: float = 1.0
    dispense: Dispense = field(default_factory=Dispense)
    arc_tolerance: float = 0.02828
    block_skip: bool = False
    skip_axes: str = ""
    max_steps: int = 10_000_000
    axis_speeds: tuple[float, float, float] = UNLIMITED
    flow_output: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", space_point("start", self.start))
        positive("rapid", self.rapid, "mm/min")
        positive("acceleration", self.acceleration, "mm/s²")
        positive("cycle", self.cycle, "s")
        positive("feed_override", self.feed_override)
        at_least("arc_tolerance", self.arc_tolerance, 0, "mm")
        whole_number("max_steps", self.max_steps, 1)
        if self.flow_output and not _FLOW_OUTPUT.fullmatch(self.flow_output):
            raise InputError(f'flow_output = "{self.flow_output}": must be "S", "M106", or with its number "M67 E0"')
        if len(self.axis_speeds) != 3:
            raise InputError(f"axis_speeds of {len(self.axis_speeds)} values: must be three, of x, y and z")
        for name, speed in zip("xyz", self.axis_speeds, strict=True):
            if speed != math.inf:
                positive(f"axis_speeds {name}", speed, "mm/s")
        if set(self.skip_axes) - set("ABCUVW"):
            raise InputError(f"skip_axes = {self.skip_axes!r}: must be letters of A, B, C, U, V, W")

    @property
    @abstractmethod
    def path_mode(self) -> float:
        """Initial tolerance of rounded corners, as the mode of `MoveTable` [mm]."""

    @property
    def laser(self) -> Literal["", "M4", "always"]:
        """When S in a move is the power of a laser, which changes with the motion: never, with M4, or always."""
        return ""

    @cached_property
    def program(self) -> Interpreted:
        """The moves of the text.

        Raises:
            InputError: a line that is refused.
        """
        outcome = self._outcome
        if isinstance(outcome, InputError):
            raise outcome.with_traceback(None)
        return outcome

    @cached_property
    def _outcome(self) -> Interpreted | InputError:
        """The moves, or why a line is refused: several ask, and a program may run for seconds until that line."""
        try:
            return self._interpreted_program()
        except InputError as error:
            return error.with_traceback(None)

    def _interpreted_program(self) -> Interpreted:
        library = self._library
        text = ProgramText(
            main=self.text.removeprefix("\ufeff"),
            subprograms=library.subprograms,
            max_steps=self.max_steps,
            block_skip=self.block_skip,
            firmware=self.dialect.lenient,
        )
        setup = ProgramSetup(
            dialect=self.dialect,
            dispense=self.dispense,
            arc_tolerance=self.arc_tolerance,
            path_mode=self.path_mode,
            skip_axes=self.skip_axes,
            tools=library.tools,
            diameters=library.diameters,
            parameters=library.parameters,
            upward=self.placement.upward,
            firmware=self._firmware,
            flow_output=self.flow_output,
            pressure_advance=self._pressure_advance,
            laser=self.laser,
        )
        return interpret(text, self.start, setup)

    def sharing_text_of(self, other: GCode) -> None:
        """Take over what another program with the same text and start has read of it."""
        self.__dict__["program"] = other.program

    @property
    def needed_speeds(self) -> dict[str, float]:
        """Largest speeds that the feeds ask of the axes, by name [mm/s]."""
        return dict(zip("xyz", self.plan.axis_speeds.tolist(), strict=True))

    def with_lift(self, height: float) -> dict[str, Any] | None:
        text = lifted_program(self.text, self.program.valve, self.start[2], height)
        return None if text is None else {"text": text}

    @property
    def _library(self) -> Library:
        return Library()

    @cached_property
    def plan(self) -> PathPlan:
        """The program's path and speed.

        Raises:
            InputError: a line that is refused, or a program without moves.
        """
        settings = PlanSettings(self.rapid / PER_MINUTE, self._limits, self.cycle, self.feed_override)
        program = self.program
        # what the text's lines, or the plan of another placement, took
        give_back()
        return plan(program, self.placement, settings)

    def release(self) -> None:
        """As `Controller.release`: drop the plan."""
        for name in ("plan", "extrusion"):
            self.__dict__.pop(name, None)

    @property
    def _limits(self) -> MotionLimits:
        """Limits of all moves, where the program sets none."""
        # firmware accelerates along the path, LinuxCNC each axis
        along = self.acceleration if self.dialect.extrudes else math.inf
        of_axis = math.inf if self.dialect.extrudes else self.acceleration
        return MotionLimits(
            acceleration=along, axis_speeds=self.axis_speeds, axis_accelerations=(of_axis, of_axis, of_axis)
        )

    @property
    def requested(self) -> Track:
        """The path of all moves."""
        return self.plan.requested

    @property
    def duration(self) -> float:
        return self.plan.duration

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes: x, y, and z unless everything lies at the height 0."""
        # arcs in other planes leave the height also where their ends do not
        flat = not self.requested.points[:, 2].any() and not self.requested.parameters()["plane"].any()
        return ("x", "y") if flat else ("x", "y", "z")

    @cached_property
    def _fastest(self) -> float:
        """The fastest feed with glue, or of all where none is laid: a printer's G0 has a feed, too [mm/s]."""
        moves = self.program.moves[:, KIND] <= ARC
        feeds = self.program.moves[:, FEED]
        laid = feeds[moves & self.program.glue].max(initial=0.0)
        return float(laid or feeds[moves].max(initial=0.0)) * self.feed_override

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        """As the feed override on the operator's panel does, from the fastest feed with glue."""
        fastest = self._fastest
        return {"feed_override": self.feed_override * change(fastest) / fastest} if fastest else {}

    def stretches(self, period: float) -> Stretches:
        """As `Controller.stretches`: the lines of the text, each with a word F of its own."""
        self._check_feeds()
        table = self.program.moves
        at_feed = table[(table[:, KIND] <= ARC) & (table[:, FEED] > 0)]
        speeds: dict[int, float] = {}
        # a line that runs several times is as fast as its slowest pass
        for line, feed in zip(at_feed[:, SOURCE].astype(int).tolist(), at_feed[:, FEED].tolist(), strict=True):
            speeds[line] = min(feed * self.feed_override, speeds.get(line, math.inf))
        return Stretches.of_lines(self.setpoints(period), self.lines(period), speeds)

    def with_stretch_speeds(self, speeds: Mapping[int, float]) -> dict[str, Any]:
        """As `Controller.with_stretch_speeds`: words F of the lines."""
        self._check_feeds()
        unit = INCH if re.search(_INCHES, self._bare_text) else 1.0
        feeds = {line: speed * PER_MINUTE / (unit * self.feed_override) for line, speed in speeds.items()}
        return {"text": with_feed_words(self.text, feeds, _COMMENT)}

    def with_stretch_flows(self, values: Mapping[int, float]) -> dict[str, Any]:
        """As `Controller.with_stretch_flows`: words M67 or S of the lines."""
        if not self.flow_output or self.flow_output == "M106" or self.dialect.extrudes:
            return super().with_stretch_flows(values)
        return {"text": with_flow_words(self.text, values, _COMMENT, self.flow_output)}

    @property
    def _bare_text(self) -> str:
        return re.sub(_COMMENT, "", self.text).upper()

    def _check_feeds(self) -> None:
        """Raise InputError where F is no path speed in one unit throughout the text."""
        codes = [f"G{code}" for code in (93, 95) if re.search(rf"G\s*{code}(?![0-9.])", self._bare_text)]
        if codes:
            raise InputError(f"program: has {' and '.join(codes)}, in which F is no path speed; it must be in G94")
        if re.search(_INCHES, self._bare_text) and re.search(_MILLIMETRES, self._bare_text):
            raise InputError("program: has G20 and G21, so that a word F has no one unit; it must have one of them")

    def setpoints(self, period: float) -> Setpoints:
        positive("period", period, "s")
        count = ticks(self.duration, period) + 1
        parts = (self._commands(period, block, count) for block in blocks(count))
        sent = Setpoints.of_blocks(period, self.axes, parts, count, self.requested)
        if self.extrusion is None or not self.extrusion.lateness:
            return sent
        # averages of the pressure advance end after the motion
        held = sent.hold(self.extrusion.lateness)
        late = np.arange(count, len(held.position), dtype=np.float64) * period
        assert sent.extruder is not None
        return replace(held, extruder=np.concatenate([sent.extruder, self.extrusion.advanced(late)]))

    def _commands(self, period: float, block: slice, count: int) -> SetpointTable:
        """Return the setpoints of a block out of so many."""
        time = self._times(period, block, count)
        place, dispense, progress = self.plan.at(time)
        position = np.ascontiguousarray(place[:, : len(self.axes)])
        material: dict[str, Floats] = {}
        if self.extrusion is not None:
            material["extrusion"] = self.extrusion.position(time)
            if self.extrusion.is_advanced:
                material["extruder"] = self.extrusion.advanced(time)
            self.extrusion.sampled(period, count).apply(material, dispense, block.start)
        if self.flow_output:
            material["analogue"] = self.plan.analogue(time)
        return SetpointTable(position, dispense, progress, **material)

    @cached_property
    def extrusion(self) -> Extrusion | None:
        """Position of the extruder over time; None for a program that feeds no material by E."""
        if not self.feeds_material:
            return None
        return extrusion_of(self.plan, self._advance_law)

    @property
    def feeds_material(self) -> bool:
        return self.program.feeds_material

    @property
    def _firmware(self) -> Firmware:
        """The firmware that reads the program, in a dialect that extrudes."""
        return "marlin"

    @property
    def _pressure_advance(self) -> float:
        """Pressure advance of the firmware's configuration [s]."""
        return 0.0

    @property
    def _advance_law(self) -> AdvanceLaw:
        """The law of the firmware's non-linear pressure advance."""
        return "tanh"

    def _times(self, period: float, block: slice, count: int) -> Floats:
        time = np.arange(block.start, block.stop, dtype=np.float64) * period
        if block.stop == count:
            # the last tick is up to a period after the end, and commands the end
            time[-1] = self.duration
        return time

    def lines(self, period: float) -> NDArray[np.intp]:
        """Return the line of the text that runs at every setpoint, (n,)."""
        positive("period", period, "s")
        count = ticks(self.duration, period) + 1
        return by_blocks(lambda block: self.plan.lines(self._times(period, block, count)), count)

    def line_at(self, time: float) -> int | None:
        """Return the line of the text that runs at a time [s]."""
        return int(self.lines_at(np.array([time]))[0]) or None

    def lines_at(self, times: Floats) -> NDArray[np.intp]:
        """As `Controller.lines_at`."""
        return self.plan.lines(times)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was ignored, where the path slows down, and how much material E feeds."""
        notes = [] if self._slowed is None else [self._slowed]
        if self.program.without_feed:
            notes.append(
                f"{self.program.without_feed} moves before the first F run at {UNSTATED_FEED / PER_MINUTE:g} mm/s."
            )
        notes += [
            f"#<{name}> is a feed of the machine that was not given: {UNSTATED_FEED:g} mm/min (parameters)."
            for name in self.program.assumed_feeds
        ]
        if self.program.without_diameter:
            tools = ", ".join(map(str, self.program.without_diameter))
            notes.append(
                f"Cutter compensation with tool {tools}, whose diameter was not given: 0 mm, so that the path is the "
                "programmed one (tool_diameters)."
            )
        if self.program.without_length:
            tools = ", ".join(map(str, self.program.without_length))
            notes.append(
                f"G43 with tool {tools}, whose length was not given: 0 mm, so that it shifts nothing (tool_lengths)."
            )
        if self.program.ignored:
            words = ", ".join(f"{word} ({count})" for word, count in sorted(self.program.ignored.items()))
            notes.append(f"Words without an effect on the path: {words}.")
        if self.program.valve.note:
            notes.append(self.program.valve.note)
        # of a printer S is the power of a fan
        if not self.feeds_material and not self.flow_output:
            notes += unused_set_points(self.program.unused_set_points, self.program.valve)
        corners = self.plan.corners
        if corners.stops:
            notes.append(corners.note(self._remedy))
        if corners.cut > _NOTED_CUT:
            notes.append(
                f"G64 without P cuts corners by up to {corners.cut:.3g} mm; "
                f"G64 P{_NOTED_CUT:g}, or program.corner_tolerance = {_NOTED_CUT:g}, "
                f"keeps within {_NOTED_CUT:g} mm of them."
            )
        lost = self.program.lost_relative
        if lost:
            notes.append(
                f"G90 after M83 makes E absolute, as in Marlin, and {lost} E words follow: M83 after G90, or "
                'program.firmware = "klipper" or "reprapfirmware", keeps E relative.'
            )
        return (*notes, *self._flow)

    @property
    def dryness(self) -> str:
        return self.program.valve.dryness

    @cached_property
    def _slowed(self) -> str | None:
        """A note on what the largest speeds of the axes cost; None where they cost nothing."""
        if self.axis_speeds == UNLIMITED:
            return None
        free = replace(self, axis_speeds=UNLIMITED)
        free.sharing_text_of(self)
        longer = self.duration - free.duration
        if longer <= _NOTED_SLOWING * self.duration:
            return None
        speeds = ", ".join(f"{name} {speed:g}" for name, speed in zip("xyz", self.axis_speeds, strict=True))
        return (
            f"Feeds above the machine's speed ({speeds} mm/s) are run at it: the program takes {self.duration:.4g} s, "
            f"{longer:.3g} s longer than at its feeds (axis_speeds)."
        )

    @property
    def corner_cut(self) -> float:
        return self.plan.corners.cut

    @property
    @abstractmethod
    def _remedy(self) -> str:
        """What rounds corners between lines that are not rounded, in a sentence."""

    @property
    def _flow(self) -> tuple[str, ...]:
        table = self.program.moves
        fed = self.program.glue & (table[:, FLOW] > 0)
        if not fed.any():
            return ()
        # what is pulled back and fed again counts once
        total = float(np.maximum.accumulate(np.cumsum(table[:, FLOW]))[-1])
        laid = fed & (table[:, KIND] == LINE)
        if not laid.any():
            return (f"E feeds {total:.6g} mm, none of it in lines.",)
        points = np.concatenate([[self.program.start], table[:, END : END + 3]])
        length = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
        laid &= length > 0
        # the ends of the distribution are primes and wipes, not the bead
        rates = table[laid, FLOW] / length[laid]
        # of the lines themselves: between two of them lies an amount that none has
        low, high = np.percentile(rates, (5, 95), method="nearest") if laid.any() else (0.0, 0.0)
        judged = (
            " The verdict compares all of them with one section, their median."
            if high > _UNEVEN_EXTRUSION * low
            else ""
        )
        return (f"E feeds {total:.6g} mm, {low:.3g} to {high:.3g} mm per mm of the lines (5 to 95 %).{judged}",)
