"""Speeds and accelerations of a real machine, as lines of a job that runs its programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple


class AxisLimits(NamedTuple):
    """Limits of an axis; 0 where they are not known.

    Attributes:
        name: of the axis, x, y or z.
        speed: [mm/s].
        acceleration: [mm/s²].
        steps: that a position drive gets per travel [1/mm].
        following_error: at which the drives are disabled [mm].
    """

    name: str
    speed: float
    acceleration: float
    steps: float = 0.0
    following_error: float = 0.0

    def in_words(self) -> str:
        """Return the limits in a line."""
        parts = [f"{self.speed:.6g} mm/s", f"{self.acceleration:.6g} mm/s²"]
        if self.steps:
            parts.append(f"{self.steps:.6g} steps/mm, {1e3 / self.steps:.4g} µm each")
        if self.following_error:
            parts.append(f"following error at most {self.following_error:.6g} mm")
        return f"{self.name}: {', '.join(parts)}"


def program_lines(limits: Sequence[AxisLimits], acceleration: float = 0.0) -> list[str]:
    """Return the table [program] of a job of G-code with the limits of a machine.

    Args:
        limits: of its axes.
        acceleration: along the path; 0 for the lowest of the axes, as a job has one for all [mm/s²].
    """
    speeds = {limit.name: limit.speed for limit in limits}
    lowest = min((limit.acceleration for limit in limits if limit.acceleration), default=0.0)
    lines = ["[program]"]
    if acceleration or lowest:
        meaning = "along the path" if acceleration else "the lowest of the axes"
        lines.append(f"acceleration = {acceleration or lowest!r}  # {meaning} [mm/s²]")
    of_axes = ", ".join(repr(speeds.get(name) or math.inf) for name in "xyz")
    lines.append(f"axis_speeds = [{of_axes}]  # x, y, z [mm/s]")
    return lines
