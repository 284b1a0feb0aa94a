"""Programs run against the motion generator, servo period by servo period."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.controllers.trio.basic.code import Code, Statement
from gantrysim.controllers.trio.basic.motion import Motion
from gantrysim.controllers.trio.basic.process import Controller, Process
from gantrysim.errors import InputError

MOST_PER_TICK = 1000  # statements of a process within a servo period, where they cost no time
RECORDED = 4  # axes 0 to 3 can be those of the machine without being named
_EARLY = 1e-9  # of a servo period


@dataclass(frozen=True)
class Trace:
    """What a run of the programs made.

    Attributes:
        period: servo period [s].
        position: of the recorded axes at every servo tick, (n, recorded) [units].
        outputs: whether the valve's output was on at them, (n,).
        lines: of the text, of the move that runs then, else of the first process, (n,).
        controller: its state at the end.
    """

    period: float
    position: Floats
    outputs: NDArray[np.bool_]
    lines: NDArray[np.int64]
    controller: Controller


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
    codes: list[Code], controller: Controller, times: dict[str, float], recorded: tuple[int, ...], valve: int, limits: Limits
) -> Trace:
    """Run the first program, and those that it starts, until all have ended and the axes rest.

    At every servo tick the processes execute their statements that are due; what they command takes effect at that
    tick. A statement takes the time of its kind, after which the next one is due.

    Raises:
        InputError: a statement fails, with its line, or a limit is exceeded.
    """
    return _Run(controller, times, recorded, valve, limits).run(codes[0].name)


class _Run:
    def __init__(
        self, controller: Controller, times: dict[str, float], recorded: tuple[int, ...], valve: int, limits: Limits
    ) -> None:
        self._controller, self._times, self._limits = controller, {**times, "none": 0.0}, limits
        self._recorded, self._valve = recorded, valve
        self._count, self._line = 0, 0

    def run(self, name: str) -> Trace:
        controller, motion = self._controller, self._controller.motion
        positions, outputs, lines = array("d"), bytearray(), array("q")
        axes = [motion.axis(number) for number in self._recorded]
        controller.run(name, 0.0)
        most = math.ceil(self._limits.time / motion.period)
        while True:
            for process in list(controller.processes):
                self._execute(process)
            controller.processes = [process for process in controller.processes if not process.ended]
            positions.extend([axis.position for axis in axes])
            outputs.append(self._valve in controller.outputs)
            lines.append(self._active(axes))
            if not controller.processes and motion.resting(self._recorded):
                break
            if controller.tick >= most:
                raise InputError(
                    f"line {lines[-1]}: the program still runs after {self._limits.time:g} s: must end before, or a "
                    "greater time_limit"
                )
            motion.step()
            controller.tick += 1
        position = np.frombuffer(positions, float).reshape(-1, len(axes))
        on = np.frombuffer(outputs, np.uint8).astype(bool)
        return Trace(motion.period, position, on, np.frombuffer(lines, np.int64), controller)

    def _active(self, axes: list) -> int:  # type: ignore[type-arg]
        for axis in axes:
            if axis.member is not None:
                line: int = axis.member.line
                return line
        return self._line

    def _execute(self, process: Process) -> None:
        """Execute the statements of a process that are due at the current tick."""
        now = self._controller.time
        due = now * (1 + _EARLY) + _EARLY * self._controller.motion.period
        if process.blocked is not None:
            if process.ended or not self._guarded(process, process.blocked):
                return
            process.blocked, process.ready = None, max(process.ready, now)
        statements, done = process.code.statements, 0
        while process.ready <= due and not process.ended and process.blocked is None:
            if process.at >= len(statements):
                process.ended = True
                break
            if done >= MOST_PER_TICK and process.ready <= now:
                process.ready = now + self._controller.motion.period
                break
            done += 1
            statement = statements[process.at]
            self._step(process, statement, due)

    def _step(self, process: Process, statement: Statement, due: float) -> None:
        self._count += 1
        self._line = statement.line
        if self._count > self._limits.statements:
            raise InputError(
                f"line {statement.line}: more than {self._limits.statements} statements are executed: must be fewer, or a "
                "greater statement_limit"
            )
        goal = self._guarded(process, lambda: statement.act(process))
        process.ready += self._times[statement.cost]
        process.changed |= not statement.pure
        here, process.at = process.at, process.at + 1 if goal is None else goal
        if goal is not None and goal <= here:
            self._polls(process, due)

    def _polls(self, process: Process, due: float) -> None:
        """Skip the passes of a loop that only tests: within a servo tick nothing changes for it."""
        tick = self._controller.tick
        at, when, ready = process.last
        if not process.changed and (at, when) == (process.at, tick):
            lasting = process.ready - ready
            if lasting > 0:
                process.ready += max(math.floor((due - process.ready) / lasting), 0) * lasting
            else:
                process.ready = (tick + 1) * self._controller.motion.period
        process.last, process.changed = (process.at, tick, process.ready), False

    def _guarded(self, process: Process, act):  # type: ignore[no-untyped-def]
        """Call a function; its errors name the line."""
        line = process.code.statements[min(process.at, len(process.code.statements) - 1)].line
        try:
            return act()
        except ZeroDivisionError:
            text = "division by zero"
        except (OverflowError, ValueError) as error:
            if isinstance(error, InputError):
                text = str(error)
                if text.startswith("line "):
                    raise
            else:
                text = "result is no number: out of range"
        raise InputError(f"line {line}: {text}") from None
