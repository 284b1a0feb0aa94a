"""Interface of a machine's kinematics: from a program's coordinates to positions of the axes, and back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError

MM = 1e3
DEG = 180 / np.pi
_ROUNDING = 1e-9  # [mm or deg]


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
