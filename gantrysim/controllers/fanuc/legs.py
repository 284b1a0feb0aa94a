"""The motions of a program: the path of a block, given its start, with feed, rotary axis and dispenser."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gantrysim.controllers.fanuc.alarm import Alarm
from gantrysim.controllers.fanuc.blocks import FRAMES, PLANES, Arc, Dwell, Line, Rapid, Spiral
from gantrysim.controllers.fanuc.program_text import SourceBlock
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.valve import Motions, Outputs, Valve, is_upright
from gantrysim.paths.pieces import Coil, Vector, vector
from gantrysim.paths.pieces import Line as Segment

Fail = Callable[[int, str], Alarm]  # an alarm's number and detail, to be raised

_ROUNDING = 1e-9
_NAMES = "xyz"
_CENTRE_WORDS = "IJK"
_SHORTEST_LINE = 1e-6  # length of a line; less is rounding of incremental coordinates [mm]


@dataclass(frozen=True)
class _Round:
    """A motion about a centre, in its plane as x + iy of the plane's axes [mm].

    Attributes:
        block: that is run.
        start: in space.
        end: in space.
        centre: of the rotation.
    """

    block: Arc | Spiral
    start: Vector
    end: Vector
    centre: complex

    @property
    def axes(self) -> tuple[int, int, int]:
        """The plane's axes and its normal."""
        return PLANES[self.block.plane]

    @property
    def begin_arm(self) -> complex:
        """From the centre to the start."""
        return _in_plane(self.block, self.start) - self.centre

    @property
    def end_arm(self) -> complex:
        """From the centre to the end."""
        return _in_plane(self.block, self.end) - self.centre

    @property
    def rise(self) -> float:
        """Change of the height above the plane."""
        across = self.axes[2]
        return self.end[across] - self.start[across]

    def coil(self, swept: float) -> Coil:
        """Return the path, given the angle swept [rad]."""
        first, second, across = self.axes
        place = [0.0, 0.0, 0.0]
        place[first] = self.centre.real
        place[second] = self.centre.imag
        place[across] = self.start[across]
        return Coil(
            centre=(place[0], place[1], place[2]),
            radius=(abs(self.begin_arm), abs(self.end_arm)),
            begin=math.atan2(self.begin_arm.imag, self.begin_arm.real),
            angle=-swept if self.block.clockwise else swept,
            rise=self.rise,
            frame=FRAMES[self.block.plane],
        )


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


def _in_plane(block: Arc | Spiral, point: Vector) -> complex:
    first, second, _ = PLANES[block.plane]
    return complex(point[first], point[second])


def _arc(block: Arc, start: Vector, end: Vector, tolerance: float, fail: Fail) -> Coil:
    a = _in_plane(block, start)
    if block.centre is not None:
        centre = a + complex(*block.centre)
    elif block.radius:
        ends = (a, _in_plane(block, end))
        centre = _centre_by_radius(ends, block.radius, block.clockwise, tolerance, fail)
    else:
        raise fail(22, "arc without a centre and without a radius: must have I, J, K of its plane, or R")
    turn = _Round(block, start, end, centre)
    radius = abs(turn.begin_arm)
    reached = abs(turn.end_arm)
    if radius < _ROUNDING:
        raise fail(22, "radius = 0 mm: must be greater than 0 mm; I, J, K are relative to the start")
    if abs(reached - radius) > tolerance:
        raise fail(
            20,
            f"radius = {radius:.6g} mm at the start, {reached:.6g} mm at the end: "
            f"difference {abs(reached - radius):.4g} mm must be at most radius_tolerance, {tolerance:g} mm",
        )
    return turn.coil(_angle(turn))


def _centre_by_radius(
    ends: tuple[complex, complex], radius: float, clockwise: bool, tolerance: float, fail: Fail
) -> complex:
    a, b = ends
    chord = b - a
    if abs(chord) < _ROUNDING:
        raise fail(22, "arc by R that ends at its start: has no centre; use I, J, K")
    square = radius**2 - 0.25 * abs(chord) ** 2
    # R and the ends of half a circle are rounded
    if square < 0 and 0.5 * abs(chord) - abs(radius) > tolerance:
        raise fail(20, f"R = {radius:g} mm: must be at least half the chord, {0.5 * abs(chord):.6g} mm")
    # counter-clockwise, an arc of less than half a circle has its centre to the left of the chord
    side = 1.0 if (radius > 0) != clockwise else -1.0
    return a + 0.5 * chord + side * 1j * chord / abs(chord) * math.sqrt(max(square, 0.0))


def _spiral(block: Spiral, start: Vector, end: Vector, tolerance: float, fail: Fail) -> Coil:
    turn = _Round(block, start, end, _in_plane(block, start) + complex(*block.centre))
    radius = abs(turn.begin_arm)
    reached = abs(turn.end_arm)
    across = turn.axes[2]
    if block.compensation and min(radius, reached) < _ROUNDING:
        end_name = "start" if radius < _ROUNDING else "end"
        raise fail(5124, f"{end_name} at the centre under cutter compensation: must be away from it")
    if radius < _ROUNDING:
        raise fail(5122, "radius at the start = 0 mm: must be greater than 0 mm")
    if block.height_per_turn is not None and abs(turn.rise) < _ROUNDING:
        word = _CENTRE_WORDS[across]
        axis = _NAMES[across].upper()
        raise fail(5122, f"height per turn {word} without a height: must come with an end {axis}")
    # an end at the centre has no direction: a whole turn leads there
    part = _angle(turn) if reached > _ROUNDING else 2 * math.pi
    turns = _turns(block, turn, part / (2 * math.pi), tolerance, fail)
    if block.change is not None:
        _compare(("radius", "Q"), radius + turns * block.change, reached, tolerance, fail)
    if block.height_per_turn is not None:
        words = ("height", _CENTRE_WORDS[across])
        _compare(words, start[across] + turns * block.height_per_turn, end[across], tolerance, fail)
    return turn.coil(2 * math.pi * turns)


def _turns(block: Spiral, turn: _Round, part: float, tolerance: float, fail: Fail) -> float:
    """Number of turns: whole ones, and the part from the start's direction to the end's, 0 < part <= 1."""
    if block.change is not None:
        step = block.change
        total = abs(turn.end_arm) - abs(turn.begin_arm)
        name = "Q"
    elif block.height_per_turn is not None:
        step = block.height_per_turn
        total = turn.rise
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


def _compare(words: tuple[str, str], computed: float, programmed: float, tolerance: float, fail: Fail) -> None:
    """Check a length at the end that two words of the block determine, of which the first one says what it is."""
    name, word = words
    if abs(computed - programmed) > tolerance:
        raise fail(
            5123,
            f"{name} at the end = {computed:.6g} mm by {word}, {programmed:.6g} mm by the end point: "
            f"difference {abs(computed - programmed):.4g} mm must be at most end_point_tolerance, {tolerance:g} mm",
        )


def _angle(turn: _Round) -> float:
    """Angle from the start to the end in the sense of rotation, a full turn if they are equal [rad]."""
    angle = float(np.angle(turn.end_arm / turn.begin_arm)) * (-1 if turn.block.clockwise else 1)
    angle = angle % (2 * math.pi)
    return 2 * math.pi if angle < _ROUNDING or 2 * math.pi - angle < _ROUNDING else angle


@dataclass(frozen=True)
class PathLeg:
    """One motion.

    Attributes:
        source: the block.
        start: its start [mm].
        piece: its path, None if at most the rotary axis moves.
        rotary: angle of the rotary axis at its start and end [deg].
        feed: programmed path speed, or speed of the rotary axis alone [mm/s, deg/s].
        compensation: cutter compensation, positive to the left [mm].
        exact_stop: whether to stop at its end.
        spiral: whether it is a spiral or a cone, with stops before and after.
        dispense: whether glue is laid.
        dwell: time of a stop [s].
        rapid: whether it is run at the rapid feed.
    """

    source: SourceBlock
    start: Vector
    piece: Segment | Coil | None
    rotary: tuple[float, float]
    feed: float
    compensation: float = 0.0
    exact_stop: bool = False
    spiral: bool = False
    dispense: bool = False
    dwell: float = 0.0
    rapid: bool = False

    @property
    def plane(self) -> str:
        """The block's plane; XY for a stop."""
        block = self.source.block
        return "xy" if isinstance(block, Dwell) else block.plane

    @property
    def is_upright(self) -> bool:
        """Whether it leads straight up or down."""
        return isinstance(self.piece, Segment) and is_upright(self.piece.start, self.piece.end)

    @property
    def climbs(self) -> bool:
        """Whether it changes the height above the XY plane."""
        if isinstance(self.piece, Segment):
            return self.piece.start[2] != self.piece.end[2]
        return self.piece is not None and self.piece.rise != 0


def legs_of(
    blocks: tuple[SourceBlock, ...], start: Vector, rapid: float, end_tolerance: float, arc_tolerance: float
) -> list[PathLeg]:
    """Return the consecutive motions of blocks.

    Args:
        blocks: of the program.
        start: initial position [mm].
        rapid: feed of rapid moves [mm/min].
        end_tolerance: of a spiral's end point [mm].
        arc_tolerance: of an arc's radius at its end [mm].

    Raises:
        Alarm: a block that cannot be run from the end of the one before.
    """
    legs = []
    here = start
    angle = 0.0
    # in force; a rapid move leaves it as it is
    feed: float | None = None
    for line in blocks:
        block = line.block
        if isinstance(block, Dwell):
            legs.append(PathLeg(line, here, None, (angle, angle), 0.0, dispense=block.dispense, dwell=block.time))
            continue
        if not isinstance(block, Rapid) and block.feed is not None:
            feed = block.feed
        speed = rapid if isinstance(block, Rapid) else feed
        if speed is None:
            raise line.fail(11, "a motion at feed must have an F, in its block or before")
        piece = piece_of(block, here, end_tolerance, arc_tolerance, line.fail)
        # a line without a length has no direction: only the rotary axis moves, if it does
        still = isinstance(piece, Segment) and math.dist(piece.start, piece.end) <= _SHORTEST_LINE
        turned = angle if block.rotary is None else block.rotary
        is_dry = isinstance(block, Rapid) or (isinstance(piece, Segment) and is_upright(piece.start, piece.end))
        dispense = not is_dry if block.dispense is None else block.dispense
        legs.append(
            PathLeg(
                source=line,
                start=here,
                piece=None if still else piece,
                rotary=(angle, turned),
                feed=speed / 60,
                compensation=block.compensation,
                exact_stop=block.exact_stop,
                spiral=isinstance(block, Spiral),
                rapid=isinstance(block, Rapid),
                dispense=dispense and not still,
            )
        )
        x, y, z = (there if there is not None else now for there, now in zip(block.end, here, strict=True))
        here = (x, y, z)
        angle = turned
    return legs


def switched_legs(legs: list[PathLeg], outputs: Outputs, upward: float) -> tuple[list[PathLeg], Valve]:
    """Return the motions of a text with the glue that its valve lays, and the valve.

    Args:
        legs: the motions.
        outputs: which the text switches.
        upward: sign of the program's z on the work, -1 where it is a depth.
    """
    dwells = np.array([isinstance(leg.source.block, Dwell) for leg in legs], bool)
    heights = np.array([leg.start[2] for leg in legs], float)
    turns = np.array([leg.piece is None for leg in legs], bool) & ~dwells
    motions = Motions(
        work=np.array([leg.dispense for leg in legs], bool),
        dwell=dwells,
        rise=upward * np.append(np.diff(heights), 0.0)[: len(legs)],
        upright=np.array([leg.is_upright for leg in legs], bool),
        feeds=np.zeros(len(legs), bool),
        is_on=lambda output: np.array([output in leg.source.outputs for leg in legs], bool),
    )
    valve = outputs.valve(motions)
    laid = valve.laid & ~turns
    return [replace(leg, dispense=lays) for leg, lays in zip(legs, laid.tolist(), strict=True)], valve


def placed_legs(legs: list[PathLeg], placement: Placement) -> list[PathLeg]:
    """Return the motions where a program lies on the work."""
    if placement == Placement():
        return legs
    return [replace(leg, start=placement.place(leg.start), piece=_piece(leg.piece, placement)) for leg in legs]


def _piece(piece: Segment | Coil | None, placement: Placement) -> Segment | Coil | None:
    if piece is None:
        return None
    u, v = (vector(placement.direction(axis) / placement.scale) for axis in piece.frame)
    if isinstance(piece, Segment):
        return Segment(placement.place(piece.start), placement.place(piece.end), (u, v))
    first, last = piece.radius
    scale = placement.scale
    return replace(
        piece,
        centre=placement.place(piece.centre),
        radius=(scale * first, scale * last),
        rise=scale * placement.upward * piece.rise,  # along u x v, which a mirrored frame turns round
        frame=(u, v),
    )
