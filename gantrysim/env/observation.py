"""Observation of the environments: its entries with range and unit, computed from the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.env.episodes import TUNED_GAINS
from gantrysim.env.interval import AXIS_VALUES, PATH_VALUES

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
    def of(cls, of_path: NDArray[np.void], of_axes: NDArray[np.void]) -> IntervalValues:
        """Return live views of values written by `measure`, (n,) of `PATH_VALUES` and (n, axes) of `AXIS_VALUES`."""
        return cls(
            **{name: of_path[name] for name in PATH_VALUES.fields or ()},
            **{name: of_axes[name] for name in AXIS_VALUES.fields or ()},
        )


class Observer:
    """Observations of a task whose agent sets gains, in the order of `entries`.

    Values of one kind are converted together, as a decision has little time for each of NumPy's functions.

    Args:
        axes: names of the machine's axes.
        per_axis: whether every axis has gains of its own.
        tolerance: tolerance of the contour error [mm].
        ripple_limit: limit of the torque ripple, share of the peak torque.
    """

    def __init__(self, axes: Sequence[str], per_axis: bool, tolerance: float, ripple_limit: float) -> None:
        # the columns of each kind in the order in which a decision joins them, with their units
        magnitudes = {
            **{f"following_rms_{axis}": tolerance for axis in axes},
            **{f"following_max_{axis}": tolerance for axis in axes},
            "contour_rms": tolerance,
            "contour_max": tolerance,
            **{f"ripple_{axis}": ripple_limit for axis in axes},
        }
        values = {
            **{f"following_mean_{axis}": tolerance for axis in axes},
            "contour_mean": tolerance,
            "speed": _SPEED_UNIT,
            "curvature": _CURVATURE_UNIT,
            **{f"torque_{axis}": 1.0 for axis in axes},
        }
        listed = {entry.name: entry for entry in entries(axes, per_axis)}
        self._magnitude_units = np.array(list(magnitudes.values()))
        self._units = np.array(list(values.values()))
        self._lowest = np.array([listed[name].low for name in values])
        self._highest = np.array([listed[name].high for name in values])
        gains = [name for name in listed if name.startswith("gain_")]
        columns = [*magnitudes, *values, "cos_heading", "sin_heading", *gains, "progress"]
        self._order = np.array([columns.index(name) for name in listed])

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
