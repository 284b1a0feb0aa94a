"""Preview: torques sent with the setpoints, by a zero-phase inverse of the linear machine."""

from __future__ import annotations

from collections.abc import Callable

from gantrysim.base.arrays import Floats
from gantrysim.servo.gains import Parameter
from gantrysim.servo.laws.law import Law, LawDesign

CUT_OFF_SHARE = 0.25  # of the servo's frequency, the cut-off of the preview


class Preview(Law):
    """The law as one of the ladder. It has no linear model: its torques follow from the setpoints alone."""

    name = "preview"
    meaning = "torque sent with the setpoints, by a zero-phase inverse of the linear machine"
    parameters = (Parameter("preview_bandwidth", "Hz", "cut-off frequency of the zero-phase preview"),)
    needs_known_base = True
    inverts_machine = True

    def derived(self, design: LawDesign) -> dict[str, float]:
        return {"preview_bandwidth": CUT_OFF_SHARE / design.period}

    def torque(self, invert: Callable[[Floats], Floats], position: Floats) -> Floats:
        return invert(position)


PREVIEW = Preview()
