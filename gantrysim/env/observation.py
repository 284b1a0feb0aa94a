"""What the agent sees and is told: every entry with its range and unit, and how it follows from the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.env.episodes import GAINS
from gantrysim.env.interval import PER_AXIS, SHARED

_DECADES = 3.0  # of errors and ripple, to either side of their limits
_MEAN = 10.0  # tolerances
_SPEED, _SPEEDS = 100.0, 10.0  # unit [mm/s] and largest
_CURVATURE, _CURVATURES = 0.1, 10.0  # unit [1/mm] and largest


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
    decades, tolerances = (-_DECADES, _DECADES), "log10 of tolerances"
    found: list[Entry] = []
    for axis in axes:
        of = f"following error of {axis}"
        found += [
            Entry(f"tracking_rms_{axis}", *decades, tolerances, f"rms {of}"),
            Entry(f"tracking_max_{axis}", *decades, tolerances, f"largest {of}"),
            Entry(f"tracking_mean_{axis}", -_MEAN, _MEAN, "tolerances", f"mean {of}, signed"),
        ]
    found += [
        Entry("contour_rms", *decades, tolerances, "rms contour error while the dispenser is on"),
        Entry("contour_max", *decades, tolerances, "largest contour error of the same"),
        Entry("contour_mean", -_MEAN, _MEAN, "tolerances", "mean contour error, positive to the left of the path"),
        Entry("speed", 0.0, _SPEEDS, "100 mm/s", "path speed of the nozzle"),
        Entry("curvature", -_CURVATURES, _CURVATURES, "0.1/mm", "of the path at the nozzle, positive to the left"),
        Entry("cos_heading", -1.0, 1.0, "1", "of the path there, from +x"),
        Entry("sin_heading", -1.0, 1.0, "1", "of the same"),
    ]
    for axis in axes:
        found += [
            Entry(f"torque_{axis}", 0.0, 1.0, "peak torques", f"largest torque demand of {axis}"),
            Entry(f"ripple_{axis}", *decades, "log10 of limits", f"torque ripple of {axis}"),
        ]
    for gain in GAINS:
        for name in [f"{gain}_{axis}" for axis in axes] if per_axis else [gain]:
            found.append(Entry(f"gain_{name}", -1.0, 1.0, "1", f"present {gain}, as the action has it"))
    return [*found, Entry("progress", 0.0, 1.0, "1", "share of the setpoints that are sent")]


class Measured(NamedTuple):
    """Rows of measurements in the units of their limits, one for each environment; all zero before the first interval.

    Attributes:
        contour_rms, contour_max: [mm], (n,).
        ripple: share of the peak torque, (n, axes).
        tracking_rms, tracking_max, tracking_mean: [mm or deg], (n, axes).
        torque: share of the peak torque, (n, axes).
        lateral: mean contour error, signed [mm], (n,).
        speed: [mm/s], (n,).
        heading: [rad], (n,).
        curvature: [1/mm], (n,).
    """

    contour_rms: Floats
    contour_max: Floats
    ripple: Floats
    tracking_rms: Floats
    tracking_max: Floats
    tracking_mean: Floats
    torque: Floats
    lateral: Floats
    speed: Floats
    heading: Floats
    curvature: Floats

    @classmethod
    def of(cls, rows: Floats, period: float, peak: Floats) -> Measured:
        """Return what rows of measurements say, (n, columns).

        Args:
            rows: as `measure` writes them.
            period: servo period [s].
            peak: torque of the axes' drives [N·m], (axes,).
        """
        shared = dict(zip(SHARED, rows.T, strict=False))
        axes = rows[:, len(SHARED) :].reshape(len(rows), -1, len(PER_AXIS))
        square, largest, total, demand, ripple = np.moveaxis(axes, 2, 0)
        ticks, dispensing, pairs = (np.maximum(shared[name], 1) for name in ("ticks", "dispensing", "pairs"))
        every = ticks[:, None]
        return cls(
            contour_rms=np.sqrt(shared["contour_square"] / dispensing),
            contour_max=shared["contour_max"],
            ripple=np.sqrt(0.5 * ripple / pairs[:, None]) / peak,
            tracking_rms=np.sqrt(square / every),
            tracking_max=largest,
            tracking_mean=total / every,
            torque=demand / peak,
            lateral=shared["lateral"] / dispensing,
            speed=shared["way"] / (ticks * period),
            heading=shared["heading"],
            curvature=shared["turning"],
        )


def observe(
    measured: Measured, gains: Floats, progress: Floats, tolerance: float, ripple_limit: float
) -> NDArray[np.float32]:
    """Return the observations, in the order of `entries`, clipped to their ranges, (n, entries).

    Args:
        measured: of the last interval.
        gains: the action that is in force, (n, gains).
        progress: share of the setpoints that are sent, (n,).
        tolerance: of the contour error [mm].
        ripple_limit: share of the peak torque.
    """
    mean = np.clip(measured.tracking_mean / tolerance, -_MEAN, _MEAN)
    tracking = np.stack(
        [_decades(measured.tracking_rms, tolerance), _decades(measured.tracking_max, tolerance), mean], 2
    )
    path = [
        _decades(measured.contour_rms, tolerance),
        _decades(measured.contour_max, tolerance),
        np.clip(measured.lateral / tolerance, -_MEAN, _MEAN),
        np.clip(measured.speed / _SPEED, 0.0, _SPEEDS),
        np.clip(measured.curvature / _CURVATURE, -_CURVATURES, _CURVATURES),
        np.cos(measured.heading),
        np.sin(measured.heading),
    ]
    torque = np.stack([np.clip(measured.torque, 0.0, 1.0), _decades(measured.ripple, ripple_limit)], 2)
    n = len(progress)
    parts = [tracking.reshape(n, -1), np.stack(path, 1), torque.reshape(n, -1), gains, progress[:, None]]
    return np.concatenate(parts, 1, dtype=np.float32)


def _decades(value: Floats, unit: float) -> Floats:
    """Logarithm of a magnitude in units, within the decades that are told."""
    return np.clip(np.log10(np.maximum(value, 1e-300) / unit), -_DECADES, _DECADES)
