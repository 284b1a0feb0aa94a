"""`gantrysim study circle`: a circular test of a machine in the manner of ISO 230-4."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.errors import InputError, positive
from gantrysim.iso import SPIKE_REACH, CircularTest, Reversal, Trace, minimum_zone
from gantrysim.job import Job
from gantrysim.run import Run
from gantrysim.study.cases import OK, Case, Row, measure
from gantrysim.study.circle_figures import draw_chart, draw_deviation
from gantrysim.study.runner import Measure
from gantrysim.study.study import Plot, Rounds

if TYPE_CHECKING:
    from gantrysim.page import Table

__all__ = ["CircleStudy", "circle_row"]

_UM = 1e3
_LEAD = 225.0  # before and after the circle that counts, at least: it begins and ends between two reversals [deg]
_CALM = 0.3  # at the full speed before it counts, at least [s]
_ACCELERATION = 3000.0  # along the path, at begin and end [mm/s²]
_SENSES = {"clockwise": -1.0, "counter-clockwise": 1.0}
_AXES = ("x", "y")
_DECAY = 0.1  # within which a spike has decayed [s]
_LARGEST_REACH = 40.0  # of a spike [deg]


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
        names = self.job.built_machine.axis_names
        if not set(_AXES) <= set(names):
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
    def reach(self) -> float:
        """Angle after a reversal within which its spike has decayed [deg]."""
        return min(max(SPIKE_REACH, self._decay), _LARGEST_REACH)

    @property
    def _decay(self) -> float:
        return math.degrees(self.speed * _DECAY / self.radius)

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
        figures = partial(circle_row, centre=self.centre, radius=self.radius, lead=self.lead, reach=self.reach)
        return partial(measure, figures=figures)

    def rounds(self) -> Rounds:
        """Yield both ways round."""
        yield [
            Case.of(self.job, {"program.program": self._program(sense)}, direction=name)
            for name, sense in _SENSES.items()
        ]

    def _traces(self, rows: list[Row]) -> dict[str, Trace]:
        return {str(row["direction"]): self._trace(row, "radial_deviation_um") for row in rows if row["status"] == OK}

    def _trace(self, row: Row, curve: str) -> Trace:
        angle, deviation = np.radians(np.array(row["angle_deg"], float)), np.array(row[curve], float) / _UM
        out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return Trace(self.centre + (self.radius + deviation)[:, None] * out, self.centre, self.radius)

    def findings(self, rows: list[Row]) -> list[str]:
        """Return the figures, where the deviation is largest, and what of it the servo makes."""
        traces = self._traces(rows)
        if len(traces) < len(_SENSES):
            failed = next(row for row in rows if row["status"] != OK)
            return [f"The circle run {failed['direction']} has no figures: {failed['status']}"]
        test = CircularTest(traces["clockwise"], traces["counter-clockwise"])
        both = _UM * test.bidirectional_circular_deviation
        mean = _UM * test.mean_bidirectional_radial_deviation
        one, other = (_UM * trace.circular_deviation for trace in traces.values())
        text = (
            f"Radius {self.radius:g} mm at {self.speed:g} mm/s on {self.job.built_machine.name}: circular deviation "
            f"G = {one:.1f} µm clockwise and {other:.1f} µm counter-clockwise, bidirectional G(b) = {both:.1f} µm. The "
            f"paths' mean radius is {abs(mean):.2f} µm too {'large' if mean > 0 else 'small'} (D = {mean:+.2f} µm)."
        )
        return [text, self._largest(traces), self._structure_share(rows, one, other), self._followed()]

    def _largest(self, traces: dict[str, Trace]) -> str:
        found = [(direction, one) for direction, trace in traces.items() for one in trace.reversals(self.reach)]
        direction, spike = max(found, key=lambda item: abs(item[1].spike))
        _, step = max(found, key=lambda item: abs(item[1].step))
        late = ""
        if self._decay > self.reach:
            late = (
                f" At this speed {_DECAY:g} s are {self._decay:.0f} deg, so that a spike is not over where the step is "
                "taken: the two are not clearly told apart."
            )
        return (
            f"The largest spike is {_UM * spike.spike:+.1f} µm, {direction}, {spike.spike_at:.1f} deg after "
            f"{_AXES[spike.axis]} reverses at {spike.angle:g} deg; the largest step is {_UM * step.step:+.1f} µm, at a "
            f"reversal of {_AXES[step.axis]}.{late}"
        )

    def _structure_share(self, rows: list[Row], *nozzle: float) -> str:
        motors = [_UM * minimum_zone(self._trace(row, "motor_deviation_um").points).width for row in rows]
        return (
            f"The motors' own positions have G = {motors[0]:.1f} and {motors[1]:.1f} µm against the nozzle's "
            f"{nozzle[0]:.1f} and {nozzle[1]:.1f} µm; the difference is the structure's behind them."
        )

    def _followed(self) -> str:
        return (
            f"What counts is one full circle at constant speed after {self.lead:g} deg of lead. F is taken from the "
            "nominal circle about the axes' zero, G and G(b) from minimum-zone circles, D from the least-squares "
            "circle of both paths, after public descriptions of ISO 230-4:2005 and 2022; spikes and steps at reversals "
            "are not the standard's (see gantrysim.iso)."
        )

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return the circular-test chart, and the deviation over the angle."""
        traces = self._traces(rows)
        if len(traces) < len(_SENSES):
            return []
        test = CircularTest(traces["clockwise"], traces["counter-clockwise"])
        structure = {
            str(row["direction"]): trace.deviation - np.array(row["motor_deviation_um"], float) / _UM
            for row, trace in zip(rows, traces.values(), strict=True)
        }
        return [
            Plot(
                "chart",
                "Radial deviation, magnified",
                "The nominal circle is the bold ring; outside of it the path is too large. The dashed rings are the "
                "minimum zone of both paths.",
                draw_chart(test),
                tables=[_figures_table(test), _reversals_table(traces, self.reach)],
            ),
            Plot(
                "deviation",
                "Radial deviation over the angle",
                "At 0 and 180 deg x reverses, at 90 and 270 deg y; the marks are the spikes. Below, what of it arises "
                "behind the motors.",
                draw_deviation(traces, structure, self.reach),
            ),
        ]


def circle_row(run: Run, centre: tuple[float, float], radius: float, lead: float, reach: float) -> Row:
    """Return the figures of one circle, and its radial deviation as curves over the angle.

    Args:
        run: of a circle with leads.
        centre: of the nominal circle [mm].
        radius: of the nominal circle [mm].
        lead: angle that is commanded before the circle counts [deg].
        reach: as in `Trace.reversals` [deg].
    """
    commanded = run.commanded_tip[:, :2] - centre
    swept = np.degrees(np.abs(np.unwrap(np.arctan2(commanded[:, 1], commanded[:, 0]))))
    passed = np.abs(swept - swept[0])
    counts = (passed >= lead) & (passed < lead + 360)
    nozzle, motor = (Trace(tip[counts, :2], centre, radius) for tip in (run.nozzle, run.motor_tip))
    row: Row = {
        "circular_deviation_um": _UM * nozzle.circular_deviation,
        "radial_deviation_max_um": _UM * float(nozzle.deviation.max()),
        "radial_deviation_min_um": _UM * float(nozzle.deviation.min()),
    }
    for reversal in nozzle.reversals(reach):
        row |= _reversal_row(reversal)
    # the motors' deviation is told at the nozzle's angle: what they are apart changes it by their distance squared
    curves = {
        "angle_deg": nozzle.angle,
        "radial_deviation_um": _UM * nozzle.deviation,
        "motor_deviation_um": _UM * motor.deviation,
    }
    return row | {name: np.round(curve, 6).tolist() for name, curve in curves.items()}


def _reversal_row(reversal: Reversal) -> Row:
    name = f"reversal_{_AXES[reversal.axis]}_{reversal.angle:.0f}"
    return {
        f"{name}_step_um": _UM * reversal.step,
        f"{name}_spike_um": _UM * reversal.spike,
        f"{name}_spike_at_deg": reversal.spike_at,
    }


def _figures_table(test: CircularTest) -> Table:
    from gantrysim.page import Column, Table

    rows: list[list[Any]] = []
    for name, trace in (("clockwise", test.clockwise), ("counter-clockwise", test.counter_clockwise)):
        deviation = _UM * trace.deviation
        rows.append([name, _UM * trace.circular_deviation, deviation.max(), deviation.min(), None, None])
    both = _UM * test.bidirectional_circular_deviation, _UM * test.mean_bidirectional_radial_deviation
    rows.append(["both", None, None, None, *both])
    heads = ("G [µm]", "Fmax [µm]", "Fmin [µm]", "G(b) [µm]", "D [µm]")
    columns: list[str | Column] = ["path", *(Column(head, ".2f") for head in heads)]
    return Table(columns, rows, caption="Figures in the manner of ISO 230-4.")


def _reversals_table(traces: dict[str, Trace], reach: float) -> Table:
    from gantrysim.page import Column, Table

    found = {name: trace.reversals(reach) for name, trace in traces.items()}
    rows = [
        [
            f"{angle:g} deg",
            _AXES[k % 2],
            *(_UM * value for one in found.values() for value in (one[k].step, one[k].spike)),
        ]
        for k, angle in enumerate((0, 90, 180, 270))
    ]
    columns: list[str | Column] = ["reversal at", "axis"]
    columns += [Column(f"{name}, {what} [µm]", ".2f") for name in found for what in ("step", "spike")]
    return Table(columns, rows, caption="Reversals of the axes; outward is positive.")
