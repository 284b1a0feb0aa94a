"""Axes in series: programs give the positions of the axes, as on a Cartesian gantry or a stage."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.machine.kinematics.base import Coordinate, Kinematics


class Serial(Kinematics):
    """Every axis is a coordinate; the supervision of the axes checks their travel."""

    axes_are_coordinates: ClassVar[bool] = True

    def __init__(self, coordinates: Sequence[Coordinate]) -> None:
        self.coordinates = tuple(coordinates)

    @classmethod
    def of(cls, model: mujoco.MjModel, driven: Sequence[int], nozzle: int, work: int) -> Serial:
        return cls([Coordinate.of(model, joint) for joint in driven])

    def forward(self, axes: Floats) -> Floats:
        return np.array(axes, float)

    def inverse(self, position: Floats) -> Floats:
        return position
