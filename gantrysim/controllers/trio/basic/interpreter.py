"""Programs run against the motion generator, servo period by servo period."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.tasks import Scheduler, StatementClock
from gantrysim.controllers.trio.basic.axis import Axis
from gantrysim.controllers.trio.basic.outputs import SetPoint
from gantrysim.controllers.trio.basic.process import ProgramCode, State

RECORDED = 4  # axes 0 to 3 can be those of the machine without being named
_LONGEST = 1000  # servo periods passed at once
_LONGEST_WAIT = 300.0  # for a condition, with all axes at rest [s]


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
                raise InputError(
                    f"line {lines[-1]}: the program still runs after {self._limits.time:g} s: must end before, or "
                    "raise time_limit, or give stop_after to take the first seconds"
                )
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

    def _stop(self) -> None:
        """Stop the processes and bring the axes to rest."""
        state = self._state
        state.stopped = self._clock.line
        state.stop(None)
        state.motion.wind_down()

    def _free_periods(self, most: float) -> int:
        """Servo periods, up to the tick `most`, until a process can act without the end of a move; at least 1."""
        state = self._state
        ahead: float = min(most - state.tick, _LONGEST)
        for process in state.processes:
            if process.blocked is None:
                ahead = min(ahead, (process.ready - state.time) / state.motion.period)
            elif process.polls:
                return 1
        return max(int(ahead), 1)

    def _active_line(self, axes: list[Axis]) -> int:
        return next((axis.member.line for axis in axes if axis.member is not None), self._clock.line)
