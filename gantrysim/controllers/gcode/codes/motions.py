"""Modal group of motion: lines, arcs, splines and canned cycles; and the dwell.

A cycle goes at every place down to the depth and up again, as in drilling, or as a needle lays dots. The place is
reached at the rapid speed, at the height before; then the needle goes to R at the rapid speed, to the depth
at feed, and up: to the height before the first cycle of a series (G98), or to R (G99).
"""

from __future__ import annotations

import math
from collections.abc import Callable

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.codes.code_table import LINUXCNC, action, motion, setting
from gantrysim.controllers.gcode.curves import (
    add_arc,
    add_cubic,
    add_knot,
    add_quadratic,
    add_uniform_point,
    end_uniform,
)
from gantrysim.controllers.gcode.move_table import EXACT_PATH, PLANES
from gantrysim.controllers.gcode.program_state import CycleSeries, ProgramState, WordBlock

_LINUXCNC = (LINUXCNC,)
_CLEARANCE = 1.0  # by which pecks lift the needle, LinuxCNC's on a metric machine [mm]
_MOST_REPEATS = 10_000
_MOST_PECKS = 10_000
_TIME_WORDS = "P"  # words that are no lengths


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
        stated = f" of {min(times):g} s" if times else ""
        raise InputError(f"G4{stated}: must have {letters}, at least 0")
    state.pause(times[0])


class _Stroke:
    """The way down and up at a place.

    Args:
        state: of the program.
        words: of the cycle: P [s], Q and D [mm].
        clear: height at which it begins, R [mm].
        bottom: the depth [mm].
        up: height at which it ends [mm].
    """

    def __init__(self, state: ProgramState, words: dict[str, float], clear: float, bottom: float, up: float) -> None:
        self.words = words
        self.clear = clear
        self.bottom = bottom
        self.up = up
        self._state = state
        self._axis = PLANES[state.modes.plane][2]
        # glue is laid in the dwell at the bottom, not on the way
        self._lays_dots = words.get("P", 0.0) > 0

    def rapid(self, height: float) -> None:
        self._state.rapid_to(self._place(height))

    def feed(self, height: float) -> None:
        place = self._place(height)
        feed = self._state.feed_at(math.dist(self._state.frames.here, place))
        self._state.line_to(place, feed, at_work=not self._lays_dots)

    def dwell(self) -> None:
        if self._lays_dots:
            self._state.pause(self.words["P"], at_work=True)

    def peck(self, lift: Callable[[float], float]) -> None:
        """Go to the bottom in steps of Q, and lift the needle between them.

        Args:
            lift: returns the height to which the needle is lifted from a depth [mm].
        """
        step = self.words["Q"]
        if step <= 0 or self.clear - self.bottom > _MOST_PECKS * step:
            raise InputError(f"Q = {step:g} mm: must be above 0, for at most {_MOST_PECKS} steps")
        clearance = self.words.get("D", _CLEARANCE)
        depth = self.clear - step
        while depth > self.bottom:
            self.feed(depth)
            self.rapid(lift(depth))
            self.rapid(depth + clearance)
            depth -= step
        self.feed(self.bottom)

    def _place(self, height: float) -> list[float]:
        frames = self._state.frames
        place = frames.program(frames.here)
        place[self._axis] = height
        return frames.machine(place)


Strokes = Callable[[_Stroke], None]


def _run_cycle(state: ProgramState, block: WordBlock, strokes: Strokes, *, needs: str = "", takes: str = "") -> None:
    """Run a cycle at its places.

    Args:
        state: of the program.
        block: with its words.
        strokes: the way down, and up where that is at feed.
        needs: words that it needs, beside R and the depth; they stay in force in a series.
        takes: words that it may have.
    """
    name = state.motion
    frames = state.frames
    modes = state.modes
    if modes.feed_mode == "G93":
        raise InputError(f"{name} in G93: must have a feed per minute or revolution")
    axis = PLANES[modes.plane][2]
    depth = "XYZ"[axis]
    if state.cycle is None:
        state.cycle = CycleSeries(frames.program(frames.here)[axis])
    series = state.cycle
    words = _words(state, block, name, (depth, "R", *needs), takes)
    clear = words["R"] + (0.0 if frames.absolute else series.level)
    bottom = words[depth] + (0.0 if frames.absolute else clear)
    if clear < bottom:
        raise InputError(f"{name}: R at {depth} = {clear:g} mm must not be below the depth, {bottom:g} mm")
    repeats = block.values.pop("L", 1.0)
    if repeats != int(repeats) or not 1 <= repeats <= _MOST_REPEATS:
        raise InputError(f"L = {repeats:g}: must be a whole number of repeats, from 1 to {_MOST_REPEATS}")
    place = {letter: block.values.pop(letter) for letter in "XYZ@^" if letter in block.values}
    up = clear if state.retracts_to_r else max(series.level, clear)
    path = (modes.path, modes.naive)
    modes.path = EXACT_PATH
    modes.naive = 0.0
    stroke = _Stroke(state, words, clear, bottom, up)
    if frames.program(frames.here)[axis] < clear:
        stroke.rapid(clear)
    for _ in range(int(repeats)):
        state.rapid_to(frames.end(dict(place), in_machine=False))
        stroke.rapid(clear)
        strokes(stroke)
        stroke.rapid(up)
    modes.path, modes.naive = path


def _words(state: ProgramState, block: WordBlock, name: str, needed: tuple[str, ...], takes: str) -> dict[str, float]:
    """Take the words of a cycle from its block, or from the cycle before where that has the same code [mm or s]."""
    assert state.cycle is not None
    words = dict(state.cycle.words) if state.cycle.name == name else {}
    for letter in (*needed, *takes):
        if letter in block.values:
            words[letter] = block.values.pop(letter) * (1.0 if letter in _TIME_WORDS else state.frames.unit)
    missing = [letter for letter in needed if letter not in words]
    if missing:
        raise InputError(f"{name} without {missing[0]}: must have {', '.join(needed)}")
    if words.get("P", 0.0) < 0:
        raise InputError(f"{name}: P = {words['P']:g} s: must be at least 0 s")
    state.cycle.name = name
    state.cycle.words = words
    return words


def _down(stroke: _Stroke) -> None:
    stroke.feed(stroke.bottom)


def _down_and_wait(stroke: _Stroke) -> None:
    stroke.feed(stroke.bottom)
    stroke.dwell()


def _down_and_up(stroke: _Stroke) -> None:
    _down_and_wait(stroke)
    stroke.feed(stroke.up)


def _down_and_up_to_r(stroke: _Stroke) -> None:
    _down(stroke)
    stroke.feed(stroke.clear)


@motion(dialects=_LINUXCNC, is_cycle=True)
def g73(state: ProgramState, block: WordBlock) -> None:
    """Drilling cycle that breaks chips: steps of Q, lifted by D between them."""

    def strokes(stroke: _Stroke) -> None:
        stroke.peck(lambda depth: depth)

    _run_cycle(state, block, strokes, needs="Q", takes="D")


@motion(dialects=_LINUXCNC, is_cycle=True)
def g74(state: ProgramState, block: WordBlock) -> None:
    """Tapping cycle to the left: down at feed, dwell of P, up at feed."""
    _run_cycle(state, block, _down_and_up, takes="P")


@motion(dialects=_LINUXCNC, is_cycle=True)
def g81(state: ProgramState, block: WordBlock) -> None:
    """Drilling cycle: down at feed, up."""
    _run_cycle(state, block, _down)


@motion(dialects=_LINUXCNC, is_cycle=True)
def g82(state: ProgramState, block: WordBlock) -> None:
    """Drilling cycle with a dwell of P, in which a needle lays a dot."""
    _run_cycle(state, block, _down_and_wait, needs="P")


@motion(dialects=_LINUXCNC, is_cycle=True)
def g83(state: ProgramState, block: WordBlock) -> None:
    """Drilling cycle that clears chips: steps of Q, between them up to R."""

    def strokes(stroke: _Stroke) -> None:
        stroke.peck(lambda depth: stroke.clear)

    _run_cycle(state, block, strokes, needs="Q", takes="D")


@motion(dialects=_LINUXCNC, is_cycle=True)
def g84(state: ProgramState, block: WordBlock) -> None:
    """Tapping cycle to the right: down at feed, dwell of P, up at feed."""
    _run_cycle(state, block, _down_and_up, takes="P")


@motion(dialects=_LINUXCNC, is_cycle=True)
def g85(state: ProgramState, block: WordBlock) -> None:
    """Boring cycle: down and up to R at feed."""
    _run_cycle(state, block, _down_and_up_to_r)


@motion(dialects=_LINUXCNC, is_cycle=True)
def g86(state: ProgramState, block: WordBlock) -> None:
    """Boring cycle with a dwell of P; the spindle stops before the way up."""
    _run_cycle(state, block, _down_and_wait, needs="P")


@motion(dialects=_LINUXCNC, is_cycle=True)
def g89(state: ProgramState, block: WordBlock) -> None:
    """Boring cycle with a dwell of P; up at feed."""
    _run_cycle(state, block, _down_and_up, needs="P")


@motion(dialects=_LINUXCNC)
def g80(state: ProgramState, block: WordBlock) -> None:
    """No cycle, and no motion until the next code of one."""
    raise InputError(
        "axis words while no motion is in force, as at the start and after G80: must follow its code, as G0 or G1"
    )


@setting("retraction", _LINUXCNC)
def g98(state: ProgramState, block: WordBlock) -> None:
    """Canned cycles retract to the height before their series."""
    state.retracts_to_r = False


@setting("retraction", _LINUXCNC)
def g99(state: ProgramState, block: WordBlock) -> None:
    """Canned cycles retract to R."""
    state.retracts_to_r = True
