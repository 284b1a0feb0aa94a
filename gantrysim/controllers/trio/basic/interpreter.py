"""Programs run against the motion generator, servo period by servo period, with their outputs and the moves' speeds."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.tasks import Scheduler, StatementClock
from gantrysim.controllers.trio.basic.buffers import MOST_AXES, Axis
from gantrysim.controllers.trio.basic.process import MOST_ANALOGUE, MOST_OUTPUTS, ProgramCode, State
from gantrysim.controllers.trio.basic.words import MOST_BITS

RECORDED = 4  # axes 0 to 3 can be those of the machine without being named
_PASSED_PERIODS = 1000  # servo periods passed at once
_LONGEST_WAIT = 300.0  # for a condition, with all axes at rest [s]

SetPoint = Callable[[State], float]

_WORD = re.compile(r"(AOUT|DAC AXIS|OP)\((\d{1,4})(?:,(\d{1,4}))?\)")

_MOVE = re.compile(r"\b(MOVEABS|MOVECIRC|MOVE|MHELICAL)(?:SP)?(?=[ \t]*\()", re.IGNORECASE)
_TEXT_OR_COMMENT = re.compile(r"(\"[^\"\n]*\"|'[^\n]*)")
_DIGITS = 8  # of a speed


@dataclass(frozen=True)
class Trace:
    """What a run of the programs made.

    Attributes:
        period: servo period [s].
        position: of the recorded axes at every servo tick, (n, recorded) [units].
        outputs: whether the valve's output was on at them, (n,).
        set_points: of the flow, by an output, at them, (n,); None without.
        lines: of the text, of the move that runs then, else of the first process, (n,).
        state: of the controller at the end.
    """

    period: float
    position: Floats
    outputs: NDArray[np.bool_]
    set_points: Floats | None
    lines: NDArray[np.int64]
    state: State


@dataclass(frozen=True)
class GlueOutputs:
    """The outputs that lay glue.

    Attributes:
        valve: number of the one that opens the valve.
        set_point: reads the set point of the flow; None without.
    """

    valve: int
    set_point: SetPoint | None = None

    def values(self, state: State) -> tuple[float, float]:
        """Return whether the valve is open, and the set point."""
        return float(self.valve in state.outputs), 0.0 if self.set_point is None else self.set_point(state)


@dataclass(frozen=True)
class Limits:
    """Bounds of a run.

    Attributes:
        statements: executed.
        time: simulated [s].
        stop_after: time at which the processes are stopped and the axes brought to rest, inf for never [s].
    """

    statements: int
    time: float
    stop_after: float = math.inf


def run(
    codes: list[ProgramCode],
    state: State,
    times: dict[str, float],
    recorded: tuple[int, ...],
    glue: GlueOutputs,
    limits: Limits,
) -> Trace:
    """Run the first program, and those that it starts, until all have ended and the axes rest.

    At every servo tick the processes execute their statements that are due; what they command takes effect at that
    tick. A statement takes the time of its kind, after which the next one is due.

    Raises:
        InputError: a statement fails, with its line, or a limit is exceeded.
    """
    return _Run(state, times, recorded, glue, limits).run(codes[0].name)


class _Run:
    def __init__(
        self, state: State, times: dict[str, float], recorded: tuple[int, ...], glue: GlueOutputs, limits: Limits
    ) -> None:
        refusal = f"more than {limits.statements} statements are executed: must be fewer, or raise statement_limit"
        self._state = state
        self._clock = StatementClock(times, limits.statements, refusal)
        self._scheduler = Scheduler(self._clock, state.motion.period)
        self._limits = limits
        self._recorded = recorded
        self._glue = glue

    def run(self, name: str) -> Trace:
        state = self._state
        motion = self._state.motion
        positions = array("d")
        outputs = array("d")
        lines = array("q")
        # of ticks for which outputs and line stay the same
        counts = array("q")
        axes = [motion.axis(number) for number in self._recorded]
        state.run(name, 0.0)
        most = math.ceil(self._limits.time / motion.period)
        last = math.inf if math.isinf(self._limits.stop_after) else round(self._limits.stop_after / motion.period)
        resting_since = 0
        while True:
            count = self._clock.count
            if state.tick >= last and not state.stopped:
                self._stop()
            for process in state.processes:  # which they may add to
                self._scheduler.execute(process, state.tick)
            # after a statement, what another process waits for may have come about already
            is_settled = self._clock.count == count or len(state.processes) == 1
            state.processes = [process for process in state.processes if not process.ended]
            positions.extend([axis.position for axis in axes])
            outputs.extend(self._glue.values(state))
            lines.append(self._active_line(axes))
            counts.append(1)
            if not state.processes and motion.resting(self._recorded):
                break
            if state.tick >= most:
                raise self._endless(lines[-1], axes)
            waits = is_settled and all(process.polls and process.blocked is not None for process in state.processes)
            if not (waits and motion.resting(self._recorded)):
                resting_since = state.tick
            elif (state.tick - resting_since) * motion.period > _LONGEST_WAIT:
                raise InputError(
                    f"line {lines[-1]}: waits for {_LONGEST_WAIT:g} s while nothing moves: what it waits for must come "
                    "about"
                )
            ahead = self._free_periods(most if state.stopped else min(most, last)) if is_settled else 1
            passed = motion.glide(ahead, self._recorded)
            state.tick += len(passed)
            if len(passed) < ahead:
                motion.step()
                state.tick += 1
            else:
                passed = passed[:-1]
            if len(passed):
                positions.frombytes(passed.tobytes())
                counts[-1] += len(passed)
        # they refer to the state: a cycle, which only the garbage collector would free
        state.latest.clear()
        position = np.frombuffer(positions, float).reshape(-1, len(axes))
        is_on, flow = np.frombuffer(outputs, float).reshape(-1, 2).T.repeat(counts, axis=1)
        set_points = None if self._glue.set_point is None else flow
        active = np.frombuffer(lines, np.int64).repeat(counts)
        return Trace(motion.period, position, is_on > 0, set_points, active, state)

    def _endless(self, line: int, axes: list[Axis]) -> InputError:
        """Return the error for a program that has not ended."""
        stuck = [axis.number for axis in axes if axis.member is not None and not axis.speed]
        still = f", as axis {stuck[0]} is to move at SPEED = 0" if stuck else ""
        return InputError(
            f"line {line}: the program still runs after {self._limits.time:g} s{still}: must end before, or raise "
            "time_limit, or give stop_after to take the first seconds"
        )

    def _stop(self) -> None:
        """Stop the processes and bring the axes to rest."""
        state = self._state
        state.stopped = self._clock.line
        state.stop(None)
        state.motion.wind_down()

    def _free_periods(self, most: float) -> int:
        """Servo periods, up to the tick `most`, until a process can act without the end of a move; at least 1."""
        state = self._state
        ahead: float = min(most - state.tick, _PASSED_PERIODS)
        for process in state.processes:
            if process.blocked is None:
                ahead = min(ahead, (process.ready - state.time) / state.motion.period)
            elif process.polls:
                return 1
        return max(int(ahead), 1)

    def _active_line(self, axes: list[Axis]) -> int:
        return next((axis.member.line for axis in axes if axis.member is not None), self._clock.line)


def set_point(word: str) -> SetPoint:
    """Return what reads an output: "AOUT(0)", "DAC AXIS(3)", "OP(8)", or as a number the bits of "OP(8,15)".

    Raises:
        InputError: another word, or a number out of bounds.
    """
    parts = _WORD.fullmatch(word)
    if parts is None or (parts[3] is not None and parts[1] != "OP"):
        raise InputError(
            f'flow_output = "{word}": must be with its numbers "AOUT(0)", "DAC AXIS(3)", "OP(8)", or "OP(8,15)" for '
            "the number of which these outputs are the bits"
        )
    kind = parts[1]
    first = int(parts[2])
    last = first if parts[3] is None else int(parts[3])
    most = {"AOUT": MOST_ANALOGUE, "DAC AXIS": MOST_AXES, "OP": MOST_OUTPUTS}[kind]
    if not (0 <= last - first < MOST_BITS and last < most):
        bits = f", the first output first and of at most {MOST_BITS} bits" if kind == "OP" else ""
        raise InputError(f'flow_output = "{word}": must be up to {most - 1}{bits}')
    if kind == "AOUT":
        return lambda state: state.analogue.get(first, 0.0)
    if kind == "DAC AXIS":
        return lambda state: state.motion.axis(first).values.get("DAC", 0.0)
    return lambda state: float(sum(1 << k for k in range(last - first + 1) if first + k in state.outputs))


def with_move_speeds(text: str, speeds: Mapping[int, float]) -> str:
    """Return a text whose moves have speeds of their own.

    A move buffers FORCE_SPEED, its speed, and STARTMOVE_SPEED, to which the move before brakes; SPEED would act at once
    on the move that runs when the program sets it.

    Args:
        text: of the program.
        speeds: path speeds of the moves by their lines [mm/s].
    """
    lines = text.split("\n")
    for number, speed in speeds.items():
        parts = _TEXT_OR_COMMENT.split(lines[number - 1])
        # splitting at a group leaves texts and comments at every second place
        parts[::2] = [_MOVE.sub(lambda match: f"{match[1]}SP", part) for part in parts[::2]]
        line = "".join(parts)
        match = _MOVE.search(line)
        # speeds stay set until the next ones
        if match is None or (speeds.get(number - 1) == speed and _MOVE.search(lines[number - 2])):
            lines[number - 1] = line
            continue
        words = f"FORCE_SPEED={speed:.{_DIGITS}g}: STARTMOVE_SPEED={speed:.{_DIGITS}g}: "
        lines[number - 1] = line[: match.start()] + words + line[match.start() :]
    return "\n".join(lines)


def speeds_of_moves(trace: Trace) -> dict[int, float]:
    """Return the path speeds of the moves of a run by their lines: that which each forces, else the fastest one [mm/s].

    A line that runs several times is as fast as its slowest pass.
    """
    steps = np.sqrt((np.diff(trace.position[:, :3], axis=0) ** 2).sum(axis=1)) / trace.period
    reached = np.zeros(int(trace.lines.max(initial=0)) + 1)
    np.maximum.at(reached, trace.lines[1:], steps)
    speeds: dict[int, float] = {}
    for move in trace.state.motion.loaded:
        speed = float(reached[move.line]) if move.line < reached.size else 0.0
        if move.speeds is not None and move.speeds.force is not None:
            speed = move.speeds.force
        speeds[move.line] = min(speed, speeds.get(move.line, np.inf))
    return speeds
