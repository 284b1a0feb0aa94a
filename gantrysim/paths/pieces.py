"""The pieces of a chain: lines and coils, in or out of a plane."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.base.errors import InputError
from gantrysim.paths.lengths import arc_length

Vector = tuple[float, float, float]
Frame = tuple[Vector, Vector]  # the directions u and v of a plane; its normal is u x v

XY: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
ZX: Frame = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
YZ: Frame = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
XZ: Frame = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
_PLANES = (XY, ZX, YZ, XZ)

SHORTEST_PIECE = 1e-9  # length up to which a piece is dropped [mm]
_SQUARE = 1e-9  # tolerance of a frame's scalar products

# a piece as a row of numbers
ROW = np.dtype(
    [
        ("coil", bool),
        ("frame", float, (3, 3)),
        ("origin", float, (3,)),  # a line's start, a coil's centre
        ("direction", float, (3,)),  # of a line
        ("radius", float),  # of a coil at its start
        ("growth", float),  # of the radius, per radian
        ("rise", float),  # per radian
        ("begin", float),
        ("turn", float),  # -1 or 1
        ("angle", float),  # swept
        ("heading", float),  # of a line; of a coil, an offset in whole turns
    ]
)


@dataclass(frozen=True)
class Line:
    """A straight line.

    Args:
        start, end: (3,) [mm].
        frame: the plane of its heading.
    """

    start: Vector
    end: Vector
    frame: Frame = XY

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.start, *self.end))):
            raise _infinite("line", vars(self))
        _check_frame("line", self.frame)


@dataclass(frozen=True)
class Coil:
    """A curve about an axis whose radius and height are linear in the angle.

    It is an arc if neither changes, a helix if the height does, an Archimedean spiral if the radius does, and a
    conical spiral if both do.

    Args:
        centre: at the height of the start, (3,) [mm].
        radius: distance from the axis at the start and at the end [mm].
        begin: angle of the start about the centre, from the plane's first direction [rad].
        angle: swept, counter-clockwise positive about the plane's normal [rad].
        rise: height along the plane's normal [mm].
        frame: the plane.
    """

    centre: Vector
    radius: tuple[float, float]
    begin: float
    angle: float
    rise: float = 0.0
    frame: Frame = XY

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.centre, *self.radius, self.begin, self.angle, self.rise))):
            raise _infinite("coil", vars(self))
        _check_frame("coil", self.frame)
        if min(self.radius) < -SHORTEST_PIECE:
            raise InputError(f"coil: radius = {min(self.radius):g} mm: must be at least 0 mm")
        if not self.angle and (self.rise or self.radius[0] != self.radius[1]):
            raise InputError("coil: angle = 0 rad: must not be 0 where the radius or the height changes")


def vector(point: ArrayLike) -> Vector:
    """Return the first three numbers of an array as a vector."""
    x, y, z = np.asarray(point)[:3].tolist()
    return x, y, z


def piece_from(arguments: Mapping[str, Any]) -> Line | Coil:
    """Return the piece with the given arguments, of the `kind` "Line" or "Coil"."""
    values = dict(arguments)
    kinds: dict[str, type[Line | Coil]] = {"Line": Line, "Coil": Coil}
    kind = values.pop("kind", None)
    if kind not in kinds:
        raise InputError(f"chain: piece of kind {kind!r}: must be Line or Coil")
    return kinds[kind](**values)


def _infinite(piece: str, values: Mapping[str, Any]) -> InputError:
    """Return the error for the first value of a piece that is not finite."""
    infinite = (name for name, value in values.items() if name != "frame" and not np.isfinite(value).all())
    name = next(infinite)
    return InputError(f"{piece}: {name} = {values[name]}: must be finite")


def _check_frame(piece: str, frame: Frame) -> None:
    if frame in _PLANES:
        return
    u, v = frame
    products = (sum(map(operator.mul, a, b)) for a, b in ((u, u), (u, v), (v, v)))
    # so written that a nan is refused
    if not all(abs(product - unit) <= _SQUARE for product, unit in zip(products, (1.0, 0.0, 1.0), strict=True)):
        raise InputError(f"{piece}: frame = {frame}: must be two orthogonal unit vectors")


def _growth(coil: Coil) -> tuple[float, float]:
    """Change of radius and height per radian."""
    return (coil.radius[1] - coil.radius[0]) / abs(coil.angle), coil.rise / abs(coil.angle)


def length_of(piece: Line | Coil) -> float:
    """Return the length of a piece [mm]."""
    if isinstance(piece, Line):
        return math.dist(piece.start, piece.end)
    if not piece.angle:
        return 0.0
    growth, rise = _growth(piece)
    if not growth:
        return math.hypot(piece.radius[0], rise) * abs(piece.angle)
    return float(arc_length(piece.radius[0], growth, np.hypot(growth, rise), abs(piece.angle))[0])


def row_of(piece: Line | Coil, length: float) -> tuple[Any, ...]:
    """Return a piece of positive length as a row of numbers, without the frame's normal and a line's heading."""
    frame = (*piece.frame, (0.0, 0.0, 0.0))
    if isinstance(piece, Line):
        x, y, z = ((end - start) / length for start, end in zip(piece.start, piece.end, strict=True))
        return False, frame, piece.start, (x, y, z), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    growth, rise = _growth(piece)
    turn = math.copysign(1.0, piece.angle)
    angle = abs(piece.angle)
    return True, frame, piece.centre, (0.0, 0.0, 0.0), piece.radius[0], growth, rise, piece.begin, turn, angle, 0.0
