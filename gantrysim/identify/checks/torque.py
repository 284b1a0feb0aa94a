"""Check of the log: its torque must be one that the drive can deliver."""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.checks.units import torque_slips
from gantrysim.machine.axis import Axis

PEAK = 1.2  # largest torque, of the drive's peak torque: room for noise and a motor constant of another temperature


def check_torque(axis: Axis, torque: Floats, ratio: float) -> None:
    """Refuse a torque beyond the drive's peak.

    Args:
        axis: of the machine.
        torque: (n,) [N·m].
        ratio: of the log's inertia to that of the table; nan where it is not known.

    Raises:
        NotIdentifiedError: with the torque, the peak and the unit that the inertia suggests.
    """
    largest = float(np.abs(torque).max())
    if not (math.isfinite(axis.peak_torque) and axis.peak_torque > 0 and largest > PEAK * axis.peak_torque):
        return
    excess = largest / axis.peak_torque
    slips = torque_slips(axis, ratio) if ratio > 0 else []
    hint = "check its unit, and that it is the torque at the motor shaft"
    if slips:
        hint = f"the log's inertia is {ratio:.3g} times that of the table: torque in {' or '.join(slips)} read as N·m?"
    raise NotIdentifiedError(
        f"axis {axis.name}: its largest torque is {largest:.4g} N·m, {excess:.3g} times the drive's peak of "
        f"{axis.peak_torque:.4g} N·m: must be at most {PEAK:g} times; {hint}"
    )
