"""From the record of a circle to the row of its case, and from the row back to the actual path."""

from __future__ import annotations

from typing import Literal

import numpy as np

from gantrysim.metrics import Reversal, Trace
from gantrysim.run import Run
from gantrysim.study.cases import Row

AXES = ("x", "y")
SENSES = {"clockwise": -1.0, "counter-clockwise": 1.0}  # of the cases, counter-clockwise positive
DECAY = 0.1  # of a spike after a reversal, until it is over [s]
_UM = 1e3


def circle_row(run: Run, centre: tuple[float, float], radius: float, lead: float, reach: float) -> Row:
    """Return the figures of one circle, and its radial deviation as curves over the angle.

    Args:
        run: of a circle with leads.
        centre: of the nominal circle [mm].
        radius: of the nominal circle [mm].
        lead: angle that is commanded before the circle counts [deg].
        reach: as in `Trace.reversals` [deg].
    """
    commanded = run.commanded_tip[:, :2] - centre
    swept = np.degrees(np.abs(np.unwrap(np.arctan2(commanded[:, 1], commanded[:, 0]))))
    passed = np.abs(swept - swept[0])
    counts = (passed >= lead) & (passed < lead + 360)
    nozzle, motor = (Trace(tip[counts, :2], centre, radius) for tip in (run.nozzle, run.motor_tip))
    row: Row = {
        "circular_deviation_um": _UM * nozzle.circular_deviation,
        "radial_deviation_max_um": _UM * float(nozzle.deviation.max()),
        "radial_deviation_min_um": _UM * float(nozzle.deviation.min()),
    }
    for reversal in nozzle.reversals(reach):
        row |= _reversal_row(reversal)
    # the motors' deviation is told at the nozzle's angle: what they are apart changes it by their distance squared
    curves = {
        "angle_deg": nozzle.angle,
        "radial_deviation_um": _UM * nozzle.deviation,
        "motor_deviation_um": _UM * motor.deviation,
    }
    return row | {name: np.round(curve, 6).tolist() for name, curve in curves.items()}


def _reversal_row(reversal: Reversal) -> Row:
    name = f"reversal_{AXES[reversal.axis]}_{reversal.angle:.0f}"
    return {
        f"{name}_step_um": _UM * reversal.step,
        f"{name}_spike_um": _UM * reversal.spike,
        f"{name}_spike_at_deg": reversal.spike_at,
    }


def trace_of(row: Row, centre: tuple[float, float], radius: float, link: Literal["radial", "motor"]) -> Trace:
    """Return the actual path of a row.

    Args:
        row: of `circle_row`.
        centre: of the nominal circle [mm].
        radius: of the nominal circle [mm].
        link: "radial" for the path of the nozzle, "motor" for that of the motors.
    """
    angle = np.radians(np.array(row["angle_deg"], float))
    deviation = np.array(row[f"{link}_deviation_um"], float) / _UM
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Trace(centre + (radius + deviation)[:, None] * out, centre, radius)
