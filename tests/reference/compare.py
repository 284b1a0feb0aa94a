"""What the comparisons of gantrysim with the references share."""

from __future__ import annotations

import numpy as np

from gantrysim.record.run import Run
from gantrysim.servo.servo import Servo

from .law import Law

Traces = tuple[np.ndarray, np.ndarray]  # contour error (n,) [mm]; torque demands and motor torques, (n, 2 axes) [N·m]
Tolerance = tuple[float, float]  # rms, largest


def law_of(servo: Servo, axis: int) -> Law:
    """Return the servo of one axis in plain numbers."""
    frequency, width, depth = (servo.per_axis(f"notch_{name}")[axis] for name in ("frequency", "width", "depth"))
    gains = ("kp", "ki", "kd", "velocity_ff", "acceleration_ff", "output_velocity")
    return Law(
        period=servo.period,
        delay=servo.delay,
        limit=servo.drives[axis].torque_limit,
        count=servo.drives[axis].resolution,
        notch=(frequency, depth * width, width),
        **{name: servo.per_axis(name)[axis] for name in gains},
    )


def torques_of(run: Run) -> np.ndarray:
    """Return torque demands and motor torques while the dispenser is on, (n, 2 axes) [N·m]."""
    return np.hstack([run.demand, run.torque])[run.dispense]


def sizes(error: np.ndarray) -> Tolerance:
    return float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())


def within(one: Traces, other: Traces, tolerance: Tolerance, torque_tolerance: Tolerance) -> bool:
    """Return whether contour errors agree, and torques as a share of the largest of `other`."""
    peak = np.abs(other[1]).max()
    contours, torques = sizes(one[0] - other[0]), sizes((one[1] - other[1]) / peak)
    return all(found <= bound for found, bound in zip(contours + torques, tolerance + torque_tolerance, strict=True))
