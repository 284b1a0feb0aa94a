"""Relation of the torque to the motion beside it: torque = J a + b v + Fc sign v + constant, low-passed."""

# ruff: noqa: N806 - matrices bear the letters of the equations

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gantrysim.base.arrays import Floats

EXPLAINED = 0.5  # least share of the torque's variance that acceleration and friction explain
WIDTH = 0.004  # standard deviation of the low-pass [s]
_MOVING = 0.02  # share of the highest speed from which an axis slides
_SLIDING = 0.9  # share of the samples around one that must be in motion
_JUMP = 3.0  # acceleration that no motion has, of that which 98 % of the samples stay below
_FEWEST = 500  # samples; a shorter log is refused by the regression


class Relation(NamedTuple):
    """Regression of a torque on a motion.

    Attributes:
        explained: share of the torque's variance.
        inertia: [N·m·s²/u].
    """

    explained: float
    inertia: float


def relation_of(position: Floats, torque: Floats, period: float) -> Relation | None:
    """Return the regression of the torque where the axis slides; None of an axis that hardly does."""
    width = WIDTH / period
    if position.size < _FEWEST:
        return None
    speed = np.gradient(gaussian_filter1d(position, width), period)
    least = _MOVING * float(np.quantile(np.abs(speed), 0.99))
    slides = gaussian_filter1d(1.0 * (np.abs(speed) > least), width) > _SLIDING
    if not least > 0 or slides.sum() < _FEWEST:
        return None
    acceleration = np.gradient(speed, period)
    # jumps of the position are the matter of another check
    slides &= np.abs(acceleration) < _JUMP * float(np.quantile(np.abs(acceleration[slides]), 0.98))
    direction = gaussian_filter1d(np.sign(np.gradient(position)), width)
    A = np.stack([acceleration, speed, direction, np.ones_like(speed)], axis=1)[slides]
    smooth = gaussian_filter1d(torque, width)[slides]
    size = np.maximum(np.abs(A).max(axis=0), 1e-300)
    coefficients = np.linalg.lstsq(A / size, smooth, rcond=None)[0]
    variance = float(np.var(smooth))
    if not variance > 0:
        return None
    remainder = float(np.var(smooth - (A / size) @ coefficients))
    return Relation(1 - remainder / variance, float(coefficients[0] / size[0]))
