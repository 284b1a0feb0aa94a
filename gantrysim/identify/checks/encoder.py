"""Check of the log: the encoder must count throughout.

A frozen encoder, a log that repeats its last sample, or a lost count is a motion that no torque makes: the position
stands while the torque swings by more than friction can hold, or jumps by more than the torque can accelerate.
"""

from __future__ import annotations

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.model import AxisModel
from gantrysim.machine.axis import Axis

HOLD = 6.0  # swing of the torque at rest, times the static friction: friction thrice the table's holds ± 3
PEAK = 0.1  # the same of a machine without friction, of the peak torque
JUMP = 5.0  # change of the speed in a sample, times what the drive's peak torque gives the table's inertia: the motor
# without its load, a lighter machine and a loop at its limit reach thrice
_COUNTS = 5.0  # of the encoder that a change of speed may show beside
_STILL = 0.005  # shortest standstill that counts [s]
_FEWEST = 5  # samples of it
_SETTLING = 2  # first samples of it, whose torque answers to the last count
_MEAN = 3  # samples of the moving mean of the torque, against its noise


def check_encoder(axis: Axis, table: AxisModel, position: Floats, torque: Floats, period: float) -> None:
    """Refuse a position that stands still under torque, or jumps.

    Args:
        axis: of the machine.
        table: its model by the MJCF.
        position: (n,) [u].
        torque: (n,) [N·m].
        period: of the samples [s].

    Raises:
        NotIdentifiedError: with the time and the bound.
    """
    bound = max(HOLD * table.static, PEAK * axis.peak_torque if np.isfinite(axis.peak_torque) else 0.0)
    calm = np.convolve(torque, np.ones(_MEAN) / _MEAN, "same")
    changes = np.flatnonzero(np.diff(position) != 0)
    starts = np.concatenate([[0], changes + 1])
    ends = np.concatenate([changes + 1, [position.size]])
    fewest = max(_FEWEST, round(_STILL / period))
    for start, end in zip(starts, ends, strict=True):
        if end - start < fewest:
            continue
        swing = float(np.ptp(calm[start + _SETTLING : end - 1]))
        if swing > bound:
            raise NotIdentifiedError(
                f"axis {axis.name}: its position stands still from {start * period:.4g} to {end * period:.4g} s of the "
                f"log while the torque swings by {swing:.3g} N·m, friction holds at most {bound:.3g} N·m: the encoder "
                "is frozen, or the log repeats samples"
            )
    turns = np.abs(np.diff(position, 2))
    strongest = axis.peak_torque if np.isfinite(axis.peak_torque) else 2 * float(np.abs(torque).max())
    most = JUMP * strongest / table.inertia * period**2 + _COUNTS * axis.resolution
    worst = int(np.argmax(turns))
    if turns[worst] > most:
        time = (worst + 1) * period
        raise NotIdentifiedError(
            f"axis {axis.name}: its position jumps by {turns[worst]:.3g} {axis.unit} at {time:.4g} s of the log, the "
            f"drive's peak torque moves it by {most:.3g} {axis.unit} in a sample: the encoder skips, or "
            "samples are missing"
        )
