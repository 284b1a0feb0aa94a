"""Settings of a bead: its shape, and the resolution of its height map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from gantrysim.base.errors import InputError, at_least, finite

_LEAST = 1e-6  # smallest gap and cell [mm]
_HIGHEST = 1e9  # gap [mm]
_LEAST_ANGLE = 1.0  # [deg]; below, glue is a film without a shape


@dataclass(frozen=True)
class BeadSettings:
    """Shape of the bead, and resolution of its height map.

    Attributes:
        gap: height of the nozzle above the surface along the requested path; None for the machine's gap [mm].
        contact_angle: contact angle of the glue on the surface, 1 to 90 [deg].
        squashed: whether the bead keeps the section pressed by the needle's face; otherwise it relaxes to a sessile
            shape.
        cell: cell size of the height map [mm].
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    gap: float | None = None
    contact_angle: float = 60.0
    squashed: bool = True
    cell: float = 0.25

    def __post_init__(self) -> None:
        if self.gap is not None:
            at_least("gap", self.gap, _LEAST, "mm", _HIGHEST)
        if not _LEAST_ANGLE <= finite("contact_angle", self.contact_angle, "deg") <= 90:
            raise InputError(
                f"contact_angle = {self.contact_angle:g} deg: must be at least {_LEAST_ANGLE:g} and at most 90 deg"
            )
        at_least("cell", self.cell, _LEAST, "mm")
