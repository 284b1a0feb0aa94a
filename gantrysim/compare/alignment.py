"""The alignment of a measured trace with a simulated run, in time and place.

With m(t) a measured position, s(t) the simulated one of the same link and R a turn about z, the least sum of squares of

    m(t) - R s(t - shift) - offset

gives shift, offset and turn; it starts from the places where the velocities differ least (`gantrysim.compare.places`),
and the best of them is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, unknown
from gantrysim.compare.measured import LEAST, Trace
from gantrysim.compare.places import Place, places
from gantrysim.record.run import Run

ALIGNED = ("time", "offset", "rotation")
_STEPS = 50
_SETTLED = 1e-9  # change of the shift that ends the search, in servo periods
_AS_WELL = 1.1  # residual, of the best one, up to which another place fits as well
_NOTHING = 1e-5  # residual that is rounding [mm or deg]
_APART = 15  # servo periods by which the shifts of two places differ
_AS_LONG = 0.9  # overlap with the run, of the first place's, below which a place is none


@dataclass(frozen=True)
class Alignment:
    """How a trace lies against the simulation.

    Attributes:
        by: link that gives it: commanded, encoder or nozzle.
        shift: the trace's time less the run's [s].
        offsets: the trace's position less the run's, by frame: "axes" (axes,) and "nozzle" (3,) [mm or deg].
        rotation: turn of the nozzle's frame about z, counter-clockwise positive [deg].
        residual: rms of what is left of the link [mm or deg].
        others: shifts with which the trace fits as well, as on a circle of several turns [s].
    """

    by: str
    shift: float
    offsets: Mapping[str, Floats]
    rotation: float
    residual: float
    others: tuple[float, ...] = ()


class _Fit(NamedTuple):
    """A trace laid on a run: time shift [s], offset (axes,), turn [rad], rms of the residual, samples that overlap."""

    shift: float
    offset: Floats
    turn: float
    residual: float
    overlap: int


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
    fit, others = _best(trace, run, by, None if "time" in what else 0.0, placed, turning)
    turn = fit.turn
    offsets = {}
    if by != "nozzle":
        offsets["axes"] = fit.offset
        if trace.nozzle is not None:
            of_nozzle, _ = _best(trace, run, "nozzle", fit.shift, placed, turning)
            offsets["nozzle"] = of_nozzle.offset
            turn = of_nozzle.turn
    else:
        offsets["nozzle"] = fit.offset
    return Alignment(by, fit.shift, offsets, float(np.degrees(turn)), fit.residual, others)


def _best(
    trace: Trace, run: Run, link: str, shift: float | None, placed: bool, turning: bool
) -> tuple[_Fit, tuple[float, ...]]:
    """Return the fit of one link with the least residual, and the shifts of others as good; a given shift is kept."""
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    if measured is None:
        raise InputError(f"{link} is not measured")
    known = ~np.isnan(measured).any(axis=0)
    turning = turning and link == "nozzle"
    free = shift is None
    starts = [Place(float(shift or 0.0), 0.0)]
    if free:
        starts = places(trace.time, measured[:, known], run, getattr(run, link)[:, known], turning)
    fits = [_fitted(trace, run, link, start, (free, placed, turning)) for start in starts]
    whole = [fit for fit in fits if fit.overlap >= _AS_LONG * fits[0].overlap]
    best = min(whole, key=lambda fit: fit.residual)
    as_good = [fit.shift for fit in whole if fit.residual <= max(_AS_WELL * best.residual, _NOTHING)]
    return best, tuple(sorted(_apart(as_good, best.shift, _APART * run.period)))


def _apart(shifts: list[float], from_shift: float, least: float) -> list[float]:
    """Return the shifts that differ from one, and from each other, by more than a least difference."""
    distinct = [from_shift]
    for shift in shifts:
        if min(abs(shift - other) for other in distinct) > least:
            distinct.append(shift)
    return distinct[1:]


def _fitted(trace: Trace, run: Run, link: str, start: Place, free: tuple[bool, bool, bool]) -> _Fit:
    """Return the fit of one link by Gauss and Newton from a place; free are shift, offset and turn."""
    shifting, placed, turning = free
    measured = trace.nozzle if link == "nozzle" else trace.axes[link]
    assert measured is not None
    known = ~np.isnan(measured).any(axis=0)
    spline = CubicSpline(run.time, getattr(run, link)[:, known], axis=0)
    m = measured[:, known]
    columns = np.flatnonzero(known)
    tau, turn = start
    offset = np.zeros(m.shape[1])
    for _ in range(_STEPS):
        shifted = trace.time - tau
        inside = (shifted >= run.time[0]) & (shifted <= run.time[-1])
        overlap = int(np.count_nonzero(inside))
        if overlap < LEAST:
            raise InputError(
                f"the trace covers {overlap} of its samples with the run, from {run.time[0]:g} to "
                f"{run.time[-1]:g} s: must be at least {LEAST}"
            )
        s = spline(shifted[inside])
        rate = spline(shifted[inside], 1)
        residual = m[inside] - turned(s, turn) - offset
        slopes = []
        if shifting:
            slopes.append(-turned(rate, turn))
        if turning:
            slopes.append(turned(s, turn + np.pi / 2) * (columns < 2))
        if placed:
            slopes += [np.broadcast_to(unit, residual.shape) for unit in np.eye(residual.shape[1])]
        if not slopes:
            break
        step = np.linalg.lstsq(np.stack([slope.ravel() for slope in slopes], axis=1), residual.ravel(), rcond=None)[0]
        steps = list(step)
        change = steps.pop(0) if shifting else 0.0
        tau += change
        if turning:
            turn += steps.pop(0)
        offset = offset + (np.array(steps) if placed else 0.0)
        if abs(change) <= _SETTLED * run.period and np.abs(step).max() <= _SETTLED:
            break
    whole = np.zeros(measured.shape[1])
    whole[known] = offset
    return _Fit(float(tau), whole, float(turn), float(np.sqrt(np.mean(residual**2))), overlap)


def turned(points: Floats, turn: float) -> Floats:
    """Return points turned about z, (n, 2 or more)."""
    if turn == 0.0:
        return points
    x, y, *others = points.T
    cos = np.cos(turn)
    sin = np.sin(turn)
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, *others])
