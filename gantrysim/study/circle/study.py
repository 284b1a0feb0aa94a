"""`gantrysim study circle`: a circular test of a machine in the manner of ISO 230-4."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from gantrysim.errors import InputError, positive
from gantrysim.job.job import Job
from gantrysim.metrics import SPIKE_REACH, Trace
from gantrysim.study.cases import OK, Case, Row, measure
from gantrysim.study.circle.figures import figures
from gantrysim.study.circle.findings import findings
from gantrysim.study.circle.rows import AXES, DECAY, SENSES, circle_row, trace_of
from gantrysim.study.runner import Measure
from gantrysim.study.study import Plot, Rounds

_LARGEST_REACH = 40.0  # of a spike [deg]
_LEAD = 225.0  # before and after the circle that counts, at least: it begins and ends between two reversals [deg]
_CALM = 0.3  # at the full speed before it counts, at least [s]
_LEAST_TICKS = 120  # on the circle, one every 3 deg
_ACCELERATION = 3000.0  # along the path, at begin and end [mm/s²]


@dataclass(frozen=True)
class CircleStudy:
    """A circle run both ways, and what an instrument for circular tests would show of it.

    softMC's CIRCLE runs the circle about the axes' zero with a lead before and after it, so that start and stop do not
    count; what counts is one full circle at constant speed.

    Args:
        machine: a built-in machine or an MJCF file, with axes x and y.
        radius: of the circle [mm].
        speed: along it [mm/s].
        overrides: values of the job that is made of this, as "servo.period=0.0005".
    """

    machine: str = "xy"
    radius: float = 50.0
    speed: float = 100.0
    overrides: tuple[str, ...] = ()

    name = "circle"
    plots = ("chart", "deviation")

    def __post_init__(self) -> None:
        positive("radius", self.radius, "mm")
        positive("speed", self.speed, "mm/s")
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
        """Heads the report."""
        return f"Circular test of {self.job.built_machine.name}"

    @property
    def settings(self) -> dict[str, Any]:
        """What the study does."""
        return {"radius": self.radius, "speed": self.speed}

    @property
    def lead(self) -> float:
        """Angle run before the circle that counts, and after it [deg]."""
        way = self.speed**2 / (2 * _ACCELERATION) + self.speed * _CALM
        more = math.degrees(way / self.radius) - _LEAD
        return _LEAD + 360 * max(math.ceil(more / 360), 0)

    @property
    def decay(self) -> float:
        """Angle within which a spike after a reversal has decayed [deg]."""
        return math.degrees(self.speed * DECAY / self.radius)

    @property
    def reach(self) -> float:
        """Angle after a reversal within which its spike is looked for: that of its decay, within bounds [deg]."""
        return min(max(SPIKE_REACH, self.decay), _LARGEST_REACH)

    def _program(self, sense: float) -> str:
        angle = sense * (360 + 2 * self.lead)
        return f"Circle G1 Angle={angle:.10g} CircleCenter={{0, 0}}"

    @cached_property
    def job(self) -> Job:
        """The job that runs the circle counter-clockwise."""
        job = Job(
            name="circle",
            program={
                "controller": "softmc.Program",
                "program": self._program(1.0),
                "start": [self.radius, 0.0],
                "group": {"velocity": self.speed, "acceleration": _ACCELERATION},
            },
            servo={"integral_time": 0.03},  # type: ignore[arg-type]
        )
        return job.overridden([f"machine={self.machine}", *self.overrides])

    @cached_property
    def centre(self) -> tuple[float, float]:
        """Where the nozzle is in the work frame with all axes at zero [mm]."""
        machine = self.job.built_machine
        x, y, _ = machine.tip(np.zeros(len(machine.axes))).tolist()
        return x, y

    @property
    def measure(self) -> Measure:
        """From a case to its row, with the radial deviation as a curve."""
        of_a_run = partial(circle_row, centre=self.centre, radius=self.radius, lead=self.lead, reach=self.reach)
        return partial(measure, figures=of_a_run)

    def rounds(self) -> Rounds:
        """Yield both ways round."""
        yield [
            Case.of(self.job, {"program.program": self._program(sense)}, direction=name)
            for name, sense in SENSES.items()
        ]

    def traces(self, rows: list[Row]) -> dict[str, Trace]:
        """Return the nozzle's paths by their direction, those that have figures."""
        good = [row for row in rows if row["status"] == OK]
        return {str(row["direction"]): trace_of(row, self.centre, self.radius, "radial") for row in good}

    def findings(self, rows: list[Row]) -> list[str]:
        """Return the figures, where the deviation is largest, and what of it the servo makes."""
        return findings(self, rows)

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return the circular-test chart, and the deviation over the angle."""
        return figures(self, rows)
