"""Modal group of motion: lines, arcs and splines; and the dwell."""

from __future__ import annotations

import math

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.codes.code_table import LINUXCNC, action, motion, setting
from gantrysim.controllers.gcode.program_state import ProgramState, WordBlock
from gantrysim.controllers.gcode.round_moves import add_arc
from gantrysim.controllers.gcode.splines import add_cubic, add_knot, add_quadratic, add_uniform_point, end_uniform


@motion(straight=True)
def g0(state: ProgramState, block: WordBlock) -> None:
    """Rapid move; printers run it at the feed."""
    state.spline_control = None
    if state.dialect.extrudes:
        _line_at_feed(state, block, at_work=False)
    else:
        state.rapid_to(state.frames.end(block.values, block.in_machine))


@motion(straight=True)
def g1(state: ProgramState, block: WordBlock) -> None:
    """Line at feed."""
    state.spline_control = None
    _line_at_feed(state, block, at_work=True)


def _line_at_feed(state: ProgramState, block: WordBlock, at_work: bool) -> None:
    start = state.frames.here
    end = state.frames.end(block.values, block.in_machine)
    state.line_to(end, state.feed_at(math.dist(start, end)), block.fed, at_work=at_work)


@motion(moved_by="IJKR")
def g2(state: ProgramState, block: WordBlock) -> None:
    """Arc or helix, clockwise."""
    add_arc(state, block, clockwise=True)


@motion(moved_by="IJKR")
def g3(state: ProgramState, block: WordBlock) -> None:
    """Arc or helix, counter-clockwise."""
    add_arc(state, block, clockwise=False)


@motion(moved_by="IJPQ", dialects=(LINUXCNC,))
def g5(state: ProgramState, block: WordBlock) -> None:
    """Cubic spline; I J and P Q are the control points, from the start and from the end."""
    add_cubic(state, block)


@motion(moved_by="IJPQ")
def g5_1(state: ProgramState, block: WordBlock) -> None:
    """Quadratic spline; I J is the control point, from the start."""
    add_quadratic(state, block)


@motion(moved_by="PL", dialects=(LINUXCNC,))
def g5_2(state: ProgramState, block: WordBlock) -> None:
    """Control point of a NURBS that begins where the nozzle is; P is its weight, L the order of the curve."""
    add_uniform_point(state, block)


@setting("motion", (LINUXCNC,))
def g5_3(state: ProgramState, block: WordBlock) -> None:
    """The NURBS of the control points of G5.2."""
    end_uniform(state)


@motion(moved_by="KRPQ", dialects=(LINUXCNC,))
def g6_2(state: ProgramState, block: WordBlock) -> None:
    """Control point of a NURBS; P is the order of the curve, R the weight, K the knot."""
    add_knot(state, block)


@action(shares_words=True)
def g4(state: ProgramState, block: WordBlock) -> None:
    """Dwell of P, or as printers have it S; a printer's G4 without both waits for the moves before it."""
    words = state.dialect.dwell
    times = [block.values.pop(letter) * unit for letter, unit in words if letter in block.values]
    if not times and state.dialect.lenient:
        times = [0.0]
    if not times or min(times) < 0:
        letters = " or ".join(letter for letter, _ in words)
        raise InputError(f"G4: must have {letters}, at least 0")
    state.pause(times[0])
