"""Entries of observations and actions with range and unit, and the values measured between two decisions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.env.interval import AXIS_VALUES, PATH_VALUES


class Entry(NamedTuple):
    """One entry of an observation or of an action."""

    name: str
    low: float
    high: float
    unit: str
    meaning: str


class IntervalValues(NamedTuple):
    """Values measured between two decisions, one row per environment; all zero before the first interval.

    Attributes:
        contour_rms, contour_max: contour error [mm], (n,).
        lateral: mean contour error, signed [mm], (n,).
        speed: path speed of the nozzle [mm/s], (n,).
        heading: direction of the path at the last foot [rad], (n,).
        curvature: curvature of the path there [1/mm], (n,).
        following_rms, following_max, following_mean: following error [mm or deg], (n, axes).
        torque: largest torque demand, share of the peak torque, (n, axes).
        ripple: torque ripple, RMS change of the demand over pairs of ticks with the dispenser on divided by sqrt(2),
            share of the peak torque, (n, axes).
    """

    contour_rms: Floats
    contour_max: Floats
    lateral: Floats
    speed: Floats
    heading: Floats
    curvature: Floats
    following_rms: Floats
    following_max: Floats
    following_mean: Floats
    torque: Floats
    ripple: Floats

    @classmethod
    def of(cls, of_path: NDArray[np.void], of_axes: NDArray[np.void]) -> IntervalValues:
        """Return live views of values written by `measure`, (n,) of `PATH_VALUES` and (n, axes) of `AXIS_VALUES`."""
        return cls(
            **{name: of_path[name] for name in PATH_VALUES.fields or ()},
            **{name: of_axes[name] for name in AXIS_VALUES.fields or ()},
        )
