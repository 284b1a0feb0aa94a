"""The commands of Trio BASIC that name axes, memory or outputs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gantrysim.base.errors import InputError
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
    cost: str = "statement"


def _order(p: Process, move: Move) -> None:
    """Hand a move to the axes; the program waits where the buffer is full."""
    motion = p.state.motion
    if not motion.order(move):
        p.blocked = lambda: motion.order(move)


def _move(p: Process, values: Values, line: int) -> None:
    _order(p, Move(MOVE, line, p.axes(len(values)), Straight(tuple(values))))


def _moveabs(p: Process, values: Values, line: int) -> None:
    _order(p, Move(MOVEABS, line, p.axes(len(values)), targets=tuple(values)))


def _movecirc(p: Process, values: Values, line: int) -> None:
    ex, ey, cx, cy, direction = values
    shape = Arc((ex, ey), (cx, cy), _switch("direction", direction))
    _order(p, Move(MOVECIRC, line, p.axes(2), shape))


def _mhelical(p: Process, values: Values, line: int) -> None:
    ex, ey, cx, cy, direction, rise, mode = (*values, 0.0)[:7]
    shape = Arc((ex, ey), (cx, cy), _switch("direction", direction), rise, _switch("mode", mode))
    _order(p, Move(MHELICAL, line, p.axes(3), shape))


def _forward(p: Process, values: Values, line: int) -> None:
    _order(p, Move(FORWARD, line, p.axes(1), Jog(1.0)))


def _reverse(p: Process, values: Values, line: int) -> None:
    _order(p, Move(REVERSE, line, p.axes(1), Jog(-1.0)))


def _connect(p: Process, values: Values, line: int) -> None:
    _order(p, Move(CONNECT, line, p.axes(1), driver=_axis(p, values[1]), ratio=values[0]))


def _cam(p: Process, values: Values, line: int) -> None:
    first, last, scale, distance = values
    _order(p, Move(CAM, line, p.axes(1), _profile(p, first, last, scale, _positive("distance", distance))))


def _cambox(p: Process, values: Values, line: int) -> None:
    first, last, scale, distance, link, *options = values
    shape = _profile(p, first, last, scale, _positive("link distance", distance))
    _order(p, _linked(p, CAMBOX, line, shape, link, options))


def _movelink(p: Process, values: Values, line: int) -> None:
    distance, length, up, down, link, *options = values
    for name, value in (("acceleration", up), ("deceleration", down)):
        if value < 0:
            raise InputError(f"link distance of {name} = {value:g}: must be at least 0")
    shape = Ramps(distance, _positive("link distance", length), up, down)
    _order(p, _linked(p, MOVELINK, line, shape, link, options))


def _linked(p: Process, kind: int, line: int, shape: Shape, link: float, options: Values) -> Move:
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
        p.axes(1),
        shape,
        driver=_axis(p, link),
        repeats=bool(bits & REPEATS),
        forward_only=bool(bits & FORWARD_ONLY),
        link_start=start,
    )


def _profile(p: Process, first: float, last: float, scale: float, length: float) -> Table:
    """The part of TABLE that is a cam, in units from its first value."""
    begin = index("TABLE", first, TABLE_SIZE)
    end = index("TABLE", last, TABLE_SIZE)
    if not 1 <= end - begin < MOST_POINTS:
        raise InputError(f"cam from TABLE({begin}) to TABLE({end}): must have 2 to {MOST_POINTS} points")
    table = p.state.table
    units = p.state.motion.axis(p.base[0]).units
    missing = [k for k in range(begin, end + 1) if k not in table]
    if missing:
        raise InputError(f"cam: TABLE({missing[0]}) must be set before")
    values = tuple((table[k] - table[begin]) * scale / units for k in range(begin, end + 1))
    if not all(map(math.isfinite, values)):
        raise InputError(f"cam from TABLE({begin}) to TABLE({end}): its values must be finite")
    return Table(values, length)


def _addax(p: Process, values: Values, line: int) -> None:
    p.state.motion.superimpose(p.base[0], None if values[0] == -1 else _axis(p, values[0]))


def _cancel(p: Process, values: Values, line: int) -> None:
    p.state.motion.cancel(p.base[0], _mode(values))


def _rapidstop(p: Process, values: Values, line: int) -> None:
    p.state.motion.stop_all(_mode(values))


def _mode(values: Values) -> int:
    mode = values[0] if values else 0
    if mode not in (0, 1, 2):
        raise InputError(f"mode {mode:g}: must be 0 (executing move), 1 (buffered moves) or 2 (both)")
    return int(mode)


def _defpos(p: Process, values: Values, line: int) -> None:
    for number, value in zip(p.axes(len(values)), values, strict=True):
        axis = p.state.motion.axis(number)
        axis.zero = axis.position - value


def _base(p: Process, values: Values, line: int) -> None:
    numbers = tuple(_axis(p, value) for value in values)
    if len(set(numbers)) < len(numbers):
        raise InputError(f"BASE{numbers}: must name an axis once")
    p.base = numbers


def _op(p: Process, values: Values, line: int) -> None:
    output = index("OP", values[0], MOST_OUTPUTS)
    outputs = p.state.outputs
    p.state.switched.add(output)
    if values[1]:
        outputs.add(output)
    else:
        outputs.discard(output)


def _table(p: Process, values: Values, line: int) -> None:
    first = index("TABLE", values[0], TABLE_SIZE)
    index("TABLE", first + len(values) - 2, TABLE_SIZE)
    p.state.table.update(enumerate(values[1:], first))


def _wa(p: Process, values: Values, line: int) -> None:
    p.ready += p.state.wait(values[0])


def _axis(p: Process, value: float) -> int:
    return p.state.motion.axis(value).number


def _switch(name: str, value: float) -> bool:
    if value not in (0, 1):
        raise InputError(f"{name} {value:g}: must be 0 or 1")
    return value == 1


def _positive(name: str, value: float) -> float:
    if not value > 0 or math.isinf(value):
        raise InputError(f"{name} = {value:g}: must be greater than 0")
    return value


COMMANDS = {
    "ADDAX": Command(_addax, 1, 1, "motion"),
    "BASE": Command(_base, 1, MAX_AXES),
    "CAM": Command(_cam, 4, 4, "motion"),
    "CAMBOX": Command(_cambox, 5, 7, "motion"),
    "CANCEL": Command(_cancel, 0, 1, "motion"),
    "CONNECT": Command(_connect, 2, 2, "motion"),
    "DEFPOS": Command(_defpos, 1, MAX_AXES, "motion"),
    "FORWARD": Command(_forward, 0, 0, "motion"),
    "MHELICAL": Command(_mhelical, 6, 7, "motion"),
    "MOVE": Command(_move, 1, MAX_AXES, "motion"),
    "MOVEABS": Command(_moveabs, 1, MAX_AXES, "motion"),
    "MOVECIRC": Command(_movecirc, 5, 5, "motion"),
    "MOVELINK": Command(_movelink, 5, 7, "motion"),
    "OP": Command(_op, 2, 2),
    "RAPIDSTOP": Command(_rapidstop, 0, 1, "motion"),
    "REVERSE": Command(_reverse, 0, 0, "motion"),
    "TABLE": Command(_table, 2, 1024),
    "WA": Command(_wa, 1, 1, "wait"),
}
