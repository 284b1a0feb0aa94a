"""Chains of lines, arcs, helices, spirals and cones in any plane, with or without corners."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.arrays import Floats, LastCall
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
_JOINT = 1e-6  # largest gap between two pieces [mm]
_EVEN = 0.02  # change of an arc's radius by the rounding of its end point [mm]
_SHARP = 1e-4  # jump of the unit tangent at a corner


class _Picked:
    """Some rows of a table's columns, picked on access."""

    def __init__(self, columns: Columns, k: NDArray[np.intp]) -> None:
        self._columns, self._k = columns, k

    def __getitem__(self, name: str) -> Floats:
        return self._columns[name][self._k]


class Chain(Path):
    """Consecutive pieces; each begins at the end of the one before.

    At a corner the heading jumps by the angle between the tangents; lines along the plane's normal keep the heading
    of the piece before.

    Args:
        pieces: lines and coils, or mappings of their arguments with `kind` "Line" or "Coil"; pieces of zero length
            are dropped.

    Raises:
        InputError: no piece of positive length, or a gap between two pieces.
    """

    def __init__(self, pieces: Iterable[Line | Coil | Mapping[str, Any]]) -> None:
        built = [piece if isinstance(piece, Line | Coil) else piece_from(piece) for piece in pieces]
        lengths = np.array([length_of(piece) for piece in built])
        self.pieces: tuple[Line | Coil, ...] = tuple(
            piece for piece, length in zip(built, lengths, strict=True) if length > SHORTEST
        )
        if not self.pieces:
            raise InputError("chain: must have a piece of positive length")
        self._s = np.concatenate([[0.0], np.cumsum(lengths[lengths > SHORTEST])])
        rows = np.array([row_of(piece) for piece in self.pieces], ROW)
        self._columns: Columns = {name: np.ascontiguousarray(rows[name]) for name in ROW.names or ()}
        frame = self._columns["frame"]
        frame[:, 2] = np.cross(frame[:, 0], frame[:, 1])
        # sine of a line's climb
        self._columns["straight"] = np.einsum("ij,ij->i", frame[:, 2], self._columns["direction"])
        self._swept = LastCall(self._sweep)
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
        """Make the headings continuous except at corners."""
        ends = np.arange(len(self.pieces)), np.diff(self._s)
        first, last = self._heading_of(ends[0], 0 * ends[1]), self._heading_of(*ends)
        before = None
        frame, direction = self._columns["frame"], self._columns["direction"]
        for k, coil in enumerate(self._columns["coil"]):
            if not coil and np.linalg.norm(frame[k, :2] @ direction[k]) < 1e-9:  # along the normal
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
        """Change of the radius per turn, to a nanometre, if all spirals of the chain have the same."""
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

    def _sweep(self, k: NDArray[np.intp], rest: Floats) -> tuple[_Picked, Floats, Floats]:
        """Rows of coils, and angles swept and radii at lengths from their starts."""
        row = _Picked(self._columns, k)
        speed = np.hypot(row["growth"], row["rise"])
        swept = swept_angle(row["radius"], row["growth"], speed, rest, row["angle"])
        return row, swept, row["radius"] + row["growth"] * swept

    def position(self, s: ArrayLike) -> Floats:
        return self._place(*self._locate(s))

    def _place(self, k: NDArray[np.intp], rest: Floats) -> Floats:
        points = self._columns["origin"][k] + rest[:, None] * self._columns["direction"][k]
        coil = self._columns["coil"][k]
        if coil.any():
            row, swept, rho = self._swept(k[coil], rest[coil])
            psi = row["begin"] + row["turn"] * swept
            local = np.stack([rho * np.cos(psi), rho * np.sin(psi), row["rise"] * swept], axis=1)
            points[coil] += np.einsum("ij,ijk->ik", local, row["frame"])
        return points

    def progress(self, s: ArrayLike) -> tuple[NDArray[np.intp], Floats]:
        """Piece at arc lengths, (n,), and the completed share of its angle, or of a line's length, (n,)."""
        k, rest = self._locate(s)
        share = rest / np.diff(self._s)[k]
        coil = self._columns["coil"][k]
        if coil.any():
            row, swept, _ = self._swept(k[coil], rest[coil])
            share[coil] = swept / row["angle"]
        return k, share

    def heading(self, s: ArrayLike) -> Floats:
        return self._heading_of(*self._locate(s))

    def _heading_of(self, k: NDArray[np.intp], rest: Floats) -> Floats:
        theta = self._columns["heading"][k]
        coil = self._columns["coil"][k]
        if coil.any():
            row, swept, rho = self._swept(k[coil], rest[coil])
            theta[coil] += row["begin"] + row["turn"] * (swept + np.arctan2(np.maximum(rho, 0.0), row["growth"]))
        return theta

    def curvature(self, s: ArrayLike) -> Floats:
        return self._turning_of(*self._locate(s))

    def _turning_of(self, k: NDArray[np.intp], rest: Floats) -> Floats:
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
        sine = self._columns["straight"][k]
        coil = self._columns["coil"][k]
        if coil.any():
            row, _, rho = self._swept(k[coil], rest[coil])
            sine[coil] = row["rise"] / np.maximum(np.hypot(np.hypot(rho, row["growth"]), row["rise"]), SHORTEST)
        return sine

    def local(self, s: ArrayLike) -> Local:
        k, rest = self._locate(s)
        theta, sine, kappa = self._heading_of(k, rest), self._climb_of(k, rest), self._turning_of(k, rest)
        return Local.of(self._place(k, rest), theta, sine, self._columns["frame"][k], kappa)

    def frame(self, s: ArrayLike) -> Floats:
        return self._columns["frame"][self._locate(s)[0]]
