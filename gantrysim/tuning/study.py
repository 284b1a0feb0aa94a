"""`gantrysim tune`: the gains with which a job's error is smallest."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from typing import Any

from gantrysim.controllers.servo import Servo
from gantrysim.engine.simulate import simulate
from gantrysim.engine.simulation import axis_positions
from gantrysim.errors import InputError, finite, positive, unknown, whole
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.tolerances import Tolerances
from gantrysim.run import Run
from gantrysim.study.cases import Case, Row, Value
from gantrysim.study.study import Plot, Report, Rounds, Study
from gantrysim.study.worker import MeasureTogether
from gantrysim.tuning.figures import figures
from gantrysim.tuning.findings import findings
from gantrysim.tuning.laws import LAWS, Space
from gantrysim.tuning.objective import FIGURES, case_of, measure_together, measured
from gantrysim.tuning.search import Candidate, History, Search, Trial, least_budget, search
from gantrysim.tuning.servo import TUNED, servo_toml
from gantrysim.tuning.stability import Stability

_MOST_MACHINES = 64  # that a candidate is run on
_MOST_SEED = 2**32 - 1


@dataclass(frozen=True)
class TuningStudy(Study):
    """The gains of a law with which the figure of a job is smallest, found by CMA-ES.

    The figure is the largest over the job's own machine and some that differ from it, drawn from a Latin hypercube. Of
    all gains those are looked for that

    - keep the margin on every axis of each of these machines, see `gantrysim.tuning.stability`;
    - keep the torque ripple on each of them, the largest of all axes, as a share of the peak torque;
    - end in no fault on any.

    `gantrysim.tuning.search` says how candidates are compared, and what of them is run. The start is a candidate too,
    so the answer is never worse than it. In the end start and answer are run on machines that the search has not seen.

    Attributes:
        job: whose servo is the start; it keeps all but its gains.
        law: which gains are moved, one of `LAWS`; by default pid where the job has an integral term, else pd.
        figure: one of `FIGURES`: rms, p95 or max of the contour error, or of the tracking part of the error budget.
        budget: most runs of the search.
        robust: number of machines besides the job's own.
        margin: gain margin, in every direction.
        ripple: most torque ripple [% of the peak torque]. The derived gains have 0.5 to 1.5 % in the jobs that come
            along, where beyond 2 % a little more gain makes the torque chatter.
        per_axis: whether every axis has numbers of its own, or all share them.
        spread: how far machines differ.
        unseen: number of machines for the check in the end, which are not in the budget.
        seed: of the random numbers.
    """

    job: Job
    law: str | None = None
    figure: str = "contour_rms"
    budget: int = 300
    robust: int = 4
    margin: float = 2.0
    ripple: float = 2.0
    per_axis: bool = False
    spread: Tolerances = field(default_factory=Tolerances)
    unseen: int = 32
    seed: int = 1

    name = "tune"
    command = "tune"
    texts = (TUNED,)
    plots = ("budget", "path", "search", "gains", "loop", "machines")

    def __post_init__(self) -> None:
        if self.law is not None and self.law not in LAWS:
            raise unknown("law", self.law, LAWS)
        if self.figure not in FIGURES:
            raise unknown("figure", self.figure, FIGURES)
        for name, least in (("seed", 0), ("robust", 0), ("unseen", 0), ("budget", 1)):
            whole(name, getattr(self, name), least)
        for name, most in (("seed", _MOST_SEED), ("robust", _MOST_MACHINES)):
            if getattr(self, name) > most:
                raise InputError(f"{name} = {getattr(self, name)}: must be at most {most}")
        positive("ripple", self.ripple, "%")
        if not finite("margin", self.margin) > 1:
            raise InputError(f"margin = {self.margin:g}: must be greater than 1, the factor at which a loop is lost")
        if (self.robust or self.unseen) and not any(asdict(self.spread).values()):
            raise InputError("spread: must be above 0 for at least one factor, or robust and unseen be 0")
        if self.budget < (least := least_budget(self.robust + 1)):
            raise InputError(
                f"budget = {self.budget}: must be at least {least}, the start and one candidate on "
                f"{_machines(self.robust + 1)} each"
            )

    @property
    def title(self) -> str:
        """Heads the report."""
        return f"Tuning of {self.job.name}"

    @property
    def settings(self) -> dict[str, Any]:
        """What the search does with the job."""
        named = ("figure", "budget", "robust", "margin", "ripple", "per_axis", "unseen", "seed")
        own = {name: getattr(self, name) for name in named}
        return {"law": self.searched_law, **own, "spread": asdict(self.spread)}

    @cached_property
    def searched_law(self) -> str:
        """The law that is searched."""
        return self.law or ("pid" if any(self.job.built_servo.ki) else "pd")

    @property
    def expected(self) -> int:
        """Number of runs if the search uses all of its budget."""
        return self.budget + 2 * self.unseen

    @property
    def news(self) -> str:
        """The best figure so far."""
        return self._news[-1] if self._news else ""

    @property
    def measure_together(self) -> MeasureTogether:
        """From cases to their rows."""
        return partial(measure_together, figure=self.figure)

    @cached_property
    def perturbations(self) -> list[Perturbation | None]:
        """Of the machines that the search runs candidates on; the first is the job's own."""
        others = self.spread.machines(self.job.built_machine, self.robust, self.seed) if self.robust else []
        return [None, *others]

    @cached_property
    def unseen_perturbations(self) -> list[Perturbation]:
        """Of the machines that the search does not see."""
        if not self.unseen:
            return []
        return self.spread.machines(self.job.built_machine, self.unseen, self.seed + 1)

    @cached_property
    def _machines(self) -> list[Machine]:
        return self._built(self.perturbations)

    def _built(self, perturbations: Sequence[Perturbation | None]) -> list[Machine]:
        machine = self.job.built_machine
        return [machine if one is None else machine.perturbed(one) for one in perturbations]

    @cached_property
    def stability(self) -> Stability:
        """The margins on the machines of the search."""
        return self._stability_on(self._machines)

    @cached_property
    def unseen_stability(self) -> Stability | None:
        """The margins on the machines that the search has not seen."""
        return self._stability_on(self._built(self.unseen_perturbations)) if self.unseen else None

    def _stability_on(self, machines: list[Machine]) -> Stability:
        servo = self.job.built_servo
        return Stability(machines, servo.period, servo.delay, self.margin, self.job.simulation.physics_step)

    @cached_property
    def space(self) -> Space:
        """The space of the search."""
        axes, start = self.job.built_machine.axes, self.job.built_servo
        derived = Servo.derive(axes, start.period, delay=start.delay)
        return Space(self.searched_law, axes, derived, start, self.per_axis)

    def search(self) -> Search:
        """Return the search, begun anew."""
        return search(
            self.space,
            self.stability,
            machines=self.robust + 1,
            budget=self.budget,
            ripple=0.01 * self.ripple,
            seed=self.seed,
            leads=self._tell,
        )

    def rounds(self) -> Rounds:
        """Yield the runs that the search asks for, and in the end those on machines that it has not seen.

        Raises:
            InputError: a machine whose margins cannot be told, or one that refuses the job.
        """
        for machine in self._machines:
            axis_positions(machine, self.job.setpoints)
        history = yield from self._searched()
        yield from self._checked(history)

    def _searched(self) -> Generator[list[Case], list[Row], History]:
        own = self.search()
        trials = next(own)
        while True:
            rows = (yield [self._case(trial) for trial in trials]) if trials else []
            try:
                trials = own.send([measured(row, self.figure) for row in rows])
            except StopIteration as stop:
                return stop.value

    def _checked(self, history: History) -> Generator[list[Case], list[Row], None]:
        if self.unseen:
            yield [
                case_of(self.job, candidate.servo, one, **self._tags(stage, candidate, number))
                for stage, candidate in (("unseen, before", history.start), ("unseen, after", history.best))
                for number, one in enumerate(self.unseen_perturbations, 1)
            ]

    def _case(self, trial: Trial) -> Case:
        stage = "search" if trial.candidate.generation else "start"
        perturbation = self.perturbations[trial.machine]
        return case_of(
            self.job, trial.candidate.servo, perturbation, **self._tags(stage, trial.candidate, trial.machine)
        )

    @staticmethod
    def _tags(stage: str, candidate: Candidate, machine: int) -> dict[str, Value]:
        """Columns that say what a run is to the search; machine 0 is the job's own."""
        return {
            "stage": stage,
            "generation": candidate.generation,
            "candidate": candidate.number,
            "machine": machine,
        }

    def history(self, rows: list[Row]) -> History:
        """Return what the search has done, from the rows of the study."""
        if not self._histories or self._histories[-1][0] is not rows:
            self._histories[:] = [(rows, self._replayed(rows))]
        return self._histories[-1][1]

    def _replayed(self, rows: list[Row]) -> History:
        own, left = self._searched(), iter(rows)
        cases = next(own)
        while True:
            try:
                cases = own.send([next(left) for _ in cases])
            except StopIteration as stop:
                return stop.value

    def checked(self, rows: list[Row], stage: str) -> list[Row]:
        """Return the rows of the machines that the search has not seen, of the stage before or after."""
        return [row for row in rows if row["stage"] == f"unseen, {stage}"]

    def run(self, servo: Servo) -> Run:
        """Return the record of the job on its own machine with a servo."""
        if servo not in self._runs:
            job = self.job
            self._runs[servo] = simulate(
                job.built_machine,
                servo,
                job.setpoints,
                physics_step=job.simulation.physics_step,
                dispenser=job.dispenser,
            )
        return self._runs[servo]

    def report(self, rows: list[Row]) -> Report:
        """Return headline, notes and plots."""
        headline, *notes = self.findings(rows)
        return Report(headline, notes=notes, plots=self.figures(rows))

    def findings(self, rows: list[Row]) -> list[str]:
        """Return what has become better and what has not, the gains, and how they do on machines not seen."""
        return findings(self, rows)

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return the plots: before and after, the search, the gains and their loops, machines not seen."""
        return figures(self, rows)

    def text(self, _name: str, rows: list[Row]) -> str:
        """Return the servo that was found, as TOML."""
        return servo_toml(self, self.history(rows))

    @cached_property
    def _runs(self) -> dict[Servo, Run]:
        return {}

    @cached_property
    def _histories(self) -> list[tuple[list[Row], History]]:
        return []

    @cached_property
    def _news(self) -> list[str]:
        return []

    def _tell(self, candidate: Candidate) -> None:
        rank, figure = candidate.order(0.01 * self.ripple)
        self._news.append(f"best {figure:.3g} µm" if rank == 1 else "none good yet")


def _machines(number: int) -> str:
    return "one machine" if number == 1 else f"{number} machines"
