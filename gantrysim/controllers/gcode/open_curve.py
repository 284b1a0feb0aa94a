"""A NURBS whose control points are being read."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class OpenCurve:
    """A NURBS whose control points are being read, as x + iy of the plane's axes.

    Attributes:
        name: code of its control points.
        order: one more than its degree.
        points: control points [mm].
        weights: of the points.
        knots: of its own.
    """

    name: str
    order: int
    points: list[complex] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)
    knots: list[float] = field(default_factory=list)

    def add(self, point: complex, weight: float) -> None:
        """Add a control point."""
        self.points.append(point)
        self.weights.append(weight)
