"""The path of a block, given its start."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gantrysim.controllers.fanuc.alarm import Alarm
from gantrysim.controllers.fanuc.blocks import FRAMES, PLANES, Arc, Line, Rapid, Spiral
from gantrysim.paths.pieces import Coil, Vector
from gantrysim.paths.pieces import Line as Segment

Fail = Callable[[int, str], Alarm]  # an alarm's number and detail, to be raised

_ROUNDING = 1e-9
_NAMES = "xyz"
_CENTRE_WORDS = "IJK"


def piece_of(
    block: Rapid | Line | Arc | Spiral, start: Vector, end_tolerance: float, arc_tolerance: float, fail: Fail
) -> Segment | Coil:
    """Return the path of a block.

    Args:
        block: to run.
        start: its start, (3,) [mm].
        end_tolerance: of a spiral's end point [mm].
        arc_tolerance: of an arc's radius at its end [mm].
        fail: makes the alarm.
    """
    x, y, z = (there if there is not None else here for there, here in zip(block.end, start, strict=True))
    if isinstance(block, Spiral):
        return _spiral(block, start, (x, y, z), end_tolerance, fail)
    if isinstance(block, Arc):
        return _arc(block, start, (x, y, z), arc_tolerance, fail)
    return Segment(start, (x, y, z), FRAMES[block.plane])


def _arc(block: Arc, start: Vector, end: Vector, tolerance: float, fail: Fail) -> Coil:
    first, second, across = PLANES[block.plane]
    a = complex(start[first], start[second])
    b = complex(end[first], end[second])
    if block.centre is not None:
        centre = a + complex(*block.centre)
    elif block.radius:
        centre = _centre_by_radius(a, b, block.radius, block.clockwise, fail)
    else:
        raise fail(22, "arc without a centre and without a radius: must have I, J, K of its plane, or R")
    radius = abs(a - centre)
    reached = abs(b - centre)
    if radius < _ROUNDING:
        raise fail(22, "radius = 0 mm: must be greater than 0 mm; I, J, K are relative to the start")
    if abs(reached - radius) > tolerance:
        raise fail(
            20,
            f"radius = {radius:.6g} mm at the start, {reached:.6g} mm at the end: "
            f"difference {abs(reached - radius):.4g} mm must be at most {tolerance:g} mm",
        )
    swept = _angle(a - centre, b - centre, block.clockwise)
    return _coil(block.plane, start, centre, (radius, reached), swept, end[across] - start[across], block.clockwise)


def _centre_by_radius(a: complex, b: complex, radius: float, clockwise: bool, fail: Fail) -> complex:
    chord = b - a
    if abs(chord) < _ROUNDING:
        raise fail(22, "arc by R that ends at its start: has no centre; use I, J, K")
    square = radius**2 - 0.25 * abs(chord) ** 2
    if square < -_ROUNDING * radius**2:
        raise fail(20, f"R = {radius:g} mm: must be at least half the chord, {0.5 * abs(chord):.6g} mm")
    # counter-clockwise, an arc of less than half a circle has its centre to the left of the chord
    side = 1.0 if (radius > 0) != clockwise else -1.0
    return a + 0.5 * chord + side * 1j * chord / abs(chord) * math.sqrt(max(square, 0.0))


def _spiral(block: Spiral, start: Vector, end: Vector, tolerance: float, fail: Fail) -> Coil:
    first, second, across = PLANES[block.plane]
    a = complex(start[first], start[second])
    b = complex(end[first], end[second])
    centre = a + complex(*block.centre)
    radius = abs(a - centre)
    reached = abs(b - centre)
    rise = end[across] - start[across]
    if block.compensation and min(radius, reached) < _ROUNDING:
        end_name = "start" if radius < _ROUNDING else "end"
        raise fail(5124, f"{end_name} at the centre under cutter compensation: must be away from it")
    if radius < _ROUNDING:
        raise fail(5122, "radius at the start = 0 mm: must be greater than 0 mm")
    if block.height_per_turn is not None and abs(rise) < _ROUNDING:
        word = _CENTRE_WORDS[across]
        axis = _NAMES[across].upper()
        raise fail(5122, f"height per turn {word} without a height: must come with an end {axis}")
    turn = _angle(a - centre, b - centre, block.clockwise) if reached > _ROUNDING else 2 * math.pi
    turns = _turns(block, radius, reached, rise, turn / (2 * math.pi), tolerance, fail)
    if block.change is not None:
        _compare("radius", "Q", radius + turns * block.change, reached, tolerance, fail)
    if block.height_per_turn is not None:
        word = _CENTRE_WORDS[across]
        _compare("height", word, start[across] + turns * block.height_per_turn, end[across], tolerance, fail)
    swept = 2 * math.pi * turns
    return _coil(block.plane, start, centre, (radius, reached), swept, rise, block.clockwise)


def _turns(
    block: Spiral, radius: float, reached: float, rise: float, part: float, tolerance: float, fail: Fail
) -> float:
    """Number of turns: whole ones, and the part from the start's direction to the end's, 0 < part <= 1."""
    if block.change is not None:
        step = block.change
        total = reached - radius
        name = "Q"
    elif block.height_per_turn is not None:
        step = block.height_per_turn
        total = rise
        name = "height per turn"
    elif block.turns is not None:
        if block.turns < 1 or block.turns != int(block.turns):
            raise fail(5122, f"L = {block.turns:g}: must be a whole number of at least 1")
        return block.turns - 1 + part
    else:
        raise fail(5122, "spiral without Q, without a height per turn and without L: must have one of them")
    if step == 0:
        raise fail(5122, f"{name} = 0 mm: must not be 0 mm")
    whole = math.ceil(total / step - _ROUNDING) - 1
    # near a whole turn the rounding of the end point may make them one too many or too few
    for other in (whole - 1, whole + 1):
        if abs((whole + part) * step - total) > tolerance >= abs((other + part) * step - total):
            whole = other
    if whole + part <= 0:
        raise fail(
            5123, f"{name} = {step:g} mm leads away from the end point, {total:+.6g} mm: must have the same sign"
        )
    return whole + part


def _compare(what: str, word: str, computed: float, programmed: float, tolerance: float, fail: Fail) -> None:
    if abs(computed - programmed) > tolerance:
        raise fail(
            5123,
            f"{what} at the end = {computed:.6g} mm by {word}, {programmed:.6g} mm by the end point: "
            f"difference {abs(computed - programmed):.4g} mm must be at most {tolerance:g} mm",
        )


def _angle(begin: complex, end: complex, clockwise: bool) -> float:
    """Angle from one direction to another in the sense of rotation, a full turn if they are equal [rad]."""
    angle = float(np.angle(end / begin)) * (-1 if clockwise else 1)
    angle = angle % (2 * math.pi)
    return 2 * math.pi if angle < _ROUNDING or 2 * math.pi - angle < _ROUNDING else angle


def _coil(
    plane: str, start: Vector, centre: complex, radius: tuple[float, float], swept: float, rise: float, clockwise: bool
) -> Coil:
    first, second, across = PLANES[plane]  # type: ignore[index]
    place = [0.0, 0.0, 0.0]
    place[first], place[second], place[across] = centre.real, centre.imag, start[across]
    begin = math.atan2(start[second] - centre.imag, start[first] - centre.real)
    angle = -swept if clockwise else swept
    return Coil((place[0], place[1], place[2]), radius, begin, angle, rise, FRAMES[plane])  # type: ignore[index]
