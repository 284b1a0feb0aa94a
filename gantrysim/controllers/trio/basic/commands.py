"""The commands of Trio BASIC that name axes, memory or outputs, a function each: `cmd_connect` is CONNECT."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.controllers.basic.code import STATEMENT
from gantrysim.controllers.basic.statements import PREFIX
from gantrysim.controllers.trio.basic.moves import (
    CAM,
    CAMBOX,
    CONNECT,
    FORWARD,
    MHELICAL,
    MOVE,
    MOVEABS,
    MOVECIRC,
    MOVELINK,
    REVERSE,
    Arc,
    Jog,
    Move,
    Ramps,
    Shape,
    Straight,
    Table,
)
from gantrysim.controllers.trio.basic.process import MOST_OUTPUTS, TABLE_SIZE, Process, index

MOST_POINTS = 32_000  # of a cam
# bits of the link options
REPEATS = 4
ABSOLUTE = 2
FORWARD_ONLY = 32
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


COMMANDS: dict[str, Command] = {}


def command(least: int, most: int, cost: str = STATEMENT) -> Callable[[Action], Action]:
    """Return a decorator that enters the function `cmd_NAME` as the command NAME.

    Args:
        least: number of its arguments.
        most: number of its arguments.
        cost: kind of statement that its time is counted as.
    """

    def enter(act: Action) -> Action:
        name = act.__name__.removeprefix(PREFIX).upper()
        COMMANDS[name] = Command(act, least, most, cost)
        return act

    return enter


def _order(process: Process, move: Move) -> None:
    """Hand a move to the axes; the program waits where the buffer is full."""
    motion = process.state.motion
    if not motion.order(move):
        process.blocked = lambda: motion.order(move)


@command(1, MAX_AXES, MOTION)
def cmd_move(process: Process, values: Values, line: int) -> None:
    """MOVE(distance, ...): a straight line by these distances."""
    _order(process, Move(MOVE, line, process.axes(len(values)), Straight(tuple(values))))


@command(1, MAX_AXES, MOTION)
def cmd_moveabs(process: Process, values: Values, line: int) -> None:
    """MOVEABS(position, ...): a straight line to these positions."""
    _order(process, Move(MOVEABS, line, process.axes(len(values)), targets=tuple(values)))


@command(5, 5, MOTION)
def cmd_movecirc(process: Process, values: Values, line: int) -> None:
    """MOVECIRC(end x, end y, centre x, centre y, direction): an arc, its end and centre relative to its start."""
    ex, ey, cx, cy, direction = values
    shape = Arc((ex, ey), (cx, cy), _switch("direction", direction))
    _order(process, Move(MOVECIRC, line, process.axes(2), shape))


@command(6, 7, MOTION)
def cmd_mhelical(process: Process, values: Values, line: int) -> None:
    """MHELICAL(end x, end y, centre x, centre y, direction, rise[, mode]): an arc with an even climb."""
    ex, ey, cx, cy, direction, rise, mode = (*values, 0.0)[:7]
    shape = Arc((ex, ey), (cx, cy), _switch("direction", direction), rise, _switch("mode", mode))
    _order(process, Move(MHELICAL, line, process.axes(3), shape))


@command(0, 0, MOTION)
def cmd_forward(process: Process, values: Values, line: int) -> None:
    """FORWARD: on and on in the positive direction."""
    _order(process, Move(FORWARD, line, process.axes(1), Jog(1.0)))


@command(0, 0, MOTION)
def cmd_reverse(process: Process, values: Values, line: int) -> None:
    """REVERSE: on and on in the negative direction."""
    _order(process, Move(REVERSE, line, process.axes(1), Jog(-1.0)))


@command(2, 2, MOTION)
def cmd_connect(process: Process, values: Values, line: int) -> None:
    """CONNECT(ratio, axis): follow an axis in proportion."""
    _order(process, Move(CONNECT, line, process.axes(1), driver=_axis(process, values[1]), ratio=values[0]))


@command(4, 4, MOTION)
def cmd_cam(process: Process, values: Values, line: int) -> None:
    """CAM(first, last, scale, distance): run through positions of TABLE at SPEED."""
    first, last, scale, distance = values
    shape = _profile(process, first, last, scale, _positive("distance", distance))
    _order(process, Move(CAM, line, process.axes(1), shape))


@command(5, 7, MOTION)
def cmd_cambox(process: Process, values: Values, line: int) -> None:
    """CAMBOX(first, last, scale, link distance, link axis[, options[, position]]): a cam over a link axis."""
    first, last, scale, distance, link, *options = values
    shape = _profile(process, first, last, scale, _positive("link distance", distance))
    _order(process, _linked(process, CAMBOX, line, shape, link, options))


@command(5, 7, MOTION)
def cmd_movelink(process: Process, values: Values, line: int) -> None:
    """MOVELINK(distance, link distance, up, down, link axis[, options[, position]]): a ramp over a link axis."""
    distance, length, up, down, link, *options = values
    for name, value in (("acceleration", up), ("deceleration", down)):
        if value < 0:
            raise InputError(f"link distance of {name} = {value:g}: must be at least 0")
    shape = Ramps(distance, _positive("link distance", length), up, down)
    _order(process, _linked(process, MOVELINK, line, shape, link, options))


def _linked(process: Process, kind: int, line: int, shape: Shape, link: float, options: Values) -> Move:
    bits = int(options[0]) if options else 0
    if bits & ~(REPEATS | ABSOLUTE | FORWARD_ONLY) or (options and bits != options[0]):
        raise InputError(
            f"link options = {options[0]:g}: must be a sum of 2 (from a position), 4 (repeat), 32 (forward)"
        )
    if bool(bits & ABSOLUTE) != (len(options) > 1):
        raise InputError("link position: must be given with link option 2, and with no other")
    start = options[1] if bits & ABSOLUTE else None
    return Move(
        kind,
        line,
        process.axes(1),
        shape,
        driver=_axis(process, link),
        repeats=bool(bits & REPEATS),
        forward_only=bool(bits & FORWARD_ONLY),
        link_start=start,
    )


def _profile(process: Process, first: float, last: float, scale: float, length: float) -> Table:
    """The part of TABLE that is a cam, in units from its first value."""
    begin = index("TABLE", first, TABLE_SIZE)
    end = index("TABLE", last, TABLE_SIZE)
    if not 1 <= end - begin < MOST_POINTS:
        raise InputError(f"cam from TABLE({begin}) to TABLE({end}): must have 2 to {MOST_POINTS} points")
    table = process.state.table
    units = process.state.motion.axis(process.base[0]).units
    missing = [k for k in range(begin, end + 1) if k not in table]
    if missing:
        raise InputError(f"cam: TABLE({missing[0]}) must be set before")
    values = tuple((table[k] - table[begin]) * scale / units for k in range(begin, end + 1))
    if not all(map(math.isfinite, values)):
        raise InputError(f"cam from TABLE({begin}) to TABLE({end}): its values must be finite")
    return Table(values, length)


@command(1, 1, MOTION)
def cmd_addax(process: Process, values: Values, line: int) -> None:
    """ADDAX(axis): add the motion of another axis; -1 ends it."""
    process.state.motion.superimpose(process.base[0], None if values[0] == -1 else _axis(process, values[0]))


@command(0, 1, MOTION)
def cmd_cancel(process: Process, values: Values, line: int) -> None:
    """CANCEL[(mode)]: cancel the moves of the axis."""
    process.state.motion.cancel(process.base[0], _mode(values))


@command(0, 1, MOTION)
def cmd_rapidstop(process: Process, values: Values, line: int) -> None:
    """RAPIDSTOP[(mode)]: cancel the moves of all axes."""
    process.state.motion.stop_all(_mode(values))


def _mode(values: Values) -> int:
    mode = values[0] if values else 0
    if mode not in (0, 1, 2):
        raise InputError(f"mode {mode:g}: must be 0 (executing move), 1 (buffered moves) or 2 (both)")
    return int(mode)


@command(1, MAX_AXES, MOTION)
def cmd_defpos(process: Process, values: Values, line: int) -> None:
    """DEFPOS(position, ...): define the positions at which the axes are."""
    for number, value in zip(process.axes(len(values)), values, strict=True):
        axis = process.state.motion.axis(number)
        axis.zero = axis.position - value


@command(1, MAX_AXES)
def cmd_base(process: Process, values: Values, line: int) -> None:
    """BASE(axis, ...): the axes of the commands that follow."""
    numbers = tuple(_axis(process, value) for value in values)
    if len(set(numbers)) < len(numbers):
        raise InputError(f"BASE{numbers}: must name an axis once")
    process.base = numbers


@command(2, 2)
def cmd_op(process: Process, values: Values, line: int) -> None:
    """OP(output, state): switch an output."""
    output = index("OP", values[0], MOST_OUTPUTS)
    outputs = process.state.outputs
    process.state.switched.add(output)
    if values[1]:
        outputs.add(output)
    else:
        outputs.discard(output)


@command(2, 1024)
def cmd_table(process: Process, values: Values, line: int) -> None:
    """TABLE(first, value, ...): set cells of TABLE."""
    first = index("TABLE", values[0], TABLE_SIZE)
    index("TABLE", first + len(values) - 2, TABLE_SIZE)
    process.state.table.update(enumerate(values[1:], first))


@command(1, 1, WAIT)
def cmd_wa(process: Process, values: Values, line: int) -> None:
    """WA(time): wait for a time [ms]."""
    process.ready += process.state.wait(values[0])


def _axis(process: Process, value: float) -> int:
    return process.state.motion.axis(value).number


def _switch(name: str, value: float) -> bool:
    if value not in (0, 1):
        raise InputError(f"{name} {value:g}: must be 0 or 1")
    return value == 1


def _positive(name: str, value: float) -> float:
    if not value > 0 or math.isinf(value):
        raise InputError(f"{name} = {value:g}: must be greater than 0")
    return value
