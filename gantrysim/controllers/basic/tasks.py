"""Tasks: programs that run beside one another, statement by statement, each by its clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import Frame

MOST_PER_TICK = 1000  # statements of a task within a tick, where they cost no time
_TIME_ROUNDING = 1e-9  # of a tick: rounding of the times of statements


class LimitError(InputError):
    """A limit of the simulation, which no program can handle."""


class StatementClock:
    """The number of statements that are executed, and the time that each takes.

    Args:
        times: of a statement, by its kind [s].
        most: statements.
        refusal: message where there are more.

    Attributes:
        count: statements begun.
        line: of the statement begun last.
    """

    def __init__(self, times: Mapping[str, float], most: int, refusal: str) -> None:
        self._times: dict[str | None, float] = {None: 0.0}
        for kind, time in times.items():
            self._times[kind] = time
        self.count = 0
        self.line = 0
        self._most = most
        self._refusal = refusal

    @property
    def remaining(self) -> int:
        """Number of statements that may still be begun."""
        return self._most - self.count

    def begin(self, line: int, cost: str | None) -> float:
        """Count a statement and return the time that it takes [s].

        Raises:
            LimitError: there are too many.
        """
        self.line = line
        self.count += 1
        if self.count > self._most:
            raise LimitError(self._refusal)
        return self._times[cost]


@dataclass
class Task(Frame):
    """A running program.

    Attributes:
        ready: time from which its next statement is executed [s].
        blocked: whether what it waits for has come about; None where it waits for nothing.
        polls: whether that may come about without the end of a move.
        changed: whether it has done more than test and jump since the last backward jump.
        last_pass: position, tick and `ready` of that jump.
        ended: whether it has stopped.
        line: of the statement executed last.
    """

    ready: float = 0.0
    blocked: Callable[[], bool] | None = None
    polls: bool = False
    changed: bool = True
    last_pass: tuple[int, int, float] = (-1, -1, 0.0)
    ended: bool = False
    line: int = 0

    def recovers(self, error: str, ready: float) -> bool:
        """Go on after an error where the program names a place for that; return whether it does.

        The place holds for one error: another one there, without a new statement that names it, ends the program.

        Args:
            error: message with its line.
            ready: time from which the next statement is executed [s].
        """
        if self.error_target is None:
            return False
        self.position = self.error_target
        self.error_target = None
        self.blocked = None
        self.polls = False
        self.changed = True
        self.ready = ready
        return True


class Scheduler:
    """Executes the statements of tasks that are due at a tick.

    A statement takes the time of its kind, after which the next one is due. What is commanded takes effect at ticks
    alone, so that between two of them only tasks change what tasks see.

    Args:
        clock: of all tasks.
        period: from one tick to the next [s].
    """

    def __init__(self, clock: StatementClock, period: float) -> None:
        self._clock = clock
        self._period = period

    def execute(self, task: Task, tick: int) -> None:
        """Execute the statements of a task that are due at a tick.

        Raises:
            InputError: a statement fails, with its line.
        """
        now = tick * self._period
        try:
            self._execute(task, tick, now)
        except ZeroDivisionError:
            self._fail(task, "division by zero", now)
        except LimitError as error:
            raise InputError(f"line {task.line}: {error}") from None
        except InputError as error:
            self._fail(task, str(error), now)
        except (OverflowError, ValueError):
            self._fail(task, "no number, the operands are out of range", now)

    def _fail(self, task: Task, reason: str, now: float) -> None:
        """End with an error, unless the program handles it from the next tick on."""
        error = reason if reason.startswith("line ") else f"line {task.line}: {reason}"
        if not task.recovers(error, now + self._period):
            raise InputError(error) from None

    def _execute(self, task: Task, tick: int, now: float) -> None:
        if task.blocked is not None and not task.ended:
            if not task.blocked():
                return
            task.blocked = None
            task.polls = False
            task.ready = max(task.ready, now)
        due = now + _TIME_ROUNDING * (now + self._period)
        count = 0
        code = task.code
        while task.ready <= due and not task.ended and task.blocked is None:
            position = task.position
            if position >= len(code):
                task.ended = True
                return
            if count >= MOST_PER_TICK and task.ready <= now:
                task.ready = now + self._period
                return
            count += 1
            instruction = code[position]
            task.line = instruction.line
            time = self._clock.begin(instruction.line, instruction.cost)
            goal = instruction.act(task)
            task.position = position + 1 if goal is None else goal
            task.ready += time
            task.changed |= not instruction.pure
            if goal is not None and goal <= position:
                self._skip_idle_passes(task, tick, due)

    def _skip_idle_passes(self, task: Task, tick: int, due: float) -> None:
        """Skip the passes of a loop that only tests: until the next tick nothing changes for it."""
        position, tick_of_last, ready = task.last_pass
        if not task.changed and (position, tick_of_last) == (task.position, tick):
            pass_time = task.ready - ready
            if pass_time > 0:
                task.ready += max(math.floor((due - task.ready) / pass_time), 0) * pass_time
            else:
                task.ready = (tick + 1) * self._period
        task.last_pass = (task.position, tick, task.ready)
        task.changed = False
