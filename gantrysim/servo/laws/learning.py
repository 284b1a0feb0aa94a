"""Learning: torques sent with the setpoints, learnt over repeats of the same run.

`gantrysim.servo.inverse` makes the next torques of an error, `gantrysim.engine.learning` repeats the run.
"""

from __future__ import annotations

from gantrysim.servo.gains import Parameter
from gantrysim.servo.laws import preview
from gantrysim.servo.laws.law import Law, LawDesign

CUT_OFF_SHARE = 2.0  # times the natural frequency, the cut-off of the learning


class Learning(Law):
    """The law as one of the ladder. It has no linear model: within a run its torques do not answer to the position."""

    name = "learning"
    meaning = "torque sent with the setpoints, learnt over repeats"
    parameters = (Parameter("learning_bandwidth", "Hz", "cut-off frequency of the learning filter"),)
    needs_known_base = True
    inverts_machine = True

    def derived(self, design: LawDesign) -> dict[str, float]:
        return {"learning_bandwidth": min(CUT_OFF_SHARE * design.frequency, preview.CUT_OFF_SHARE / design.period)}


LEARNING = Learning()
