"""The path of the real axes: the virtual circles, scaled by the ratio of every pass."""

from __future__ import annotations

import math

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.paths.arcs import ArcChain
from gantrysim.controllers.paths.chain import Chain
from gantrysim.controllers.paths.path import Path
from gantrysim.controllers.paths.pieces import Coil, Line, Vector
from gantrysim.controllers.trio.loop import Passes


def track(start: Vector, passes: Passes, radius: float, climb: float, clockwise: bool) -> Path:
    """Return the path that a loop's passes command, an arc or a helix for each.

    Args:
        start: first point [mm].
        passes: of the program loop.
        radius: of the virtual circles [mm].
        climb: height per radian of the virtual circles [mm/rad].
        clockwise: sense of the turning; the first motion is towards +y.
    """
    ratio, angle = passes.connected, np.diff(passes.way) / radius
    turn = -1.0 if clockwise else 1.0
    if np.all(ratio > 0):
        return ArcChain(start, 0.5 * math.pi, turn / (ratio * radius), angle * ratio * radius, climb * angle)
    return _with_cusps(start, -turn * ratio * radius, turn * angle, climb * angle)


def _with_cusps(start: Vector, radius: Floats, angle: Floats, rise: Floats) -> Chain:
    """Arcs about centres square to +y, of signed radii: a negative one is run backwards, at zero nothing turns.

    A point of the virtual circle at the angle psi stands at centre + r (cos psi, sin psi) with the signed radius r.
    """
    pieces: list[Line | Coil] = []
    at = np.array(start)
    psi = math.pi
    for r, swept, up in zip(radius.tolist(), angle.tolist(), rise.tolist(), strict=True):
        centre = at - r * np.array([math.cos(psi), math.sin(psi), 0.0])
        begin = psi if r >= 0 else psi + math.pi
        psi += swept
        end = centre + np.array([r * math.cos(psi), r * math.sin(psi), up])
        if r:
            pieces.append(Coil(_vector(centre), (abs(r), abs(r)), begin, swept, up))
        else:
            pieces.append(Line(_vector(at), _vector(end)))
        at = end
    return Chain(pieces)


def _vector(point: Floats) -> Vector:
    x, y, z = point.tolist()
    return x, y, z
