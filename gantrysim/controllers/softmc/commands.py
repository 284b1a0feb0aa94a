"""The commands of a program as values: CIRCLE by angle or through points, and MOVE."""

from __future__ import annotations

from dataclasses import dataclass

from gantrysim.base.errors import InputError, between, finite
from gantrysim.controllers.softmc.group import Nodal

Coordinates = tuple[float, ...]  # x, y[, z[, r]]; omitted ones stay

PLANES = ("XY", "XZ", "YZ")
_FARTHEST_COORDINATE = 1e6  # coordinate [mm or deg]


class SoftMCError(InputError):
    """A command that cannot be run, with its line, its text and the reason."""


@dataclass(frozen=True)
class Circle(Nodal):
    """An arc by its angle, `Circle(angle, centre)`, or through points, `Circle(via=..., target=...)`.

    Args:
        angle: swept, counter-clockwise positive; more than 360 makes several turns (Angle) [deg].
        centre: (CircleCenter) [mm]. Its component outside the plane is the height at the end, to which the axis
            climbs in proportion to the angle; its fourth the orientation at the end [deg]. Both are assumptions.
        plane: 0 XY, 1 XZ, 2 YZ; positive angles turn the first axis towards the second (CirclePlane).
        via: a point between the start and the target, in any plane (CirclePoint) [mm]; its orientation is not used.
        target: end point (TargetPoint) [mm], and the orientation there [deg].
    """

    angle: float | None = None
    centre: Coordinates | None = None
    plane: int = 0
    via: Coordinates | None = None
    target: Coordinates | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [name for name in ("angle", "centre", "via", "target") if getattr(self, name) is not None]
        if given not in (["angle", "centre"], ["via", "target"]):
            raise SoftMCError(
                f"circle by {' and '.join(given) or 'nothing'}: must be by angle and centre, or by via and target; "
                "in text Angle and CircleCenter, or CirclePoint and TargetPoint"
            )
        if isinstance(self.plane, bool) or self.plane not in range(len(PLANES)):
            raise SoftMCError(f"plane = {self.plane!r}: must be 0 (XY), 1 (XZ) or 2 (YZ)")
        if self.angle is not None:
            object.__setattr__(self, "angle", finite("angle", self.angle, "deg"))
            if self.angle == 0:
                raise SoftMCError("angle = 0 deg: must not be 0 deg; positive is counter-clockwise")
        elif self.plane:
            raise SoftMCError(
                f"plane = {self.plane} ({PLANES[self.plane]}) with a circle through points: must be omitted; "
                "the three points define the plane"
            )
        for name in ("centre", "via", "target"):
            object.__setattr__(self, name, _coordinates(name, getattr(self, name)))


@dataclass(frozen=True)
class Move(Nodal):
    """A straight line to a point.

    Args:
        target: end point [mm], and the orientation there [deg].
    """

    target: Coordinates

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "target", _coordinates("target", self.target))


Command = Circle | Move


def _coordinates(name: str, values: Coordinates | None) -> Coordinates | None:
    if values is None:
        return None
    if isinstance(values, str) or not hasattr(values, "__iter__"):
        raise SoftMCError(f"{name} = {values!r}: must be coordinates [mm]")
    return tuple(
        between(f"coordinate of {name}", value, -_FARTHEST_COORDINATE, _FARTHEST_COORDINATE) for value in values
    )
