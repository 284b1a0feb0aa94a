"""How far each link of the chain was off: figures of a run, from its record alone.

    requested path -> commanded (generation error) -> encoder (tracking error) -> nozzle
    nozzle to the requested path: contour error, what the part sees

Errors are taken while the dispenser is on. The distance to a path is to the nearest point of the whole
path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gantrysim.controllers.path import Floats, Path
from gantrysim.errors import InputError
from gantrysim.run import Run

__all__ = ["Figures", "Range", "Spacing", "Spread", "figures", "path_speed", "spacing", "tracking_error"]

_NEWTON_STEPS = 20
_NEWTON_TOLERANCE = 1e-10  # [mm]
_SLOPE_REACH = 0.25  # [mm]


@dataclass(frozen=True)
class Spread:
    """Root mean square and largest magnitude of an error."""

    rms: float
    max: float

    @classmethod
    def of(cls, error: Floats) -> Spread:
        return cls(float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error))))


@dataclass(frozen=True)
class Range:
    """Mean, standard deviation, smallest and largest value."""

    mean: float
    std: float
    min: float
    max: float

    @classmethod
    def of(cls, values: Floats) -> Range:
        return cls(float(values.mean()), float(values.std()), float(values.min()), float(values.max()))


@dataclass(frozen=True)
class Spacing:
    """Distance from each point of a spiral's trace to the next turn, along the trace's normal.

    Attributes:
        s: arc length of the points on the requested path, (m,) [mm].
        turn: turns of the tangent since the start of the requested path, (m,).
        distance: to the neighbouring turn, (m,) [mm].
    """

    s: Floats
    turn: Floats
    distance: Floats


@dataclass(frozen=True)
class Figures:
    """The figures of a run, in mm, s and mm/s.

    Attributes:
        spacing: of neighbouring turns, or None where the trace has no neighbouring turns.
        tracking: commanded minus encoder position, for each axis.
        tracking_along: the same along the requested path's tangent: lag is positive.
        generation: commanded position to the requested path.
        contour: nozzle to the requested path.
        speed: path speed of the nozzle.
        path_length: length of the commanded path [mm].
        duration: of the run [s].
        end_point: the nozzle at the end, (x, y, z) [mm].
    """

    spacing: Range | None
    tracking: dict[str, Spread]
    tracking_along: Spread
    generation: Spread
    contour: Spread
    speed: Range
    path_length: float
    duration: float
    end_point: tuple[float, float, float]


def figures(run: Run) -> Figures:
    """Return the figures of a run; of one that a fault ended, those up to the fault.

    Raises:
        InputError: the dispenser is never on.
    """
    on = run.dispense
    if not on.any():
        raise InputError("the dispenser is never on in this run: its figures are taken while it is")
    commanded = run.requested.project(run.commanded_tip[on])
    nozzle = run.requested.project(run.nozzle[on])
    along = _dot(run.commanded_tip[on] - run.encoder_tip[on], run.requested.tangent(commanded.s))
    turns = spacing(run.requested, run.nozzle[on])
    error = tracking_error(run)
    x, y, z = run.nozzle[-1].tolist()
    return Figures(
        spacing=Range.of(turns.distance) if turns.distance.size else None,
        tracking={name: Spread.of(error[on, a]) for a, name in enumerate(run.axes)},
        tracking_along=Spread.of(along),
        generation=Spread.of(commanded.distance),
        contour=Spread.of(nozzle.distance),
        speed=Range.of(path_speed(run)[on]),
        path_length=float(np.linalg.norm(np.diff(run.commanded_tip[on], axis=0), axis=1).sum()),
        duration=float(run.time[-1]),
        end_point=(x, y, z),
    )


def tracking_error(run: Run) -> Floats:
    """Commanded minus encoder position, the following error, (n, axes) [mm]."""
    return run.commanded - run.encoder


def path_speed(run: Run) -> Floats:
    """Speed of the nozzle in the work frame, by central differences over two servo periods, (n,) [mm/s]."""
    if len(run.time) < 2:
        return np.zeros(len(run.time))
    speed: Floats = np.linalg.norm(np.gradient(run.nozzle, run.time, axis=0), axis=1)
    return speed


def spacing(path: Path, trace: ArrayLike) -> Spacing:
    """Return the distance of neighbouring turns of a trace, along the trace's own normal.

    With s the foot of a point on the requested path and e(s) its lateral error the trace is
    q(s) = c(s) + e(s) n(s), and its tangent is along (1 - kappa e) t + e' n, with e' taken over a quarter
    millimetre to both sides. From each point p the normal is followed to where it meets the trace again a
    turn later: (q(s') - p).tangent = 0, solved by Newton's method. Points with no turn after them are left out.

    Args:
        path: the requested path.
        trace: points in the order of the motion, (n, 3) [mm].
    """
    foot = path.project(trace)
    s, first = np.unique(foot.s, return_index=True)
    lateral = foot.lateral[first]

    def offset(at: Floats) -> Floats:
        error: Floats = np.interp(at, s, lateral)
        return error

    def place(at: Floats) -> Floats:
        point: Floats = path.position(at) + offset(at)[:, None] * path.normal(at)
        return point

    heading = path.heading(s)
    sense = np.sign(heading[-1] - heading[0])
    turned = np.maximum.accumulate((heading - heading[0]) * sense)  # a spiral's heading is monotonic
    inner = np.flatnonzero(turned + 2 * np.pi <= turned[-1]) if sense else np.zeros(0, np.intp)
    if not inner.size:
        return Spacing(np.zeros(0), np.zeros(0), np.zeros(0))
    at = s[inner]
    low, high = np.maximum(at - _SLOPE_REACH, s[0]), np.minimum(at + _SLOPE_REACH, s[-1])
    slope = (offset(high) - offset(low)) / (high - low)
    ahead = 1 - path.curvature(at) * offset(at)
    angle = np.arctan2(slope, ahead)[:, None]
    tangent = np.cos(angle) * path.tangent(at) + np.sin(angle) * path.normal(at)
    normal = np.cos(angle) * path.normal(at) - np.sin(angle) * path.tangent(at)
    point = place(at)
    met_at = np.interp(turned[inner] + 2 * np.pi, turned, s)
    for _ in range(_NEWTON_STEPS):
        step = _dot(place(met_at) - point, tangent)
        met_at = met_at - step
        if np.max(np.abs(step)) < _NEWTON_TOLERANCE:
            break
    met = (met_at <= s[-1]) & (met_at >= s[0])
    distance = np.abs(_dot(place(met_at) - point, normal))
    return Spacing(at[met], turned[inner][met] / (2 * np.pi), distance[met])


def _dot(a: Floats, b: Floats) -> Floats:
    product: Floats = np.einsum("ij,ij->i", a, b)
    return product
