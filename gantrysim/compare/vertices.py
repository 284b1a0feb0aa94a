"""Traces by vertices a chord apart, whose directions do not depend on speed, standstill or noise."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate, correlation_lags, find_peaks

from gantrysim.base.arrays import Floats

CHORDS = 2000  # of a run, about
NOISES = 10.0  # deviations of the noise that a chord is long
FEWEST_CHORDS = 8
_MOST_PLACES = 6  # places that are tried
_NEARLY_LEAST = 0.1  # of the trace's sum of squares, by which the difference at a place may exceed the least one
_DISTINCT_CHORDS = 10  # chords by which two places differ
SPARSE_SAMPLES = 0.02  # distance of samples, of the run's extent, beyond which places between them are not known


class Vertices(NamedTuple):
    """Points of a trace, each a chord from the one before: rows of its samples, fractional, and points."""

    row: Floats
    points: Floats


def noise_of(positions: Floats) -> float:
    """Return the standard deviation of white noise in positions, (n, k), from their fourth differences.

    A motion leaves little of itself in these, and the median takes no notice of its jumps.
    """
    if len(positions) < 5:
        return 0.0
    differences = np.diff(positions, 4, axis=0)
    # 70 = 1 + 16 + 36 + 16 + 1, and the median of a normal distribution's magnitude is 0.6745 deviations
    deviations = np.median(np.abs(differences), axis=0) / (0.6745 * math.sqrt(70))
    return float(np.sqrt(np.mean(deviations**2)))


def vertices(points: Floats, chord: float) -> Vertices:
    """Return the vertices of a trace, (n, k), that lie a chord apart."""
    rows = [0.0]
    corners = [points[0]]
    place = points[0]
    before = points[0]
    for row in range(1, len(points)):
        point = points[row]
        fraction = 0.0
        while float((point - place) @ (point - place)) >= chord * chord:
            # from the point before, along the step, to the distance of a chord from the last vertex
            step = point - before
            off = before - place
            a = float(step @ step)
            b = float(off @ step)
            c = float(off @ off) - chord * chord
            share = (-b + math.sqrt(max(b * b - a * c, 0.0))) / a if a > 0 else 1.0
            place = before + min(max(share, 0.0), 1.0) * step
            fraction += (1 - fraction) * min(max(share, 0.0), 1.0)
            rows.append(row - 1 + fraction)
            corners.append(place)
            before = place
        before = point
    return Vertices(np.array(rows), np.array(corners))


def starts(measured: Vertices, simulated: Vertices, turning: bool) -> list[tuple[int, float]]:
    """Return numbers of the run's vertex at which a trace may begin, with a turn about z, the best first."""
    ours, theirs = (_directions(trace.points, turning) for trace in (measured, simulated))
    lags = -correlation_lags(ours.shape[1], theirs.shape[1])
    products = np.array([correlate(a, b, method="fft") for a, b in zip(ours, theirs, strict=True)])
    likeness = np.abs(products) if turning else products
    count = ours.shape[1]
    covered = np.clip(np.minimum(lags + count, theirs.shape[1]) - np.maximum(lags, 0), 0, None)
    difference = count + covered - 2 * likeness.sum(axis=0)
    peaks, _ = find_peaks(-difference, distance=_DISTINCT_CHORDS)
    minima = np.union1d(peaks, [int(np.argmin(difference))])
    near = minima[difference[minima] <= difference.min() + _NEARLY_LEAST * count]
    best = near[np.argsort(difference[near], kind="stable")][:_MOST_PLACES]
    return [(int(lags[k]), float(np.angle(products[0, k])) if turning else 0.0) for k in best.tolist()]


def _directions(points: Floats, turning: bool) -> NDArray[Any]:
    """Return the directions of chords, a row per axis, or one of complex numbers of the first two."""
    steps = np.diff(points, axis=0)
    steps = steps / np.maximum(np.linalg.norm(steps, axis=1), 1e-12)[:, None]
    return (steps[:, 0] + 1j * steps[:, 1])[None] if turning else steps.T
