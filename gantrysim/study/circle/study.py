"""The circle study: a circular test of a machine after ISO 230-4."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gantrysim.base.errors import InputError, at_least, positive
from gantrysim.base.quantity import UM
from gantrysim.job.job import Job
from gantrysim.job.programs import circle_program
from gantrysim.metrics import SPIKE_REACH, Trace, circle_row
from gantrysim.study.cases import OK, Case, Row, measure
from gantrysim.study.runner import Measure
from gantrysim.study.study import Rounds, Study

if TYPE_CHECKING:
    pass

Link = Literal["radial", "motor"]  # the nozzle's or the motors' path, by the name of its curve

AXES = ("x", "y")
SENSES = {"clockwise": -1.0, "counter-clockwise": 1.0}  # of the cases, counter-clockwise positive
DECAY = 0.1  # of a spike after a reversal [s]

_LARGEST_REACH = 40.0  # of a spike [deg]
_LEAD = 225.0  # before and after the evaluated circle, at least: it begins and ends between two reversals [deg]
_CALM_TIME = 0.3  # at full speed before the evaluated circle, at least [s]
_LEAST_TICKS = 120  # servo periods on the circle, one every 3 deg
# radius [mm]
_SMALLEST_RADIUS = 1e-6
_LARGEST_RADIUS = 1e6
_FASTEST_SPEED = 1e6  # speed [mm/s]
_ACCELERATION = 3000.0  # along the path, at start and end [mm/s²]


@dataclass(frozen=True)
class CircleStudy(Study):
    """A circle run in both directions, evaluated as an instrument for circular tests does.

    The circle lies about the axes' zero, with a lead before and after the one full circle at constant speed that is
    evaluated.

    Args:
        machine: a built-in machine or an MJCF file, with axes x and y.
        radius: of the circle [mm].
        speed: along it [mm/s].
        overrides: values of the resulting job, as "servo.period=0.0005".
    """

    job: Job = field(init=False)

    machine: str = "xy"
    radius: float = 50.0
    speed: float = 100.0
    overrides: tuple[str, ...] = ()

    name = "circle"
    plots = ("chart", "deviation")

    def __post_init__(self) -> None:
        at_least("radius", positive("radius", self.radius, "mm", _LARGEST_RADIUS), _SMALLEST_RADIUS, "mm")
        positive("speed", self.speed, "mm/s", _FASTEST_SPEED)
        object.__setattr__(self, "job", self._job())
        period = self.job.built_servo.period
        least = _LEAST_TICKS * self.speed * period / (2 * math.pi)
        if self.radius < least:
            raise InputError(
                f"radius = {self.radius:g} mm: must be at least {least:.4g} mm, for {_LEAST_TICKS} servo periods of "
                f"{period:g} s on the circle at {self.speed:g} mm/s"
            )
        names = self.job.built_machine.axis_names
        if not set(AXES) <= set(names):
            raise InputError(
                f"machine {self.job.built_machine.name} has the axes {', '.join(names)}: must have x and y"
            )

    @property
    def title(self) -> str:
        return f"Circular test of {self.job.built_machine.name}"

    @property
    def settings(self) -> dict[str, Any]:
        return {"radius": self.radius, "speed": self.speed}

    @property
    def lead(self) -> float:
        """Angle run before and after the evaluated circle [deg]."""
        distance = self.speed**2 / (2 * _ACCELERATION) + self.speed * _CALM_TIME
        # whole circles more, so that the evaluated one still begins and ends between two reversals
        missing = math.degrees(distance / self.radius) - _LEAD
        return _LEAD + 360 * max(math.ceil(missing / 360), 0)

    @property
    def decay(self) -> float:
        """Angle within which a spike after a reversal decays [deg]."""
        return math.degrees(self.speed * DECAY / self.radius)

    @property
    def reach(self) -> float:
        """Angle after a reversal within which its spike is searched: the angle of its decay, within bounds [deg]."""
        return min(max(SPIKE_REACH, self.decay), _LARGEST_REACH)

    def _program(self, sense: float) -> dict[str, Any]:
        angle = sense * (360 + 2 * self.lead)
        return circle_program(self.radius, self.speed, _ACCELERATION, angle)

    def _job(self) -> Job:
        """Return the job that runs the circle counter-clockwise."""
        content = {
            "name": "circle",
            "program": self._program(1.0),
            "servo": {"integral_time": 0.03},
        }
        job = Job.of_content(content, f"circle of radius {self.radius:g} mm at {self.speed:g} mm/s")
        return job.with_overrides([f"machine={self.machine}", *self.overrides])

    @cached_property
    def centre(self) -> tuple[float, float]:
        """Position of the nozzle in the work frame with all axes at zero [mm]."""
        machine = self.job.built_machine
        x, y, _ = machine.tip(np.zeros(len(machine.axes))).tolist()
        return x, y

    @property
    def measure(self) -> Measure:
        values = partial(circle_row, centre=self.centre, radius=self.radius, lead=self.lead, reach=self.reach)
        return partial(measure, values=values)

    def rounds(self) -> Rounds:
        """Yield both directions."""
        yield [
            Case.of(self.job, {"program.program": self._program(sense)["program"]}, direction=name)
            for name, sense in SENSES.items()
        ]

    def traces(self, rows: Sequence[Row], link: Link) -> dict[str, Trace]:
        """Return the paths of nozzle or motors by direction, for the rows that have values."""
        good = [row for row in rows if row["status"] == OK]
        return {str(row["direction"]): _trace(row, self.centre, self.radius, link) for row in good}


def _trace(row: Row, centre: tuple[float, float], radius: float, link: Link) -> Trace:
    """Return the actual path from a row of `circle_row`."""
    angle = np.radians(np.array(row["angle_deg"], float))
    deviation = np.array(row[f"{link}_deviation_um"], float) / UM
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Trace(centre + (radius + deviation)[:, None] * out, centre, radius)
