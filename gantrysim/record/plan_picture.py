"""A drawing of setpoints in plan view for a notebook."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.display import svg_picture
from gantrysim.paths.path import Path

_MOST_POINTS = 800  # of a drawn line
_FAINT = 0.5  # opacity of the path without glue


def plan_picture(path: Path, progress: Floats | None, dispense: NDArray[np.bool_]) -> str:
    """Return a requested path, and over it where the dispenser is on, as an SVG element.

    Positions of axes are no plan view where the work turns: the progress along the path says where glue is laid.

    Args:
        path: the requested path.
        progress: arc length along it of each setpoint, (n,) [mm]; None where it is not known.
        dispense: dispenser command, (n,).
    """
    line = _points(path, 0.0, path.length, _MOST_POINTS)
    low = line.min(axis=0)
    wide, high = np.maximum(np.ptp(line, axis=0), 1e-3).tolist()
    pixel = max(wide, high) / 320
    content = _line(line, pixel, _FAINT)
    if progress is not None:
        content += "".join(_line(points, 3 * pixel) for points in _glued_stretches(path, progress, dispense))
    return svg_picture(content, (*low.tolist(), wide, high), "plan view of the setpoints")


def _glued_stretches(path: Path, progress: Floats, dispense: NDArray[np.bool_]) -> Iterator[Floats]:
    """Yield the points of each stretch of the path that is passed with the dispenser on, (k, 2) [mm]."""
    edges = np.flatnonzero(np.diff(dispense, prepend=False, append=False)).reshape(-1, 2)
    for begin, end in edges[:_MOST_POINTS].tolist():
        first = float(progress[begin])
        last = float(progress[end - 1])
        count = 2 + round(_MOST_POINTS * (last - first) / path.length)
        yield _points(path, first, last, count)


def _points(path: Path, first: float, last: float, count: int) -> Floats:
    return path.position(np.linspace(first, last, count))[:, :2]


def _line(points: Floats, width: float, opacity: float = 1.0) -> str:
    drawn = " ".join(f"{x:.5g},{y:.5g}" for x, y in points.tolist())
    stroke = f'stroke="currentColor" stroke-opacity="{opacity:g}" stroke-width="{width:.3g}" stroke-linecap="round"'
    return f'<polyline points="{drawn}" fill="none" {stroke}/>'
