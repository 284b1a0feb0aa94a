"""Errors, spacing and speed of a run, from its record alone.

    requested path -> commanded (program error) -> encoder (following error) -> nozzle
    nozzle to the requested path: contour error

Only ticks where the dispenser is on count.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats, as_slice, at_rows, dot, lengths, scaled_rows
from gantrysim.base.columns import Column, blocks, by_blocks, table_by_blocks
from gantrysim.base.display import Shown
from gantrysim.base.errors import InputError
from gantrysim.metrics.spacing import Spacing, spacing_of
from gantrysim.paths.feet import Projection, assigned_progress
from gantrysim.record.run import Run, check_run

THOUSANDTH = {"mm": "µm", "deg": "mdeg"}  # unit of an axis' errors, by the axis' own

_START_AND_END = 0.05  # of the dispensing time, each


@dataclass(frozen=True)
class ErrorSize:
    """Root mean square and largest magnitude of an error."""

    rms: float
    max: float

    @classmethod
    def of(cls, error: Floats) -> ErrorSize:
        return cls(float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error))))


@dataclass(frozen=True)
class ErrorSpread(ErrorSize):
    """Root mean square, largest magnitude and 95th percentile of the magnitude of an error."""

    p95: float

    @classmethod
    def of(cls, error: Floats) -> ErrorSpread:
        size = ErrorSize.of(error)
        return cls(size.rms, size.max, float(np.percentile(np.abs(error), 95)))


@dataclass(frozen=True)
class SteadyFollowing:
    """Following error at the nozzle, without the transients of start and end.

    Attributes:
        along: along the requested path's tangent [mm].
        normal: normal to it [mm].
    """

    along: ErrorSize
    normal: ErrorSize


@dataclass(frozen=True)
class _Stretches:
    """Stretches of a path.

    Attributes:
        begin, end: arc lengths, (m,) [mm].
    """

    begin: Column[Floats] = Column()
    end: Column[Floats] = Column()


@dataclass(frozen=True)
class _Following:
    """Following error at the nozzle.

    Attributes:
        along: along the requested path's tangent, (m,) [mm].
        normal: its size normal to it, (m,) [mm].
    """

    along: Column[Floats] = Column()
    normal: Column[Floats] = Column()


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
class AnalysisValues:
    """The values of a run.

    Attributes:
        spacing: spacing of neighbouring turns, None for a trace without any [mm].
        following: commanded minus encoder position of each axis, in the axis' unit, `Run.units` [mm or deg].
        following_along: the same at the nozzle, along the requested path's tangent; lag is positive [mm].
        program: distance of the commanded position from the requested path [mm].
        contour: distance of the nozzle from the requested path [mm].
        speed: path speed of the nozzle [mm/s].
        path_length: length of the commanded path while the dispenser is on [mm].
        duration: time at which the commanded motion ends [s].
        end_point: position of the nozzle at the end, (x, y, z) [mm].
    """

    spacing: Range | None
    following: dict[str, ErrorSize]
    following_along: ErrorSize
    program: ErrorSize
    contour: ErrorSize
    speed: Range
    path_length: float
    duration: float
    end_point: tuple[float, float, float]


class Analysis(Shown):
    """A run's traces projected onto its requested path; each projection is computed once, on first use.

    The traces are taken at `ticks`, where the dispenser is on. Their feet lie near the progress that the controller
    states: a point belongs to its own turn, not to a neighbouring one that may be nearer, see
    `gantrysim.paths.nearest`.

    Raises:
        InputError: the dispenser is never on.
    """

    def __init__(self, run: Run) -> None:
        check_run(run)
        self.run = run
        self.ticks = _dispensing_ticks(run)

    def facts(self) -> dict[str, str]:
        return {**self.run.facts(), "dispensing": f"{len(self.ticks)} ticks"}

    @property
    def progress(self) -> Floats:
        """Arc length along the requested path for which the command stands, (m,) [mm]."""
        stated = self.run.progress
        return self._assigned_progress if stated is None else at_rows(stated, self.ticks)

    @cached_property
    def _assigned_progress(self) -> Floats:
        return assigned_progress(self.run.requested, self.run.commanded_tip)[self.ticks]

    @cached_property
    def _stretches(self) -> _Stretches:
        """The stretches of the path in which all feet of a tick lie."""
        run = self.run
        names = ["commanded_tip", "encoder_tip", "motor_tip", "nozzle"]
        if run.geometric_tip is not None:
            names.append("geometric_tip")

        def traces(block: slice) -> list[Floats]:
            # columns of a long run are mapped anew for each block, as those of all traces have no room together
            rows = as_slice(self.ticks[block])
            return [getattr(run, name)[rows] for name in names]

        stretches = run.requested.stretches(traces, self.progress)
        count = self.ticks.size
        return table_by_blocks((_Stretches(*stretches[:, block]) for block in blocks(count)), count)

    @cached_property
    def commanded(self) -> Projection:
        """Projection of the commanded positions; its distance is the program error."""
        return self._near(self.run.commanded_tip, again=True)

    def _near(self, trace: Floats, again: bool = False) -> Projection:
        stretches = (self._stretches.begin, self._stretches.end)
        return self.run.requested.near(trace, self.progress, stretches, self.ticks, again=again)

    @cached_property
    def encoder(self) -> Projection:
        """Projection of the nozzle of a rigid machine at the encoders' positions."""
        return self._follow(self.run.encoder_tip, like=(self.run.commanded_tip, "commanded"))

    @cached_property
    def motor(self) -> Projection:
        """Projection of the nozzle of a rigid machine at the motors' positions."""
        return self._follow(self.run.motor_tip, like=(self.run.encoder_tip, "encoder"))

    @cached_property
    def geometric(self) -> Projection:
        """Projection of the nozzle of a rigid machine with geometric errors at the motors' positions."""
        tip = self.run.geometric_tip
        return self.motor if tip is None else self._follow(tip, like=(self.run.motor_tip, "motor"))

    @cached_property
    def nozzle(self) -> Projection:
        """Projection of the nozzle; its distance is the contour error."""
        tip = self.run.geometric_tip
        before = (self.run.motor_tip, "motor") if tip is None else (tip, "geometric")
        return self._follow(self.run.nozzle, like=before)

    def _follow(self, trace: Floats, like: tuple[Floats, str]) -> Projection:
        """Follow a trace, unless an ideal link made it equal to the trace of the link before."""
        other, name = like
        # following is the longest part of an analysis; with exact encoders or a rigid machine traces are equal
        if all(np.array_equal(trace[block], other[block]) for block in blocks(len(trace))):
            return getattr(self, name)
        return self._near(trace)

    @cached_property
    def spacing(self) -> Spacing:
        """Spacing of neighbouring turns."""
        return spacing_of(self.run.requested, self.nozzle, self.ticks, self.heading)

    @cached_property
    def heading(self) -> Floats:
        """Heading of the requested path at the nozzle's furthest foot so far, (m,) [rad]."""
        # a nozzle that shakes moves its foot back and forth
        foot = np.maximum.accumulate(self.nozzle.s)
        return by_blocks(lambda block: self.run.requested.heading(foot[block]), foot.size)

    @property
    def speed(self) -> Floats:
        """Path speed of the nozzle, (m,) [mm/s]."""
        return path_speed(self.run)[self.ticks]

    @cached_property
    def _following(self) -> _Following:
        """Following error at the nozzle."""
        run = self.run

        def components(block: slice) -> _Following:
            ticks = self.ticks[block]
            error = at_rows(run.commanded_tip, ticks) - at_rows(run.encoder_tip, ticks)
            tangent = run.requested.last_tangent(self.commanded.s[block])
            along = dot(error, tangent)
            return _Following(along, lengths(error - scaled_rows(tangent, along)))

        count = self.ticks.size
        return table_by_blocks((components(block) for block in blocks(count)), count)

    @cached_property
    def values(self) -> AnalysisValues:
        """The values of the run, up to a fault where there is one."""
        run = self.run
        ticks = self.ticks

        def steps(block: slice) -> Floats:
            return lengths(np.diff(at_rows(run.commanded_tip, ticks[block.start : block.stop + 1]), axis=0))

        def moves(block: slice) -> NDArray[np.bool_]:
            return np.any(np.diff(run.commanded[block.start : block.stop + 1], axis=0) != 0, axis=1)

        following = {}
        for a, name in enumerate(run.axes):
            following[name] = ErrorSize.of(run.commanded[ticks, a] - run.encoder[ticks, a])
        # not the way between stretches of dispensing
        path_length = float(by_blocks(steps, ticks.size - 1)[np.diff(ticks) == 1].sum())
        x, y, z = run.nozzle[-1].tolist()
        moving = np.flatnonzero(by_blocks(moves, len(run.time) - 1))
        return AnalysisValues(
            spacing=Range.of(self.spacing.distance) if self.spacing.distance.size else None,
            following=following,
            following_along=ErrorSize.of(self._following.along),
            program=ErrorSize.of(self.commanded.distance),
            contour=ErrorSize.of(self.nozzle.distance),
            speed=Range.of(self.speed),
            path_length=path_length,
            duration=float(run.time[moving[-1] + 1]) if moving.size else 0.0,
            end_point=(x, y, z),
        )

    @property
    def speed_ripple(self) -> float:
        """Ripple of the path speed, see `speed_ripple`."""
        speed = self.speed[steady(self.ticks.size)]
        mean = float(speed.mean())
        return float(speed.std()) / mean if mean > 0 else 0.0

    @cached_property
    def steady_following(self) -> SteadyFollowing:
        """Following error at the nozzle in the middle 90 % of the dispensing time."""
        middle = steady(self.ticks.size)
        following = self._following
        return SteadyFollowing(ErrorSize.of(following.along[middle]), ErrorSize.of(following.normal[middle]))


def values(run: Run) -> AnalysisValues:
    """Return the values of a run, up to a fault where there is one.

    Raises:
        InputError: the dispenser is never on.
    """
    return Analysis(run).values


def following_error(run: Run) -> Floats:
    """Commanded minus encoder position, the following error, (n, axes), each axis in its own unit [mm or deg]."""
    check_run(run)
    return run.commanded - run.encoder


def path_speed(run: Run) -> Floats:
    """Speed of the nozzle in the work frame, by central differences, (n,) [mm/s]."""
    check_run(run)
    n = len(run.time)
    if n < 2:
        return np.zeros(n)

    def speed(block: slice) -> Floats:
        # with one row of each neighbouring block, so that differences are central at its ends too
        before = min(block.start, 1)
        after = 1 if block.stop < n else 0
        around = run.nozzle[block.start - before : block.stop + after]
        return lengths(np.gradient(around, run.period, axis=0))[before : len(around) - after]

    return by_blocks(speed, n)


def speed_ripple(run: Run) -> float:
    """Standard deviation of the nozzle's path speed over its mean, in the middle 90 % of the dispensing time.

    It is 0 for a nozzle that does not move.

    Raises:
        InputError: the dispenser is never on.
    """
    return Analysis(run).speed_ripple


def torque_ripple(run: Run) -> Floats:
    """Torque ripple: noise of each axis' torque demand while the dispenser is on, (axes,) [N·m].

        ripple = rms(d tau) / sqrt(2),        d tau: change of the demand from one tick to the next

    It is the standard deviation of white noise with the same changes, and 0 if the dispenser is never on for two
    consecutive ticks.

    Raises:
        InputError: the dispenser is never on.
    """
    check_run(run)
    # raises where there are none
    _dispensing_ticks(run)
    both = run.dispense[:-1] & run.dispense[1:]
    squares = [np.sum(np.diff(run.demand[:, a])[both] ** 2) for a in range(len(run.axes))]
    return np.sqrt(np.array(squares) / (2 * max(int(np.count_nonzero(both)), 1)))


def steady(ticks: int) -> slice:
    """Return the middle 90 % of a number of ticks, without the start and the end of the motion."""
    edge = round(_START_AND_END * ticks)
    return slice(edge, ticks - edge)


def _dispensing_ticks(run: Run) -> NDArray[np.intp]:
    ticks = np.flatnonzero(run.dispense)
    if not ticks.size:
        raise InputError("the dispenser is never on in this run: nothing to measure")
    return ticks
