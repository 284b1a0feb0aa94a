"""A program of blocks: text or values in, setpoints out."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import groupby
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, lengths
from gantrysim.base.errors import InputError, at_least, finite, positive, space_point, whole_number
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.fanuc.blocks import COMMENT, Arc, Block, Dwell, Line, Rapid, Spiral
from gantrysim.controllers.fanuc.codes import INCH
from gantrysim.controllers.fanuc.compensation import compensated_legs
from gantrysim.controllers.fanuc.corners import cornered_legs
from gantrysim.controllers.fanuc.legs import PathLeg, legs_of, placed_legs, switched_legs
from gantrysim.controllers.fanuc.modal_state import ModalState
from gantrysim.controllers.fanuc.program_text import SPEEDS, ProgramMotions, ProgramSource, SourceBlock, read
from gantrysim.controllers.fanuc.speed import PER_MINUTE, Clamp, Feeding, Part, averaged_places, in_place, stretch
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.speeds import Stretches, with_feed_words, with_flow_words
from gantrysim.controllers.valve import Dispense, Outputs, Valve, unused_set_points
from gantrysim.paths.chain import Chain
from gantrysim.paths.feet import assigned_progress
from gantrysim.paths.pieces import Vector, vector
from gantrysim.record.setpoints import Setpoints, ticks

# what of a program its text and its place alone decide
_OF_TEXT = ("_outputs", "_motions", "_valve_motions", "legs", "requested")

# Notes on a program: cutter compensation without an offset, and where the motion stops although it need not.


def notes_of(legs: Sequence[PathLeg], path: Chain, blend_time: float, acceleration: float) -> tuple[str, ...]:
    """Return the notes on the motions of a program.

    Args:
        legs: the motions.
        path: of all of them.
        blend_time: of the moving average [s].
        acceleration: of each axis [mm/s²].
    """
    moving = [leg for leg in legs if leg.piece is not None and not leg.rapid]
    idle = sum(leg.source.idle for leg in moving)
    halting = sum(leg.source.halting for leg in moving)
    zero_height = sum(leg.source.zero_height for leg in moving)
    notes = []
    if zero_height:
        notes.append(f"{zero_height} arcs with a third centre word of 0, as K0 in G17: without an effect on the path.")
    if idle:
        notes.append(
            f"{idle} motions in G41 or G42 have no D or an offset of 0: they follow the programmed path (offsets)."
        )
    if math.isinf(acceleration) and not blend_time:
        return tuple(notes)
    if halting:
        notes.append(
            f"{halting} motions in G64 stop at their end, as G05.1 Q1 or G08 P1, which the program uses, is off."
        )
    return (*notes, *(() if blend_time else _stops(legs, path, acceleration)))


def _stops(legs: Sequence[PathLeg], path: Chain, acceleration: float) -> tuple[str, ...]:
    """Return the note on corners at which motions stop, where they are too short to reach their feed or in G64."""
    lengths = np.diff(path.ends, prepend=0.0)
    pieces = iter(range(lengths.size))
    # of the path's pieces; -1 for a stop
    index = [next(pieces) if leg.piece is not None else -1 for leg in legs]
    corners = set(np.searchsorted(path.ends, path.corners - 1e-9).tolist())
    halts = [
        (leg, float(lengths[k]))
        for leg, k, after, last in zip(legs, index, legs[1:], index[1:], strict=False)
        if k in corners and last >= 0 and not (leg.rapid or after.rapid or leg.spiral or after.spiral)
        if not leg.exact_stop
    ]
    # from rest to the feed and back takes the length v^2 / a
    short = [length for leg, length in halts if length < leg.feed**2 / acceleration]
    if short:
        return (
            f"{_counted_stops(len(short))} after motions too short to reach their feed, {np.median(short):.3g} mm "
            "long at the median; blend_time = 0.05 passes without a stop.",
        )
    if any(leg.source.continuous for leg, _ in halts):
        return (f"{_counted_stops(len(halts))} in G64, as blend_time is 0; blend_time = 0.05 passes without a stop.",)
    return ()


def _counted_stops(count: int) -> str:
    return "1 stop at a corner" if count == 1 else f"{count} stops at corners"


_LONGEST_BLEND = 10.0  # [s]
_ON_THE_PATH = 1e-6  # distance from it that is rounding [mm]
_FLOW_OUTPUT = re.compile(r"S|#11(?:0\d|1[0-5]|32|33)")
_WORDS = "ABC"
_LINEAR_AXES = "xyz"


@dataclass(frozen=True)
class Program(Controller):
    """A program of lines, arcs, helices, spirals and cones, with the controller's parameters.

    A text consists of blocks, such as `N10 G17 G02 X0 Y-30 I0 J-100 Q-20 F300`, with subprograms by M98, M99 and G65,
    macro variables, IF, GOTO and WHILE; docs/g-code.md lists the words. Glue is laid in motions at feed, and only
    between the program's codes for the valve if it has any. G28 moves to `start`, but not down to its height. If the
    program uses G05.1 or G08, blocks overlap by `blend_time` only while that mode is on; elsewhere the motion stops
    between blocks.

    F is the constant speed along the path. With a limited acceleration, the motion stops before and after a spiral, at
    corners, at G61, and between rapid moves and moves at feed. With a `blend_time` it stops only at G61: a moving
    average over the commanded positions rounds the corners. They are passed at a speed that uses half of the
    acceleration; the other half is left for the motion along the blocks. (High-precision contour control; the halves
    are an assumption.)

    Source: FANUC operator's manuals B-63534EN, B-63944EN, A-78962EN.

    Args:
        program: text of the program, or blocks.
        start: initial position [mm].
        rapid: speed of rapid moves, G00 [mm/min].
        acceleration: acceleration limit of every linear axis; none by default, but 1000 for a program file [mm/s²].
        end_point_tolerance: tolerance on a spiral's radius and height at its end, parameter 3471 [mm].
        radius_tolerance: tolerance on an arc's radius at its end, parameter 3410, and on R below half the chord [mm].
        clamp: feed limit by an arc's radius, parameters 1730 to 1732; none by default.
        feed_in_space: whether F includes the height of a helix or cone; it does not by default, an assumption.
        blend_time: duration of the moving average over commanded positions, rounded to whole setpoint periods; 0 for
            none [s].
        dry_run: feed that replaces F in a dry run; none by default [mm/min].
        dry_run_from: time at which dry run is switched on [s].
        dry_run_until: time at which dry run is switched off [s].
        offsets: offsets of cutter compensation by the number D, as {"1": 3.0} [mm].
        rotary_velocity: speed limit of the rotary axis; the path slows to keep it [deg/s].
        rotary_acceleration: acceleration limit of the rotary axis; the path slows to keep it, and stops or is blended
            where the axis' rate along the path jumps. Needs a finite `acceleration` [deg/s²].
        rotary_axis: machine axis that the rotary word moves.
        rotary_word: letter of the rotary word: A, B or C.
        block_skip: whether blocks that begin with a slash are skipped.
        placement: placement of the program on the work, `start` included.
        max_steps: largest number of blocks executed, loops included.
        subprograms: texts of subprograms kept in separate files, by file name without suffix, such as O1000.
        dispense: when glue is laid in a text; by default in motions at feed, but only between the program's codes for
            the valve if it has any.
        flow_output: output whose value is the set point of a pump's flow, which `dispenser.per_output` multiplies: "S"
            of the spindle, or the variable of an interface output, "#1100" to "#1115" for one signal, 0 or 1, "#1132"
            and "#1133" for a number of 16 or 32 bits; by default none.

    Raises:
        Alarm: a block that the controller refuses, with number, title, block and line.
        InputError: a parameter out of bounds.
    """

    speed_scaling: ClassVar[str] = "the feeds F of the program, changed in one proportion; rapid moves and clamps stay"

    text_argument: ClassVar[str] = "program"
    ramp_arguments: ClassVar[tuple[str, ...]] = ("acceleration", "rotary_acceleration")
    assumed_acceleration: ClassVar[float] = 1000.0
    corner_argument: ClassVar[str | None] = "blend_time"

    program: str | tuple[Block, ...]
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rapid: float = 12000.0
    acceleration: float = math.inf
    end_point_tolerance: float = 0.01
    radius_tolerance: float = 0.01
    clamp: Clamp | None = None
    feed_in_space: bool = False
    blend_time: float = 0.0
    dry_run: float | None = None
    dry_run_from: float = 0.0
    dry_run_until: float = math.inf
    offsets: dict[str, float] = field(default_factory=dict)
    rotary_velocity: float = math.inf
    rotary_acceleration: float = math.inf
    rotary_axis: str = "r"
    rotary_word: str = "C"
    block_skip: bool = False
    placement: Placement = field(default_factory=Placement)
    max_steps: int = 1_000_000
    subprograms: dict[str, str] = field(default_factory=dict)
    dispense: Dispense = field(default_factory=Dispense)
    flow_output: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.program, str):
            object.__setattr__(self, "program", tuple(self.program))
        object.__setattr__(self, "start", space_point("start", self.start))
        positive("rapid", self.rapid, "mm/min")
        if self.acceleration != math.inf:
            positive("acceleration", self.acceleration, "mm/s²")
        at_least("end_point_tolerance", self.end_point_tolerance, 0, "mm")
        at_least("radius_tolerance", self.radius_tolerance, 0, "mm")
        at_least("blend_time", self.blend_time, 0, "s", _LONGEST_BLEND)
        if self.dry_run is not None:
            positive("dry_run", self.dry_run, "mm/min")
        at_least("dry_run_from", self.dry_run_from, 0, "s")
        if not self.dry_run_until >= self.dry_run_from:
            raise InputError(
                f"dry_run_until = {self.dry_run_until:g} s: must be at least dry_run_from, {self.dry_run_from:g} s"
            )
        for name, unit in (("rotary_velocity", "deg/s"), ("rotary_acceleration", "deg/s²")):
            if getattr(self, name) != math.inf:
                positive(name, getattr(self, name), unit)
        if math.isinf(self.acceleration) and math.isfinite(self.rotary_acceleration):
            raise InputError(
                f"rotary_acceleration = {self.rotary_acceleration:g} deg/s²: must have a finite acceleration, "
                "with which the path slows for it"
            )
        whole_number("max_steps", self.max_steps, 1)
        for number, offset in self.offsets.items():
            finite(f"offset {number}", offset, "mm")
        if self.rotary_axis in _LINEAR_AXES:
            raise InputError(f"rotary_axis = {self.rotary_axis!r}: must not be one of {', '.join(_LINEAR_AXES)}")
        if self.rotary_word not in _WORDS or len(self.rotary_word) != 1:
            raise InputError(f"rotary_word = {self.rotary_word!r}: must be one of {', '.join(_WORDS)}")
        if self.flow_output and not _FLOW_OUTPUT.fullmatch(self.flow_output):
            raise InputError(
                f'flow_output = "{self.flow_output}": must be "S", or the variable of an output, "#1100" to "#1115", '
                '"#1132" or "#1133"'
            )
        if self.flow_output and not isinstance(self.program, str):
            raise InputError(f'flow_output = "{self.flow_output}": needs a program\'s text, not blocks')
        if not any(leg.piece for leg in self.legs):
            raise InputError("program: moves none of x, y, z; must have a block that does")

    @cached_property
    def _outputs(self) -> Outputs:
        """The outputs that the text switches; complete once `legs` are read."""
        return Outputs(self.dispense)

    @cached_property
    def _motions(self) -> ProgramMotions:
        assert isinstance(self.program, str)
        source = ProgramSource(self.program, self.subprograms, self.block_skip, self.max_steps)
        state = ModalState(
            list(self.start),
            self.offsets,
            self.rotary_word,
            home=self.start,
            upward=self.placement.upward,
            outputs=self._outputs,
        )
        return read(source, state, self.flow_output)

    @property
    def called_files(self) -> frozenset[str]:
        return self._motions.called_files if isinstance(self.program, str) else frozenset()

    @cached_property
    def legs(self) -> tuple[PathLeg, ...]:
        """The motions of the blocks."""
        legs, _ = self._valve_motions
        return tuple(placed_legs(compensated_legs(cornered_legs(legs)), self.placement))

    @cached_property
    def _valve_motions(self) -> tuple[list[PathLeg], Valve | None]:
        """The motions as the text has them, with the glue that its valve lays, and the valve; None for blocks."""
        if isinstance(self.program, str):
            blocks = self._motions.blocks
        else:
            blocks = tuple(SourceBlock(f"block {k}", 0, _block(item, k)) for k, item in enumerate(self.program, 1))
        legs = legs_of(blocks, self.start, self.rapid, self.end_point_tolerance, self.radius_tolerance)
        whole_number("max_steps", self.max_steps, 1)
        if isinstance(self.program, str):
            return switched_legs(legs, self._outputs, self.placement.upward)
        return legs, None

    def sharing_text_of(self, other: Program) -> None:
        """Take over what another program with the same text, start and place has read of it, and its path."""
        if self.placement == other.placement:
            self.__dict__.update({name: other.__dict__[name] for name in _OF_TEXT if name in other.__dict__})

    @cached_property
    def requested(self) -> Chain:
        """The path of all blocks, including compensation."""
        return Chain(leg.piece for leg in self.legs if leg.piece is not None)

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes: x, y, z unless everything lies at the height 0, and the rotary one if it moves."""
        height = self.placement.point(self.start)[2]
        flat = height == 0 and all(leg.plane == "xy" and not leg.climbs for leg in self.legs)
        turns = any(leg.rotary[0] != leg.rotary[1] for leg in self.legs)
        return ("x", "y", *(() if flat else ("z",)), *((self.rotary_axis,) if turns else ()))

    @cached_property
    def _parts(self) -> tuple[Part, ...]:
        feeding = Feeding(**{item.name: getattr(self, item.name) for item in fields(Feeding)})
        parts: list[Part] = []
        here: Vector = vector(self.placement.point(self.start))
        begun = 0.0
        reached = 0.0
        for moving, group in groupby(self._with_holds(), key=lambda leg: leg.piece is not None):
            legs = list(group)
            if moving:
                group_parts = [stretch(legs, feeding, begun, reached)]
            else:
                group_parts = [in_place(leg, here, feeding, reached) for leg in legs]
            parts += group_parts
            begun += sum(part.duration for part in group_parts)
            x, y, z, _, reached = parts[-1].sample(np.array([parts[-1].duration]))[0][0].tolist()
            here = (x, y, z)
        return tuple(parts)

    def _with_holds(self) -> Iterator[PathLeg]:
        """The motions; stops are longer by the moving average, which comes to rest in them."""
        for leg in self.legs:
            yield replace(leg, dwell=leg.dwell + self.blend_time) if leg.dwell > 0 else leg
            # the moving average reaches an exact stop only where the commanded positions wait for it
            if self.blend_time > 0 and leg.exact_stop and leg.piece is not None:
                yield replace(leg, piece=None, rotary=(leg.rotary[1], leg.rotary[1]), dwell=self.blend_time)

    @property
    def duration(self) -> float:
        return sum(part.duration for part in self._parts) + self.blend_time

    def line_at(self, time: float) -> int | None:
        """Return the line of the text that runs at a time [s]; the moving average delays it by half of its time."""
        return int(self.lines_at(np.array([time]))[0]) or None

    def lines_at(self, times: Floats) -> NDArray[np.intp]:
        """As `Controller.lines_at`."""
        begun = np.concatenate([[0.0], np.cumsum([part.duration for part in self._parts])])
        time = np.clip(times - 0.5 * self.blend_time, 0.0, begun[-1])
        which = np.clip(np.searchsorted(begun, time, side="right") - 1, 0, len(self._parts) - 1)
        lines = np.zeros(time.shape, np.intp)
        for k in np.unique(which).tolist():
            chosen = which == k
            lines[chosen] = self._parts[k].lines(time[chosen] - begun[k])
        return lines

    @property
    def notes(self) -> tuple[str, ...]:
        notes = notes_of(self.legs, self.requested, self.blend_time, self.acceleration)
        legs, valve = self._valve_motions
        if valve is None:
            return notes
        of_valve = [] if valve.note is None else [valve.note]
        if not self.flow_output:
            spindle = {leg.source.flow for leg in legs if leg.dispense}
            of_valve += unused_set_points({"S": spindle, **self._motions.outputs}, valve)
        counted = sorted(self._motions.ignored.items())
        words = ", ".join(f"{word} ({count})" for word, count in counted if word not in valve.switching_codes)
        if words:
            of_valve.append(f"Words without an effect on the path: {words}.")
        return (*of_valve, *notes)

    @property
    def dryness(self) -> str:
        _, valve = self._valve_motions
        return super().dryness if valve is None else valve.dryness

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        """As the feed override on the operator's panel does: every F, and the feed of the dry run."""

        def feed(programmed: float) -> float:
            return PER_MINUTE * change(programmed / PER_MINUTE)

        changed = {"program": SPEEDS.changed(self.arguments()["program"], feed)}
        return changed if self.dry_run is None else {**changed, "dry_run": feed(self.dry_run)}

    @property
    def program_suffix(self) -> str:
        return ".nc"

    def stretches(self, period: float) -> Stretches:
        """As `Controller.stretches`: the lines of the text, each with a word F of its own."""
        if not isinstance(self.program, str):
            raise InputError("fanuc.Program: words F by place need a program's text, not blocks")
        speeds: dict[int, float] = {}
        # a line that runs several times is as fast as its slowest pass
        for leg in self.legs:
            if leg.piece is not None and not leg.rapid:
                speeds[leg.source.line] = min(leg.feed, speeds.get(leg.source.line, math.inf))
        setpoints = self.setpoints(period)
        return Stretches.of_lines(setpoints, self.lines_at(setpoints.time), speeds)

    def with_stretch_speeds(self, speeds: Mapping[int, float]) -> dict[str, Any]:
        """As `Controller.with_stretch_speeds`: words F of the lines."""
        assert isinstance(self.program, str)
        inches, millimetres = (re.search(rf"G\s*{code}(?![0-9.])", self.program) for code in (20, 21))
        if inches and millimetres:
            raise InputError("program: has G20 and G21, so that a word F has no one unit; it must have one of them")
        unit = PER_MINUTE / INCH if inches else PER_MINUTE
        feeds = {line: speed * unit for line, speed in speeds.items()}
        return {"program": with_feed_words(self.program, feeds, COMMENT)}

    def with_stretch_flows(self, values: Mapping[int, float]) -> dict[str, Any]:
        """As `Controller.with_stretch_flows`: words S of the lines; a variable needs a block of its own."""
        if self.flow_output != "S" or not isinstance(self.program, str):
            return super().with_stretch_flows(values)
        return {"program": with_flow_words(self.program, values, COMMENT, "S")}

    def setpoints(self, period: float) -> Setpoints:
        positive("period", period, "s")
        window = max(round(self.blend_time / period), 1) * period
        if self.blend_time > 0 and abs(window - self.blend_time) > 1e-9 * period:
            return replace(self, blend_time=window).setpoints(period)
        begun = np.concatenate([[0.0], np.cumsum([part.duration for part in self._parts])])
        n = ticks(float(begun[-1]), period)
        # raises where the average makes too many
        ticks(float(begun[-1]) + self.blend_time, period)
        time = np.arange(n + 1) * period
        # the last tick is up to a period after the end, and commands the end
        time[-1] = begun[-1]
        place = np.empty((n + 1, 5))
        dispense = np.zeros(n + 1, bool)
        flow = np.zeros(n + 1) if self.flow_output else None
        which = np.clip(np.searchsorted(begun, time, side="right") - 1, 0, len(self._parts) - 1)
        for k, part in enumerate(self._parts):
            chosen = which == k
            place[chosen], dispense[chosen] = part.sample(time[chosen] - begun[k])
            if flow is not None:
                flow[chosen] = part.flow(time[chosen] - begun[k])
        progress = place[:, 4]
        if self.blend_time > 0:
            count = round(self.blend_time / period)
            begin = np.concatenate([np.full(count, progress[0]), progress])
            end = np.concatenate([progress, np.full(count, progress[-1])])
            place, dispense = averaged_places(place, dispense, count)
            if flow is not None:
                # late as the valve
                flow = np.pad(flow, (count // 2, count - count // 2), "edge")
            progress = self._blended_progress(place, np.stack([begin, end]))
        columns = {"x": 0, "y": 1, "z": 2, self.rotary_axis: 3}
        position = place[:, [columns[name] for name in self.axes]]
        progress = np.maximum.accumulate(np.clip(progress, 0.0, self.requested.length))  # of rounding
        return Setpoints(period, self.axes, position, dispense, self.requested, progress=progress, analogue=flow)

    def _blended_progress(self, place: Floats, averaged_over: Floats) -> Floats:
        """Return the progress of a moving average: where it leaves the path, that of a place that was averaged, (n,).

        Args:
            place: averages, as of `Part.sample`, (n, 5).
            averaged_over: progress at the begin and the end of what was averaged, (2, n) [mm].
        """
        mean = np.clip(place[:, 4], 0.0, self.requested.length)
        leaves = np.flatnonzero(lengths(self.requested.position(mean) - place[:, :3]) > _ON_THE_PATH)
        if leaves.size:
            mean[leaves] = assigned_progress(self.requested, place[leaves, :3], averaged_over[:, leaves])
        return mean


def _block(item: object, k: int) -> Block:
    if not isinstance(item, Rapid | Line | Arc | Spiral | Dwell):
        raise InputError(f"block {k} = {item!r}: must be a Rapid, Line, Arc, Spiral or Dwell")
    return item
