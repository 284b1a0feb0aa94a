"""The laws of a run beyond PID, as the servo tick needs them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.native.row import LAW
from gantrysim.servo.laws.friction import Friction
from gantrysim.servo.laws.observer import low_pass, torque_taps
from gantrysim.servo.laws.parameters import CASCADE, IN_THE_TICK
from gantrysim.servo.servo import Servo


def law_entries(servo: Servo, torque: Floats | None) -> NDArray[np.void] | None:
    """Return the laws of a servo at their start, (axes,) of `LAW`; None where PID does alone.

    Args:
        servo: the servo.
        torque: sent with the setpoints, contiguous and kept alive by the caller, (n, axes) [N·m]; None for none.
    """
    if torque is None and servo.own_law is None and not any(name in servo.law for name in IN_THE_TICK):
        return None
    entries = np.zeros(servo.axes, LAW)
    entries["cascade"] = CASCADE in servo.law
    entries["feed"] = 0 if torque is None else torque.ctypes.data
    for a, entry in enumerate(entries):
        values = servo.law_values(a)
        entry["contour"] = values["contour_gain"]
        entry["friction"] = [values[f"friction_{name}"] for name in ("torque", *Friction._fields[1:])]
        if values["observer_bandwidth"]:
            entry["inertia"], entry["viscous"] = values["observer_inertia"], values["observer_viscous"]
            lag = servo.delay + servo.feedback_delay * servo.period + values["observer_lag"]
            entry["shift"], entry["taps"] = torque_taps(lag / servo.period)
            entry["filter"] = low_pass(values["observer_bandwidth"], servo.period)
    return entries
