"""Tangent-continuous chains of circular arcs and lines, with or without a climb."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.jit import jit
from gantrysim.paths.nearest import chord_near
from gantrysim.paths.path import Path


class ArcChain(Path):
    """Consecutive circular arcs and straight lines, tangent-continuous in the XY plane.

    Args:
        start: first point, (2,) or (3,) [mm].
        heading: of the first tangent, from +x counter-clockwise [rad].
        curvature: signed curvature of each piece in the XY plane, 0 for a line, (m,) [1/mm].
        lengths: length of each piece in the XY plane, (m,) [mm].
        rise: height that each piece climbs, one for all or (m,) [mm].
    """

    def __init__(
        self, start: ArrayLike, heading: float, curvature: ArrayLike, lengths: ArrayLike, rise: ArrayLike = 0.0
    ) -> None:
        self._kappa = np.atleast_1d(np.asarray(curvature, float))
        pieces = np.atleast_1d(np.asarray(lengths, float))
        if self._kappa.shape != pieces.shape or pieces.ndim != 1 or not pieces.size or not np.all(pieces >= 0):
            raise InputError(
                f"arc chain: {self._kappa.size} curvatures and {pieces.size} lengths: "
                "must be as many, at least one, and no length negative"
            )
        if np.size(start) not in (2, 3):
            raise InputError(f"arc chain: start of {np.size(start)} numbers: must be two or three")
        if np.size(rise) not in (1, pieces.size):
            raise InputError(f"arc chain: {np.size(rise)} rises: must be one, or as many as the {pieces.size} pieces")
        if not all(np.isfinite(value).all() for value in (start, heading, self._kappa, pieces, rise)):
            raise InputError("arc chain: start, heading, curvatures, lengths and rises must be finite")
        self._flat = pieces
        self._rise = np.broadcast_to(np.asarray(rise, float), pieces.shape).copy()
        self._start = np.zeros(3)
        self._start[: np.size(start)] = start
        space = np.hypot(pieces, self._rise)
        self._cosine = np.divide(pieces, space, out=np.ones_like(space), where=space > 0)
        self._sine = np.divide(self._rise, space, out=np.zeros_like(space), where=space > 0)
        self._s = np.concatenate([[0.0], np.cumsum(space)])
        self._theta = heading + np.concatenate([[0.0], np.cumsum(self._kappa * pieces)])
        self._points = np.empty((pieces.size + 1, 3))
        _join_arcs((self._start, self._theta, self._kappa, pieces, self._rise), self._points)

    def parameters(self) -> dict[str, Any]:
        return {
            "start": self._start,
            "heading": float(self._theta[0]),
            "curvature": self._kappa,
            "lengths": self._flat,
            "rise": self._rise,
        }

    @property
    def length(self) -> float:
        return float(self._s[-1])

    @property
    def pieces(self) -> int:
        """Number of arcs and lines."""
        return self._kappa.size

    @property
    def ends(self) -> Floats:
        """Arc length at the end of every piece, (m,) [mm]."""
        return self._s[1:]

    def _locate(self, s: ArrayLike) -> tuple[NDArray[np.intp], Floats]:
        """Return the pieces at arc lengths, and the distances from their starts, (n,) each."""
        arc_length = np.atleast_1d(np.asarray(s, float))
        k = np.clip(np.searchsorted(self._s, arc_length, side="right") - 1, 0, self.pieces - 1)
        return k, arc_length - self._s[k]

    def position(self, s: ArrayLike) -> Floats:
        places = np.atleast_1d(np.asarray(s, float))
        points = np.empty((places.size, 3))
        pieces = (self._s, self._theta, self._kappa, self._cosine, self._sine, self._points)
        _find_points(pieces, np.ascontiguousarray(places), points)
        return points

    def heading(self, s: ArrayLike) -> Floats:
        k, distance = self._locate(s)
        return self._theta[k] + self._kappa[k] * self._cosine[k] * distance

    def curvature(self, s: ArrayLike) -> Floats:
        k = self._locate(s)[0]
        return self._kappa[k] * self._cosine[k]

    def climb(self, s: ArrayLike) -> Floats:
        return self._sine[self._locate(s)[0]]


@jit
def _arc(theta: float, kappa: float, flat: float) -> tuple[float, float]:
    """Return the displacement along an arc of initial heading theta and length `flat` in the plane [mm].

    The chord's form s sinc(kappa s / 2) (cos, sin)(theta + kappa s / 2) holds for lines as well.
    """
    half = 0.5 * kappa * flat
    chord = flat * np.sin(half) / half if half != 0.0 else flat
    return chord * np.cos(theta + half), chord * np.sin(theta + half)


@jit
def _join_arcs(arcs: tuple[Floats, Floats, Floats, Floats, Floats], points: Floats) -> None:
    """Write where arcs begin and end, (m + 1, 3) [mm], from their start, headings, curvatures, lengths and rises."""
    start, theta, kappa, flat, rise = arcs
    points[0] = start
    for k in range(kappa.size):
        x, y = _arc(theta[k], kappa[k], flat[k])
        points[k + 1, 0] = points[k, 0] + x
        points[k + 1, 1] = points[k, 1] + y
        points[k + 1, 2] = points[k, 2] + rise[k]


@jit
def _find_points(pieces: tuple[Floats, Floats, Floats, Floats, Floats, Floats], places: Floats, points: Floats) -> None:
    """Write the points of a chain at arc lengths, (n, 3) [mm]; pieces are the columns of an `ArcChain`."""
    begins, theta, kappa, cosine, sine, starts = pieces
    k = 0
    for j in range(places.size):
        k = chord_near(begins, places[j], k)  # type: ignore[no-untyped-call]
        distance = places[j] - begins[k]
        x, y = _arc(theta[k], kappa[k], distance * cosine[k])
        points[j, 0] = starts[k, 0] + x
        points[j, 1] = starts[k, 1] + y
        points[j, 2] = starts[k, 2] + distance * sine[k]
