"""Check of the log: encoder and torque must move enough to separate inertia, friction and delay."""

from __future__ import annotations

import math

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.checks.units import position_slips
from gantrysim.machine.axis import Axis

COUNTS = 200.0  # least travel, in encoder counts: 0.5 % of it is one
REVERSALS = 6  # least number: a constant torque and friction differ by direction alone
SPEEDS = 3.0  # least ratio of fast to slow speed: viscous and Coulomb friction differ by speed alone
_ENOUGH = 500  # samples; a shorter log is refused by the regression


def check_excitation(axis: Axis, position: Floats, torque: Floats, ratio: float = math.nan) -> None:
    """Refuse a log of an axis that hardly moves.

    Args:
        axis: of the machine.
        position: (n,) [u].
        torque: (n,) [N·m].
        ratio: of the log's inertia to that of the table; nan where it is not known.

    Raises:
        NotIdentifiedError: with what is missing.
    """
    if position.size < _ENOUGH:
        return
    cure = "gantrysim identify --plan writes moves that do"
    travel = float(np.ptp(position))
    if travel < COUNTS * axis.resolution or travel == 0:
        slips = position_slips(axis, 1 / ratio) if ratio > 0 else []
        if slips:
            cure = f"position in {' or '.join(slips)} read as {axis.unit}?"
        raise NotIdentifiedError(
            f"axis {axis.name}: the axis hardly moves, by {travel:.3g} {axis.unit}: must be at least "
            f"{COUNTS * axis.resolution:.3g} {axis.unit}, {COUNTS:.0f} encoder counts; {cure}"
        )
    if float(np.ptp(torque)) == 0:
        raise NotIdentifiedError(f"axis {axis.name}: its torque is {torque[0]:.3g} N·m throughout; {cure}")
    lengths = strokes(position, axis.resolution)
    if lengths.size <= REVERSALS:
        raise NotIdentifiedError(
            f"axis {axis.name}: it reverses {max(lengths.size - 1, 0)} times: must reverse at least {REVERSALS} times; "
            f"{cure}"
        )
    steps = np.abs(np.diff(position))
    moving = steps[steps > axis.resolution]
    slow, fast = np.quantile(moving, (0.1, 0.95)) if moving.size else (1, 1)
    if fast < SPEEDS * slow:
        raise NotIdentifiedError(
            f"axis {axis.name}: its fast moves are {fast / slow:.2g} times as fast as its slow ones: must be at least "
            f"{SPEEDS:g} times; {cure}"
        )


def strokes(position: Floats, resolution: float) -> Floats:
    """Return the numbers of moving samples between reversals, (k,); steps of up to two counts are none."""
    steps = np.diff(position)
    ways = np.sign(steps[np.abs(steps) > max(2 * resolution, 1e-12)])
    if not ways.size:
        return np.empty(0)
    turns = np.flatnonzero(np.diff(ways) != 0) + 1
    return np.diff(np.concatenate([[0], turns, [ways.size]])).astype(np.float64)
