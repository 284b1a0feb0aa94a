"""Interface of a machine's kinematics: from coordinates of a program to positions of the axes, and frames of work."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

MM = 1e3
DEG = 180 / np.pi
_ROUNDING = 1e-9  # [mm or deg]

_TOLERANCE = 1e-3  # [mm], also of unit vectors
_PROBE = 100.0  # displacement of each slide in the test of the rotary axes [mm]


class UnreachableError(InputError):
    """A position that the machine cannot take.

    Attributes:
        row: its index.
    """

    def __init__(self, text: str, row: int) -> None:
        super().__init__(text)
        self.row = row


@dataclass(frozen=True)
class Coordinate:
    """A coordinate of programs.

    Attributes:
        name: such as "x".
        unit: "mm" or "deg".
        travel: lowest and highest value [mm or deg].
    """

    name: str
    unit: str
    travel: tuple[float, float]

    @classmethod
    def of(cls, model: mujoco.MjModel, joint: int, name: str | None = None, origin: float = 0.0) -> Coordinate:
        """Return the coordinate of a joint.

        Args:
            model: the compiled model.
            joint: index of a slide or hinge.
            name: of the coordinate, by default the joint's.
            origin: the coordinate where the joint is at zero [mm or deg].
        """
        low = -np.inf
        high = np.inf
        if model.jnt_limited[joint]:
            low, high = model.jnt_range[joint].tolist()
        per_si = per_si_of(model, joint)
        unit = "mm" if per_si == MM else "deg"
        joint_name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or ""
        return cls(name or joint_name, unit, (origin + per_si * low, origin + per_si * high))


class Kinematics(ABC):
    """Kinematics of a machine, all of whose dimensions come from its compiled model.

    Positions of axes and coordinates are in mm for a slide or a length, in deg for a hinge or an angle.

    Attributes:
        coordinates: of programs, in the order of their columns.
        followers: joints that no motor drives but that follow the axes through a closed chain, by index.
        axes_are_coordinates: whether every axis is a coordinate by itself. Limits of the linear coordinates are then
            limits of axes, positions within the travel are within reach, and errors of a guide move the nozzle
            straight. Elsewhere the coordinates x, y and z place the nozzle in the work frame.
    """

    axes_are_coordinates: ClassVar[bool] = False
    coordinates: tuple[Coordinate, ...]
    followers: tuple[int, ...] = ()

    @classmethod
    @abstractmethod
    def of(cls, model: mujoco.MjModel, driven: Sequence[int], nozzle: int, work: int) -> Kinematics:
        """Return the kinematics of a machine.

        Args:
            model: the compiled model.
            driven: index of each axis' joint.
            nozzle: index of the site.
            work: index of the body.

        Raises:
            InputError: a model without the mechanism that these kinematics need.
        """

    @abstractmethod
    def forward(self, axes: Floats) -> Floats:
        """Return the program's coordinates at positions of the axes, (n, axes) to (n, coordinates)."""

    @abstractmethod
    def inverse(self, position: Floats) -> Floats:
        """Return the positions of the axes at a program's coordinates, (n, coordinates) to (n, axes).

        The result may be the argument itself.

        Raises:
            UnreachableError: coordinates out of their travel or reach, or too near a singularity.
        """

    def follow(self, axes: Floats) -> Floats:
        """Return qpos of the followers at positions of the axes, (n, axes) to (n, followers) [m or rad].

        It never fails: axes that the chain cannot close give the position at which it nearly does.
        """
        return np.empty((len(axes), 0))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    def position_text(self, position: Floats) -> str:
        """Return a position as text, such as "x = 10, y = 0, z = 426 mm, r = 90 deg"."""
        parts = []
        for k, (coordinate, value) in enumerate(zip(self.coordinates, position.tolist(), strict=True)):
            part = f"{coordinate.name} = {value:.6g}"
            if k + 1 == len(self.coordinates) or self.coordinates[k + 1].unit != coordinate.unit:
                # once, after the last coordinate of that unit
                part += f" {coordinate.unit}"
            parts.append(part)
        return ", ".join(parts)

    def check_travel(self, position: Floats) -> None:
        """Raise UnreachableError where a coordinate is out of its travel, at the first such position."""
        low, high = np.array([coordinate.travel for coordinate in self.coordinates]).T
        out = (position < low - _ROUNDING) | (position > high + _ROUNDING)
        if out.any():
            row = int(out.any(axis=1).argmax())
            coordinate = self.coordinates[int(out[row].argmax())]
            low, high = coordinate.travel
            bounds = f"{low:g} to {high:g} {coordinate.unit}"
            raise UnreachableError(
                f"{self.position_text(position[row])}: {coordinate.name} must lie in the travel {bounds}", row
            )


def per_si_of(model: mujoco.MjModel, joint: int) -> float:
    """Return mm per metre for a slide, degrees per radian for a hinge."""
    return MM if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else DEG


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
