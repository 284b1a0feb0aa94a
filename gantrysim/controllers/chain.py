"""Lines, arcs, helices, spirals and cones one behind the other, in any plane, with corners or without."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.controllers.path import Floats, Path
from gantrysim.controllers.spirals import arc_length, swept_angle
from gantrysim.errors import InputError

__all__ = ["XY", "XZ", "YZ", "ZX", "Chain", "Coil", "Frame", "Line", "Vector"]

Rows = NDArray[np.void]
Vector = tuple[float, float, float]
Frame = tuple[Vector, Vector]  # first and second direction of a plane; a right-handed third is its normal

XY: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
ZX: Frame = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
YZ: Frame = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
XZ: Frame = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))

_SHORTEST = 1e-9  # [mm], of a piece that is kept
_JOINT = 1e-6  # [mm], at most between two pieces
_EVEN = 0.02  # [mm], change of a radius that is no spiral's but the rounding of an arc's end point
_SHARP = 1e-4  # jump of the unit tangent at a corner
_SQUARE = 1e-9  # scalar products of a frame's directions

_ROW = np.dtype(
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
        if min(self.radius) < -_SHORTEST:
            raise InputError(f"coil: radius = {min(self.radius):g} mm: must be at least 0 mm")
        if not self.angle and (self.rise or self.radius[0] != self.radius[1]):
            raise InputError("coil: angle = 0 rad: must turn where the radius or the height changes")


class Chain(Path):
    """Pieces one behind the other; each begins where the one before ends.

    Where two pieces meet at a corner the heading jumps by the angle between their tangents; lines along the
    plane's normal keep the heading of the piece before.

    Args:
        pieces: lines and coils, or mappings of their arguments with `kind` "Line" or "Coil"; those of no length
            are left out.

    Raises:
        InputError: no piece of any length, or one that does not begin where the one before ends.
    """

    def __init__(self, pieces: Iterable[Line | Coil | Mapping[str, Any]]) -> None:
        built = [piece if isinstance(piece, Line | Coil) else _piece(piece) for piece in pieces]
        lengths = np.array([_length(piece) for piece in built])
        self.pieces: tuple[Line | Coil, ...] = tuple(
            piece for piece, length in zip(built, lengths, strict=True) if length > _SHORTEST
        )
        if not self.pieces:
            raise InputError("chain: has no piece of any length")
        self._s = np.concatenate([[0.0], np.cumsum(lengths[lengths > _SHORTEST])])
        self._rows = np.array([_row(piece) for piece in self.pieces], _ROW)
        self._last: tuple[NDArray[np.intp], Floats, tuple[Rows, Floats, Floats]] | None = None
        self._check_joints()
        self._join_headings()

    def _check_joints(self) -> None:
        lengths, k = np.diff(self._s), np.arange(len(self.pieces))
        gap = np.linalg.norm(self._place(k[1:], 0 * lengths[1:]) - self._place(k[:-1], lengths[:-1]), axis=1)
        if gap.max(initial=0.0) > _JOINT:
            worst = int(gap.argmax())
            raise InputError(
                f"chain: piece {worst + 2} begins {gap[worst]:.4g} mm from where piece {worst + 1} ends: "
                f"must be within {_JOINT:g} mm"
            )

    def _join_headings(self) -> None:
        """Make the headings continuous but for the corners."""
        ends = np.arange(len(self.pieces)), np.diff(self._s)
        first, last = self._heading_of(ends[0], 0 * ends[1]), self._heading_of(*ends)
        before = None
        for k, row in enumerate(self._rows):
            if not row["coil"] and np.linalg.norm(row["frame"][:2] @ row["way"]) < 1e-9:  # along the normal
                self._rows["heading"][k] = before = 0.0 if before is None else before
                continue
            turns = 0.0 if before is None else 2 * np.pi * np.round((before - first[k]) / (2 * np.pi))
            self._rows["heading"][k] += turns
            before = last[k] + turns

    def parameters(self) -> dict[str, Any]:
        return {"pieces": [{"kind": type(piece).__name__, **vars(piece)} for piece in self.pieces]}

    @property
    def length(self) -> float:
        return float(self._s[-1])

    @property
    def ends(self) -> Floats:
        """Arc length at the end of every piece, (m,) [mm]."""
        return self._s[1:]

    @cached_property
    def _corners(self) -> Floats:
        joints = self._s[1:-1]
        jump = self.tangent(joints + _SHORTEST) - self.tangent(joints - _SHORTEST)
        corners: Floats = joints[np.linalg.norm(jump, axis=1) > _SHARP]
        return corners

    @property
    def turn_spacing(self) -> float | None:
        """Change of the radius per turn to a nanometre, where every spiral of the chain has the same."""
        spacing = {
            round(abs((piece.radius[1] - piece.radius[0]) * 2 * np.pi / piece.angle), 6)
            for piece in self.pieces
            if isinstance(piece, Coil) and abs(piece.radius[1] - piece.radius[0]) > _EVEN
        }
        return spacing.pop() if len(spacing) == 1 else None

    def _locate(self, s: ArrayLike) -> tuple[NDArray[np.intp], Floats]:
        at = np.atleast_1d(np.asarray(s, float))
        k = np.clip(np.searchsorted(self._s, at, side="right") - 1, 0, len(self.pieces) - 1)
        return k, at - self._s[k]

    def _swept(self, k: NDArray[np.intp], rest: Floats) -> tuple[Rows, Floats, Floats]:
        """Rows of coils, angles swept and radii there; position, heading and climb ask for the same ones in turn."""
        if self._last is None or not (np.array_equal(self._last[0], k) and np.array_equal(self._last[1], rest)):
            row = self._rows[k]
            speed = np.hypot(row["growth"], row["rise"])
            swept = swept_angle(row["radius"], row["growth"], speed, rest, row["angle"])
            self._last = k, rest, (row, swept, row["radius"] + row["growth"] * swept)
        return self._last[2]

    def position(self, s: ArrayLike) -> Floats:
        return self._place(*self._locate(s))

    def _place(self, k: NDArray[np.intp], rest: Floats) -> Floats:
        points: Floats = self._rows["origin"][k] + rest[:, None] * self._rows["way"][k]
        coil = self._rows["coil"][k]
        if coil.any():
            row, swept, rho = self._swept(k[coil], rest[coil])
            psi = row["begin"] + row["turn"] * swept
            local = np.stack([rho * np.cos(psi), rho * np.sin(psi), row["rise"] * swept], axis=1)
            points[coil] += np.einsum("ij,ijk->ik", local, row["frame"])
        return points

    def progress(self, s: ArrayLike) -> tuple[NDArray[np.intp], Floats]:
        """Piece at arc lengths, (n,), and the share of its angle, or of a line's length, that is behind, (n,)."""
        k, rest = self._locate(s)
        share: Floats = rest / np.diff(self._s)[k]
        coil = self._rows["coil"][k]
        if coil.any():
            row, swept, _ = self._swept(k[coil], rest[coil])
            share[coil] = swept / row["angle"]
        return k, share

    def heading(self, s: ArrayLike) -> Floats:
        return self._heading_of(*self._locate(s))

    def _heading_of(self, k: NDArray[np.intp], rest: Floats) -> Floats:
        theta: Floats = self._rows["heading"][k]
        coil = self._rows["coil"][k]
        if coil.any():
            row, swept, rho = self._swept(k[coil], rest[coil])
            theta[coil] += row["begin"] + row["turn"] * (swept + np.arctan2(np.maximum(rho, 0.0), row["growth"]))
        return theta

    def curvature(self, s: ArrayLike) -> Floats:
        k, rest = self._locate(s)
        kappa = np.zeros(k.size)
        coil = self._rows["coil"][k]
        if coil.any():
            row, _, rho = self._swept(k[coil], rest[coil])
            flat = rho**2 + row["growth"] ** 2
            turning = row["turn"] * (flat + row["growth"] ** 2)
            kappa[coil] = turning / np.maximum(flat * np.sqrt(flat + row["rise"] ** 2), _SHORTEST**3)
        return kappa

    def climb(self, s: ArrayLike) -> Floats:
        k, rest = self._locate(s)
        sine: Floats = np.einsum("ij,ij->i", self._rows["frame"][k, 2], self._rows["way"][k])
        coil = self._rows["coil"][k]
        if coil.any():
            row, _, rho = self._swept(k[coil], rest[coil])
            sine[coil] = row["rise"] / np.maximum(np.hypot(np.hypot(rho, row["growth"]), row["rise"]), _SHORTEST)
        return sine

    def frame(self, s: ArrayLike) -> Floats:
        frames: Floats = self._rows["frame"][self._locate(s)[0]]
        return frames


def _piece(arguments: Mapping[str, Any]) -> Line | Coil:
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


def _length(piece: Line | Coil) -> float:
    if isinstance(piece, Line):
        return float(np.linalg.norm(np.subtract(piece.end, piece.start)))
    if not piece.angle:
        return 0.0
    growth, rise = _growth(piece)
    return float(arc_length(piece.radius[0], growth, np.hypot(growth, rise), abs(piece.angle))[0])


def _row(piece: Line | Coil) -> tuple[Any, ...]:
    frame = _axes(piece.frame)
    if isinstance(piece, Line):
        way = np.subtract(piece.end, piece.start) / _length(piece)
        heading = np.arctan2(way @ frame[1], way @ frame[0])
        return False, frame, piece.start, way, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, heading
    growth, rise = _growth(piece)
    turn, angle = np.sign(piece.angle), abs(piece.angle)
    return True, frame, piece.centre, (0.0, 0.0, 0.0), piece.radius[0], growth, rise, piece.begin, turn, angle, 0.0
