"""`gantrysim study repeat`: path accuracy and repeatability in the manner of ISO 9283."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.controllers.path import Floats
from gantrysim.controllers.setpoints import Setpoints
from gantrysim.engine import simulate
from gantrysim.errors import at_least, whole
from gantrysim.iso import RepeatedPath, interpolated, offset_over_length
from gantrysim.job import Job
from gantrysim.metrics import Analysis
from gantrysim.perturbation import Perturbation
from gantrysim.run import Run
from gantrysim.study.cases import OK, Case, Row, judged
from gantrysim.study.repeat_figures import draw_along, draw_plan
from gantrysim.study.runner import Measure
from gantrysim.study.study import Plot, Rounds

if TYPE_CHECKING:
    from gantrysim.page import Table

__all__ = ["PHASES", "RepeatCase", "RepeatStudy", "has_phase", "measure_repeat", "phased_setpoints", "places_along"]

PHASES = 8  # of a servo period, at which a program may start
ALL = "all"
_UM = 1e3


@dataclass(frozen=True)
class RepeatCase(Case):
    """A case whose program starts between two servo ticks.

    Attributes:
        phase: by how many `PHASES` of a servo period before a tick.
    """

    phase: int = 0

    @property
    def key(self) -> str:
        """As of any case, and of the phase."""
        return f"{super().key}-{self.phase}"


def has_phase(job: Job) -> bool:
    """Return whether a job's program may start anywhere between two servo ticks: a Trio program not bound to them."""
    return job.program["controller"] == "trio.MoveSpiral" and not job.program["servo_period"]


def phased_setpoints(job: Job, phase: int) -> Setpoints:
    """Return a job's setpoints where its program starts before a servo tick: those of a finer period, every so many.

    Args:
        job: whose program is bound to no tick.
        phase: by how many `PHASES` of a servo period it starts before the tick.
    """
    if not phase:
        return job.setpoints
    period = job.built_servo.period
    fine = job.controller.setpoints(period / PHASES)
    last = len(fine.position) - 1
    sent = np.concatenate([[0], np.arange(phase, last, PHASES), [last]])
    coarse = replace(fine, period=period, position=fine.position[sent], dispense=fine.dispense[sent])
    return job.dispenser.held_back(coarse).hold(job.simulation.settle)


def places_along(analysis: Analysis, count: int) -> Floats:
    """Return places along the requested path where glue is laid, evenly over it, at most `count` [mm]."""
    s, first = analysis.commanded.s, np.diff(analysis.ticks, prepend=analysis.ticks[0] - 2) > 1
    step = float(np.abs(np.diff(s))[~first[1:]].max(initial=0.0))
    even = np.linspace(s.min(), s.max(), count)
    ascending = np.sort(s)
    after = np.clip(np.searchsorted(ascending, even), 1, s.size - 1)
    distance = np.minimum(np.abs(even - ascending[after - 1]), np.abs(even - ascending[after]))
    places: Floats = even[distance <= step]
    return places


def measure_repeat(case: Case, places: Sequence[float]) -> Row:
    """Run a repeat and return how far the nozzle is from the path at some places, as curves.

    Args:
        case: a `RepeatCase`.
        places: on the requested path by arc length [mm].
    """
    return judged(partial(_repeated, case), partial(_row, places=places))


def _repeated(case: Case) -> Run:
    job, phase = case.job(), getattr(case, "phase", 0)
    machine = job.built_machine
    return simulate(
        machine if case.perturbation is None else machine.perturbed(case.perturbation),
        job.built_servo,
        phased_setpoints(job, phase),
        physics_step=job.simulation.physics_step,
        dispenser=job.dispenser,
    )


def _row(run: Run, places: Sequence[float]) -> Row:
    s, offset = offset_over_length(run.requested, run.nozzle[run.dispense])
    at = interpolated(np.array(places), s, offset)
    row: Row = {"contour_max_um": _UM * float(np.linalg.norm(at, axis=1).max()), "s_mm": list(places)}
    return row | {f"offset_{name}_um": np.round(_UM * at[:, i], 6).tolist() for i, name in enumerate("xyz")}


@dataclass(frozen=True)
class RepeatStudy:
    """Repeats of a job that differ as real repeats do, and what they have in common and what not.

    From one repeat to the next differ, and are also varied by themselves:

    - friction: Coulomb and viscous friction of each axis, by a log-normal factor (temperature, grease, load)
    - home offset: the zero of each axis, evenly within one count of its encoder (homing on a count)
    - phase: where between two servo ticks the program starts, where the controller has no such bond

    Args:
        job: to be repeated.
        repeats: number n of cycles; ISO 9283 has 10.
        friction: standard deviation of the logarithm of the factor of friction.
        places: number m of places along the path, at most.
        seed: of the random numbers.
    """

    job: Job
    repeats: int = 10
    friction: float = 0.03
    places: int = 400
    seed: int = 1

    name = "repeat"
    plots = ("along", "plan")

    def __post_init__(self) -> None:
        whole("repeats", self.repeats, 2)
        whole("places", self.places, 2)
        whole("seed", self.seed, 0)
        at_least("friction", self.friction, 0)

    @property
    def title(self) -> str:
        """Heads the report."""
        return f"How alike are {self.repeats} repeats of {self.job.name}?"

    @property
    def settings(self) -> dict[str, Any]:
        """What the study does with the job."""
        return {"repeats": self.repeats, "friction": self.friction, "places": self.places, "seed": self.seed}

    @cached_property
    def _places(self) -> Floats:
        return places_along(Analysis(self.job.follow()), self.places)

    @property
    def measure(self) -> Measure:
        """From a case to its row."""
        return partial(measure_repeat, places=tuple(self._places.tolist()))

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """What is varied."""
        sources = ["friction"] if self.friction else []
        sources += ["home offset"] if any(self._counts) else []
        sources += ["phase"] if has_phase(self.job) else []
        return tuple(sources)

    @property
    def _counts(self) -> tuple[float, ...]:
        return self.job.built_servo.resolution

    def rounds(self) -> Rounds:
        """Yield the repeats with all of it varied, and with each source by itself, alike but for the others."""
        generator = np.random.default_rng(self.seed)
        axes = len(self._counts)
        friction = np.exp(self.friction * generator.standard_normal((self.repeats, axes)))
        viscous = np.exp(self.friction * generator.standard_normal((self.repeats, axes)))
        home = generator.uniform(-0.5, 0.5, (self.repeats, axes)) * self._counts
        phase = generator.integers(0, PHASES, self.repeats)
        cases = []
        for varied in (ALL, *self.sources) if len(self.sources) > 1 else (ALL,):
            for k in range(self.repeats):
                perturbation = Perturbation()
                if self.friction and varied in (ALL, "friction"):
                    perturbation = replace(perturbation, friction=tuple(friction[k]), viscous=tuple(viscous[k]))
                if varied in (ALL, "home offset"):
                    perturbation = replace(perturbation, home_offset=tuple(home[k]))
                case = RepeatCase.of(self.job, perturbation=perturbation, varied=varied, repeat=k + 1)
                if has_phase(self.job) and varied in (ALL, "phase"):
                    assert isinstance(case, RepeatCase)
                    case = replace(case, phase=int(phase[k]))
                cases.append(case)
        yield cases

    def paths(self, rows: list[Row]) -> dict[str, RepeatedPath]:
        """Return the repeated paths by what was varied, those of which two repeats at least have figures."""
        command = self.job.controller.requested.position(self._places)
        found = {}
        for varied in dict.fromkeys(str(row["varied"]) for row in rows):
            offsets = [
                np.stack([np.array(row[f"offset_{name}_um"], float) / _UM for name in "xyz"], axis=1)
                for row in rows
                if row["varied"] == varied and row["status"] == OK
            ]
            if len(offsets) > 1:
                found[varied] = RepeatedPath(self._places, command, command + np.array(offsets))
        return found

    def findings(self, rows: list[Row]) -> list[str]:
        """Return accuracy and repeatability, what the scatter comes from, what was varied and what was followed."""
        paths = self.paths(rows)
        if ALL not in paths:
            return [f"Fewer than two of {self.repeats} repeats have figures: {rows[0]['status']}"]
        path = paths[ALL]
        accuracy, repeatability = _UM * path.path_accuracy, _UM * path.path_repeatability
        text = (
            f"Over {len(path.attained)} repeats of {self.job.name} the path accuracy is ATp = {accuracy:.2f} µm, at "
            f"s = {path.s[path.accuracy.argmax()]:.1f} mm, and the path repeatability RTp = {repeatability:.2f} µm, at "
            f"s = {path.s[path.repeatability.argmax()]:.1f} mm; at half of the places they are at most "
            f"{_UM * np.median(path.accuracy):.2f} and {_UM * np.median(path.repeatability):.2f} µm."
        )
        if repeatability > 0:
            text += (
                f" What the repeats have in common, at its largest, is {accuracy / repeatability:.3g} times the "
                "largest scatter: it is the part that a correction of the program could take away."
            )
        paragraphs = [text]
        alone = {varied: _UM * one.path_repeatability for varied, one in paths.items() if varied != ALL}
        if alone:
            order = sorted(alone, key=lambda varied: -alone[varied])
            several = ", ".join(f"{varied} {alone[varied]:.2f} µm" for varied in order)
            paragraphs.append(f"Varied alone, RTp comes to: {several}.")
        return [*paragraphs, self._varied(), self._followed(rows)]

    def _varied(self) -> str:
        parts = []
        if "friction" in self.sources:
            parts.append(
                f"friction and viscous friction of each axis by {100 * self.friction:g} % (standard deviation)"
            )
        if "home offset" in self.sources:
            told = ", ".join(
                f"{name} {1e3 * count:g} {'µm' if unit == 'mm' else 'mdeg'}"
                for name, count, unit in self._axes
                if count
            )
            parts.append(f"the axes' zeros evenly within one encoder count ({told})")
        if "phase" in self.sources:
            parts.append(f"the program's start in eighths of the servo period of {self.job.built_servo.period:g} s")
        said = "; ".join(parts) or "nothing"
        bound = "" if has_phase(self.job) else " The program starts on a servo tick, so there is no phase to vary."
        return f"Varied from repeat to repeat: {said}, with the seed {self.seed}.{bound}"

    @property
    def _axes(self) -> list[tuple[str, float, str]]:
        axes = self.job.built_machine.axes
        return [(axis.name, count, axis.unit) for axis, count in zip(axes, self._counts, strict=True)]

    def _followed(self, rows: list[Row]) -> str:
        lost = sum(row["status"] != OK for row in rows)
        left = f" {lost} runs did not finish and are left out." if lost else ""
        return (
            f"ATp and RTp are formed after public descriptions of ISO 9283:1998 at {self._places.size} places along "
            "the path where glue is laid, in planes square to it; load, speed and path are the job's, not the "
            f"standard's (see gantrysim.iso).{left}"
        )

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return accuracy and repeatability along the path, and where on the plan they are."""
        paths = self.paths(rows)
        if ALL not in paths:
            return []
        return [
            Plot(
                "along",
                "Along the path",
                "Above, how far the mean of the repeats is from the requested path, with the circle of repeatability "
                "as a band about it. Below, the repeatability, and what it is where one source is varied alone.",
                draw_along(paths, ALL),
                tables=[_table(paths)],
            ),
            Plot(
                "plan",
                "On the plan",
                "The path coloured by the repeatability.",
                draw_plan(paths[ALL]),
            ),
        ]


def _table(paths: dict[str, RepeatedPath]) -> Table:
    from gantrysim.page import Column, Table

    columns: list[str | Column] = ["varied", "repeats"]
    columns += [Column(head, ".2f") for head in ("ATp [µm]", "median [µm]", "RTp [µm]", "median RT [µm]")]
    rows = [
        [
            varied,
            len(path.attained),
            *(_UM * value for value in (path.path_accuracy, float(np.median(path.accuracy)))),
            *(_UM * value for value in (path.path_repeatability, float(np.median(path.repeatability)))),
        ]
        for varied, path in paths.items()
    ]
    return Table(columns, rows, caption="Figures in the manner of ISO 9283.")
