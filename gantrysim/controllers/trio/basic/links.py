"""Linked axes: how far CONNECT, ADDAX, CAMBOX and MOVELINK move an axis when others move."""

from __future__ import annotations

import math
from collections.abc import Callable

from gantrysim.controllers.trio.basic.axis import Axis
from gantrysim.controllers.trio.basic.moves import CONNECT, Move

End = Callable[[Axis], None]


def follow(axes: dict[int, Axis], linked: dict[int, Move], steps: dict[int, float], end: End) -> None:
    """Add the motion of linked axes within a period.

    Args:
        axes: by their numbers.
        linked: moves linked to another axis at the beginning of the period, by the numbers of their axes.
        steps: of the axes with a profile, to which those of the others are added [units].
        end: ends the move of an axis, and loads the next.
    """
    done: set[int] = set()

    def total(axis: Axis) -> float:
        if axis.number not in done:
            done.add(axis.number)
            move = linked.get(axis.number)
            if move is not None and move.driver is not None:
                link = axes[move.driver]
                steps[axis.number] += _linked(axis, move, total(link), link.units / axis.units, end)
            if axis.superimposed is not None:
                added = axes[axis.superimposed]
                steps[axis.number] += total(added) * added.units / axis.units
        return steps[axis.number]

    for axis in axes.values():
        total(axis)


def _linked(axis: Axis, move: Move, driven: float, edges: float, end: End) -> float:
    """Motion of a linked axis, given that of its link axis, and the ratio of their UNITS."""
    if move.kind == CONNECT:
        return move.ratio * driven * edges
    s = move.s + (max(driven, 0.0) if move.forward_only else driven)
    step = 0.0
    while move.link_start is None or s >= 0:
        move.link_start = None
        full = move.shape.length
        if move.repeats:
            rounds = math.floor(s / full)
            step += rounds * move.shape.displacement(full)[0]
            s -= rounds * full
        if s < full:
            break
        step += move.shape.displacement(full)[0] - move.displaced[0]
        move.finished = True
        move.s = full
        follows = axis.queue[0] if axis.queue else None
        end(axis)
        if axis.move is None or axis.move is not follows or follows.driver != move.driver or follows.kind == CONNECT:
            return step
        # nothing of the link axis' motion is lost
        s = s - full
        move = follows
        move.start = (axis.position + step,)
    displaced = move.shape.displacement(s)
    step += displaced[0] - move.displaced[0]
    move.s = s
    move.displaced = displaced
    return step
