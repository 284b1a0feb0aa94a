"""Coordinates of a program against the frame of the work."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.kinematics.base import Coordinate, Kinematics

_TOLERANCE = 1e-3  # [mm], also of unit vectors
_PROBE = 100.0  # displacement of each slide in the test of the rotary axes [mm]


def check_work_frame(kinematics: Kinematics, home: Floats, tip: Callable[[Floats], Floats]) -> None:
    """Raise InputError unless the coordinates x, y, z are the nozzle in the work frame, to a micrometre.

    Args:
        kinematics: of the machine.
        home: coordinates with all axes at zero, (coordinates,) [mm or deg].
        tip: from positions of the axes to the nozzle in the work frame, (n, axes) to (n, 3) [mm].
    """

    def nozzle(position: Floats) -> Floats:
        return tip(kinematics.inverse(position))

    coordinates = kinematics.coordinates
    _check_origin(kinematics, home, nozzle(home[None])[0])
    unit = np.eye(len(coordinates))
    step = _steps(kinematics, home)
    probes = _probes(kinematics, home)
    directions = step[:, None] * (nozzle(home + step[:, None] * unit) - nozzle(home[None]))
    for coordinate, along, direction in zip(coordinates, unit, directions, strict=True):
        turns = (90.0, 180.0) if coordinate.unit == "deg" else ()
        for turn in turns:
            displacement = np.linalg.norm(nozzle(probes + turn * along) - nozzle(probes), axis=1).max()
            if displacement > _TOLERANCE:
                raise InputError(
                    f"rotary axis {coordinate.name!r} moves the nozzle by {displacement:.4g} mm "
                    f"in {turn:g} deg: must turn it about its own tip; move the joint's pos there, or the nozzle"
                )
        if coordinate.name in "xyz":
            _check_direction(coordinate, direction)


def _steps(kinematics: Kinematics, home: Floats) -> Floats:
    """Return displacements of 1 mm or deg from home, (coordinates,), downwards where the travel ends above."""
    # the travel of an axis is no limit of its kinematics
    if kinematics.axes_are_coordinates:
        return np.ones(len(home))
    upper = np.array([coordinate.travel[1] for coordinate in kinematics.coordinates])
    return np.where(home + 1 <= upper, 1.0, -1.0)


def _probes(kinematics: Kinematics, home: Floats) -> Floats:
    """Return positions at which a rotary axis must not move the nozzle, (n, coordinates)."""
    # a displacement could be out of reach
    if not kinematics.axes_are_coordinates:
        return home[None]
    slides = [coordinate.unit == "mm" for coordinate in kinematics.coordinates]
    return np.concatenate([home[None], home + _PROBE * np.eye(len(home))[slides]])


def _check_origin(kinematics: Kinematics, home: Floats, nozzle: Floats) -> None:
    coordinates = dict(zip(kinematics.names, home, strict=True))
    offset = nozzle - [coordinates.get(name, 0.0) for name in "xyz"]
    if np.abs(offset).max() <= _TOLERANCE:
        return
    frame = "its coordinates in body 'work'"
    remedy = ""
    if kinematics.axes_are_coordinates:
        place = " ".join(f"{1e-3 * value:.6g}" for value in offset)
        frame = "body 'work'"
        remedy = f'; add <body name="work" pos="{place}"/> inside that body, in its place'
    raise InputError(
        f"with all axes at zero the nozzle is at {_vector(offset)} mm of {frame}: must be its origin{remedy}"
    )


def _check_direction(coordinate: Coordinate, direction: Floats) -> None:
    name = coordinate.name
    if np.abs(direction - np.eye(3)["xyz".index(name)]).max() <= _TOLERANCE:
        return
    remedy = "turn the joint's axis, or let the names of the axes change places"
    if np.abs(direction).max() <= _TOLERANCE:
        remedy = "as 'work', name a body that this axis does not carry"
    raise InputError(
        f"axis {name!r} moves the nozzle along {_vector(direction)} of body 'work': must be along its {name}; {remedy}"
    )


def _vector(values: Floats) -> str:
    return f"({', '.join(f'{value:g}' for value in values.round(6))})"
