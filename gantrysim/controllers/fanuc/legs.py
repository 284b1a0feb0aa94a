"""The motions of a program: pieces of path with feed, rotary axis and dispenser."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from gantrysim.controllers.fanuc.block_paths import piece_of
from gantrysim.controllers.fanuc.blocks import Dwell, Rapid, Spiral
from gantrysim.controllers.fanuc.program_text import SourceBlock
from gantrysim.controllers.placement import Placement
from gantrysim.controllers.valve import Motions, Outputs, Valve, is_upright
from gantrysim.paths.pieces import Coil, Line, Vector, vector

_SHORTEST = 1e-6  # length of a line; less is rounding of incremental coordinates [mm]


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
    piece: Line | Coil | None
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
        return isinstance(self.piece, Line) and is_upright(self.piece.start, self.piece.end)

    @property
    def climbs(self) -> bool:
        """Whether it changes the height above the XY plane."""
        if isinstance(self.piece, Line):
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
        still = isinstance(piece, Line) and math.dist(piece.start, piece.end) <= _SHORTEST
        turned = angle if block.rotary is None else block.rotary
        is_dry = isinstance(block, Rapid) or (isinstance(piece, Line) and is_upright(piece.start, piece.end))
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


def _piece(piece: Line | Coil | None, placement: Placement) -> Line | Coil | None:
    if piece is None:
        return None
    u, v = (vector(placement.direction(axis) / placement.scale) for axis in piece.frame)
    if isinstance(piece, Line):
        return Line(placement.place(piece.start), placement.place(piece.end), (u, v))
    first, last = piece.radius
    scale = placement.scale
    return replace(
        piece,
        centre=placement.place(piece.centre),
        radius=(scale * first, scale * last),
        rise=scale * placement.upward * piece.rise,  # along u x v, which a mirrored frame turns round
        frame=(u, v),
    )
