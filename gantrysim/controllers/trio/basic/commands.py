"""The commands of Trio BASIC that name axes, memory or outputs, a function each: `cmd_connect` is CONNECT."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.base.quantity import counted
from gantrysim.controllers.basic.code import STATEMENT
from gantrysim.controllers.basic.statements import PREFIX
from gantrysim.controllers.trio.basic.moves import (
    CAM,
    CAMBOX,
    CONNECT,
    FORWARD,
    MHELICAL,
    MHELICALSP,
    MOVE,
    MOVEABS,
    MOVEABSSP,
    MOVECIRC,
    MOVECIRCSP,
    MOVELINK,
    MOVESP,
    REVERSE,
    Arc,
    Jog,
    Move,
    Ramps,
    Shape,
    Straight,
    Table,
)
from gantrysim.controllers.trio.basic.process import MOST_OUTPUTS, TABLE_SIZE, Ordered, Process, index
from gantrysim.controllers.trio.basic.words import IGNORED_COMMANDS, MOST_BITS

# Tables of commands: a function each, `cmd_connect` for CONNECT, with the number of its arguments.

MAX_AXES = 16  # of one move
_AT_ONCE = 2  # servo periods since a move was ordered, in which a program has not waited for anything

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

    def ordered() -> bool:
        is_taken = process.state.motion.order(move)
        if is_taken:
            process.ordered = Ordered(move.axes[0], process.state.tick)
        return is_taken

    if not ordered():
        process.blocked = ordered


def _note_haste(process: Process, output: int, line: int) -> None:
    """Note an output that is switched right after moves that are still to run, as nothing has waited for them."""
    state = process.state
    if process.ordered is None or state.tick - process.ordered.tick > _AT_ONCE:
        return
    axis = state.motion.axis(process.ordered.axis)
    pending = [move for move in (axis.move, *axis.queue) if move is not None]
    moves = len(pending)
    # one that follows another axis waits for that, and may never end, as those of FORWARD and REVERSE
    if moves and all(move.has_profile and move.kind not in (FORWARD, REVERSE) for move in pending):
        state.hasty.setdefault(
            output,
            [
                f"OP({output}) is switched in line {line} while {counted(moves, 'move')} above it "
                f"{'is' if moves == 1 else 'are'} still to run: OP does not wait, WAIT IDLE does"
            ],
        )


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


# The commands that move axes along lines and arcs, with and without speeds of their own.

command = CommandTable()


@command(1, MAX_AXES, MOTION)
def cmd_move(process: Process, values: Values, line: int) -> None:
    """MOVE(distance, ...): a straight line by these distances."""
    _line(process, values, line, MOVE)


@command(1, MAX_AXES, MOTION)
def cmd_movesp(process: Process, values: Values, line: int) -> None:
    """MOVESP(distance, ...): MOVE with FORCE_SPEED, STARTMOVE_SPEED and ENDMOVE_SPEED."""
    _line(process, values, line, MOVESP)


@command(1, MAX_AXES, MOTION)
def cmd_moveabs(process: Process, values: Values, line: int) -> None:
    """MOVEABS(position, ...): a straight line to these positions."""
    _line_to(process, values, line, MOVEABS)


@command(1, MAX_AXES, MOTION)
def cmd_moveabssp(process: Process, values: Values, line: int) -> None:
    """MOVEABSSP(position, ...): MOVEABS with FORCE_SPEED, STARTMOVE_SPEED and ENDMOVE_SPEED."""
    _line_to(process, values, line, MOVEABSSP)


@command(5, 5, MOTION)
def cmd_movecirc(process: Process, values: Values, line: int) -> None:
    """MOVECIRC(end x, end y, centre x, centre y, direction): an arc, its end and centre relative to its start."""
    _arc(process, values, line, MOVECIRC)


@command(5, 5, MOTION)
def cmd_movecircsp(process: Process, values: Values, line: int) -> None:
    """MOVECIRCSP(...): MOVECIRC with FORCE_SPEED, STARTMOVE_SPEED and ENDMOVE_SPEED."""
    _arc(process, values, line, MOVECIRCSP)


@command(6, 7, MOTION)
def cmd_mhelical(process: Process, values: Values, line: int) -> None:
    """MHELICAL(end x, end y, centre x, centre y, direction, rise[, mode]): an arc with an even climb."""
    _helix(process, values, line, MHELICAL)


@command(6, 7, MOTION)
def cmd_mhelicalsp(process: Process, values: Values, line: int) -> None:
    """MHELICALSP(...): MHELICAL with FORCE_SPEED, STARTMOVE_SPEED and ENDMOVE_SPEED."""
    _helix(process, values, line, MHELICALSP)


def _line(process: Process, values: Values, line: int, kind: int) -> None:
    _order_path(process, Move(kind, line, process.axes(len(values)), Straight(tuple(values))))


def _line_to(process: Process, values: Values, line: int, kind: int) -> None:
    _order_path(process, Move(kind, line, process.axes(len(values)), targets=tuple(values)))


def _arc(process: Process, values: Values, line: int, kind: int) -> None:
    ex, ey, cx, cy, direction = values
    shape = Arc((ex, ey), (cx, cy), switch("direction", direction))
    _order_path(process, Move(kind, line, process.axes(2), shape))


def _helix(process: Process, values: Values, line: int, kind: int) -> None:
    ex, ey, cx, cy, direction, rise, mode = (*values, 0.0)[:7]
    shape = Arc((ex, ey), (cx, cy), switch("direction", direction), rise, switch("mode", mode))
    _order_path(process, Move(kind, line, process.axes(3), shape))


def _order_path(process: Process, move: Move) -> None:
    """Order a move with the speeds and the rules of corners that hold now: they are buffered with it."""
    axis = process.state.motion.axis(move.axes[0])
    move.corners = axis.corners
    if move.kind in (MOVESP, MOVEABSSP, MOVECIRCSP, MHELICALSP):
        move.speeds = axis.speeds
    order(process, move)


MOST_POINTS = 32_000  # of a cam
# bits of the link options
REPEATS = 4
ABSOLUTE = 2
FORWARD_ONLY = 32


@command(0, 0, MOTION)
def cmd_forward(process: Process, values: Values, line: int) -> None:
    """FORWARD: on and on in the positive direction."""
    order(process, Move(FORWARD, line, process.axes(1), Jog(1.0)))


@command(0, 0, MOTION)
def cmd_reverse(process: Process, values: Values, line: int) -> None:
    """REVERSE: on and on in the negative direction."""
    order(process, Move(REVERSE, line, process.axes(1), Jog(-1.0)))


@command(2, 2, MOTION)
def cmd_connect(process: Process, values: Values, line: int) -> None:
    """CONNECT(ratio, axis): follow an axis in proportion."""
    order(process, Move(CONNECT, line, process.axes(1), driver=axis_number(process, values[1]), ratio=values[0]))


@command(4, 4, MOTION)
def cmd_cam(process: Process, values: Values, line: int) -> None:
    """CAM(first, last, scale, distance): run through positions of TABLE at SPEED."""
    first, last, scale, distance = values
    shape = _profile(process, first, last, scale, positive("distance", distance))
    order(process, Move(CAM, line, process.axes(1), shape))


@command(5, 7, MOTION)
def cmd_cambox(process: Process, values: Values, line: int) -> None:
    """CAMBOX(first, last, scale, link distance, link axis[, options[, position]]): a cam over a link axis."""
    first, last, scale, distance, link, *options = values
    shape = _profile(process, first, last, scale, positive("link distance", distance))
    order(process, _linked_move(process, CAMBOX, line, shape, link, options))


@command(5, 7, MOTION)
def cmd_movelink(process: Process, values: Values, line: int) -> None:
    """MOVELINK(distance, link distance, up, down, link axis[, options[, position]]): a ramp over a link axis."""
    distance, length, up, down, link, *options = values
    for name, value in (("acceleration", up), ("deceleration", down)):
        if value < 0:
            raise InputError(f"link distance of {name} = {value:g}: must be at least 0")
    shape = Ramps(distance, positive("link distance", length), up, down)
    order(process, _linked_move(process, MOVELINK, line, shape, link, options))


def _linked_move(process: Process, kind: int, line: int, shape: Shape, link: float, options: Values) -> Move:
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
        driver=axis_number(process, link),
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
    process.state.motion.superimpose(process.base[0], None if values[0] == -1 else axis_number(process, values[0]))


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
    numbers = tuple(axis_number(process, value) for value in values)
    if len(set(numbers)) < len(numbers):
        raise InputError(f"BASE{numbers}: must name an axis once")
    process.base = numbers


@command(2, 3)
def cmd_op(process: Process, values: Values, line: int) -> None:
    """OP(output, state): switch an output; OP(first, last, number): switch several by the bits of a number."""
    first = index("OP", values[0], MOST_OUTPUTS)
    last = first if len(values) == 2 else index("OP", values[1], MOST_OUTPUTS)
    if not 0 <= last - first < MOST_BITS:
        raise InputError(f"OP({first},{last}, ...): must be 1 to {MOST_BITS} outputs, the first one first")
    number = int(values[-1]) if len(values) == 3 else int(bool(values[1]))
    for output in range(first, last + 1):
        _note_haste(process, output, line)
        process.state.switched.add(output)
        if number >> (output - first) & 1:
            process.state.outputs.add(output)
        else:
            process.state.outputs.discard(output)


@command(1, 1, MOTION)
def cmd_datum(process: Process, values: Values, line: int) -> None:
    """DATUM(0): clear errors of the axes, of which there are none here."""
    if values[0] != 0:
        raise InputError(
            f"DATUM({values[0]:g}): homing is not simulated; the axes begin where `start` says: must be 0, which "
            "clears errors"
        )


def _without_effect(name: str) -> Action:
    def act(process: Process, values: Values, line: int) -> None:
        process.state.ignored.add(name)

    act.__name__ = f"{PREFIX}{name.lower()}"
    act.__doc__ = f"{name}: accepted without effect."
    return act


for _name, (_least, _most) in IGNORED_COMMANDS.items():
    command[_name] = Command(_without_effect(_name), _least, _most, STATEMENT)


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


COMMANDS: dict[str, Command] = command
