"""The tuning study: a search for the gains that minimise a job's error, and a check on machines not used in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from importlib.metadata import version
from typing import Any

from gantrysim.base.errors import InputError, positive, unknown, whole_number
from gantrysim.engine.linear import Engine, difference_note
from gantrysim.engine.positions import axis_positions
from gantrysim.engine.simulate import simulate
from gantrysim.job.job import check_job
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.tolerances import Tolerances
from gantrysim.record.run import Run
from gantrysim.servo.request import DRIVE
from gantrysim.servo.servo import Servo
from gantrysim.study.cases import Case, Row
from gantrysim.study.study import Rounds, Study
from gantrysim.study.tuning.candidates import BATCH, Candidate, SearchLimits
from gantrysim.study.tuning.objective import METRICS, OF_LARGEST, case_of, measure_together, micrometres, trial_result
from gantrysim.study.tuning.search import History, Phase, search
from gantrysim.study.tuning.servo import TUNED, tuned_toml
from gantrysim.study.tuning.space import SPACES, SearchSpace
from gantrysim.study.tuning.stability import Stability, sensitivity_bound
from gantrysim.study.worker import MeasureTogether

_BOUNDS = (
    ("seed", 0, 2**32 - 1),
    ("robust", 0, 64),
    ("guards", 0, 256),
    ("batch", 1, 256),
    ("unseen", 0, math.inf),
    ("budget", 1, math.inf),
)
_UNSEEN_STAGES: dict[Phase, str] = {"start": "unseen, before", "tuned": "unseen, after"}  # values of the column "stage"


@dataclass(frozen=True)
class TuningStudy(Study):
    """Search for the gains that minimise a metric of a job, by simplexes in the manner of Nelder and Mead.

    The metric is the largest over the job's own machine and perturbed ones, drawn from a Latin hypercube. The gains

    - keep the margin on every axis of each of these machines and of the guards, see `gantrysim.study.tuning.stability`;
    - keep the limit of the torque ripple, the largest of all axes relative to the peak torque, on each machine;
    - cause no fault on any of them.

    `gantrysim.study.tuning.search` defines how candidates are compared and which runs are made. The start is a
    candidate too, so the result is never worse. Start and result are then run on machines that the search did not use.

    Attributes:
        job: job to tune; its servo is the start, of which all but the gains is kept.
        law: gains to search, one of `SPACES`; by default pid if the job has an integral term, else pd.
        metric: metric to minimise, one of `METRICS`: rms, p95 or max of the contour error, or of the servo error.
        budget: maximum number of runs of the search.
        robust: number of perturbed machines besides the job's own.
        guards: number of further perturbed machines on which the margin is kept, without runs; none if robust is 0.
        batch: number of points of a simplex moved in parallel; more points use more cores, but need more runs.
        margin: smallest gain margin M, expressed as a bound on |S|: its peak is at most M / (M - 1).
        ripple: largest torque ripple [% of the peak torque]. The derived gains have 0.5 to 1.5 % in the built-in jobs;
            beyond 2 %, slightly higher gains make the torque chatter.
        per_axis: whether the gains of each axis are searched separately.
        spread: tolerances from which the perturbed machines are drawn.
        unseen: number of machines for the final check, whose runs are not part of the budget.
        seed: seed of the random numbers.
        held: gains held at zero, see `SearchSpace`.
        leaders: successive best candidates of the search so far; the first is the start.
    """

    law: str | None = None
    metric: str = "contour_rms"
    budget: int = 300
    robust: int = 4
    guards: int = 28
    batch: int = BATCH
    margin: float = 2.0
    ripple: float = 2.0
    per_axis: bool = False
    spread: Tolerances = field(default_factory=Tolerances)
    unseen: int = 32
    seed: int = 1
    held: tuple[str, ...] = ()
    _runs: dict[Servo, Run] = field(init=False, repr=False, compare=False, default_factory=dict)
    _histories: list[tuple[list[Row], History]] = field(init=False, repr=False, compare=False, default_factory=list)
    leaders: list[Candidate] = field(init=False, repr=False, compare=False, default_factory=list)

    name = "tune"
    command = "tune"
    texts = (TUNED,)
    plots = ("path", "budget", "search", "gains", "loop", "machines")

    def __post_init__(self) -> None:
        check_job(self.job)
        if self.law is not None and self.law not in SPACES:
            raise unknown("law", self.law, SPACES)
        if self.metric not in METRICS:
            raise unknown("metric", self.metric, METRICS)
        for name, least, most in _BOUNDS:
            if whole_number(name, getattr(self, name), least) > most:
                raise InputError(f"{name} = {getattr(self, name)}: must be at most {most}")
        positive("ripple", self.ripple, "%")
        sensitivity_bound(self.margin)
        if (self.robust or self.unseen) and not any(asdict(self.spread).values()):
            raise InputError("spread: must be above 0 for at least one factor, or robust and unseen be 0")
        if self.budget < (least := 2 * (self.robust + 1)):
            raise InputError(f"budget = {self.budget}: must be at least {least}, start and one candidate per machine")

    @property
    def title(self) -> str:
        return f"Tuning of {self.job.name}"

    @property
    def settings(self) -> dict[str, Any]:
        named = ("metric", "budget", "robust", "guards", "batch", "margin", "ripple", "per_axis", "unseen", "seed")
        settings = {"law": self.space.name, **{name: getattr(self, name) for name in named}}
        if self.held:
            settings["held"] = list(self.held)
        return {**settings, "spread": asdict(self.spread)}

    @property
    def expected(self) -> int:
        """Number of runs if the search uses all of its budget."""
        return self.budget + 2 * self.unseen

    @property
    def news(self) -> str:
        """The best metric so far."""
        if not self.leaders:
            return ""
        rank, metric = self.leaders[-1].order(0.01 * self.ripple)
        return f"best {metric:.3g} µm" if rank == 1 else "none feasible yet"

    @property
    def measure_together(self) -> MeasureTogether:
        return partial(measure_together, metric=self.metric)

    @cached_property
    def perturbations(self) -> list[Perturbation | None]:
        """Perturbations of the machines of the search; the first machine is the job's own."""
        return [None, *self._drawn_machines(self.robust, self.seed)]

    @cached_property
    def unseen_perturbations(self) -> list[Perturbation]:
        """Perturbations of the machines of the final check."""
        # with another seed: machines of the search would flatter the gains that were fitted to them
        return self._drawn_machines(self.unseen, self.seed + 1)

    def _perturbed_machines(self, perturbations: Sequence[Perturbation | None]) -> list[Machine]:
        nominal = self.job.built_machine
        return [nominal.perturbed(perturbation) for perturbation in perturbations if perturbation is not None]

    def _drawn_machines(self, count: int, seed: int) -> list[Perturbation]:
        return self.spread.machines(self.job.built_machine, count, seed) if count else []

    @cached_property
    def machines(self) -> list[Machine]:
        """The machines of the search."""
        return [self.job.built_machine, *self._perturbed_machines(self.perturbations[1:])]

    @cached_property
    def guarded(self) -> list[Machine]:
        """The machines on which the margin is kept: the search's, then the guards."""
        # margins cost no runs, so they are kept on many more machines than are simulated
        guards = self._drawn_machines(self.guards if self.robust else 0, self.seed + 2)
        return [*self.machines, *self._perturbed_machines(guards)]

    @cached_property
    def stability(self) -> Stability:
        """Stability margins on the machines of the search and the guards."""
        return self._stability_on(self.guarded)

    @cached_property
    def unseen_stability(self) -> Stability:
        """Stability margins on the machines of the final check."""
        return self._stability_on(self._perturbed_machines(self.unseen_perturbations))

    def _stability_on(self, machines: list[Machine]) -> Stability:
        servo = self.job.built_servo
        servo.check_torque("tuning")
        return Stability(machines, servo.period, servo.delay, self.margin, servo.loop_drives)

    @cached_property
    def space(self) -> SearchSpace:
        """The search space."""
        axes = self.job.built_machine.axes
        start = self.job.built_servo
        law = self.law or ("pid" if any(start.per_axis("ki")) else "pd")
        names = [parameter.name for parameter in DRIVE if parameter.name not in ("torque_limit", "resolution")]
        settings: dict[str, Any] = {name: start.per_axis(name) for name in (*names, "feedback")}
        for name in ("delay", "feedback_delay", "encoder_seed"):
            settings[name] = getattr(start, name)
        start.check_torque("tuning")
        derived = Servo.derive(axes, start.period, mode="torque", **settings)
        return SearchSpace(law, axes, derived, start, self.per_axis, self.held)

    def rounds(self) -> Rounds:
        """Yield the runs of the search, then of the final check.

        Raises:
            InputError: a machine whose margins cannot be computed, or one that refuses the job.
        """
        # one that cannot reach the setpoints is refused before hours of runs
        for machine in self.machines:
            axis_positions(machine, self.job.setpoints)
        measured: list[Row] = []
        history = yield from self._search_rounds(measured)
        self._histories[:] = [(measured, history)]
        if self.unseen:
            yield [
                self._case(_UNSEEN_STAGES[phase], candidate, number, perturbation)
                for phase, candidate in history.phases.items()
                for number, perturbation in enumerate(self.unseen_perturbations, 1)
            ]

    def _search_rounds(self, measured: list[Row]) -> Generator[list[Case], Sequence[Row], History]:
        """Yield the runs of the search and return its history; the rows received are added to those measured."""
        largest = self.metric in OF_LARGEST
        limits = SearchLimits(self.robust + 1, self.budget, 0.01 * self.ripple, self.seed, self.batch, largest)
        trials_of_rounds = search(self.space, self.stability, limits, on_leader=self.leaders.append)
        trials = next(trials_of_rounds)
        while True:
            stage = "search" if trials[0].candidate.round else "start"
            rows = yield [
                self._case(stage, trial.candidate, trial.machine, self.perturbations[trial.machine]) for trial in trials
            ]
            measured += rows
            try:
                trials = trials_of_rounds.send([trial_result(row, self.metric) for row in rows])
            except StopIteration as stop:
                return stop.value

    def _case(self, stage: str, candidate: Candidate, machine: int, perturbation: Perturbation | None) -> Case:
        """Return the case of a candidate on a machine; its number is 0 for the job's own."""
        return case_of(
            self.job,
            candidate.servo,
            perturbation,
            stage=stage,
            round=candidate.round,
            candidate=candidate.number,
            machine=machine,
        )

    def history(self, rows: Sequence[Row]) -> History:
        """Return the history of the search of this study, or of one replayed from the rows of a study."""
        if not self._histories or rows[: len(self._histories[-1][0])] != self._histories[-1][0]:
            # the search depends on seed and rows alone: what the ledger holds is enough to repeat it without a run
            remaining = iter(rows)
            history = self.history_of(lambda cases: [next(remaining) for _ in cases])
            self._histories[:] = [(list(rows[: history.runs]), history)]
        return self._histories[-1][1]

    def history_of(self, measure: Callable[[list[Case]], list[Row]]) -> History:
        """Return the history of a search whose cases are measured by a function."""
        cases_of_rounds = self._search_rounds([])
        cases = next(cases_of_rounds)
        while True:
            try:
                cases = cases_of_rounds.send(measure(cases))
            except StopIteration as stop:
                return stop.value

    def unseen_rows(self, rows: Sequence[Row], phase: Phase) -> list[Row]:
        """Return the rows of the final check, with the gains of the start or the tuned gains."""
        return [row for row in rows if row["stage"] == _UNSEEN_STAGES[phase]]

    def run(self, servo: Servo) -> Run:
        """Return the record of the job on its own machine with a servo."""
        if servo not in self._runs:
            self._runs[servo] = self._simulated_run(servo, self.job.simulation.engine or "mujoco")
        return self._runs[servo]

    def difference_note(self, servo: Servo) -> str:
        """Return a sentence on how far that record is from the search's, empty where they agree."""
        return difference_note(self.run(servo), self._simulated_run(servo, self.job.engine_of_searches))

    def _simulated_run(self, servo: Servo, engine: Engine) -> Run:
        job = self.job
        return simulate(
            job.built_machine,
            servo,
            job.setpoints,
            physics_step=job.simulation.physics_step,
            dispenser=job.dispenser,
            faults=job.faults,
            engine=engine,
        )

    def text(self, _name: str, rows: Sequence[Row]) -> str:
        """Return the tuned gains as TOML."""
        history = self.history(rows)
        job = self.job
        start = history.start
        best = history.best
        worst = f", the worst of {self.robust + 1} machines" if self.robust else ""
        comments = [
            f"Job {job.name} on machine {job.built_machine.name}: law {self.space.name}, tuned by gantrysim "
            f"{version('gantrysim')}.",
            f"{self.metric}: {micrometres(start.metric)} at the start, {micrometres(best.metric)} tuned{worst}.",
            f"Gain margin at least {self.margin:g} in every direction, torque ripple at most {self.ripple:g} % of the "
            "peak torque.",
            f"Candidate {best.number} of round {best.round}; {history.runs} runs, seed {self.seed}.",
            f"Usage: gantrysim run job.toml --servo {TUNED}, the job.toml beside it.",
        ]
        return tuned_toml(job, best.servo, self.space.gains, comments)
