"""The start of a fit: linear regression of the torque, and the samples in motion."""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.identify.pieces import WHOLE, Starts, by_piece, gradient, inside, smoothed

_WIDTH = 0.004  # standard deviation of the filter for differentiation [s]
_MOVING = 0.02  # share of the highest speed from which an axis slides
_AROUND = 0.02  # time around a motion that counts as its own [s]
_SLIDING = 0.9  # share of the samples around one that must be in motion
_LEAST_SAMPLES = 500


def regression(
    position: Floats, torque: Floats, period: float, starts: Starts = WHOLE
) -> tuple[float, float, float, float]:
    """Return J, b, Fc and offset of torque = J a + b v + Fc sign v + offset, by least squares [N·m and u].

    Position, sign and torque pass the same zero-phase filter, a Gaussian; v and a are central differences. Samples near
    rest are left out.

    Args:
        position: (n,) [u].
        torque: (n,) [N·m].
        period: of the samples [s].
        starts: of the pieces.

    Raises:
        InputError: a log without motion.
    """
    width = _WIDTH / period
    if position.size < max(8 * width, _LEAST_SAMPLES):
        raise InputError(f"log of {position.size} samples: must have at least {max(8 * width, _LEAST_SAMPLES):.0f}")
    # the same zero-phase filter for all three, so that none is late against the others
    sign = smoothed(np.sign(gradient(position, 1.0, starts)), width, starts)
    smooth = smoothed(torque, width, starts)
    speed = gradient(smoothed(position, width, starts), period, starts)
    acceleration = gradient(speed, period, starts)
    least = _MOVING * float(np.quantile(np.abs(speed), 0.99))
    slides = np.abs(speed) > least
    chosen = smoothed(slides.astype(np.float64), width, starts) > _SLIDING
    # the filter reaches beyond the log
    chosen &= inside(position.size, starts, round(4 * width))
    if not least > 0 or chosen.sum() < 8 * width:
        raise InputError("the axis hardly moves: the log must hold moves to and fro at several speeds")
    A = np.stack([acceleration, speed, sign, np.ones_like(speed)], axis=1)[chosen]
    inertia, viscous, coulomb, offset = np.linalg.lstsq(A, smooth[chosen], rcond=None)[0].tolist()
    return inertia, viscous, coulomb, offset


def in_motion(position: Floats, period: float, resolution: float, starts: Starts = WHOLE) -> NDArray[np.bool_]:
    """Return whether each sample is near a motion of more than a count per few samples, (n,) bool."""
    reach = max(round(_AROUND / period), 1)

    def farthest(piece: Floats) -> Floats:
        after = np.concatenate([piece[reach:], np.full(min(reach, piece.size), piece[-1])])
        before = np.concatenate([np.full(min(reach, piece.size), piece[0]), piece[:-reach]])
        return np.maximum(np.abs(after - piece), np.abs(piece - before))

    return np.asarray(by_piece(farthest, position, starts) > max(4 * resolution, 1e-12))
