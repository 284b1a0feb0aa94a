"""The commands that move axes along lines and arcs, with and without speeds of their own."""

from __future__ import annotations

from gantrysim.controllers.trio.basic.command_table import MAX_AXES, MOTION, CommandTable, Values, order, switch
from gantrysim.controllers.trio.basic.moves import (
    MHELICAL,
    MHELICALSP,
    MOVE,
    MOVEABS,
    MOVEABSSP,
    MOVECIRC,
    MOVECIRCSP,
    MOVESP,
    Arc,
    Move,
    Straight,
)
from gantrysim.controllers.trio.basic.process import Process

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
