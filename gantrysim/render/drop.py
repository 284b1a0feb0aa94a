"""The glue between the needle's tip and the bead: there while it flows, drawn back into the needle when it stops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.bead.trace import BeadTrace

_WETTED = 1.0  # of the thread's radius, that the glue climbs up the needle
_HANGS = 3.0  # thread radii that a drop hangs down, off the surface


class Drop(NamedTuple):
    """An ellipsoid about the vertical below the tip.

    Attributes:
        centre: in the work frame, (3,) [m].
        radius: [m].
        half_height: [m].
    """

    centre: NDArray[np.float64]
    radius: float
    half_height: float


def drop_at(bead_trace: BeadTrace, tick: int) -> Drop | None:
    """Return the drop at a tick, or None where no glue flows.

    It is as thick as the free thread that the glue makes: of the nominal section A,

        r = sqrt(A / pi) sqrt(Q / Q0),

    with the flow Q and the largest of the run, Q0. It wets the needle, and reaches down to the surface, or hangs where
    the nozzle stands high above it.
    """
    run = bead_trace.run
    flow, most = float(run.flow[tick]), float(run.flow.max())
    section = bead_trace.nominal if bead_trace.nominal > 0 else float(bead_trace.area.max())
    if flow <= 0 or section <= 0:
        return None
    radius = float(np.sqrt(section / np.pi * flow / most))
    tip = run.nozzle[tick]
    height = float(tip[2] - bead_trace.surface[tick])
    top, bottom = _WETTED * radius, min(max(height, 0.0), _HANGS * radius)
    centre = tip + np.array([0.0, 0.0, 0.5 * (top - bottom)])
    return Drop(1e-3 * centre, 1e-3 * radius, 0.5e-3 * (top + bottom))
