"""Chains of lines, arcs, helices, spirals and cones in any plane, with or without corners."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, dot, lengths, read_only_view
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.paths.lengths import find_swept
from gantrysim.paths.path import Local, Path, tangent_of
from gantrysim.paths.pieces import (
    ROW,
    SHORTEST_PIECE,
    Coil,
    Line,
    length_of,
    piece_from,
    row_of,
)

Columns = dict[str, NDArray[Any]]
_PIECES = (Line, Coil)  # a union would be made anew for every piece
_JOINT = 1e-6  # largest gap between two pieces [mm]
_RADIUS_ROUNDING = 0.02  # change of an arc's radius by the rounding of its end point [mm]
_TANGENT_JUMP = 1e-4  # jump of the unit tangent at a corner


class _Places(NamedTuple):
    """A chain at lengths from the starts of pieces.

    Attributes:
        point: (n, 3) [mm].
        heading: see `Path.heading`, (n,) [rad].
        cosine, sine: of the heading, (n,).
        climb: see `Path.climb`, (n,).
        turning: see `Path.curvature`, (n,) [1/mm].
        swept: angle of a coil from its start, 0 on a line, (n,) [rad].
    """

    point: Floats
    heading: Floats
    cosine: Floats
    sine: Floats
    climb: Floats
    turning: Floats
    swept: Floats


class _Columns(NamedTuple):
    """The pieces of a chain as compiled functions take them, a row each; see `ROW`, and the sine of a line's climb."""

    coil: NDArray[np.bool_]
    frame: Floats
    origin: Floats
    direction: Floats
    straight: Floats
    heading: Floats
    radius: Floats
    growth: Floats
    rise: Floats
    begin: Floats
    turn: Floats
    angle: Floats


class Chain(Path):
    """Consecutive pieces; each begins at the end of the one before.

    At a corner the heading jumps by the angle between the tangents; lines along the plane's normal keep the heading
    of the piece before.

    Args:
        pieces: lines and coils, or mappings of their arguments with `kind` "Line" or "Coil"; pieces of zero length
            are dropped.

    Raises:
        InputError: no piece of positive length, a gap between two pieces, or a length beyond all numbers.
    """

    def __init__(self, pieces: Iterable[Line | Coil | Mapping[str, Any]]) -> None:
        built = [piece if isinstance(piece, _PIECES) else piece_from(piece) for piece in pieces]
        measured = [(piece, length_of(piece)) for piece in built]
        positive = [(piece, length) for piece, length in measured if length > SHORTEST_PIECE]
        if not positive:
            raise InputError("chain: must have a piece of positive length")
        self.pieces: tuple[Line | Coil, ...] = tuple(piece for piece, _ in positive)
        self._s = np.cumsum([0.0, *(length for _, length in positive)])
        if self.length == math.inf:
            raise InputError("chain: length = inf mm: must be finite")
        rows = np.array([row_of(piece, length) for piece, length in positive], ROW)
        self._columns: Columns = {name: np.ascontiguousarray(rows[name]) for name in ROW.names or ()}
        frame = self._columns["frame"]
        frame[:, 2] = _normals(*frame[:, :2].transpose(1, 2, 0))
        direction = self._columns["direction"]
        self._columns["straight"] = dot(frame[:, 2], direction)  # sine of a line's climb
        products = frame[:, :2] * direction[:, None]
        # 0, not -0, for no component
        along, across = (products[..., 0] + products[..., 1] + products[..., 2] + 0.0).T
        # 0 for coils, which have no direction
        self._columns["heading"] = np.arctan2(across, along)
        # the starts and ends of all pieces at once, as every call of a compiled function takes its time
        count = len(self.pieces)
        k = np.arange(count)
        distance = np.concatenate([np.zeros(count), self._s[1:] - self._s[:-1]])
        places = self._at(np.concatenate([k, k]), distance, "point", "heading")
        self._check_joints(places.point[:count], places.point[count:])
        along_normal = ~self._columns["coil"] & (np.hypot(along, across) < 1e-9)
        self._join_headings(places.heading[:count], places.heading[count:], along_normal)

    def _check_joints(self, starts: Floats, ends: Floats) -> None:
        gap = lengths(starts[1:] - ends[:-1])
        if gap.max(initial=0.0) > _JOINT:
            worst = int(gap.argmax())
            raise InputError(
                f"chain: piece {worst + 2} begins {gap[worst]:.4g} mm from where piece {worst + 1} ends: "
                f"must be within {_JOINT:g} mm"
            )

    def _join_headings(self, first: Floats, last: Floats, along_normal: NDArray[np.bool_]) -> None:
        """Make the headings continuous except at corners.

        Args:
            first: heading at the start of every piece, (m,) [rad].
            last: heading at its end, (m,) [rad].
            along_normal: whether it is a line along its plane's normal, (m,).
        """
        before = None
        headings = self._columns["heading"].tolist()
        for k, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            # such a line has no heading of its own
            if along_normal[k]:
                if before is None:
                    before = 0.0
                headings[k] = before
                continue
            turns = 0.0 if before is None else math.tau * round((before - begin) / math.tau)
            headings[k] += turns
            before = end + turns
        self._columns["heading"][:] = headings

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
    def corners(self) -> Floats:
        joints = self._s[1:-1]
        jump = self.tangent(joints + SHORTEST_PIECE) - self.tangent(joints - SHORTEST_PIECE)
        return joints[np.linalg.norm(jump, axis=1) > _TANGENT_JUMP]

    @property
    def joints(self) -> Floats:
        return self._s[1:-1]

    @property
    def turn_spacing(self) -> float | None:
        """Change of the radius per turn, to a nanometre, if all spirals of the chain have the same."""
        spacing = {
            round(abs((piece.radius[1] - piece.radius[0]) * 2 * np.pi / piece.angle), 6)
            for piece in self.pieces
            if isinstance(piece, Coil) and abs(piece.radius[1] - piece.radius[0]) > _RADIUS_ROUNDING
        }
        return spacing.pop() if len(spacing) == 1 else None

    def _locate(self, s: ArrayLike) -> tuple[NDArray[np.intp], Floats]:
        arc_length = np.atleast_1d(np.asarray(s, float))
        k = self._s[1:-1].searchsorted(arc_length, side="right")
        return k, arc_length - self._s[k]

    @cached_property
    def _planes(self) -> Floats:
        """Directions of the planes of all pieces, or of one where all lie in it."""
        frame = self._columns["frame"]
        return read_only_view(np.ascontiguousarray(frame[:1] if (frame == frame[0]).all() else frame))

    def _at(self, k: NDArray[np.intp], distance: Floats, *wanted: str) -> _Places:
        """Return the places at distances from the starts of pieces; columns that are not wanted are empty."""
        rows = {name: k.size if name in ("swept", *wanted) else 0 for name in _Places._fields}
        places = _Places(*(np.empty((n, 3) if name == "point" else n) for name, n in rows.items()))
        _find_places(k, distance, self._packed, places)
        return places

    @cached_property
    def _packed(self) -> _Columns:
        return _Columns(*(self._columns[name] for name in _Columns._fields))

    def position(self, s: ArrayLike) -> Floats:
        return self._at(*self._locate(s), "point").point

    def tangent(self, s: ArrayLike) -> Floats:
        k, distance = self._locate(s)
        places = self._at(k, distance, "heading", "climb")
        return tangent_of(places.heading, places.climb, self._columns["frame"][k])

    def position_and_share(self, s: ArrayLike) -> tuple[Floats, Floats]:
        """Points at arc lengths, (n, 3) [mm], and the completed share of their pieces' angles, or of lines, (n,)."""
        k, distance = self._locate(s)
        places = self._at(k, distance, "point")
        coil = self._columns["coil"][k]
        angle = np.where(coil, self._columns["angle"][k], 1.0)
        return places.point, np.where(coil, places.swept / angle, distance / np.diff(self._s)[k])

    def heading(self, s: ArrayLike) -> Floats:
        return self._at(*self._locate(s), "heading").heading

    def curvature(self, s: ArrayLike) -> Floats:
        return self._at(*self._locate(s), "turning").turning

    def climb(self, s: ArrayLike) -> Floats:
        return self._at(*self._locate(s), "climb").climb

    def local(self, s: ArrayLike) -> Local:
        k, distance = self._locate(s)
        places = self._at(k, distance, "point", "cosine", "sine", "climb", "turning")
        plane = k if len(self._planes) > 1 else np.zeros_like(k)
        heading = (places.cosine, places.sine)
        return Local(places.point, heading, places.climb, places.turning, self._planes, plane)

    def frame(self, s: ArrayLike) -> Floats:
        return self._columns["frame"][self._locate(s)[0]]


def _normals(u: Floats, v: Floats) -> Floats:
    """Return the products u x v, (m, 3), of directions (3, m); NumPy's own function takes longer for short arrays."""
    return np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], axis=1)


@jit
def _find_places(k: NDArray[np.intp], distance: Floats, columns: _Columns, places: _Places) -> None:
    """Find the places at distances from the starts of the pieces k.

    Args:
        k: pieces, (n,).
        distance: from their starts, (n,) [mm].
        columns: of the pieces.
        places: columns that are not empty are written.
    """
    _find_angles(k, distance, columns, places.swept)
    for i in range(k.size):
        j = k[i]
        is_coil = columns.coil[j]
        phi = places.swept[i]
        turn = columns.turn[j]
        b = columns.growth[j]
        c = columns.rise[j]
        rho = columns.radius[j] + b * phi
        psi = columns.begin[j] + turn * phi
        if is_coil and (places.point.size or places.cosine.size):
            along = np.cos(psi)
            across = np.sin(psi)
        if places.point.size:
            for a in range(3):
                places.point[i, a] = columns.origin[j, a] + distance[i] * columns.direction[j, a]
            if is_coil:
                frame = columns.frame[j]
                x = rho * along
                y = rho * across
                z = c * phi
                for a in range(3):
                    places.point[i, a] += x * frame[0, a] + y * frame[1, a] + z * frame[2, a]
        flat = rho * rho + b * b
        if places.cosine.size and is_coil:
            # of d(point)/d(angle) in the plane, from the centre and across
            outwards = b / np.sqrt(flat) if flat > 0.0 else 1.0
            sideways = turn * max(rho, 0.0) / np.sqrt(flat) if flat > 0.0 else 0.0
            places.cosine[i] = outwards * along - sideways * across
            places.sine[i] = outwards * across + sideways * along
        elif places.cosine.size:
            is_new = i == 0 or k[i - 1] != j
            places.cosine[i] = np.cos(columns.heading[j]) if is_new else places.cosine[i - 1]
            places.sine[i] = np.sin(columns.heading[j]) if is_new else places.sine[i - 1]
        if places.heading.size:
            places.heading[i] = columns.heading[j]
            if is_coil:
                quarter = 0.5 * np.pi if b == 0.0 and rho > 0.0 else np.arctan2(max(rho, 0.0), b)
                places.heading[i] += columns.begin[j] + turn * (phi + quarter)
        if places.climb.size:
            places.climb[i] = columns.straight[j]
            if is_coil:
                places.climb[i] = 0.0 if c == 0.0 else c / max(np.hypot(np.hypot(rho, b), c), SHORTEST_PIECE)
        if places.turning.size:
            places.turning[i] = 0.0
            if is_coil:
                places.turning[i] = turn * (flat + b * b) / max(flat * np.sqrt(flat + c * c), SHORTEST_PIECE**3)


@jit
def _find_angles(k: NDArray[np.intp], distance: Floats, columns: _Columns, swept: Floats) -> None:
    """Write the angles of coils at distances from the starts of the pieces k, 0 on lines, (n,) [rad]."""
    active = np.empty(k.size, np.bool_)
    begin = 0
    # points in a row mostly lie on one piece
    while begin < k.size:
        j = k[begin]
        end = begin + 1
        while end < k.size and k[end] == j:
            end += 1
        here = slice(begin, end)
        swept[here] = 0.0
        if columns.coil[j]:
            growth = columns.growth[j]
            curve = (columns.radius[j], growth, np.hypot(growth, columns.rise[j]), columns.angle[j])
            find_swept(curve, distance[here], swept[here], active[here])  # type: ignore[no-untyped-call]
        begin = end
