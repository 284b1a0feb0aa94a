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


def observe(
    measured: IntervalValues, gains: Floats, progress: Floats, tolerance: float, ripple_limit: float
) -> NDArray[np.float32]:
    """Return the observations, in the order of `entries`, clipped to their ranges, (n, entries).

    Args:
        measured: values of the last interval.
        gains: last action, (n, gains).
        progress: share of the setpoints sent, (n,).
        tolerance: tolerance of the contour error [mm].
        ripple_limit: limit of the torque ripple, share of the peak torque.
    """
    mean = np.clip(measured.following_mean / tolerance, -_MEAN, _MEAN)
    following = np.stack(
        [_decades(measured.following_rms, tolerance), _decades(measured.following_max, tolerance), mean], 2
    )
    path = [
        _decades(measured.contour_rms, tolerance),
        _decades(measured.contour_max, tolerance),
        np.clip(measured.lateral / tolerance, -_MEAN, _MEAN),
        np.clip(measured.speed / _SPEED_UNIT, 0.0, _SPEED_RANGE),
        np.clip(measured.curvature / _CURVATURE_UNIT, -_CURVATURE_RANGE, _CURVATURE_RANGE),
        np.cos(measured.heading),
        np.sin(measured.heading),
    ]
    torque = np.stack([np.clip(measured.torque, 0.0, 1.0), _decades(measured.ripple, ripple_limit)], 2)
    n = len(progress)
    parts = [following.reshape(n, -1), np.stack(path, 1), torque.reshape(n, -1), gains, progress[:, None]]
    return np.concatenate(parts, 1, dtype=np.float32)


def _decades(value: Floats, unit: float) -> Floats:
    """Return the logarithm of a magnitude in units, clipped to the observed decades."""
    return np.clip(np.log10(np.maximum(value, 1e-300) / unit), -_DECADES, _DECADES)
