"""What the run of a job shows: its verdict, its duration, and what levers need to know of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gantrysim.base.errors import GantryError
from gantrysim.bead import Bead
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.score import burden_of
from gantrysim.results.checks import FAIL, PASS
from gantrysim.results.verdict import Verdict


@dataclass(frozen=True)
class Outcome:
    """What a run of a job shows.

    Attributes:
        verdict: on the run; None for a job that is refused.
        duration: from the first to the last tick, nan for a job that is refused [s].
        failure: why there is no complete run: a refusal or a fault; empty otherwise.
        links: rms of the error in each link of the chain, by name [mm].
        nominal: section of the requested bead, 0 without one [mm²].
        missing: mean over the starts of the glue missing there, as length of the requested bead [mm].
        excess: mean over the stops of the glue in excess there, likewise [mm].
        dots: volumes of the dots, laid while the nozzle rests [mm³].
    """

    verdict: Verdict | None
    duration: float = math.nan
    failure: str = ""
    links: Mapping[str, float] = field(default_factory=dict)
    nominal: float = 0.0
    missing: float = 0.0
    excess: float = 0.0
    dots: tuple[float, ...] = ()

    @property
    def burden(self) -> float:
        """See `burden_of`; inf without a complete run."""
        return math.inf if self.failure or self.verdict is None else burden_of(self.verdict)

    @property
    def state(self) -> str:
        """The verdict in a word; "fail" for a job that is refused."""
        return FAIL if self.verdict is None else self.verdict.state

    @property
    def passes(self) -> bool:
        """Whether the verdict is a pass."""
        return self.state == PASS


def measured(job: Job) -> Outcome:
    """Simulate a job and return what its run shows; a job that is refused has an outcome too."""
    try:
        run = job.run()
        if run.fault is not None:
            verdict = Verdict.of_fault(run)
            return Outcome(verdict, float(run.time[-1]), verdict.fault)
        analysis = Analysis(run)
        budget = Budget(analysis)
        bead = Bead(run, job.bead, analysis)
        verdict = Verdict.of_results(job, budget, bead)
        is_laid = bead.nominal > 0 and bead.total_volume > 0
        return Outcome(
            verdict,
            float(run.time[-1]),
            links={name: part.rms for name, part in budget.values.parts.items()},
            nominal=max(float(bead.nominal), 0.0),
            missing=float(bead.missing_at_starts.mean()) if is_laid else 0.0,
            excess=float(bead.excess_at_stops.mean()) if is_laid and bead.excess_at_stops.size else 0.0,
            dots=tuple(_dots(bead)),
        )
    except GantryError as error:
        return Outcome(None, failure=str(error))


def _dots(bead: Bead) -> list[float]:
    """Return the volume laid from each dispensing at rest to the next dispensing, or to the end [mm³].

    A nozzle rests that moves by less than half its needle's diameter.
    """
    run = bead.run
    path = np.concatenate([[0.0], np.cumsum(bead.commanded_steps)])
    volume = np.concatenate([[0.0], np.cumsum(run.flow[:-1]) * run.period])
    last = len(run.time) - 1
    begins = bead.stretches[:, 0]
    ends = np.minimum(bead.stretches[:, 1], last)
    following = np.append(begins[1:], last)
    rests = path[ends] - path[begins] < 0.5 * run.face
    return [float(dot) for dot in (volume[following] - volume[begins])[rests]]
