"""How far each link of the chain was off: figures of a run, from its record alone.

    requested path -> commanded (generation error) -> encoder (tracking error) -> nozzle
    nozzle to the requested path: contour error, what the part sees

Errors are taken while the dispenser is on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gantrysim.controllers.path import Floats, Path, Projection, dot
from gantrysim.errors import InputError
from gantrysim.run import Run

__all__ = [
    "THOUSANDTH",
    "Analysis",
    "Figures",
    "Range",
    "Spacing",
    "Spread",
    "figures",
    "one_way",
    "path_speed",
    "spacing",
    "speed_ripple",
    "steady",
    "tracking_error",
]

THOUSANDTH = {"mm": "µm", "deg": "mdeg"}  # in which the errors of an axis are told

_NEWTON_STEPS = 20
_LAST_STEP = 1e-7  # of Newton's, after which the error that is left is of the order of its square [mm]
_SLOPE_REACH = 0.25  # [mm]
_LEAST_SLOPE = 0.3
_START_AND_END = 0.05  # of the dispensing time, each
_LEAST_OVERLAP = 0.02  # of the second turn over the first, for a spacing to speak of [rad]


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
        next_s: arc length of the points of the neighbouring turn on the requested path, (m,) [mm].
        link: both points on the trace, (m, 2, 3) [mm].
    """

    s: Floats
    turn: Floats
    distance: Floats
    next_s: Floats
    link: Floats


@dataclass(frozen=True)
class Figures:
    """The figures of a run, in mm, s and mm/s; of a rotary axis in deg.

    Attributes:
        spacing: of neighbouring turns, or None where the trace has no neighbouring turns.
        tracking: commanded minus encoder position, for each axis in its own unit, `Run.units` [mm or deg].
        tracking_along: the same of the nozzle that follows from the axes, along the requested path's tangent: lag
            is positive.
        generation: commanded position to the requested path.
        contour: nozzle to the requested path.
        speed: path speed of the nozzle.
        path_length: length of the commanded path, as far as the dispenser was on [mm].
        duration: time at which the commanded motion ends [s].
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


class Analysis:
    """A run's traces held against its requested path; each is worked out once, when it is first asked for.

    All is of the ticks where the dispenser is on, `ticks`. The traces are followed along the path in the order of
    the motion, so an error is to the part of the path that the trace has come to, not to a neighbouring turn that
    may be nearer.

    Raises:
        InputError: the dispenser is never on.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        self.ticks: NDArray[np.intp] = np.flatnonzero(run.dispense)
        if not self.ticks.size:
            raise InputError("the dispenser is never on in this run: its figures are taken while it is")

    @cached_property
    def commanded(self) -> Projection:
        """Commanded positions on the requested path: its distance is the generation error."""
        return self.run.requested.follow(self.run.commanded_tip[self.ticks], begin=0.0)

    @cached_property
    def encoder(self) -> Projection:
        """On the requested path, where the encoders' positions would put the nozzle of a rigid machine."""
        return self._followed(self.run.encoder_tip, like=(self.run.commanded_tip, "commanded"))

    @cached_property
    def motor(self) -> Projection:
        """The same of the motors' positions that the encoders counted."""
        return self._followed(self.run.motor_tip, like=(self.run.encoder_tip, "encoder"))

    @cached_property
    def nozzle(self) -> Projection:
        """The nozzle on the requested path: its distance is the contour error."""
        return self._followed(self.run.nozzle, like=(self.run.motor_tip, "motor"))

    def _followed(self, trace: Floats, like: tuple[Floats, str]) -> Projection:
        """Follow a trace, unless it is that of the link before: of an ideal follower, encoder or structure."""
        other, name = like
        if np.array_equal(trace, other):
            foot: Projection = getattr(self, name)
            return foot
        return self.run.requested.follow(trace[self.ticks], begin=0.0)

    @cached_property
    def spacing(self) -> Spacing:
        """Spacing of neighbouring turns."""
        return _spacing(self.run.requested, self.nozzle, self.ticks)

    @cached_property
    def figures(self) -> Figures:
        """The figures; of a run that a fault ended, those up to the fault."""
        run, on = self.run, self.ticks
        along = dot((run.commanded_tip - run.encoder_tip)[on], run.requested.tangent(self.commanded.s))
        error = tracking_error(run)
        steps = np.linalg.norm(np.diff(run.commanded_tip[on], axis=0), axis=1)
        moving = np.flatnonzero(np.any(np.diff(run.commanded, axis=0) != 0, axis=1))
        x, y, z = run.nozzle[-1].tolist()
        return Figures(
            spacing=Range.of(self.spacing.distance) if self.spacing.distance.size else None,
            tracking={name: Spread.of(error[on, a]) for a, name in enumerate(run.axes)},
            tracking_along=Spread.of(along),
            generation=Spread.of(self.commanded.distance),
            contour=Spread.of(self.nozzle.distance),
            speed=Range.of(path_speed(run)[on]),
            path_length=float(steps[np.diff(on) == 1].sum()),
            duration=float(run.time[moving[-1] + 1]) if moving.size else 0.0,
            end_point=(x, y, z),
        )


def figures(run: Run) -> Figures:
    """Return the figures of a run; of one that a fault ended, those up to the fault.

    Raises:
        InputError: the dispenser is never on.
    """
    return Analysis(run).figures


def tracking_error(run: Run) -> Floats:
    """Commanded minus encoder position, the following error, (n, axes), each axis in its own unit [mm or deg]."""
    return run.commanded - run.encoder


def path_speed(run: Run) -> Floats:
    """Speed of the nozzle in the work frame, by central differences over two servo periods, (n,) [mm/s]."""
    if len(run.time) < 2:
        return np.zeros(len(run.time))
    speed: Floats = np.linalg.norm(np.gradient(run.nozzle, run.period, axis=0), axis=1)
    return speed


def speed_ripple(run: Run) -> float:
    """Standard deviation of the nozzle's path speed over its mean, in the middle 90 % of the dispensing time.

    0 where the nozzle does not move.

    Raises:
        InputError: the dispenser is never on.
    """
    on = np.flatnonzero(run.dispense)
    if not on.size:
        raise InputError("the dispenser is never on in this run: its speed ripple is taken while it is")
    speed = path_speed(run)[on[steady(on.size)]]
    mean = float(speed.mean())
    return float(speed.std()) / mean if mean > 0 else 0.0


def steady(ticks: int) -> slice:
    """Return the middle 90 % of a number of ticks: in the first and the last 5 % the motion starts and ends."""
    edge = round(_START_AND_END * ticks)
    return slice(edge, ticks - edge)


def spacing(path: Path, trace: ArrayLike) -> Spacing:
    """Return the distance of neighbouring turns of a trace, along the trace's own normal in the path's plane.

    With s the foot of a point on the requested path and e(s) its lateral error the trace is, but for what it is off
    the plane, q(s) = c(s) + e(s) n(s), and its direction in the plane is along (cos(beta) - kappa e) h + e' n, with
    h the heading, beta the climb and e' taken over a quarter millimetre to both sides. From each point p the normal is
    followed to where it meets the trace again a turn later: (q(s') - p).direction = 0, solved by Newton's method.
    Points with no turn after them are left out. Of a path that turns now left, now right it is the stretch that
    turns furthest one way.

    Args:
        path: the requested path.
        trace: points in the order of the motion, (n, 3) [mm].
    """
    foot = path.follow(trace)
    return _spacing(path, foot, np.arange(foot.s.size))


def _spacing(path: Path, foot: Projection, ticks: NDArray[np.intp]) -> Spacing:
    """Spacing of a trace from its projection; where ticks are left out between two points there is no trace."""
    forward = np.concatenate([[True], foot.s[1:] > np.maximum.accumulate(foot.s)[:-1]])
    s, lateral = foot.s[forward], foot.lateral[forward]
    parts = np.concatenate([[0], np.cumsum(np.diff(ticks) > 1)])[forward]

    def offset(at: Floats) -> Floats:
        error: Floats = np.interp(at, s, lateral)
        return error

    def place(at: Floats) -> Floats:
        point: Floats = path.position(at) + offset(at)[:, None] * path.normal(at)
        return point

    def slope(at: Floats) -> Floats:
        low, high = np.maximum(at - _SLOPE_REACH, s[0]), np.minimum(at + _SLOPE_REACH, s[-1])
        ratio: Floats = (offset(high) - offset(low)) / (high - low)
        return ratio

    def direction(at: Floats) -> Floats:
        """The trace's derivative over s in the plane, (m, 3)."""
        normal = path.normal(at)
        ahead = np.sqrt(np.maximum(1 - path.climb(at) ** 2, 0.0)) - path.curvature(at) * offset(at)
        along: Floats = ahead[:, None] * np.cross(normal, path.frame(at)[:, 2]) + slope(at)[:, None] * normal
        return along

    heading, (first, last) = one_way(path.heading(s))
    s, lateral, parts = s[first:last], lateral[first:last], parts[first:last]
    if heading.size < 2 or heading[-1] < 2 * np.pi + _LEAST_OVERLAP:
        return Spacing(*np.zeros((4, 0)), link=np.zeros((0, 2, 3)))
    inner = np.flatnonzero(heading + 2 * np.pi <= heading[-1])
    at = s[inner]
    tangent = direction(at)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.cross(path.frame(at)[:, 2], tangent)
    point = place(at)
    guess = np.interp(heading[inner] + 2 * np.pi, heading, s)
    met_at = guess.copy()
    active = np.arange(at.size)
    for _ in range(_NEWTON_STEPS):
        here, ahead = met_at[active], tangent[active]
        # where the two turns' directions differ much the step is kept short
        step = dot(place(here) - point[active], ahead) / np.maximum(dot(direction(here), ahead), _LEAST_SLOPE)
        met_at[active] -= step
        active = active[np.abs(step) >= _LAST_STEP]
        if not active.size:
            break
    met = (met_at <= s[-1]) & (met_at > 0.5 * (at + guess))
    met[active] = False
    after = np.clip(np.searchsorted(s, met_at), 1, s.size - 1)
    met &= parts[after] == parts[after - 1]
    link = np.stack([point, place(met_at)], axis=1)
    distance = np.abs(dot(link[:, 1] - point, normal))
    return Spacing(at[met], heading[inner][met] / (2 * np.pi), distance[met], met_at[met], link[met])


def one_way(heading: Floats) -> tuple[Floats, tuple[int, int]]:
    """Return the angle turned along the stretch of a heading that turns furthest one way, and where that is.

    Args:
        heading: in the order of the motion, not wrapped, (n,) [rad].

    Returns:
        The angle since the stretch begins, (k,) [rad], and the indices at which it begins and before which it ends.
    """
    change = np.diff(heading)
    sense = np.sign(change)
    # a straight stretch goes with the turning before it
    turning = np.flatnonzero(sense)
    if not turning.size:
        return np.zeros(0), (0, 0)
    sense = sense[turning[np.maximum(np.searchsorted(turning, np.arange(sense.size), side="right") - 1, 0)]]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(sense)) + 1, [sense.size]])
    turned = [abs(heading[high] - heading[low]) for low, high in pairwise(edges.tolist())]
    k = int(np.argmax(turned))
    low, high = edges[k : k + 2].tolist()
    return np.abs(heading[low : high + 1] - heading[low]), (low, high + 1)
