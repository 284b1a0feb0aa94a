"""Tables of commands: a function each, `cmd_connect` for CONNECT, with the number of its arguments."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import STATEMENT
from gantrysim.controllers.basic.statements import PREFIX
from gantrysim.controllers.trio.basic.moves import Move
from gantrysim.controllers.trio.basic.process import Process

MAX_AXES = 16  # of one move

Values = list[float]
Action = Callable[[Process, Values, int], None]


# kinds of statement, by which their time is counted
MOTION = "motion"
WAIT = "wait"


@dataclass(frozen=True)
class Command:
    """A command.

    Attributes:
        act: runs it, given the process, the arguments and the line.
        least, most: number of arguments.
        cost: kind of statement that its time is counted as.
    """

    act: Action
    least: int
    most: int
    cost: str


class CommandTable(dict[str, Command]):
    """Commands by their names; a call returns a decorator that enters the function `cmd_NAME` as NAME."""

    def __call__(self, least: int, most: int, cost: str = STATEMENT) -> Callable[[Action], Action]:
        """Return the decorator.

        Args:
            least: number of the command's arguments.
            most: number of its arguments.
            cost: kind of statement that its time is counted as.
        """

        def enter(act: Action) -> Action:
            name = act.__name__.removeprefix(PREFIX).upper()
            self[name] = Command(act, least, most, cost)
            return act

        return enter


def order(process: Process, move: Move) -> None:
    """Hand a move to the axes; the program waits where the buffer is full."""
    motion = process.state.motion
    if not motion.order(move):
        process.blocked = lambda: motion.order(move)


def axis_number(process: Process, value: float) -> int:
    """Return the number of an axis, or raise InputError where there is none."""
    return process.state.motion.axis(value).number


def switch(name: str, value: float) -> bool:
    """Return whether an argument is 1, or raise InputError where it is neither 0 nor 1."""
    if value not in (0, 1):
        raise InputError(f"{name} {value:g}: must be 0 or 1")
    return value == 1


def positive(name: str, value: float) -> float:
    """Return an argument, or raise InputError where it is not above 0."""
    if not value > 0 or math.isinf(value):
        raise InputError(f"{name} = {value:g}: must be greater than 0")
    return value
