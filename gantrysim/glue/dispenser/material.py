"""What a program asks of the dispenser beyond its command: material fed by E, and the set point of an output."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError


class Material(NamedTuple):
    """Positions of the extruder at the ticks, as in `Setpoints`; None for a program without E.

    Attributes:
        extrusion: fed by E, (n,) [mm].
        extruder: that of the motor under pressure advance, (n,) [mm]; None where it is `extrusion`.
        analogue: set point of the flow by an output, (n,); None without.
    """

    extrusion: Floats | None = None
    extruder: Floats | None = None
    analogue: Floats | None = None

    def laid(self) -> Floats:
        """Return the material that leaves an ideal nozzle over the period after each tick, (n,) [mm].

        What is pulled back leaves no more of it, and what is fed again up to where it was leaves nothing.
        """
        if self.extrusion is None:
            raise without_e()
        furthest = np.maximum.accumulate(self.extrusion)
        return np.diff(furthest, append=furthest[-1:])

    def stroke(self) -> Floats:
        """Return how far the extruder's motor is sent over the period after each tick, (n,) [mm]."""
        motor = self.extrusion if self.extruder is None else self.extruder
        if motor is None:
            raise without_e()
        return np.diff(motor, append=motor[-1:])

    def set_point(self) -> Floats:
        """Return the set point of the flow, at least 0, (n,)."""
        if self.analogue is None:
            raise without_output()
        return np.maximum(self.analogue, 0.0)


NOTHING = Material()


def output_note(output: str, per_output: float) -> str:
    """Return what an output that a job names as the set point of the flow does, in a sentence."""
    if not per_output:
        return f"{output} is flow_output, but without effect: dispenser.per_output, the flow for each unit of it, is 0."
    return f"{output} sets the flow: {per_output:g} mm³/s for each unit of its value, while glue is laid."


def without_e() -> InputError:
    """Return the error of a dispenser that follows E, for a program without."""
    return InputError(
        "dispenser: filament and e_volume multiply what a program feeds by E, and this one feeds nothing: the amount "
        "must be given by flow, area or pressure"
    )


def without_output() -> InputError:
    """Return the error of a dispenser that follows an output, for a program that states none."""
    return InputError(
        "dispenser: per_output multiplies the program's flow_output, which is not stated: must be an output, as "
        'flow_output = "M67 E0" or "S" of G-code, "#1132" of FANUC, "AOUT(0)" of Trio BASIC'
    )
