"""Controllers as a user writes them: a zigzag, a reader of points, and classes that are wrong in several ways."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from gantrysim.base.errors import positive
from gantrysim.controllers.controller import Controller
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.paths.track import Track
from gantrysim.record.setpoints import Setpoints


def polyline(points):
    ends = np.array([(*point, 0.0) for point in points[1:]])
    count = len(ends)
    return Track((*points[0], 0.0), ends, np.zeros(count), np.zeros((count, 3)), np.zeros(count), [np.eye(3)])


@dataclass(frozen=True)
class Lines(Controller):
    """Lines at constant speed, from point to point.

    Args:
        speed: along the lines [mm/s].
    """

    speed: float

    def __post_init__(self) -> None:
        positive("speed", self.speed, "mm/s")

    @property
    def points(self) -> list[tuple[float, float]]:
        return [(0.0, 0.0), (10.0, 0.0)]

    @cached_property
    def requested(self) -> Track:
        return polyline(self.points)

    @property
    def duration(self) -> float:
        return self.requested.length / self.speed

    @property
    def axes(self) -> tuple[str, ...]:
        return ("x", "y")

    def setpoints(self, period: float) -> Setpoints:
        return Setpoints.along(self.requested, self.speed, period)

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        return {"speed": change(self.speed)}


@dataclass(frozen=True)
class Zigzag(Lines):
    """Lines to and fro.

    Args:
        speed: along the lines [mm/s].
        lines: number of lines.
        length: of each line [mm].
        pitch: from one line to the next [mm].
    """

    lines: int = 3
    length: float = 20.0
    pitch: float = 4.0

    @property
    def points(self) -> list[tuple[float, float]]:
        corners = [(0.0, 0.0)]
        for k in range(self.lines):
            x = self.length if k % 2 == 0 else 0.0
            corners += [(x, self.pitch * k), (x, self.pitch * (k + 1))]
        return corners[:-1]


@dataclass(frozen=True)
class Reader(Lines):
    """Lines through the points of a file, "x y" in each line."""

    text_argument: ClassVar[str] = "listing"
    listing: str = ""

    @property
    def points(self) -> list[tuple[float, float]]:
        return [tuple(map(float, line.split())) for line in self.listing.splitlines()]


class Spiral(MoveSpiral):
    """The controller of the package under another name."""


def function(speed):
    return Lines(speed)


instance = Lines(10.0)


class NoController:
    speed: float = 1.0


class Alike:
    requested = duration = axes = setpoints = with_speeds = None


@dataclass(frozen=True)
class Unfinished(Controller):
    speed: float

    @property
    def axes(self) -> tuple[str, ...]:
        return ("x",)

    def setpoints(self, period: float) -> Setpoints:
        raise NotImplementedError


@dataclass
class Changing(Controller):
    requested = duration = axes = setpoints = with_speeds = None
    speed: float


class Plain(Controller):
    requested = duration = axes = setpoints = with_speeds = None


@dataclass(frozen=True)
class Reserved(Lines):
    controller: str = ""


@dataclass(frozen=True)
class Raising(Lines):
    def __post_init__(self) -> None:
        raise KeyError("no such turn")


@dataclass(frozen=True)
class Exiting(Lines):
    def __post_init__(self) -> None:
        sys.exit(0)


@dataclass(frozen=True)
class Arrays(Lines):
    corners: np.ndarray = None


@dataclass(frozen=True)
class Undefined(Lines):
    corners: Nowhere = None  # noqa: F821


@dataclass(frozen=True)
class Complex(Lines):
    pole: complex = 1j


@dataclass(frozen=True)
class Nothing(Lines):
    def setpoints(self, period: float) -> Setpoints:
        return None


class MyTrack(Track):
    pass


@dataclass(frozen=True)
class MyPath(Lines):
    @property
    def requested(self) -> Track:
        return MyTrack((0, 0, 0), [(10, 0, 0)], [0], [(0, 0, 0)], [0], [np.eye(3)])
