"""Programs run against the motion generator, servo period by servo period."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.controllers.trio.basic.axis import Axis
from gantrysim.controllers.trio.basic.process import Code, Process, State, Statement

MOST_PER_TICK = 1000  # statements of a process within a servo period, where they cost no time
RECORDED = 4  # axes 0 to 3 can be those of the machine without being named
_LONGEST = 1000  # servo periods passed at once
_EARLY = 1e-9  # of a servo period


@dataclass(frozen=True)
class Trace:
    """What a run of the programs made.

    Attributes:
        period: servo period [s].
        position: of the recorded axes at every servo tick, (n, recorded) [units].
        outputs: whether the valve's output was on at them, (n,).
        lines: of the text, of the move that runs then, else of the first process, (n,).
        state: of the controller at the end.
    """

    period: float
    position: Floats
    outputs: NDArray[np.bool_]
    lines: NDArray[np.int64]
    state: State


@dataclass(frozen=True)
class Limits:
    """Bounds of a run.

    Attributes:
        statements: executed.
        time: simulated [s].
    """

    statements: int
    time: float


def run(
    codes: list[Code], state: State, times: dict[str, float], recorded: tuple[int, ...], valve: int, limits: Limits
) -> Trace:
    """Run the first program, and those that it starts, until all have ended and the axes rest.

    At every servo tick the processes execute their statements that are due; what they command takes effect at that
    tick. A statement takes the time of its kind, after which the next one is due.

    Raises:
        InputError: a statement fails, with its line, or a limit is exceeded.
    """
    return _Run(state, times, recorded, valve, limits).run(codes[0].name)


class _Run:
    def __init__(
        self, state: State, times: dict[str, float], recorded: tuple[int, ...], valve: int, limits: Limits
    ) -> None:
        self._state = state
        self._times = {**times, "none": 0.0}
        self._limits = limits
        self._recorded = recorded
        self._valve = valve
        self._count = 0
        self._line = 0

    def run(self, name: str) -> Trace:
        state = self._state
        motion = self._state.motion
        positions = array("d")
        outputs = bytearray()
        lines = array("q")
        axes = [motion.axis(number) for number in self._recorded]
        state.run(name, 0.0)
        most = math.ceil(self._limits.time / motion.period)
        while True:
            count = self._count
            for process in state.processes:  # which they may add to
                self._execute(process)
            state.processes = [process for process in state.processes if not process.ended]
            positions.extend([axis.position for axis in axes])
            outputs.append(self._valve in state.outputs)
            lines.append(self._active(axes))
            if not state.processes and motion.resting(self._recorded):
                break
            if state.tick >= most:
                raise InputError(
                    f"line {lines[-1]}: the program still runs after {self._limits.time:g} s: must end before, or "
                    "raise time_limit"
                )
            # after a statement, what a process waits for may have come about already
            ahead = self._undisturbed(most) if self._count == count else 1
            passed = motion.glide(ahead, self._recorded)
            if len(passed):
                positions.frombytes(passed[:-1].tobytes())
                outputs += outputs[-1:] * (len(passed) - 1)
                lines += lines[-1:] * (len(passed) - 1)
            else:
                motion.step()
            state.tick += max(len(passed), 1)
        position = np.frombuffer(positions, float).reshape(-1, len(axes))
        on = np.frombuffer(outputs, np.uint8).astype(bool)
        return Trace(motion.period, position, on, np.frombuffer(lines, np.int64), state)

    def _undisturbed(self, most: int) -> int:
        """Servo periods, up to the tick `most`, until a process can act without the end of a move."""
        state = self._state
        ahead: float = min(most - state.tick, _LONGEST)
        for process in state.processes:
            if process.blocked is None:
                ahead = min(ahead, (process.ready - state.time) / state.motion.period)
            elif process.polls:
                return 1
        return int(ahead)

    def _active(self, axes: list[Axis]) -> int:
        return next((axis.member.line for axis in axes if axis.member is not None), self._line)

    def _execute(self, process: Process) -> None:
        """Execute the statements of a process that are due at the current tick."""
        now = self._state.time
        period = self._state.motion.period
        due = now + _EARLY * (now + period)
        done = 0
        statements = process.code.statements
        try:
            if process.blocked is not None and not process.ended:
                if not process.blocked():
                    return
                process.blocked = None
                process.polls = False
                process.ready = max(process.ready, now)
            while process.ready <= due and not process.ended and process.blocked is None:
                if process.at >= len(statements):
                    process.ended = True
                elif done >= MOST_PER_TICK and process.ready <= now:
                    process.ready = now + period
                else:
                    done += 1
                    self._step(process, statements[process.at], due)
        except ZeroDivisionError:
            raise InputError(f"line {process.line}: division by zero") from None
        except InputError as error:
            text = str(error)
            raise InputError(text if text.startswith("line ") else f"line {process.line}: {text}") from None
        except (OverflowError, ValueError):
            raise InputError(f"line {process.line}: no number, the operands are out of range") from None

    def _step(self, process: Process, statement: Statement, due: float) -> None:
        self._count += 1
        process.line = self._line = statement.line
        if self._count > self._limits.statements:
            raise InputError(
                f"more than {self._limits.statements} statements are executed: must be fewer, or raise statement_limit"
            )
        goal = statement.act(process)
        process.ready += self._times[statement.cost]
        process.changed |= not statement.pure
        here = process.at
        process.at = process.at + 1 if goal is None else goal
        if goal is not None and goal <= here:
            self._skip_idle_passes(process, due)

    def _skip_idle_passes(self, process: Process, due: float) -> None:
        """Skip the passes of a loop that only tests: within a servo tick nothing changes for it."""
        tick = self._state.tick
        at, when, ready = process.last
        if not process.changed and (at, when) == (process.at, tick):
            lasting = process.ready - ready
            if lasting > 0:
                process.ready += max(math.floor((due - process.ready) / lasting), 0) * lasting
            else:
                process.ready = (tick + 1) * self._state.motion.period
        process.last = (process.at, tick, process.ready)
        process.changed = False
