"""Check of the log: the torque must be that of the motion beside it.

Acceleration and friction explain 82 % and more of the torque on healthy logs of whatever friction, 30 % and less once
the columns are apart by 15 ms, 2 % with the torque of another axis. The torque's unit changes nothing of that.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import correlate

from gantrysim.base.arrays import Floats
from gantrysim.identify.checks.finding import NotIdentifiedError
from gantrysim.identify.checks.relation import EXPLAINED, WIDTH, relation_of

_RELATED = 0.8  # share of the torque that is explained, from which another reading of the columns is named
_LATEST = 0.5  # longest shift between the columns that is searched [s]


def check_columns(axis: str, position: Floats, torque: Floats, period: float) -> None:
    """Refuse a torque that has not made the motion beside it, and name the confusion where another reading fits.

    Args:
        axis: its name.
        position: (n,) [u].
        torque: (n,) [N·m].
        period: of the samples [s].

    Raises:
        NotIdentifiedError: with the share of the torque that is explained.
    """
    relation = relation_of(position, torque, period)
    if relation is None:
        return
    percent = 100 * relation.explained
    bound = f"must explain at least {100 * EXPLAINED:.0f} %"
    if relation.explained >= EXPLAINED:
        if relation.inertia > 0:
            return
        raise NotIdentifiedError(
            f"axis {axis}: its torque accelerates it backwards, with an inertia of {relation.inertia:.3g} N·m·s²: must "
            "be greater than 0; the torque or the position has the wrong sign"
        )
    shift = _shift(position, torque, period)
    later = np.roll(torque, -shift)
    shifted = relation_of(position, later, period)
    if shift and shifted is not None and shifted.explained >= _RELATED and shifted.inertia > 0:
        side = "late" if shift > 0 else "early"
        raise NotIdentifiedError(
            f"axis {axis}: its acceleration explains {percent:.0f} % of its torque, {bound}: the torque is "
            f"{1e3 * abs(shift) * period:.3g} ms {side} against the position, shifted by which "
            f"{100 * shifted.explained:.0f} % are explained; log both by one clock"
        )
    raise NotIdentifiedError(
        f"axis {axis}: its acceleration and friction explain {percent:.0f} % of its torque, {bound}: the torque "
        "belongs to another axis or to another time"
    )


def check_swapped(axis: str, position: Floats, torque: Floats, period: float) -> None:
    """Refuse columns of which each is the other's.

    Raises:
        NotIdentifiedError: the position makes a torque of the torque's motion, and the reverse does not hold.
    """
    relation = relation_of(position, torque, period)
    swapped = relation_of(torque, position, period)
    if swapped is None or (relation is not None and relation.explained >= EXPLAINED):
        return
    if swapped.explained >= _RELATED and swapped.inertia > 0:
        raise NotIdentifiedError(
            f"axis {axis}: its columns of torque and position are swapped: read the other way round, acceleration and "
            f"friction explain {100 * swapped.explained:.0f} % of the torque"
        )


def _shift(position: Floats, torque: Floats, period: float) -> int:
    """Return the samples by which the torque follows the acceleration that correlates with it most."""
    width = WIDTH / period
    speed = np.gradient(gaussian_filter1d(position, width), period)
    acceleration = np.gradient(speed, period)
    smooth = gaussian_filter1d(torque - torque.mean(), width)
    correlation = correlate(smooth, acceleration - acceleration.mean(), "full", "fft")
    lags = np.arange(correlation.size) - (position.size - 1)
    near = np.abs(lags) <= round(_LATEST / period)
    return int(lags[near][int(np.argmax(correlation[near]))])
