"""Arcs and helices by their centre or radius."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.move_table import ARC, PLANES, MoveRow, centre_by_radius, swept_angle
from gantrysim.controllers.gcode.program_state import FARTHEST, ProgramState, WordBlock

_CENTRES = "IJK"
_LENGTHS = "IJKR"
_MOST_TURNS = 10_000
_SMALLEST_RADIUS = 1e-6  # radius [mm]
_RELATIVE = 1e-3  # difference of an arc's radii, of the radius
_WORST = 100  # times the tolerance, which the relative one does not excuse
_COARSE_TOLERANCE = 2.54  # times the tolerance, in inches


@dataclass(frozen=True)
class _Arc:
    """An arc in its plane, as x + iy of the plane's axes, in the program's coordinates [mm]."""

    start: complex
    end: complex
    centre: complex
    angle: float

    @property
    def length(self) -> float:
        """In the plane; of a spiral, with radii that differ within the tolerance, nearly [mm]."""
        radius = 0.5 * (abs(self.start - self.centre) + abs(self.end - self.centre))
        return self.angle * radius


def add_arc(state: ProgramState, block: WordBlock, clockwise: bool) -> None:
    """Add an arc, with the words X Y Z I J K R P of a block, seen against the plane's normal."""
    state.spline_control = None
    frames = state.frames
    modes = state.modes
    values = block.values
    for letter in _LENGTHS:
        if letter in values:
            values[letter] *= frames.unit
    u, v, w = PLANES[modes.plane]
    turns = values.pop("P", 1.0)
    if turns != int(turns) or not 1 <= turns <= _MOST_TURNS:
        raise InputError(f"P = {turns:g}: must be a whole number of turns, from 1 to {_MOST_TURNS}")
    start = frames.here
    before = frames.program(start)
    end = frames.end(values, in_machine=False)
    after = frames.program(end)
    arc = _arc(state, block, (complex(before[u], before[v]), complex(after[u], after[v])), clockwise, int(turns))
    centre = list(before)
    centre[u] = arc.centre.real
    centre[v] = arc.centre.imag
    placed = frames.machine(centre)
    if modes.plane and frames.turns[frames.system]:
        raise InputError(f"G{17 + modes.plane} arc under a turned coordinate system: must be in G17")
    feed = state.feed_at(math.hypot(arc.length, end[w] - start[w]))
    if not max(*map(abs, end), *map(abs, placed)) <= FARTHEST:
        raise InputError(f"arc to {[round(c, 3) for c in end]} mm: must be within {FARTHEST:g} mm")
    x, y, z = end
    state.add(
        MoveRow(
            kind=ARC,
            x=x,
            y=y,
            z=z,
            u=placed[u],
            v=placed[v],
            plane=modes.plane,
            angle=arc.angle,
            feed=feed,
            mode=modes.path,
            naive=modes.naive,
            work=True,
            source=state.line,
            flow=block.fed,
            limits=state.limits.index(block.fed > 0),
            outputs=state.outputs.index,
            advance=state.extruder.index,
            analogue=state.flow_value,
        )
    )


def _arc(state: ProgramState, block: WordBlock, ends: tuple[complex, complex], clockwise: bool, turns: int) -> _Arc:
    """The arc between two points of the plane, by the words of its centre or R."""
    plane = state.modes.plane
    first, second, across = (_CENTRES[axis] for axis in PLANES[plane])
    start, end = ends
    i = block.values.pop(first, None)
    j = block.values.pop(second, None)
    if block.values.get(across) == 0:
        del block.values[across]
        refused = "" if state.dialect.lenient else ", which LinuxCNC itself refuses"
        state.ignored[f"{across}0 of arcs in G{17 + plane}{refused}"] += 1
    if across in block.values:
        raise InputError(f"{across} in G{17 + plane}: the centre must be given in the plane")
    radius = block.values.pop("R", None)
    if radius is not None:
        if i is not None or j is not None:
            raise InputError("arc by R and by its centre: must be one of them")
        centre = centre_by_radius(start, end, radius, clockwise, state.setup.arc_tolerance)
    elif i is None and j is None:
        raise InputError(f"arc without {first}, {second} and R: must have a centre or a radius")
    else:
        centre = complex(i or 0.0, j or 0.0) + (0.0 if state.modes.centres else start)
    _check_radii(state, abs(start - centre), abs(end - centre), (first, second))
    return _Arc(start, end, centre, swept_angle(start - centre, end - centre, clockwise, turns))


def _check_radii(state: ProgramState, radius: float, reached: float, words: tuple[str, str]) -> None:
    """Check that the end lies on the arc: coordinates are rounded, in inches to coarser steps."""
    centre = "{}, {}".format(*words)
    if radius < _SMALLEST_RADIUS:
        raise InputError(f"the start of the arc is its centre, by {centre}: radius = 0 mm must be greater than 0 mm")
    if reached < _SMALLEST_RADIUS:
        raise InputError(
            f"the end of the arc is its centre, by {centre}: radius = {radius:.6g} mm at the start, 0 mm at the end"
        )
    error = abs(radius - reached)
    tolerance = state.setup.arc_tolerance * (1.0 if state.frames.unit == 1.0 else _COARSE_TOLERANCE)
    if error > _WORST * tolerance or (error > tolerance and error > _RELATIVE * max(radius, reached)):
        raise InputError(
            f"radius = {radius:.6g} mm at the start, {reached:.6g} mm at the end: difference {error:.4g} mm "
            f"must be at most arc_tolerance, {tolerance:g} mm"
        )
