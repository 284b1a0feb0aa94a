"""How many times as wide as it is a thin bead is drawn, so that it is seen in a picture that holds all of it."""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.glue.bead.trace import BeadTrace
from gantrysim.render.framing import FIELD_OF_VIEW, Framing

# of the picture below the panel that the bead is to cover: a twelfth of the whole frame, with some of it hidden
_SHARE = 0.12
_MOST = 4.0  # a wider bead looks like a ribbon
_STEPS = 10  # of the factor, per unit
_MERGING = 0.2  # share of the bead that may reach a neighbouring turn
_STATIONS = 800  # of the bead that are compared with each other
_DRY = 0.2  # of the median width, below which there is hardly a bead


def widening(framing: Framing, bead_trace: BeadTrace, width_over_height: float) -> float:
    """Return the factor, at least 1, by which a bead is drawn wider: as little as it needs, in tenths.

    It ends where a fifth of the bead would reach a neighbouring turn, as gaps are to stay gaps, and at 4.

    Args:
        framing: of the bead.
        bead_trace: the bead.
        width_over_height: of the picture.
    """
    share = picture_share(framing, bead_trace, width_over_height)
    if share <= 0:
        return 1.0
    needed = math.ceil(_STEPS * _SHARE / share - 1e-9) / _STEPS
    room = math.floor(_STEPS * min(clearance(bead_trace), _MOST)) / _STEPS
    return max(min(needed, room), 1.0)


def picture_share(framing: Framing, bead_trace: BeadTrace, width_over_height: float) -> float:
    """Return the share of a picture that a bead covers, were it flat and nothing before it.

    A level piece of the bead, of the area dA at q from the camera, covers dA |q_z| / (q.f)³ of the plane at unit
    distance, where f is the camera's axis; the picture covers 4 tan²(a) times its width over its height, where a is
    half of the field of view.
    """
    place = 1e-3 * bead_trace.point - framing.position(width_over_height)
    depth = place @ framing.axes[0]
    area = 1e-6 * bead_trace.width * bead_trace.ds
    covered = float(np.sum(area * np.abs(place[:, 2]) / depth**3))
    return covered / (4 * np.tan(np.radians(0.5 * FIELD_OF_VIEW)) ** 2 * width_over_height)


def clearance(bead_trace: BeadTrace) -> float:
    """Return the distance of neighbouring turns over the bead's width that four fifths of the bead exceed."""
    width = bead_trace.width
    wet = np.flatnonzero(width > _DRY * np.median(width[width > 0])) if width.any() else np.array([], np.intp)
    if not wet.size:
        return math.inf
    station = wet[np.linspace(0, wet.size - 1, min(wet.size, _STATIONS)).astype(int)]
    point = bead_trace.point[station]
    along = np.abs(np.subtract.outer(bead_trace.place[station], bead_trace.place[station]))
    distance: Floats = np.linalg.norm(point[:, None] - point[None], axis=2)
    # the same turn: hardly a detour along the bead, as around a corner
    distance[along <= 2 * (distance + width[station].max())] = np.inf
    return float(np.quantile(distance.min(axis=1) / width[station], _MERGING, method="lower"))
