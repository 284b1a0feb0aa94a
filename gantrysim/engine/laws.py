"""The laws of a run beyond PID, as stages of the servo tick."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.engine.native.functions import add_fed_torque, base_stage, feed_stage, law_stage
from gantrysim.engine.native.stages import Body, Stage
from gantrysim.machine.row import LAW
from gantrysim.servo.laws import PID
from gantrysim.servo.laws.law import FEEDFORWARD
from gantrysim.servo.servo import Servo


def law_entries(servo: Servo) -> NDArray[np.void] | None:
    """Return the laws of a servo at their start, (axes,) of `LAW`; None where none of them acts in the tick."""
    acting = [law for law in servo.laws.added if law.stages]
    if not acting:
        return None
    entries = np.zeros(servo.axes, LAW)
    for a, entry in enumerate(entries):
        for law in acting:
            for name, value in law.start(servo.laws.values(a), servo.timing).items():
                entry[name] = value
    return entries


def law_stages(servo: Servo, entries: NDArray[np.void] | None, torque: Floats | None) -> list[Stage]:
    """Return the stages of the laws, but for a user's own; they hold the addresses of the arrays.

    Args:
        servo: the servo.
        entries: its laws, as of `law_entries`.
        torque: sent with the setpoints, contiguous, (n, axes) [N·m]; None for none.
    """
    stages = []
    base = servo.laws.base
    if servo.laws.user is None and base.tick is not PID.tick:
        stages.append(Stage("law", base_stage(base), body=Body("base", base.tick)))
    if entries is not None:
        for law in servo.laws.added:
            for point, function in law.stages:
                stages.append(Stage(point, law_stage(function), entries.ctypes.data, Body("laws", function)))
    if torque is not None:
        stages.append(Stage(FEEDFORWARD, feed_stage(), torque.ctypes.data, Body("tape", add_fed_torque)))
    return stages
