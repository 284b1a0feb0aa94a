"""Corners of a path: arcs of radius zero, about which the path's frame turns from one leg to the next.

At a corner the tangent turns from t1 to t2 by the angle alpha about the axis a = t1 x t2 / |t1 x t2|. The points whose
foot is the corner fill the wedge outside it, between the planes normal to both legs:

    o.t1 >= 0  and  o.t2 <= 0,        o: offset of the point from the corner.

On an arc of radius zero the foot's tangent turns on until the offset is normal to it. So the offset's component in the
plane of the corner, of size r = |o - (o.a) a|, lies to the outside of the turn, -r along a x t, and (o.a) along a. By
that the offset, as components in the path's frame, is continuous across both planes, and across the bisector inside the
corner too, where the distances from both legs are equal: it is the signed distance of plane geometry, and changes
nowhere faster than the point moves. Components in the frame of one leg would jump as a point passes to the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.base.arrays import Floats, dot

_BESIDE_CORNER = 1e-11  # of a corner, where its legs' frames are taken [mm],
_BESIDE_ROUNDING = 4.0  # and at least so many times the rounding of its arc length
_AT_CORNER = 1e-8  # largest distance of a foot that is the corner [mm]
_ON_EDGE = 1e-9  # of the wedge outside a corner, by rounding [mm]
_FOLD = 2e-3  # sine of the angle between two legs, one back along the other, within which they count as one line
_ROUNDING = 1e-9  # of frames


class Framed(Protocol):
    """A path with corners."""

    @property
    def corners(self) -> Floats:
        """Arc lengths of the corners, ascending, (m,) [mm]."""

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents, (n, 3)."""

    def normal(self, s: ArrayLike) -> Floats:
        """Left unit normals, (n, 3)."""


@dataclass(frozen=True)
class Components:
    """Offsets from a path in its frame, each (n,) [mm].

    Attributes:
        lateral: along the left normal.
        vertical: along the binormal, tangent x left normal.
        beyond: along the tangent.
    """

    lateral: Floats
    vertical: Floats
    beyond: Floats


@dataclass(frozen=True)
class Corners:
    """The corners of a path, and the frames of the legs between them.

    Attributes:
        s: arc lengths, (m,) [mm].
        before, after: unit tangents t1 and t2 of the legs, (m, 3).
        normal: left normal of the leg before, (m, 3).
        axis: unit vector a about which the tangent turns; zero where the path retraces itself, (m, 3).
        carried: the normal and binormal of each leg, as components of those of the first leg carried along the path
            without torsion, (m + 1, 2, 2): one vector a column. Unit matrices on a path in one plane.
    """

    s: Floats
    before: Floats
    after: Floats
    normal: Floats
    axis: Floats
    carried: Floats

    @classmethod
    def of(cls, path: Framed) -> Corners:
        """Return the corners of a path."""
        s = path.corners
        inset = np.maximum(_BESIDE_CORNER, _BESIDE_ROUNDING * np.spacing(s))
        before = path.tangent(s - inset)
        after = path.tangent(s + inset)
        normal = path.normal(s - inset)
        cosine = dot(before, after)
        cross = np.cross(before, after)
        sine = np.linalg.norm(cross, axis=1)
        turns = (cosine > 0) | (sine > _FOLD)
        axis = np.where(turns[:, None], cross, 0.0) / np.where(turns, sine, 1.0)[:, None]
        # where a path retraces itself, its sides are exchanged and nothing is turned
        first = np.where(turns[:, None], _turned_vectors(normal, axis, cosine, sine), normal)
        second = np.where(turns[:, None], np.cross(after, first), np.cross(before, normal))
        next_normal = path.normal(s + inset)
        next_binormal = np.cross(after, next_normal)
        columns = [
            [dot(next_normal, first), dot(next_binormal, first)],
            [dot(next_normal, second), dot(next_binormal, second)],
        ]
        u, _, v = np.linalg.svd(np.moveaxis(np.array(columns), -1, 0))
        # the nearest orthogonal matrix, as the two lines of a fold are not exactly one
        change = u @ v
        change[np.abs(change - np.eye(2)).max(axis=(1, 2), initial=0.0) < _ROUNDING] = np.eye(2)  # which is no torsion
        return cls(s, before, after, normal, axis, _products(change))

    def leg(self, s: Floats) -> NDArray[np.intp]:
        """Return the leg of feet, (n,), from 0; a corner belongs to the leg before it."""
        return np.searchsorted(self.s, s - _AT_CORNER)

    def between(self, s: Floats, other: Floats) -> NDArray[np.bool_]:
        """Whether a corner lies between two feet, or is one of them, (n,)."""
        low = np.minimum(s, other)
        high = np.maximum(s, other)
        return np.searchsorted(self.s, low - _AT_CORNER) != np.searchsorted(self.s, high + _AT_CORNER)

    def about(self, s: Floats, offset: Floats) -> tuple[NDArray[np.intp], Components]:
        """Return which of some feet are corners, and the components of their offsets in the frame of the leg before.

        Args:
            s: feet, (n,) [mm].
            offset: points minus their feet, (n, 3) [mm].

        Returns:
            Their indices, (k,), and their components: rolled about the corner where the point lies in the wedge outside
            it, so that none is along the tangent.
        """
        middles = 0.5 * (self.s[1:] + self.s[:-1])
        nearest = np.searchsorted(middles, s)
        rows = np.flatnonzero(np.abs(self.s[nearest] - s) <= _AT_CORNER)
        corner = nearest[rows]
        tangent = self.before[corner]
        axis = self.axis[corner]
        across = offset[rows]
        outside = (dot(across, tangent) > -_ON_EDGE) & (dot(across, self.after[corner]) < _ON_EDGE)
        rolls = (outside & axis.any(axis=1))[:, None]
        along_axis = dot(across, axis)[:, None] * axis
        radius = np.linalg.norm(across - along_axis, axis=1)
        across = np.where(rolls, along_axis - radius[:, None] * np.cross(axis, tangent), across)
        normal = self.normal[corner]
        binormal = np.cross(tangent, normal)
        beyond = np.where(rolls[:, 0], 0.0, dot(across, tangent))
        return rows, Components(dot(across, normal), dot(across, binormal), beyond)

    def carry(self, components: Components, s: Floats, to: Floats) -> Components:
        """Return offsets at feet in the frame of the legs of other feet, carried there without torsion.

        Args:
            components: of the offsets in the frames at their feet.
            s: their feet, (n,) [mm].
            to: the other feet, (n,) [mm].
        """
        if self._plane:
            return components
        start = self.leg(s)
        end = self.leg(to)
        rows = np.flatnonzero(start != end)
        across = np.stack([components.lateral[rows], components.vertical[rows]], axis=1)
        carried_to_start = self.carried[start[rows]]
        carried_to_end = self.carried[end[rows]]
        # orthogonal: the inverse of the second is its transpose
        across = np.einsum("nji,njk,nk->ni", carried_to_end, carried_to_start, across)
        lateral = components.lateral.copy()
        vertical = components.vertical.copy()
        lateral[rows] = across[:, 0]
        vertical[rows] = across[:, 1]
        return Components(lateral, vertical, components.beyond)

    @cached_property
    def _plane(self) -> bool:
        """Whether the path lies in a plane and nowhere retraces itself."""
        return bool((self.carried == np.eye(2)).all())


def _turned_vectors(vector: Floats, axis: Floats, cosine: Floats, sine: Floats) -> Floats:
    """Turn vectors about axes, by Rodrigues' formula, (n, 3)."""
    along = dot(axis, vector)[:, None] * axis
    return cosine[:, None] * (vector - along) + sine[:, None] * np.cross(axis, vector) + along


def _products(changes: Floats) -> Floats:
    """Return the product of the first k matrices, k from 0 to m, (m + 1, 2, 2)."""
    products = np.empty((len(changes) + 1, 2, 2))
    products[0] = np.eye(2)
    for k, change in enumerate(changes):
        products[k + 1] = products[k] @ change
    return products
