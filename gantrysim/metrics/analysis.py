"""How far each link of the chain was off: figures of a run, from its record alone.

    requested path -> commanded (generation error) -> encoder (tracking error) -> nozzle
    nozzle to the requested path: contour error, what the part sees

Errors are taken while the dispenser is on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats, dot
from gantrysim.controllers.paths.path import Projection
from gantrysim.errors import InputError
from gantrysim.metrics.spacing import Spacing, spacing_of
from gantrysim.run import Run

THOUSANDTH = {"mm": "µm", "deg": "mdeg"}  # in which the errors of an axis are told

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
    tracking: dict[str, ErrorSize]
    tracking_along: ErrorSize
    generation: ErrorSize
    contour: ErrorSize
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
            return getattr(self, name)
        return self.run.requested.follow(trace[self.ticks], begin=0.0)

    @cached_property
    def spacing(self) -> Spacing:
        """Spacing of neighbouring turns."""
        return spacing_of(self.run.requested, self.nozzle, self.ticks)

    @cached_property
    def values(self) -> AnalysisValues:
        """The figures; of a run that a fault ended, those up to the fault."""
        run, on = self.run, self.ticks
        along = dot((run.commanded_tip - run.encoder_tip)[on], run.requested.tangent(self.commanded.s))
        error = tracking_error(run)
        steps = np.linalg.norm(np.diff(run.commanded_tip[on], axis=0), axis=1)
        moving = np.flatnonzero(np.any(np.diff(run.commanded, axis=0) != 0, axis=1))
        x, y, z = run.nozzle[-1].tolist()
        return AnalysisValues(
            spacing=Range.of(self.spacing.distance) if self.spacing.distance.size else None,
            tracking={name: ErrorSize.of(error[on, a]) for a, name in enumerate(run.axes)},
            tracking_along=ErrorSize.of(along),
            generation=ErrorSize.of(self.commanded.distance),
            contour=ErrorSize.of(self.nozzle.distance),
            speed=Range.of(path_speed(run)[on]),
            path_length=float(steps[np.diff(on) == 1].sum()),
            duration=float(run.time[moving[-1] + 1]) if moving.size else 0.0,
            end_point=(x, y, z),
        )


def values(run: Run) -> AnalysisValues:
    """Return the figures of a run; of one that a fault ended, those up to the fault.

    Raises:
        InputError: the dispenser is never on.
    """
    return Analysis(run).values


def tracking_error(run: Run) -> Floats:
    """Commanded minus encoder position, the following error, (n, axes), each axis in its own unit [mm or deg]."""
    return run.commanded - run.encoder


def path_speed(run: Run) -> Floats:
    """Speed of the nozzle in the work frame, by central differences over two servo periods, (n,) [mm/s]."""
    if len(run.time) < 2:
        return np.zeros(len(run.time))
    return np.linalg.norm(np.gradient(run.nozzle, run.period, axis=0), axis=1)


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


def torque_ripple(run: Run) -> Floats:
    """Return how restless each axis' torque demand is while the dispenser is on, (axes,) [N·m].

        ripple = rms(d tau) / sqrt(2),        d tau: change of the demand from one tick to the next

    It is the standard deviation of the white noise that would change as much; a smooth torque has almost none. Over
    `Axis.peak_torque` it is a share of what the drive can give. Of a dispenser that is never on for two ticks on end
    it is 0.

    Raises:
        InputError: the dispenser is never on.
    """
    if not run.dispense.any():
        raise InputError("the dispenser is never on in this run: its torque ripple is taken while it is")
    change = np.diff(run.demand, axis=0)[run.dispense[:-1] & run.dispense[1:]]
    return np.sqrt(np.sum(change**2, axis=0) / (2 * max(len(change), 1)))


def steady(ticks: int) -> slice:
    """Return the middle 90 % of a number of ticks: in the first and the last 5 % the motion starts and ends."""
    edge = round(_START_AND_END * ticks)
    return slice(edge, ticks - edge)
