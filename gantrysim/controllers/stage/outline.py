"""The outline of a work piece: a polygon with rounded corners."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, point
from gantrysim.paths.arcs import ArcChain

_ROUNDING = 1e-9  # [mm]
_STRAIGHT = 1e-6  # [rad]


def polygon(corners: Sequence[Sequence[float]]) -> Floats:
    """Return the corners of a polygon as complex numbers, (m,) [mm].

    Raises:
        InputError: fewer than three, coincident ones, no area, or crossing edges.
    """
    if len(corners) < 3:
        raise InputError(f"outline of {len(corners)} corners: must have at least 3")
    z = np.array([complex(*point(f"outline corner {k + 1}", corner)) for k, corner in enumerate(corners)])
    edges = np.roll(z, -1) - z
    short = np.flatnonzero(np.abs(edges) < _ROUNDING)
    if short.size:
        raise InputError(f"outline: corners {short[0] + 1} and {(short[0] + 1) % z.size + 1} coincide")
    if abs(_area(z)) < _ROUNDING:
        raise InputError("outline: has no area: its corners must not be collinear, nor its edges cross")
    crossing = _crossing(z)
    if crossing is not None:
        raise InputError(f"outline: edges {crossing[0] + 1} and {crossing[1] + 1} cross: must not")
    return z


def _crossing(z: Floats) -> tuple[int, int] | None:
    """Two crossing edges, or None: each has the ends of the other on different sides."""

    def side(points: Floats) -> Floats:
        """Positive for points to the left of the edges, (edges, points)."""
        return (np.conj(np.roll(z, -1) - z)[:, None] * (points[None] - z[:, None])).imag

    apart = side(z) * side(np.roll(z, -1)) < 0
    crossing = np.argwhere(np.triu(apart & apart.T))
    return (int(crossing[0, 0]), int(crossing[0, 1])) if crossing.size else None


def _area(z: Floats) -> float:
    """Signed area, positive where the corners go counter-clockwise [mm²]."""
    return float(0.5 * np.sum((np.conj(z) * np.roll(z, -1)).imag))


def outline(z: Floats, radius: float) -> tuple[ArcChain, float]:
    """Return the closed path along a polygon's edges, each followed by the arc of the corner at its end.

    It begins at the start of the first edge, after its corner.

    Args:
        z: corners in the order of the motion, as complex numbers, (m,) [mm].
        radius: of the corners [mm].

    Returns:
        path: edges and arcs alternately, 2 m pieces.
        outward: side of the outside, 1 for left and -1 for right.

    Raises:
        InputError: edges that double back or cross, or an edge too short for the arcs at its ends.
    """
    edges = np.roll(z, -1) - z
    turn = np.angle(np.roll(edges, -1) / edges)  # at the end of each edge
    # an arc that turns by half a turn would need infinite room on its edges
    back = np.flatnonzero(np.abs(turn) > math.pi - _STRAIGHT)
    if back.size:
        raise InputError(f"outline: doubles back at corner {(back[0] + 1) % z.size + 1}")
    if abs(abs(turn.sum()) - 2 * math.pi) > _STRAIGHT:
        raise InputError(f"outline: turns by {math.degrees(turn.sum()):.0f} deg in total: must not cross itself")
    cut = radius * np.tan(0.5 * np.abs(turn))  # of an edge at its end, from the corner to where the arc begins
    straight = np.abs(edges) - cut - np.roll(cut, 1)
    if straight.min() < -_ROUNDING:
        room = radius * np.abs(edges) / (cut + np.roll(cut, 1))
        k = int(room.argmin())
        raise InputError(
            f"corner_radius = {radius:g} mm: must be at most {room[k]:.6g} mm for edge {k + 1} of {abs(edges[k]):g} mm"
        )
    lengths = np.stack([np.maximum(straight, 0.0), radius * np.abs(turn)], axis=1).ravel()
    curvature = np.stack([np.zeros(z.size), np.sign(turn) / radius], axis=1).ravel()
    start = z[0] + np.roll(cut, 1)[0] * edges[0] / abs(edges[0])
    path = ArcChain((start.real, start.imag), math.atan2(edges[0].imag, edges[0].real), curvature, lengths)
    return path, -math.copysign(1.0, _area(z))
