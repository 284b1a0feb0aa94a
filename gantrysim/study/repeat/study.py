"""The repeat study: path accuracy and repeatability after ISO 9283."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, at_least, whole
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics import Positioning, RepeatedPath
from gantrysim.metrics.analysis import Analysis
from gantrysim.study.cases import OK, Row
from gantrysim.study.repeat.positioning import CYCLES, linear_axes, positioning
from gantrysim.study.repeat.repeats import ALL, PHASES, RepeatCase, has_phase, measure_repeat, places_along
from gantrysim.study.runner import Measure
from gantrysim.study.study import Rounds, Study

_UM = 1e3
_MOST = 10_000  # repeats
_WIDEST = 1.0  # standard deviation of the logarithm of a friction factor


@dataclass(frozen=True)
class RepeatStudy(Study):
    """Repeats of a job with realistic variation: their systematic error and their scatter.

    Varied from repeat to repeat, all together and each alone:

    - friction: Coulomb and viscous friction of each axis, by a log-normal factor (temperature, grease, load)
    - home offset: the zero of each axis, evenly within one count of its encoder (homing on a count)
    - phase: start of the program between two servo ticks, where the controller allows it

    Args:
        job: to repeat.
        repeats: number n of cycles; ISO 9283 has 10.
        friction: standard deviation of the logarithm of the friction factor.
        places: maximum number m of places along the path.
        seed: of the random numbers.
    """

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
        at_least("friction", self.friction, 0, most=_WIDEST)  # factors beyond e to the fourth are no friction

    @cached_property
    def s(self) -> Floats:
        """Places at which the repeats are compared, by arc length along the path, (m,) [mm]."""
        return places_along(Analysis(self.job.follow()), self.places)

    @property
    def measure(self) -> Measure:
        """From a case to its row."""
        return partial(measure_repeat, places=tuple(self.s.tolist()))

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """Names of the varied sources."""
        sources = ["friction"] if self.friction else []
        sources += ["home offset"] if any(self.counts) else []
        sources += ["phase"] if has_phase(self.job) else []
        return tuple(sources)

    @property
    def counts(self) -> tuple[float, ...]:
        """Encoder counts of the axes, (axes,) [mm or deg]."""
        return self.job.built_servo.per_axis("resolution")

    def rounds(self) -> Rounds:
        """Yield the repeats with all sources varied, and with each source alone, by the same random numbers."""
        generator = np.random.default_rng(self.seed)
        axes = len(self.counts)
        friction = np.exp(self.friction * generator.standard_normal((self.repeats, axes)))
        viscous = np.exp(self.friction * generator.standard_normal((self.repeats, axes)))
        home = generator.uniform(-0.5, 0.5, (self.repeats, axes)) * self.counts
        phase = generator.integers(0, PHASES, self.repeats)
        cases = []
        alone = self.sources if len(self.sources) > 1 else ()  # a single source is all that varies
        for varied in (ALL, *alone):
            for k in range(self.repeats):
                perturbation = Perturbation()
                if self.friction and varied in (ALL, "friction"):
                    perturbation = replace(perturbation, friction=tuple(friction[k]), viscous=tuple(viscous[k]))
                if varied in (ALL, "home offset"):
                    perturbation = replace(perturbation, home_offset=tuple(home[k]))
                case = RepeatCase.of(self.job, perturbation=perturbation, varied=varied, repeat=k + 1)
                if has_phase(self.job) and varied in (ALL, "phase"):
                    case = replace(case, phase=int(phase[k]))
                cases.append(case)
        yield cases

    @cached_property
    def positioning(self) -> dict[str, Positioning]:
        """The positioning of each linear axis over some cycles, on a machine with errors of its geometry, by name.

        Friction and home offset vary from cycle to cycle as they do from repeat to repeat.
        """
        if self.job.built_machine.geometry is None:
            return {}
        cases = [case for case in next(iter(self.rounds())) if ("varied", ALL) in case.tags]
        varied = [case.perturbation or Perturbation() for case in cases[:CYCLES]]
        return {name: positioning(self.job, name, varied) for name in linear_axes(self.job)}

    def paths(self, rows: Sequence[Row]) -> dict[str, RepeatedPath]:
        """Return the repeated paths by varied source, if at least two repeats have values."""
        command = self.job.controller.requested.position(self.s)
        paths = {}
        for varied in dict.fromkeys(str(row["varied"]) for row in rows):
            offsets = [_offset(row) for row in rows if row["varied"] == varied and row["status"] == OK]
            if len(offsets) > 1:
                paths[varied] = RepeatedPath(self.s, command, command + np.array(offsets))
        return paths


def _offset(row: Row) -> Floats:
    """Return the offset of the nozzle from the path at the places of a row, (m, 3) [mm]."""
    return np.stack([np.array(row[f"offset_{name}_um"], float) / _UM for name in "xyz"], axis=1)
