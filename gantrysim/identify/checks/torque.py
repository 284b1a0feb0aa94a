"""Check of the log: its torque must be one that the drive can deliver."""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.machine.axis import Axis

PEAK = 1.2  # largest torque, of the drive's peak torque: room for noise and a motor constant of another temperature


def check_torque(axis: Axis, torque: Floats) -> None:
    """Refuse a torque beyond the drive's peak.

    Raises:
        InputError: with the ratio.
    """
    largest = float(np.abs(torque).max())
    if math.isfinite(axis.peak_torque) and axis.peak_torque > 0 and largest > PEAK * axis.peak_torque:
        ratio = largest / axis.peak_torque
        raise InputError(
            f"axis {axis.name}: its largest torque is {largest:.4g} N·m, {ratio:.3g} times the drive's peak of "
            f"{axis.peak_torque:.4g} N·m: must be at most {PEAK:g} times; check its unit (mN·m?), and that it is the "
            "torque at the motor shaft"
        )
