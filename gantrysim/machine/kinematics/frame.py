"""Coordinates of a program against the frame of the work."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.kinematics.base import Kinematics

_TOLERANCE = 1e-3  # [mm], also of unit vectors
_PROBE = 100.0  # displacement of each slide in the test of the rotary axes [mm]


def check_work_frame(kinematics: Kinematics, at_home: Floats, tip: Callable[[Floats], Floats]) -> None:
    """Raise InputError unless the coordinates x, y, z are the nozzle in the work frame, to a micrometre.

    Args:
        kinematics: of the machine.
        at_home: coordinates with all axes at zero, (coordinates,) [mm or deg].
        tip: from positions of the axes to the nozzle in the work frame, (n, axes) to (n, 3) [mm].
    """

    def nozzle(position: Floats) -> Floats:
        return tip(kinematics.inverse(position))

    coordinates = kinematics.coordinates
    each = np.eye(3)
    unit = np.eye(len(coordinates))
    home = at_home[None]
    room = [
        not kinematics.followers or at + 1 <= along.travel[1] for at, along in zip(at_home, coordinates, strict=True)
    ]
    step = np.where(room, 1.0, -1.0)  # within the travel
    placed = dict(zip(kinematics.names, home[0], strict=True))
    offset = nozzle(home)[0] - [placed.get(name, 0.0) for name in "xyz"]
    if np.abs(offset).max() > _TOLERANCE:
        at = f"{_vector(offset)} mm of {'body' if not kinematics.followers else 'its coordinates in body'} 'work'"
        place = " ".join(f"{1e-3 * value:.6g}" for value in offset)
        remedy = (
            "" if kinematics.followers else f'; add <body name="work" pos="{place}"/> inside that body, in its place'
        )
        raise InputError(f"with all axes at zero the nozzle is at {at}: must be its origin{remedy}")
    # within a closed chain every position has its own reach
    far = [] if kinematics.followers else [coordinate.unit == "mm" for coordinate in coordinates]
    probes = np.concatenate([home, home + _PROBE * unit[far]]) if any(far) else home
    moves = step[:, None] * (nozzle(home + step[:, None] * unit) - nozzle(home))
    for coordinate, along, direction in zip(coordinates, unit, moves, strict=True):
        name = coordinate.name
        for turn in (90.0, 180.0) if coordinate.unit == "deg" else ():
            moved = np.linalg.norm(nozzle(probes + turn * along) - nozzle(probes), axis=1).max()
            if moved > _TOLERANCE:
                raise InputError(
                    f"rotary axis {name!r} moves the nozzle by {moved:.4g} mm "
                    f"in {turn:g} deg: must turn it about its own tip; move the joint's pos there, or the nozzle"
                )
        if name in "xyz" and np.abs(direction - each["xyz".index(name)]).max() > _TOLERANCE:
            still = np.abs(direction).max() <= _TOLERANCE
            remedy = (
                "as 'work', name a body that this axis does not carry"
                if still
                else "turn the joint's axis, or let the names of the axes change places"
            )
            raise InputError(
                f"axis {name!r} moves the nozzle along {_vector(direction)} of body 'work': must be along its {name}; "
                f"{remedy}"
            )


def _vector(values: Floats) -> str:
    return f"({', '.join(f'{value:g}' for value in values.round(6))})"
