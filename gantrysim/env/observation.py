"""Observation of the environments: its entries with range and unit, computed from the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.env.episodes import TUNED_GAINS
from gantrysim.env.interval import PER_AXIS, SHARED

_DECADES = 3.0  # range of errors and ripple, above and below their limits
_MEAN = 10.0  # range of mean errors [tolerances]
_SPEED_UNIT = 100.0  # [mm/s]
_SPEED_RANGE = 10.0  # of these units
_CURVATURE_UNIT = 0.1  # [1/mm]
_CURVATURE_RANGE = 10.0  # of these units


class Entry(NamedTuple):
    """One entry of the observation."""

    name: str
    low: float
    high: float
    unit: str
    meaning: str


def entries(axes: Sequence[str], per_axis: bool) -> list[Entry]:
    """Return the entries of the observation, in order.

    Args:
        axes: names of the machine's axes.
        per_axis: whether every axis has gains of its own.
    """
    decades = (-_DECADES, _DECADES)
    tolerances = "log10 of tolerances"
    listed: list[Entry] = []
    for axis in axes:
        error = f"following error of {axis}"
        listed += [
            Entry(f"following_rms_{axis}", *decades, tolerances, f"RMS {error}"),
            Entry(f"following_max_{axis}", *decades, tolerances, f"largest {error}"),
            Entry(f"following_mean_{axis}", -_MEAN, _MEAN, "tolerances", f"mean {error}, signed"),
        ]
    listed += [
        Entry("contour_rms", *decades, tolerances, "RMS contour error while dispensing"),
        Entry("contour_max", *decades, tolerances, "largest contour error while dispensing"),
        Entry("contour_mean", -_MEAN, _MEAN, "tolerances", "mean contour error, positive to the left of the path"),
        Entry("speed", 0.0, _SPEED_RANGE, "100 mm/s", "path speed of the nozzle"),
        Entry(
            "curvature",
            -_CURVATURE_RANGE,
            _CURVATURE_RANGE,
            "0.1/mm",
            "path curvature at the nozzle, positive to the left",
        ),
        Entry("cos_heading", -1.0, 1.0, "1", "path direction at the nozzle, from +x"),
        Entry("sin_heading", -1.0, 1.0, "1", "path direction at the nozzle, from +x"),
    ]
    for axis in axes:
        listed += [
            Entry(f"torque_{axis}", 0.0, 1.0, "peak torques", f"largest torque demand of {axis}"),
            Entry(f"ripple_{axis}", *decades, "log10 of limits", f"torque ripple of {axis}"),
        ]
    for gain in TUNED_GAINS:
        names = [f"{gain}_{axis}" for axis in axes] if per_axis else [gain]
        for name in names:
            listed.append(Entry(f"gain_{name}", -1.0, 1.0, "1", f"action that sets {gain}"))
    return [*listed, Entry("progress", 0.0, 1.0, "1", "share of the setpoints sent")]


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
    def of(cls, rows: Floats) -> IntervalValues:
        """Return live views of rows written by `measure`, (n, columns)."""
        shared = {name: rows[:, k] for k, name in enumerate(SHARED)}
        axes = {name: rows[:, len(SHARED) + k :: len(PER_AXIS)] for k, name in enumerate(PER_AXIS)}
        return cls(**shared, **axes)


class Observer:
    """Observations of a task whose agent sets gains, in the order of `entries`.

    Values of one kind are converted together, as a decision has little time for each of NumPy's functions.

    Args:
        axes: number of axes.
        gains: number of gains.
        tolerance: tolerance of the contour error [mm].
        ripple_limit: limit of the torque ripple, share of the peak torque.
    """

    def __init__(self, axes: int, gains: int, tolerance: float, ripple_limit: float) -> None:
        # rms and largest following errors, rms and largest contour error, ripple
        self._magnitude_units = np.repeat([tolerance, ripple_limit], [2 * axes + 2, axes])
        # mean following errors, mean contour error, speed, curvature, torque
        counts = [axes + 1, 1, 1, axes]
        self._units = np.repeat([tolerance, _SPEED_UNIT, _CURVATURE_UNIT, 1.0], counts)
        self._lowest = np.repeat([-_MEAN, 0.0, -_CURVATURE_RANGE, 0.0], counts)
        self._highest = np.repeat([_MEAN, _SPEED_RANGE, _CURVATURE_RANGE, 1.0], counts)
        magnitudes, values, others = np.split(
            np.arange(5 * axes + gains + 8), [len(self._magnitude_units), 5 * axes + 5]
        )
        following = [column for a in range(axes) for column in (magnitudes[a], magnitudes[axes + a], values[a])]
        path = [*magnitudes[2 * axes : 2 * axes + 2], *values[axes : axes + 3], *others[:2]]
        torque = [column for a in range(axes) for column in (values[axes + 3 + a], magnitudes[2 * axes + 2 + a])]
        self._order = np.array([*following, *path, *torque, *others[2:]])

    def __call__(self, measured: IntervalValues, gains: Floats, progress: Floats) -> NDArray[np.float32]:
        """Return the observations, clipped to their ranges, (n, entries).

        Args:
            measured: values of the last interval.
            gains: last action, (n, gains).
            progress: share of the setpoints sent, (n,).
        """
        contour = (measured.contour_rms[:, None], measured.contour_max[:, None])
        magnitudes = np.concatenate([measured.following_rms, measured.following_max, *contour, measured.ripple], 1)
        decades = np.log10(np.maximum(magnitudes, 1e-300) / self._magnitude_units)
        path = (measured.lateral[:, None], measured.speed[:, None], measured.curvature[:, None])
        values = np.concatenate([measured.following_mean, *path, measured.torque], 1) / self._units
        heading = measured.heading[:, None]
        parts = [
            np.minimum(np.maximum(decades, -_DECADES), _DECADES),
            np.minimum(np.maximum(values, self._lowest), self._highest),
            np.cos(heading),
            np.sin(heading),
            gains,
            progress[:, None],
        ]
        return np.concatenate(parts, 1, dtype=np.float32).take(self._order, axis=1)
