"""Modal group of motion: lines, arcs and splines; and the dwell."""

from __future__ import annotations

import math

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.arcs import add_arc
from gantrysim.controllers.gcode.codes.code import LINUXCNC, action, motion
from gantrysim.controllers.gcode.splines import add_cubic, add_quadratic
from gantrysim.controllers.gcode.state import Block, State


@motion(straight=True)
def g0(state: State, block: Block) -> None:
    """Rapid move; printers run it at the feed."""
    if state.dialect.extrudes:
        g1(state, block)
        return
    state.spline_control = None
    state.rapid_to(state.frames.end(block.values, block.in_machine))


@motion(straight=True)
def g1(state: State, block: Block) -> None:
    """Line at feed."""
    state.spline_control = None
    start = state.frames.here
    end = state.frames.end(block.values, block.in_machine)
    state.line_to(end, state.feed_at(math.dist(start, end)), block.fed)


@motion(moved_by="IJKR")
def g2(state: State, block: Block) -> None:
    """Arc or helix, clockwise."""
    add_arc(state, block, clockwise=True)


@motion(moved_by="IJKR")
def g3(state: State, block: Block) -> None:
    """Arc or helix, counter-clockwise."""
    add_arc(state, block, clockwise=False)


@motion(moved_by="IJPQ", dialects=(LINUXCNC,))
def g5(state: State, block: Block) -> None:
    """Cubic spline; I J and P Q are the control points, from the start and from the end."""
    add_cubic(state, block)


@motion(moved_by="IJPQ")
def g5_1(state: State, block: Block) -> None:
    """Quadratic spline; I J is the control point, from the start."""
    add_quadratic(state, block)


@action(shares_words=True)
def g4(state: State, block: Block) -> None:
    """Dwell of P, or as printers have it S."""
    words = state.dialect.dwell
    times = [block.values.pop(letter) * unit for letter, unit in words if letter in block.values]
    if not times or min(times) < 0:
        letters = " or ".join(letter for letter, _ in words)
        raise InputError(f"G4: must have {letters}, at least 0")
    state.pause(times[0])
