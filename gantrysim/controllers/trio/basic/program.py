"""A program in Trio BASIC: text in, setpoints out."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, read_only
from gantrysim.base.errors import InputError, at_least, finite, positive, whole
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.speeds import SpeedWords
from gantrysim.controllers.trio.basic import interpreter, text
from gantrysim.controllers.trio.basic.assembly import assemble_all
from gantrysim.controllers.trio.basic.buffers import MOST_AXES, MotionSettings
from gantrysim.controllers.trio.basic.files import located, with_files
from gantrysim.controllers.trio.basic.interpreter import Limits, Trace
from gantrysim.controllers.trio.basic.motion import Motion
from gantrysim.controllers.trio.basic.notes import notes_of
from gantrysim.controllers.trio.basic.path import StatedSpiral, around, exact, on_path, polyline
from gantrysim.controllers.trio.basic.process import MOST_OUTPUTS, Printed, ProgramCode, State
from gantrysim.paths.path import Path
from gantrysim.paths.spirals import Involute
from gantrysim.record.setpoints import MAX_TICKS, Setpoints

_AXES = ("x", "y", "z", "r")
_Z = 2  # column of a position

SPEEDS = SpeedWords(
    word=r"\b(?:(?:FORCE|STARTMOVE|ENDMOVE)_)?SPEED(?:[ \t]*AXIS[ \t]*\([^()\n]*\))?[ \t]*=",
    comment=r"\"[^\"\n]*\"|'[^\n]*",
    key="speed",
)
_SHORTEST = 1e-5  # SERVO_PERIOD [s]
_SLOWEST = 1.0  # longest time of a statement [s]


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
            at_least(f"interpreter_time.{name}", value, 0, "s", _SLOWEST)


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
        numbers = tuple(whole("axis_numbers", number, 0) for number in self.axis_numbers)
        if numbers and (len(set(numbers)) < len(numbers) or not 2 <= len(numbers) <= len(_AXES)):
            raise InputError(f"axis_numbers = {list(numbers)}: must be 2 to 4 different numbers, of x, y[, z[, r]]")
        if max(numbers, default=0) >= MOST_AXES:
            raise InputError(f"axis_numbers = {list(numbers)}: must be at most {MOST_AXES - 1}")
        start = tuple(finite(f"start {name}", value) for name, value in zip(_AXES, self.start, strict=False))
        if not 2 <= len(self.start) <= len(_AXES) or (numbers and len(start) > len(numbers)):
            raise InputError(f"start = {list(self.start)}: must be 2 to {len(numbers) or 4} numbers, x, y[, z[, r]]")
        object.__setattr__(self, "axis_numbers", numbers)
        object.__setattr__(self, "start", start)
        object.__setattr__(self, "inputs", tuple(whole("inputs", number, 0) for number in self.inputs))
        if whole("valve", self.valve, 0) >= MOST_OUTPUTS:
            raise InputError(f"valve = {self.valve}: must be at most {MOST_OUTPUTS - 1}")
        at_least("initial_speed", self.initial_speed, 0, "mm/s")
        if self.initial_acceleration != math.inf:
            positive("initial_acceleration", self.initial_acceleration, "mm/s²")
        if whole("buffers", self.buffers, 1) > 1024:
            raise InputError(f"buffers = {self.buffers}: must be at most 1024")
        if whole("ratio_bits", self.ratio_bits, 0) and not 8 <= self.ratio_bits <= 52:
            raise InputError(f"ratio_bits = {self.ratio_bits}: must be 8 to 52, or 0 for an exact ratio")
        at_least("wait_resolution", self.wait_resolution, 0, "s")
        at_least("servo_period", self.servo_period, _SHORTEST, "s")
        whole("statement_limit", self.statement_limit, 1)
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
        with located(self.text):
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
            with located(self.text):
                self._runs[period] = interpreter.run(self.codes, state, times, recorded, self.valve, limits)
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
        return self._requested(self._trace)

    def _points(self, trace: Trace) -> Floats:
        """The linear axes on the work, (n, 3) [mm]."""
        columns = np.zeros((3, len(trace.position)))  # as NumPy adds to short rows slowly
        count = min(len(self._numbers(trace)), 3)
        columns[:count] = trace.position.T[:count]
        return self.placement.point(columns.T)

    def _requested(self, trace: Trace) -> Path:
        if self.spiral is not None:
            return self.spiral.path(self.placement)
        stated = self._stated(trace)
        if stated is not None:
            return stated
        points = self._points(trace)
        if np.ptp(points, axis=0).max() < 1e-6:
            raise InputError("program moves none of the machine's axes x, y, z: must move one; see axis_numbers")
        return polyline(np.ascontiguousarray(points))

    def _stated(self, trace: Trace) -> Path | None:
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
        k = round(time / self.servo_period)
        return int(self.lines[k]) if 0 <= k < len(self.lines) else None

    @property
    def notes(self) -> tuple[str, ...]:
        """What the program prints, and what is ignored or assumed."""
        stated = self.spiral is not None or self._stated(self._trace) is not None
        return notes_of(self._trace.state, self.stop_after, self.valve, stated)

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        return {"text": SPEEDS.changed(self.text, change)}

    def setpoints(self, period: float) -> Setpoints:
        trace = self.trace(period)
        numbers = self._numbers(trace)
        points = self._points(trace)
        position = np.stack([*points.T[: len(numbers)], *trace.position.T[3 : len(numbers)]], axis=1)
        if len(position) < 2:
            position = np.repeat(position, 2, axis=0)
        position = read_only(position)  # which Setpoints does not copy
        requested = self.requested if period == self.servo_period else self._requested(trace)
        linear = np.zeros((len(position), 3))
        linear[:, : min(len(numbers), 3)] = position[:, : min(len(numbers), 3)]
        return Setpoints(
            period=period,
            axes=_AXES[: len(numbers)],
            position=position,
            dispense=self._dispense(trace, position),
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
