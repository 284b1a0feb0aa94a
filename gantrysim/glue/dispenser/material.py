"""What a program that feeds material by E asks of the dispenser."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats


class Material(NamedTuple):
    """Positions of the extruder at the ticks, as in `Setpoints`; None for a program without E.

    Attributes:
        extrusion: fed by E, (n,) [mm].
        extruder: that of the motor under pressure advance, (n,) [mm]; None where it is `extrusion`.
    """

    extrusion: Floats | None = None
    extruder: Floats | None = None

    @property
    def motor(self) -> Floats | None:
        """Position to which the extruder's motor is sent, (n,) [mm]."""
        return self.extrusion if self.extruder is None else self.extruder

    def laid(self) -> Floats:
        """Return the material that leaves an ideal nozzle over the period after each tick, (n,) [mm].

        What is pulled back leaves no more of it, and what is fed again up to where it was leaves nothing.
        """
        assert self.extrusion is not None
        furthest = np.maximum.accumulate(np.maximum(self.extrusion, 0.0))
        return np.diff(furthest, append=furthest[-1:])
