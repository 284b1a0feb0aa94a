"""`gantrysim study repeat`: path accuracy and repeatability in the manner of ISO 9283."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.errors import InputError, at_least, whole
from gantrysim.job.job import Job
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics import RepeatedPath
from gantrysim.metrics.analysis import Analysis
from gantrysim.study.cases import OK, Row
from gantrysim.study.repeat.figures import figures
from gantrysim.study.repeat.findings import findings
from gantrysim.study.repeat.repeats import ALL, PHASES, RepeatCase, has_phase, measure_repeat, places_along
from gantrysim.study.runner import Measure
from gantrysim.study.study import Plot, Rounds

_UM = 1e3
_MOST = 10_000  # repeats


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
        if whole("repeats", self.repeats, 2) > _MOST:
            raise InputError(f"repeats = {self.repeats}: must be at most {_MOST}")
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
    def s(self) -> Floats:
        """Places at which the repeats are looked at, by arc length along the path, (m,) [mm]."""
        return places_along(Analysis(self.job.follow()), self.places)

    @property
    def measure(self) -> Measure:
        """From a case to its row."""
        return partial(measure_repeat, places=tuple(self.s.tolist()))

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """What is varied."""
        sources = ["friction"] if self.friction else []
        sources += ["home offset"] if any(self.counts) else []
        sources += ["phase"] if has_phase(self.job) else []
        return tuple(sources)

    @property
    def counts(self) -> tuple[float, ...]:
        """Encoder counts of the axes, (axes,) [mm or deg]."""
        return self.job.built_servo.resolution

    def rounds(self) -> Rounds:
        """Yield the repeats with all of it varied, and with each source by itself, alike but for the others."""
        generator = np.random.default_rng(self.seed)
        axes = len(self.counts)
        friction = np.exp(self.friction * generator.standard_normal((self.repeats, axes)))
        viscous = np.exp(self.friction * generator.standard_normal((self.repeats, axes)))
        home = generator.uniform(-0.5, 0.5, (self.repeats, axes)) * self.counts
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
        command = self.job.controller.requested.position(self.s)
        found = {}
        for varied in dict.fromkeys(str(row["varied"]) for row in rows):
            offsets = [
                np.stack([np.array(row[f"offset_{name}_um"], float) / _UM for name in "xyz"], axis=1)
                for row in rows
                if row["varied"] == varied and row["status"] == OK
            ]
            if len(offsets) > 1:
                found[varied] = RepeatedPath(self.s, command, command + np.array(offsets))
        return found

    def findings(self, rows: list[Row]) -> list[str]:
        """Return accuracy and repeatability, what the scatter comes from, what was varied and what was followed."""
        return findings(self, rows)

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return accuracy and repeatability along the path, and where on the plan they are."""
        return figures(self, rows)
