"""The alignment of a measured trace with a simulated run, in time and place.

With m(t) a measured position, s(t) the simulated one of the same link and R a turn about z, the least sum of squares of

    m(t) - R s(t - shift) - offset

gives shift, offset and turn; it starts from the highest cross-correlation of the velocities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import correlate, correlation_lags

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, unknown
from gantrysim.compare.measured import LEAST, Trace
from gantrysim.record.run import Run

ALIGNED = ("time", "offset", "rotation")
_STEPS = 50
_SETTLED = 1e-9  # change of the shift that ends the search, in servo periods
_LONGEST = 100.0  # of a trace, in lengths of the run
_SMOOTH = 15  # samples of a mean over which velocities are correlated


@dataclass(frozen=True)
class Alignment:
    """How a trace lies against the simulation.

    Attributes:
        by: link that gives it: commanded, encoder or nozzle.
        shift: the trace's time less the run's [s].
        offsets: the trace's position less the run's, by frame: "axes" (axes,) and "nozzle" (3,) [mm or deg].
        rotation: turn of the nozzle's frame about z, counter-clockwise positive [deg].
        residual: rms of what is left of the link [mm or deg].
    """

    by: str
    shift: float
    offsets: Mapping[str, Floats]
    rotation: float
    residual: float


def aligned(trace: Trace, run: Run, what: tuple[str, ...] = ("time", "offset")) -> Alignment:
    """Return the alignment of a trace with a simulated run.

    The first of command, encoder and nozzle that is measured gives the shift. Axes have one offset, of that link; the
    nozzle has its own.

    Args:
        trace: measured.
        run: simulated.
        what: is fitted, of `ALIGNED`; the rest is taken to be zero.
    """
    for quantity in what:
        if quantity not in ALIGNED:
            raise unknown("alignment", quantity, ALIGNED)
    by = trace.links[0]
    placed = "offset" in what
    turning = "rotation" in what and trace.nozzle is not None
    shift, offset, turn, residual = _fitted(trace, run, by, None if "time" in what else 0.0, placed, turning)
    offsets = {}
    if by != "nozzle":
        offsets["axes"] = offset
        if trace.nozzle is not None:
            _, offset, turn, _ = _fitted(trace, run, "nozzle", shift, placed, turning)
    if trace.nozzle is not None:
        offsets["nozzle"] = offset
    return Alignment(by, shift, offsets, float(np.degrees(turn)), residual)


def _fitted(
    trace: Trace, run: Run, link: str, shift: float | None, placed: bool, turning: bool
) -> tuple[float, Floats, float, float]:
    """Return shift [s], offset, turn [rad] and the residual's rms of one link; a given shift is kept."""
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    if measured is None:
        raise InputError(f"{link} is not measured")
    simulated = getattr(run, link)
    known = ~np.isnan(measured).any(axis=0)
    turning = turning and link == "nozzle"
    spline = CubicSpline(run.time, simulated[:, known], axis=0)
    m = measured[:, known]
    columns = np.flatnonzero(known)
    free = shift is None
    tau, turn = _correlated(trace.time, m, run, simulated[:, known], turning) if free else (float(shift or 0.0), 0.0)
    offset = np.zeros(m.shape[1])
    for _ in range(_STEPS):
        shifted = trace.time - tau
        inside = (shifted >= run.time[0]) & (shifted <= run.time[-1])
        if np.count_nonzero(inside) < LEAST:
            raise InputError(
                f"the trace covers {np.count_nonzero(inside)} of its samples with the run, from {run.time[0]:g} to "
                f"{run.time[-1]:g} s: must be at least {LEAST}"
            )
        s = spline(shifted[inside])
        rate = spline(shifted[inside], 1)
        residual = m[inside] - turned(s, turn) - offset
        slopes = []
        if free:
            slopes.append(-turned(rate, turn))
        if turning:
            slopes.append(turned(s, turn + np.pi / 2) * (columns < 2))
        if placed:
            slopes += [np.broadcast_to(unit, residual.shape) for unit in np.eye(residual.shape[1])]
        if not slopes:
            break
        step = np.linalg.lstsq(np.stack([slope.ravel() for slope in slopes], axis=1), residual.ravel(), rcond=None)[0]
        steps = list(step)
        change = steps.pop(0) if free else 0.0
        tau += change
        if turning:
            turn += steps.pop(0)
        offset = offset + (np.array(steps) if placed else 0.0)
        if abs(change) <= _SETTLED * run.period and np.abs(step).max() <= _SETTLED:
            break
    whole = np.zeros(measured.shape[1])
    whole[known] = offset
    return float(tau), whole, float(turn), float(np.sqrt(np.mean(residual**2)))


def turned(points: Floats, turn: float) -> Floats:
    """Return points turned about z, (n, 2 or more)."""
    if turn == 0.0:
        return points
    x, y, *others = points.T
    cos = np.cos(turn)
    sin = np.sin(turn)
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, *others])


def _correlated(time: Floats, measured: Floats, run: Run, simulated: Floats, turning: bool) -> tuple[float, float]:
    """Return shift [s] and turn [rad] at the highest cross-correlation of the velocities."""
    long = time[-1] - time[0]
    least = 2 * _SMOOTH * run.period
    most = _LONGEST * (run.time[-1] - run.time[0])
    if not least <= long <= most:
        raise InputError(
            f"the trace lasts {long:.4g} s: must last {least:.4g} to {most:.4g} s beside a run of {run.time[-1]:.4g} "
            "s; is its time in another unit?"
        )
    even = np.arange(time[0], time[-1], run.period)
    smooth = partial(np.convolve, np.full(_SMOOTH, 1 / _SMOOTH), mode="same")
    first, second = (
        np.array([smooth(np.diff(column)) for column in columns])
        for columns in (
            [np.interp(even, time, column) for column in measured.T],
            simulated.T,
        )
    )
    lags = correlation_lags(first.shape[1], second.shape[1])
    if turning:  # in the plane as complex numbers, whose magnitude does not depend on a turn
        product = correlate(first[0] + 1j * first[1], second[0] + 1j * second[1], method="fft")
        best = int(np.abs(product).argmax())
        turn = float(np.angle(product[best]))
    else:
        total = sum(correlate(a, b, method="fft") for a, b in zip(first, second, strict=True))
        best = int(np.argmax(total))
        turn = 0.0
    return float(even[0] - run.time[0] + lags[best] * run.period), turn
