"""Lines, arcs, helices, spirals and cones one behind the other, in any plane, with corners or without."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats
from gantrysim.controllers.paths.lengths import swept_angle
from gantrysim.controllers.paths.path import Local, Path
from gantrysim.controllers.paths.pieces import (
    ROW,
    SHORTEST,
    Coil,
    Line,
    length_of,
    piece_from,
    row_of,
)
from gantrysim.errors import InputError

Columns = dict[str, NDArray[Any]]
_JOINT = 1e-6  # [mm], at most between two pieces
_EVEN = 0.02  # [mm], change of a radius that is no spiral's but the rounding of an arc's end point
_SHARP = 1e-4  # jump of the unit tangent at a corner


class _Picked:
    """Columns of a table at some of its rows, picked when they are asked for."""

    def __init__(self, columns: Columns, k: NDArray[np.intp]) -> None:
        self._columns, self._k = columns, k

    def __getitem__(self, name: str) -> Floats:
        return self._columns[name][self._k]


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
        built = [piece if isinstance(piece, Line | Coil) else piece_from(piece) for piece in pieces]
        lengths = np.array([length_of(piece) for piece in built])
        self.pieces: tuple[Line | Coil, ...] = tuple(
            piece for piece, length in zip(built, lengths, strict=True) if length > SHORTEST
        )
        if not self.pieces:
            raise InputError("chain: has no piece of any length")
        self._s = np.concatenate([[0.0], np.cumsum(lengths[lengths > SHORTEST])])
        rows = np.array([row_of(piece) for piece in self.pieces], ROW)
        self._columns: Columns = {name: np.ascontiguousarray(rows[name]) for name in ROW.names or ()}
        # sine of a line's climb
        self._columns["straight"] = np.einsum("ij,ij->i", self._columns["frame"][:, 2], self._columns["way"])
        self._last: tuple[NDArray[np.intp], Floats, tuple[_Picked, Floats, Floats]] | None = None
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
        frame, way = self._columns["frame"], self._columns["way"]
        for k, coil in enumerate(self._columns["coil"]):
            if not coil and np.linalg.norm(frame[k, :2] @ way[k]) < 1e-9:  # along the normal
                self._columns["heading"][k] = before = 0.0 if before is None else before
                continue
            turns = 0.0 if before is None else 2 * np.pi * np.round((before - first[k]) / (2 * np.pi))
            self._columns["heading"][k] += turns
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
    def corners(self) -> Floats:
        joints = self._s[1:-1]
        jump = self.tangent(joints + SHORTEST) - self.tangent(joints - SHORTEST)
        return joints[np.linalg.norm(jump, axis=1) > _SHARP]

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

    def _swept(self, k: NDArray[np.intp], rest: Floats) -> tuple[_Picked, Floats, Floats]:
        """Rows of coils, angles swept and radii there; position, heading and climb ask for the same ones in turn."""
        if self._last is None or not (np.array_equal(self._last[0], k) and np.array_equal(self._last[1], rest)):
            row = _Picked(self._columns, k)
            speed = np.hypot(row["growth"], row["rise"])
            swept = swept_angle(row["radius"], row["growth"], speed, rest, row["angle"])
            self._last = k, rest, (row, swept, row["radius"] + row["growth"] * swept)
        return self._last[2]

    def position(self, s: ArrayLike) -> Floats:
        return self._place(*self._locate(s))

    def _place(self, k: NDArray[np.intp], rest: Floats) -> Floats:
        points: Floats = self._columns["origin"][k] + rest[:, None] * self._columns["way"][k]
        coil = self._columns["coil"][k]
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
        coil = self._columns["coil"][k]
        if coil.any():
            row, swept, _ = self._swept(k[coil], rest[coil])
            share[coil] = swept / row["angle"]
        return k, share

    def heading(self, s: ArrayLike) -> Floats:
        return self._heading_of(*self._locate(s))

    def _heading_of(self, k: NDArray[np.intp], rest: Floats) -> Floats:
        theta: Floats = self._columns["heading"][k]
        coil = self._columns["coil"][k]
        if coil.any():
            row, swept, rho = self._swept(k[coil], rest[coil])
            theta[coil] += row["begin"] + row["turn"] * (swept + np.arctan2(np.maximum(rho, 0.0), row["growth"]))
        return theta

    def curvature(self, s: ArrayLike) -> Floats:
        return self._curvature_of(*self._locate(s))

    def _curvature_of(self, k: NDArray[np.intp], rest: Floats) -> Floats:
        kappa = np.zeros(k.size)
        coil = self._columns["coil"][k]
        if coil.any():
            row, _, rho = self._swept(k[coil], rest[coil])
            flat = rho**2 + row["growth"] ** 2
            turning = row["turn"] * (flat + row["growth"] ** 2)
            kappa[coil] = turning / np.maximum(flat * np.sqrt(flat + row["rise"] ** 2), SHORTEST**3)
        return kappa

    def climb(self, s: ArrayLike) -> Floats:
        return self._climb_of(*self._locate(s))

    def _climb_of(self, k: NDArray[np.intp], rest: Floats) -> Floats:
        sine: Floats = self._columns["straight"][k]
        coil = self._columns["coil"][k]
        if coil.any():
            row, _, rho = self._swept(k[coil], rest[coil])
            sine[coil] = row["rise"] / np.maximum(np.hypot(np.hypot(rho, row["growth"]), row["rise"]), SHORTEST)
        return sine

    def local(self, s: ArrayLike) -> Local:
        k, rest = self._locate(s)
        theta, sine, kappa = self._heading_of(k, rest), self._climb_of(k, rest), self._curvature_of(k, rest)
        return Local.of(self._place(k, rest), theta, sine, self._columns["frame"][k], kappa)

    def frame(self, s: ArrayLike) -> Floats:
        return self._columns["frame"][self._locate(s)[0]]
