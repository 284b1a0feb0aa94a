"""A program in Trio BASIC: text in, setpoints out."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from itertools import chain
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, read_only
from gantrysim.base.errors import InputError, at_least, finite, positive, whole_number
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.speeds import SpeedWords, Stretches
from gantrysim.controllers.trio.basic import interpreter, text
from gantrysim.controllers.trio.basic.buffers import MOST_AXES, MotionSettings
from gantrysim.controllers.trio.basic.expressions import known_words
from gantrysim.controllers.trio.basic.interpreter import (
    GlueOutputs,
    Limits,
    Trace,
    set_point,
    speeds_of_moves,
    with_move_speeds,
)
from gantrysim.controllers.trio.basic.motion import Motion
from gantrysim.controllers.trio.basic.moves import Arc
from gantrysim.controllers.trio.basic.path import StatedSpiral, around, exact, on_path, polyline
from gantrysim.controllers.trio.basic.process import MOST_OUTPUTS, Printed, ProgramCode, State
from gantrysim.controllers.trio.basic.raw import ProcessAssembler, Source
from gantrysim.controllers.trio.basic.text import STATEMENTS, located_errors, with_files
from gantrysim.controllers.trio.basic.words import NOTED
from gantrysim.paths.path import Path
from gantrysim.paths.spirals import Involute
from gantrysim.record.setpoints import MAX_TICKS, Setpoints

# Notes on a run of programs: what was ignored, assumed, handled and printed.

_SHOWN = 20  # printed lines, and handled errors
_OFF_CIRCLE = 1e-3  # distance of an arc's stated end from its circle that rounding does not explain [mm]


def notes_of(state: State, stop_after: float, outputs: tuple[int, str], stated: bool) -> tuple[str, ...]:
    """Return the notes.

    Args:
        state: of the controller at the end.
        stop_after: time at which programs are stopped [s].
        outputs: number of the one that opens the valve, and the one that sets the flow.
        stated: whether the program or the job states the requested path.
    """
    notes = []
    if state.stopped:
        notes.append(
            f"stopped at {stop_after:g} s (stop_after), at line {state.stopped}: the program had not ended; its "
            "processes end there, and the axes come to rest"
        )
    notes += [remark for code in state.programs.values() for remark in code.remarks]
    notes += [*state.hasty.get(outputs[0], ()), *_off_circle(state)]
    notes += [f"{error}: the program went on at its ON BASICERROR" for error in state.handled[:_SHOWN]]
    if len(state.handled) > _SHOWN:
        notes.append(f"ON BASICERROR: {len(state.handled) - _SHOWN} more errors")
    valve, flow = outputs
    ignored = sorted(state.ignored - {flow.partition(" ")[0]})
    for reason in dict.fromkeys(NOTED[name] for name in ignored):
        names = [name for name in ignored if NOTED[name] == reason]
        notes.append(f"{', '.join(names)}: accepted without effect, {reason}")
    unused = [f"AOUT({number})" for number in sorted(state.analogue) if f"AOUT({number})" != flow]
    if unused:
        notes.append(
            f"{', '.join(unused)}: set without effect; --set 'program.flow_output=\"{unused[0]}\"' makes it the set "
            "point of the flow, with dispenser.per_output"
        )
    if valve not in state.switched:
        others = ", ".join(f"OP({output})" for output in sorted(state.switched))
        are, it = ("is", "it") if len(state.switched) == 1 else ("are", "one")
        remedy = (
            f"; {others} {are}, and --set program.valve={min(state.switched)} makes {it} the valve" if others else ""
        )
        notes.append(
            f"OP({valve}) is never switched: the dispenser is on while the axes move, but not straight up or "
            f"down{remedy}"
        )
    if not stated:
        notes.append("the moves alone do not state the axes' path: the commanded trace is the requested path")
    for line in state.printed[:_SHOWN]:
        channel = "" if line.channel is None else f"#{line.channel}"
        notes.append(f"PRINT{channel} at {line.time:.3f} s: {line.text}")
    unshown = len(state.printed) - _SHOWN + state.unlogged
    return (*notes, f"PRINT: {unshown} more lines") if unshown > 0 else tuple(notes)


def _off_circle(state: State) -> list[str]:
    """Return a note on the arcs whose stated ends do not lie on their circles, by the worst of them."""
    off = [
        (move.shape.off_circle, move)
        for move in state.motion.loaded
        if isinstance(move.shape, Arc) and move.shape.off_circle > _OFF_CIRCLE
    ]
    if not off:
        return []
    worst, move = max(off, key=lambda pair: pair[0])
    return [
        f"line {move.line}: the arc's stated end lies {worst:.4g} mm off its circle ({len(off)} such arcs): as on the "
        "controller, the stated end gives the angle alone, and the arc ends on the circle"
    ]


# A program that can be executed, from its statements as they stand in the text.

_NESTED_PROGRAMS = 8  # programs included by one another


def assemble_all(sources: Sequence[Source], strict: bool) -> list[ProgramCode]:
    """Return programs that can be executed.

    Args:
        sources: the programs.
        strict: whether a variable that no statement assigns is an error; else it reads as 0.

    Raises:
        InputError: a block without its end, an unknown label or word, a number of values that a word does not take.
    """
    by_name = {source.name: source for source in sources}
    shared = {
        str(raw.data[0])[1:-1].upper()
        for source in sources
        for raw in chain.from_iterable(source.lines)
        if raw.kind in ("constant", "global")
    }
    included = {
        str(raw.data[0])[1:-1].upper()
        for source in sources
        for raw in chain.from_iterable(source.lines)
        if raw.kind == "include"
    }
    codes = []
    for source in sources:
        assembler = ProcessAssembler(lambda target, name: _include(target, name, by_name, 1))
        _add(assembler, source)
        statements = assembler.finish()
        if strict and source.name not in included:
            _check_assigned(source, assembler.assigned | shared)
        codes.append(ProgramCode(source.name, statements, tuple(source.remarks)))
    return codes


def _include(assembler: ProcessAssembler, name: str, sources: Mapping[str, Source], depth: int) -> None:
    """Add the statements of an included program."""
    if name not in sources:
        raise InputError(
            f'INCLUDE "{name}": must be one of the programs {", ".join(sources)}, or a file {name.lower()}.bas beside '
            "the program"
        )
    if depth > _NESTED_PROGRAMS:
        raise InputError(f'INCLUDE "{name}": programs include each other more than {_NESTED_PROGRAMS} deep')
    outer = assembler.include
    assembler.include = lambda target, inner: _include(target, inner, sources, depth + 1)
    _add(assembler, sources[name])
    assembler.include = outer


def _add(assembler: ProcessAssembler, source: Source) -> None:
    for raw in chain.from_iterable(source.lines):
        try:
            STATEMENTS.handlers[raw.kind](assembler, raw)
        except InputError as error:
            text = str(error)
            raise InputError(text if text.startswith("line ") else f"line {raw.line}: {text}") from None


def _check_assigned(source: Source, assigned: set[str]) -> None:
    for name, line in source.read.items():
        if name not in assigned:
            near = get_close_matches(name, sorted(assigned.difference(known_words())), n=1, cutoff=0.6)
            hint = f", did you mean {near[0].lower()}?" if near else ""
            raise InputError(
                f"line {line}: variable {name.lower()} is assigned nowhere{hint}: it must be, or unassigned_zero = "
                "true, with which it reads as 0 as on the controller"
            )


_AXES = ("x", "y", "z", "r")
_Z = 2  # column of a position

SPEEDS = SpeedWords(
    word=r"\b(?:(?:FORCE|STARTMOVE|ENDMOVE)_)?SPEED(?:[ \t]*AXIS[ \t]*\([^()\n]*\))?[ \t]*=",
    comment=r"\"[^\"\n]*\"|'[^\n]*",
    key="speed",
)
_SHORTEST_PERIOD = 1e-5  # SERVO_PERIOD [s]
_SLOWEST_STATEMENT = 1.0  # longest time of a statement [s]


@dataclass(frozen=True)
class InterpreterTime:
    """Time that a statement takes, by its kind; no manual states it.

    Attributes:
        statement: time of any other statement [s].
        motion: time of a motion command [s].
        print: time of PRINT [s].
        wait: time of WA and WAIT, in addition to the wait itself [s].
    """

    statement: float = 1e-5
    motion: float = 1e-5
    print: float = 1e-5
    wait: float = 1e-5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            at_least(f"interpreter_time.{name}", value, 0, "s", _SLOWEST_STATEMENT)


@dataclass(frozen=True)
class Basic(Controller):
    """A program in Trio BASIC, interpreted against a motion generator of the controller's axes.

    At every servo tick the processes execute the statements that are due, then all axes move for a servo period:
    those with a move of their own by SPEED, ACCEL and DECEL, those linked to others by CONNECT, ADDAX, CAMBOX or
    MOVELINK with them in the same period. Lengths of the program are mm, whatever UNITS is.

    A text may hold several programs: each but the first begins with a line '$PROGRAM name, and is started by RUN.
    The first one starts with the controller.

    The requested path is that of the moves where MOVE, MOVEABS, MOVECIRC and MHELICAL alone move the machine's
    axes, one at a time and to their ends; else `spiral`; else the commanded trace stands for it.

    Source: Trio Motion Technology, Motion Coordinator technical reference manual, Trio BASIC commands.

    Attributes:
        text: text of the programs.
        axis_numbers: numbers of the machine's axes x, y[, z[, r]]; all other axes are virtual. By default 0 and 1, and
            2 if the program moves it, links no axis to it and does not set its ATYPE to 0.
        start: initial position of the axes x, y[, z[, r]], and their DPOS [mm, mm, mm, deg].
        valve: number of the output that opens the dispenser's valve; a program that never switches it dispenses
            while the axes move.
        flow_output: output whose value is the set point of a pump's flow, which `dispenser.per_output` multiplies:
            "AOUT(0)", "DAC AXIS(3)", "OP(8)" for 0 or 1, or "OP(8,15)" for the number of which these outputs are the
            bits; by default none.
        inputs: numbers of the inputs that are on; all others are off.
        initial_speed: SPEED of every axis until the program sets it [mm/s].
        initial_acceleration: ACCEL and DECEL of every axis until the program sets them; inf for no limit [mm/s²].
        buffers: number of moves that an axis buffers, besides the one being executed.
        ratio_bits: fractional bits of CONNECT's ratio; 0 for an exact ratio.
        wait_resolution: WA truncates its time to a multiple of this; 0 for exact waits [s].
        interpreter_time: time that each kind of statement takes.
        servo_period: SERVO_PERIOD for `duration` and `axes`; setpoints are computed at the servo's own period [s].
        unassigned_zero: whether variables that no statement assigns read as 0, as on the controller; otherwise they are
            errors.
        statement_limit: number of executed statements after which the program counts as endless.
        time_limit: simulated time after which the program counts as endless [s].
        stop_after: time at which a program that is still running is stopped, as by STOP and RAPIDSTOP; 0 for never [s].
        spiral: requested path of a program that makes a spiral with linked axes.
        placement: position of the program's origin on the work, and its turn; scale must be 1.

    Raises:
        InputError: a value out of bounds, or a program that the controller would refuse, with its line.
    """

    speed_scaling: ClassVar[str] = "numbers that the program assigns to SPEED, changed in one proportion"
    loop_words: ClassVar[str] = r"\b(?:REPEAT|WHILE|FOR)\b"
    suffixes: ClassVar[tuple[str, ...]] = (".bas",)

    text: str
    axis_numbers: tuple[int, ...] = ()
    start: tuple[float, ...] = (0.0, 0.0)
    valve: int = 8
    flow_output: str = ""
    inputs: tuple[int, ...] = ()
    initial_speed: float = 1.0
    initial_acceleration: float = 1000.0
    buffers: int = 1
    ratio_bits: int = 16
    wait_resolution: float = 0.001
    interpreter_time: InterpreterTime = field(default_factory=InterpreterTime)
    servo_period: float = 0.001
    unassigned_zero: bool = False
    statement_limit: int = 10_000_000
    time_limit: float = 3600.0
    stop_after: float = 0.0
    spiral: StatedSpiral | None = None
    placement: Placement = field(default_factory=Placement)

    def __post_init__(self) -> None:
        numbers = tuple(whole_number("axis_numbers", number, 0) for number in self.axis_numbers)
        if numbers and (len(set(numbers)) < len(numbers) or not 2 <= len(numbers) <= len(_AXES)):
            raise InputError(f"axis_numbers = {list(numbers)}: must be 2 to 4 different numbers, of x, y[, z[, r]]")
        if max(numbers, default=0) >= MOST_AXES:
            raise InputError(f"axis_numbers = {list(numbers)}: must be at most {MOST_AXES - 1}")
        start = tuple(finite(f"start {name}", value) for name, value in zip(_AXES, self.start, strict=False))
        if not 2 <= len(self.start) <= len(_AXES) or (numbers and len(start) > len(numbers)):
            wanted = ("2 numbers, x, y", "2 or 3 numbers, x, y[, z]", "2 to 4 numbers, x, y[, z[, r]]")
            raise InputError(f"start = {list(self.start)}: must be {wanted[(len(numbers) or 4) - 2]}")
        object.__setattr__(self, "axis_numbers", numbers)
        object.__setattr__(self, "start", start)
        inputs = tuple(whole_number("inputs", number, 0) for number in self.inputs)
        if max(inputs, default=0) >= MOST_OUTPUTS:
            raise InputError(f"inputs = {list(inputs)}: must be at most {MOST_OUTPUTS - 1}")
        object.__setattr__(self, "inputs", inputs)
        if whole_number("valve", self.valve, 0) >= MOST_OUTPUTS:
            raise InputError(f"valve = {self.valve}: must be at most {MOST_OUTPUTS - 1}")
        if self.flow_output:
            set_point(self.flow_output)
        at_least("initial_speed", self.initial_speed, 0, "mm/s")
        if self.initial_acceleration != math.inf:
            positive("initial_acceleration", self.initial_acceleration, "mm/s²")
        if whole_number("buffers", self.buffers, 1) > 1024:
            raise InputError(f"buffers = {self.buffers}: must be at most 1024")
        if whole_number("ratio_bits", self.ratio_bits, 0) and not 8 <= self.ratio_bits <= 52:
            raise InputError(f"ratio_bits = {self.ratio_bits}: must be 8 to 52, or 0 for an exact ratio")
        at_least("wait_resolution", self.wait_resolution, 0, "s")
        at_least("servo_period", self.servo_period, _SHORTEST_PERIOD, "s")
        whole_number("statement_limit", self.statement_limit, 1)
        positive("time_limit", self.time_limit, "s")
        at_least("stop_after", self.stop_after, 0, "s")
        if self.placement.scale != 1:
            raise InputError(
                f"placement.scale = {self.placement.scale:g}: must be 1, a program computes its lengths itself"
            )
        _ = self.codes

    @cached_property
    def codes(self) -> list[ProgramCode]:
        """The programs of the text."""
        with located_errors(self.text):
            return assemble_all(text.read(self.text), not self.unassigned_zero)

    @cached_property
    def _runs(self) -> dict[float, Trace]:
        return {}

    def trace(self, period: float) -> Trace:
        """Return a run of the programs at a servo period [s].

        Raises:
            InputError: a statement fails, or a limit is exceeded, with the line.
        """
        if period not in self._runs:
            positive("period", period, "s")
            recorded = self.axis_numbers or (0, 1, 2)
            starts = dict(zip(self.axis_numbers or range(len(_AXES)), self.start, strict=False))
            settings = MotionSettings(
                period,
                starts,
                self.initial_speed,
                self.initial_acceleration,
                self.buffers,
                self.axis_numbers or (0, 1),
                self.ratio_bits or None,
            )
            state = State(
                Motion(settings), {code.name: code for code in self.codes}, frozenset(self.inputs), self.wait_resolution
            )
            times = dict(vars(self.interpreter_time))
            limits = Limits(self.statement_limit, min(self.time_limit, MAX_TICKS * period), self.stop_after or math.inf)
            glue = GlueOutputs(self.valve, set_point(self.flow_output) if self.flow_output else None)
            with located_errors(self.text):
                self._runs[period] = interpreter.run(self.codes, state, times, recorded, glue, limits)
        return self._runs[period]

    @property
    def _trace(self) -> Trace:
        return self.trace(self.servo_period)

    def _numbers(self, trace: Trace) -> tuple[int, ...]:
        if self.axis_numbers:
            return self.axis_numbers
        motion = trace.state.motion
        z = motion.axes[2]
        return (0, 1, 2) if z.moved and z.type != 0 and 2 not in motion.drivers else (0, 1)

    @property
    def axes(self) -> tuple[str, ...]:
        return _AXES[: len(self._numbers(self._trace))]

    @property
    def duration(self) -> float:
        return (len(self._trace.position) - 1) * self.servo_period

    @cached_property
    def requested(self) -> Path:
        return self._requested_path(self._trace)

    def _points(self, trace: Trace) -> Floats:
        """The linear axes on the work, (n, 3) [mm]."""
        # as NumPy adds to short rows slowly
        columns = np.zeros((3, len(trace.position)))
        count = min(len(self._numbers(trace)), 3)
        columns[:count] = trace.position.T[:count]
        return self.placement.point(columns.T)

    def _requested_path(self, trace: Trace) -> Path:
        if self.spiral is not None:
            return self.spiral.path(self.placement)
        stated = self._stated_path(trace)
        if stated is not None:
            return stated
        points = self._points(trace)
        if np.ptp(points, axis=0).max() < 1e-6:
            raise InputError("program moves none of the machine's axes x, y, z: must move one; see axis_numbers")
        return polyline(np.ascontiguousarray(points))

    def _stated_path(self, trace: Trace) -> Path | None:
        motion = trace.state.motion
        numbers = self._numbers(trace)
        start = np.zeros(3)
        start[: min(len(numbers), 3)] = trace.position[0, : min(len(numbers), 3)]
        return exact(motion.loaded, motion.unstated, numbers, start, self.placement)

    @classmethod
    def with_files(cls, content: str, folder: pathlib.Path) -> str:
        return with_files(content, folder)

    @property
    def printed(self) -> tuple[Printed, ...]:
        """What the programs print."""
        return tuple(self._trace.state.printed)

    @property
    def lines(self) -> NDArray[np.int64]:
        """Line of the text that moves the axes, else that is executed, at every tick of `servo_period`, (n,)."""
        return self._trace.lines

    def line_at(self, time: float) -> int | None:
        """Return the line of the text at a time [s], None outside the program."""
        return int(self.lines_at(np.array([time]))[0]) or None

    def lines_at(self, times: Floats) -> NDArray[np.intp]:
        """As `Controller.lines_at`."""
        k = np.rint(times / self.servo_period)
        inside = (k >= 0) & (k < len(self.lines))
        lines = np.zeros(times.size, np.intp)
        lines[inside] = np.asarray(self.lines)[k[inside].astype(np.intp)]
        return lines

    @property
    def notes(self) -> tuple[str, ...]:
        """What the program prints, and what is ignored or assumed."""
        stated = self.spiral is not None or self._stated_path(self._trace) is not None
        return notes_of(self._trace.state, self.stop_after, (self.valve, self.flow_output), stated)

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        return {"text": SPEEDS.changed(self.text, change)}

    def stretches(self, period: float) -> Stretches:
        """As `Controller.stretches`: the lines with moves that state their path."""
        trace = self.trace(period)
        if self._stated_path(trace) is None:
            raise InputError(
                "trio.Basic: the machine's axes are linked to others, or move one by one, so that no line of the "
                "program sets the path speed of a stretch"
            )
        return Stretches.of_lines(self.setpoints(period), trace.lines.astype(np.intp), speeds_of_moves(trace))

    def with_stretch_speeds(self, speeds: Mapping[int, float]) -> dict[str, Any]:
        """As `Controller.with_stretch_speeds`: FORCE_SPEED of the moves of the lines."""
        return {"text": with_move_speeds(self.text, speeds)}

    def setpoints(self, period: float) -> Setpoints:
        trace = self.trace(period)
        numbers = self._numbers(trace)
        points = self._points(trace)
        position = np.stack([*points.T[: len(numbers)], *trace.position.T[3 : len(numbers)]], axis=1)
        if len(position) < 2:
            position = np.repeat(position, 2, axis=0)
        # which Setpoints does not copy
        position = read_only(position)
        requested = self.requested if period == self.servo_period else self._requested_path(trace)
        linear = np.zeros((len(position), 3))
        linear[:, : min(len(numbers), 3)] = position[:, : min(len(numbers), 3)]
        return Setpoints(
            period=period,
            axes=_AXES[: len(numbers)],
            position=position,
            dispense=self._dispense(trace, position),
            analogue=trace.set_points,
            requested=requested,
            progress=around(requested, linear) if isinstance(requested, Involute) else on_path(requested, linear),
        )

    def _dispense(self, trace: Trace, position: Floats) -> NDArray[np.bool_]:
        if self.valve in trace.state.switched:
            return trace.outputs
        moves = np.diff(position, axis=0) != 0
        upright = moves[:, _Z : _Z + 1].any(axis=1) & (moves.sum(axis=1) == 1)
        moving = np.flatnonzero(moves.any(axis=1) & ~upright)
        on = np.zeros(len(position), bool)
        if moving.size:
            on[moving[0] : moving[-1] + 2] = True
            on[:-1] &= ~upright
        return on
