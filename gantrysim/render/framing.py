"""A camera that holds the whole bead of a run in the picture, from the side where least of the machine hides it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.columns import by_blocks
from gantrysim.glue.bead.trace import LEVEL, climb
from gantrysim.record.run import Run

FIELD_OF_VIEW = 35.0  # vertical [deg]
MARGIN = 1.2  # half width and height of the picture over those of the bead
_FLAT_ELEVATION = -35.0  # of the camera's axis, for beads in a level plane [deg]
_STEEP_ELEVATION = -50.0  # for bowls and cones, whose far side a flatter view hides [deg]
_NEAREST = 0.08  # from the camera to the middle of a bead: nearer, the needle would leave the picture [m]
_MOST_POINTS = 2000  # of a bead that are looked at


@dataclass(frozen=True, eq=False)
class Framing:
    """Axis of a camera in the frame of the work, whose distance holds all points of a bead.

    Attributes:
        points: places of the nozzle with glue, (n, 3) [m].
        azimuth: direction in which the camera looks, from the work's x axis about z [deg].
        elevation: above the work's xy plane, negative for a camera that looks down [deg].
    """

    points: Floats
    azimuth: float
    elevation: float

    @classmethod
    def of(cls, runs: Sequence[Run], azimuth: float) -> Framing:
        """Return the framing of the beads of some runs; of one that lays none, of the whole path of its nozzle."""
        shown = [np.flatnonzero(run.dispense) if run.dispense.any() else np.arange(len(run.time)) for run in runs]
        sizes = [ticks.size for ticks in shown]
        every = max(1, sum(sizes) // _MOST_POINTS)
        points: list[Floats] = []
        heights: list[Floats] = []
        for run, ticks, before in zip(runs, shown, np.cumsum([0, *sizes[:-1]]).tolist(), strict=True):
            # evenly from all runs together
            points.append(run.nozzle[ticks[-before % every :: every]])
            heights.append(_heights(run, ticks))
        elevation = _FLAT_ELEVATION if climb(np.concatenate(heights)) <= LEVEL else _STEEP_ELEVATION
        return cls(1e-3 * np.concatenate(points), azimuth, elevation)

    @cached_property
    def centre(self) -> Floats:
        """Centre of the box around the points, at which the camera looks, (3,) [m]."""
        return 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))

    @property
    def axes(self) -> tuple[Floats, Floats, Floats]:
        """The camera's axes in the work's frame: forward, right and up, (3,) each."""
        azimuth = np.radians(self.azimuth)
        elevation = np.radians(self.elevation)
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        forward = np.cos(elevation) * level + [0.0, 0.0, np.sin(elevation)]
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        return forward, right, np.cross(right, forward)

    def distance(self, width_over_height: float, margin: float = MARGIN) -> float:
        """Return the least distance of the camera from the centre at which every point is in the picture [m].

        A point p, relative to the centre, lies d + p.f before a camera at the distance d, and p.r beside its axis. It
        is inside the margin m of a picture with the half angle a where

            m |p.r| <= (d + p.f) tan(a),

        which holds for all points from the largest m |p.r| / tan(a) - p.f; the same in height.

        Args:
            width_over_height: of the picture.
            margin: half width and half height of the picture over those of the bead.
        """
        forward, right, up = self.axes
        relative = self.points - self.centre
        half_height = np.tan(np.radians(0.5 * FIELD_OF_VIEW))
        half_width = half_height * width_over_height
        beside = margin * np.abs(relative @ right) / half_width
        above = margin * np.abs(relative @ up) / half_height
        return max(float((np.maximum(beside, above) - relative @ forward).max()), _NEAREST)

    def in_picture(self, width_over_height: float) -> Floats:
        """Return the places of the points in the picture, (n, 2): -1 to 1 from left to right and from bottom to top."""
        forward, right, up = self.axes
        relative = self.points - self.centre
        half_height = np.tan(np.radians(0.5 * FIELD_OF_VIEW))
        depth = self.distance(width_over_height) + relative @ forward
        across = (relative @ right) / (depth * half_height * width_over_height)
        return np.stack([across, (relative @ up) / (depth * half_height)], axis=1)

    def position(self, width_over_height: float) -> Floats:
        """Return the place of the camera in the frame of the work, (3,) [m]."""
        return self.centre - self.distance(width_over_height) * self.axes[0]


def _heights(run: Run, ticks: NDArray[np.intp]) -> Floats:
    """Return the height of the nozzle at ticks, (n,) [mm]; block by block, as a long run does not fit in memory."""
    return by_blocks(lambda block: run.nozzle[ticks[block], 2], ticks.size)
