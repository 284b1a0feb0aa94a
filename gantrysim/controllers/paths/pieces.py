"""The pieces of a chain: lines and coils, in a plane or out of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.paths.lengths import arc_length
from gantrysim.errors import InputError

Vector = tuple[float, float, float]
Frame = tuple[Vector, Vector]  # first and second direction of a plane; a right-handed third is its normal

XY: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
ZX: Frame = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
YZ: Frame = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
XZ: Frame = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))

SHORTEST = 1e-9  # [mm], of a piece that is kept
_SQUARE = 1e-9  # scalar products of a frame's directions

# a piece as a row of numbers
ROW = np.dtype(
    [
        ("coil", bool),
        ("frame", float, (3, 3)),
        ("origin", float, (3,)),  # a line's start, a coil's centre
        ("way", float, (3,)),  # direction of a line
        ("radius", float),  # of a coil at its start
        ("growth", float),  # of the radius, per radian
        ("rise", float),  # per radian
        ("begin", float),
        ("turn", float),  # -1 or 1
        ("angle", float),  # swept in all
        ("heading", float),  # of a line; of a coil, what its own is short of
    ]
)


@dataclass(frozen=True)
class Line:
    """A straight line.

    Args:
        start, end: (3,) [mm].
        frame: the plane in which headings are taken.
    """

    start: Vector
    end: Vector
    frame: Frame = XY

    def __post_init__(self) -> None:
        _check("line", self.frame, start=self.start, end=self.end)


@dataclass(frozen=True)
class Coil:
    """A curve about an axis whose distance from it and whose height change evenly with the angle.

    An arc where neither changes, a helix where the height does, Archimedes' spiral where the radius does, a
    conical spiral where both do.

    Args:
        centre: of the start's plane, (3,) [mm].
        radius: distance from the axis at the start and at the end [mm].
        begin: angle of the start about the centre, from the plane's first direction [rad].
        angle: swept, counter-clockwise positive about the plane's normal [rad].
        rise: height gained along the plane's normal [mm].
        frame: the plane.
    """

    centre: Vector
    radius: tuple[float, float]
    begin: float
    angle: float
    rise: float = 0.0
    frame: Frame = XY

    def __post_init__(self) -> None:
        _check("coil", self.frame, **{name: value for name, value in vars(self).items() if name != "frame"})
        if min(self.radius) < -SHORTEST:
            raise InputError(f"coil: radius = {min(self.radius):g} mm: must be at least 0 mm")
        if not self.angle and (self.rise or self.radius[0] != self.radius[1]):
            raise InputError("coil: angle = 0 rad: must turn where the radius or the height changes")


def piece_from(arguments: Mapping[str, Any]) -> Line | Coil:
    """Return the piece of a mapping of its arguments, with `kind` "Line" or "Coil"."""
    values = dict(arguments)
    kinds: dict[str, type[Line | Coil]] = {"Line": Line, "Coil": Coil}
    kind = values.pop("kind", None)
    if kind not in kinds:
        raise InputError(f"chain: piece of kind {kind!r}: must be Line or Coil")
    return kinds[kind](**values)


def _check(piece: str, frame: Frame, **values: Any) -> None:
    for name, value in values.items():
        if not np.isfinite(value).all():
            raise InputError(f"{piece}: {name} = {value}: must be finite")
    axes = np.array(frame, float)
    if not np.abs(axes @ axes.T - np.eye(2)).max() <= _SQUARE:
        raise InputError(f"{piece}: frame = {frame}: must be two unit vectors at a right angle")


def _axes(frame: Frame) -> Floats:
    u, v = np.array(frame, float)
    return np.array([u, v, np.cross(u, v)])


def _growth(coil: Coil) -> tuple[float, float]:
    """Change of radius and of height per radian swept."""
    return (coil.radius[1] - coil.radius[0]) / abs(coil.angle), coil.rise / abs(coil.angle)


def length_of(piece: Line | Coil) -> float:
    """Return the length of a piece [mm]."""
    if isinstance(piece, Line):
        return float(np.linalg.norm(np.subtract(piece.end, piece.start)))
    if not piece.angle:
        return 0.0
    growth, rise = _growth(piece)
    return float(arc_length(piece.radius[0], growth, np.hypot(growth, rise), abs(piece.angle))[0])


def row_of(piece: Line | Coil) -> tuple[Any, ...]:
    """Return a piece of some length as a row of numbers."""
    frame = _axes(piece.frame)
    if isinstance(piece, Line):
        way = np.subtract(piece.end, piece.start) / length_of(piece)
        heading = np.arctan2(way @ frame[1], way @ frame[0])
        return False, frame, piece.start, way, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, heading
    growth, rise = _growth(piece)
    turn, angle = np.sign(piece.angle), abs(piece.angle)
    return True, frame, piece.centre, (0.0, 0.0, 0.0), piece.radius[0], growth, rise, piece.begin, turn, angle, 0.0
