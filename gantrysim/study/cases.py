"""A case, one run of a study, and the row of values kept of it: the figures of a run."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import metadata
from typing import Any, Literal, Self

from gantrysim.base.errors import InputError, check_type
from gantrysim.base.quantity import MEAN, Quantity, contents
from gantrysim.glue.bead import Bead, BeadSettings
from gantrysim.glue.bead.values import VOLUME_ERROR_PERCENT, WIDTH
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.budget import Budget
from gantrysim.metrics.error_quantities import ERRORS, MOTION, of_axes
from gantrysim.record.run import Run, check_run
from gantrysim.results.checks import Check
from gantrysim.results.checks import Row as Aspect
from gantrysim.results.verdict import GLUE, MACHINE, PATH, STABILITY, Verdict

# The verdict on a run as columns of a study's row.

ASPECTS = (PATH, GLUE, STABILITY, MACHINE)  # rows of a verdict, in its order

# of the worst check of an aspect
LIMIT_USE = Quantity[Any](
    "limit_use",
    label="largest use of a limit",
    unit="%",
    form=".1f",
    meaning="Worst value of the verdict over its limit, or the limit over it where it must be at least that; above "
    "100 % the run fails",
    path=(),
    factor=100.0,
)

Columns = dict[str, str | float | None]


def state_column(aspect: str) -> str:
    """Return the name of the column with the state of an aspect: "pass", "warn", "fail" or "not judged"."""
    return f"{aspect}_verdict"


def check_column(aspect: str) -> str:
    """Return the name of the column with the worst check of an aspect in words."""
    return f"{aspect}_check"


def use_column(aspect: str) -> str:
    """Return the name of the column with the largest use of a limit of an aspect [%]."""
    return f"{aspect}_{LIMIT_USE.key}"


def verdict_columns(verdict: Verdict) -> Columns:
    """Return the verdict on a complete run: for each aspect its state, the use of its limit, and its worst check.

    The use is None where nothing is judged, and where a limit of zero is exceeded.
    """
    columns: Columns = {}
    for aspect in verdict.rows:
        worst = _worst(aspect)
        columns[state_column(aspect.name)] = aspect.state
        columns[use_column(aspect.name)] = None if worst is None else LIMIT_USE.content(worst.usage)
        columns[check_column(aspect.name)] = aspect.remark if worst is None else worst.brief
    return columns


def _worst(aspect: Aspect) -> Check | None:
    """Return the judged check with the largest use of its limit; None where nothing is judged."""
    judged = [check for check in aspect.checks if not math.isnan(check.usage)]
    return max(judged, key=lambda check: check.usage, default=None)


Value = str | float | int | bool | list[float] | None  # a list is a curve and goes into curves.csv
Row = dict[str, Value]
Mode = Literal["simulated", "perfect follower"]

OK = "ok"
version = cache(metadata.version)  # which reads a file at every call
_FAULT = "fault: "
_REFUSED_PREFIX = "refused: "


class _LastJob:
    """The content of the job that was asked for last, as values and as TOML: a study's cases are mostly of one job."""

    def __init__(self) -> None:
        self._last: tuple[Job, dict[str, Any], str] | None = None

    def contents(self, job: Job) -> tuple[dict[str, Any], str]:
        """Return the values, which are not to be changed, and the text, one object for all cases of the job."""
        # once, as another thread may replace it
        last = self._last
        if last is None or last[0] is not job:
            last = job, job.model_dump(exclude_none=True), job.toml()
            self._last = last
        return last[1], last[2]

    def forget(self) -> None:
        """Let go of the job."""
        self._last = None


_LAST_JOB = _LastJob()


@dataclass(frozen=True)
class Case:
    """One run of a study: a job, its overrides, and the machine or its substitute.

    It is hashable and can be sent to another process or computer. Nothing is built before the case is measured, so a
    job that is refused can be a case.

    Attributes:
        content: the study's job as TOML.
        overrides: changed values, as (dotted key, JSON of the value), sorted. A value that the job has already is left
            out, so that cases with the same result have the same key.
        mode: "simulated", or "perfect follower" for a machine that is always at its commanded position.
        perturbation: of the machine, or None; the servo keeps the gains of the nominal machine.
        tags: columns of the row that identify the case, as (name, value).
    """

    content: str
    overrides: tuple[tuple[str, str], ...] = ()
    mode: Mode = "simulated"
    perturbation: Perturbation | None = None
    tags: tuple[tuple[str, Value], ...] = ()

    @classmethod
    def of(
        cls,
        job: Job,
        overrides: Mapping[str, Any] | None = None,
        mode: Mode = "simulated",
        perturbation: Perturbation | None = None,
        **tags: Value,
    ) -> Self:
        """Return a case; overrides by full dotted key, as in {"program.loop_period": 0.01}, None for the default."""
        job.check_code()
        content, text = _LAST_JOB.contents(job)
        # a value that the job has already changes nothing: left out, so that equal cases have one key
        changes = {key: value for key, value in (overrides or {}).items() if not _has(content, key, value)}
        changed = tuple(sorted((key, json.dumps(value)) for key, value in changes.items()))
        return cls(text, changed, mode, perturbation, tuple(tags.items()))

    @property
    def key(self) -> str:
        """Identity of the case without its tags: a SHA-256 in hexadecimal."""
        # the version too: another one computes other numbers
        content = (version("gantrysim"), self.content, self.overrides, self.mode, repr(self.perturbation))
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    @property
    def settings(self) -> dict[str, Any]:
        """The overrides as values."""
        return {key: json.loads(value) for key, value in self.overrides}

    @property
    def machine(self) -> str:
        """Name or file of the machine, as in a job."""
        return str(self.settings.get("machine") or _job(self.content).machine)

    def tagged(self, **tags: Value) -> Case:
        """Return the case with tags added or replaced."""
        return replace(self, tags=tuple({**dict(self.tags), **tags}.items()))

    def job(self) -> Job:
        """Return the job with the overrides applied.

        Raises:
            InputError: the job is refused.
        """
        return _changed_job(self.content, self.overrides) if self.overrides else _job(self.content)


def machine_digest(case: Case) -> str:
    """Return the SHA-256 of a case's machine before any perturbation.

    Raises:
        InputError: the machine is refused.
    """
    job = _job(case.content)
    return (job.built_machine if case.machine == job.machine else Machine(case.machine)).digest


def forget_jobs() -> None:
    """Clear the cache of jobs, and with it the machines built from files that may have changed."""
    _LAST_JOB.forget()
    _job.cache_clear()
    _changed_job.cache_clear()
    perturbed_machine.cache_clear()


def measure(case: Case, values: Callable[[Run], Row] | None = None) -> Row:
    """Run a case and return its row: `status` first, "ok" or the reason for missing values, then the values.

    A case that is refused ("refused: ...") or ended by a fault ("fault: ...") has only its status.

    Args:
        case: to run.
        values: from the record to the values, by default `values_row` with the bead of the job. The verdict on the
            run follows them, see `verdict_row`.
    """

    def row(run: Run) -> Row:
        budget = Budget(run)
        bead = Bead(run, case.job().bead, budget.analysis)
        values_of_run = _values(budget, bead) if values is None else values(run)
        return {**values_of_run, **_verdict(case, budget, bead)}

    return judged_row(lambda: simulated(case), row)


def verdict_row(case: Case, run: Run) -> Row:
    """Return the verdict on the complete run of a case, by the limits of its job; nothing for a perfect follower.

    Raises:
        InputError: the dispenser is never on.
    """
    budget = Budget(run)
    return _verdict(case, budget, Bead(run, case.job().bead, budget.analysis))


def _verdict(case: Case, budget: Budget, bead: Bead) -> Row:
    # it has neither servo nor motors
    if case.mode != "simulated":
        return {}
    job = case.job()
    machine = None if case.perturbation is None else perturbed_machine(job.built_machine, case.perturbation)
    verdict = Verdict.of_results(job, budget, bead, machine)
    # errors that are not known keep no limit
    if verdict.contradiction:
        raise InputError(verdict.contradiction)
    return dict(verdict_columns(verdict))


def judged_row(start: Callable[[], Run], values: Callable[[Run], Row]) -> Row:
    """Return status and values of a run, as `measure` does; `start` may raise an InputError."""
    try:
        run = start()
        if run.fault is not None:
            return {"status": f"{_FAULT}{run.fault}"}
        return {"status": OK, **values(run)}
    except InputError as error:
        return {"status": f"{_REFUSED_PREFIX}{error}"}


def is_fault(row: Row) -> bool:
    """Return whether a fault ended the run of a row."""
    return str(row["status"]).startswith(_FAULT)


def simulated(case: Case) -> Run:
    """Return the record of a case.

    Raises:
        InputError: the job is refused.
    """
    job = case.job()
    if case.mode == "perfect follower":
        return job.follow()
    if case.perturbation is None:
        return job.run(engine=job.engine_of_searches)
    machine = perturbed_machine(job.built_machine, case.perturbation)
    return job.run(machine=machine, engine=job.engine_of_searches)


@lru_cache(maxsize=64)
def perturbed_machine(machine: Machine, perturbation: Perturbation) -> Machine:
    """Return a perturbed machine: built once for a case's run and its verdict, and for all gains of a tuning."""
    return machine.perturbed(perturbation)


def values_row(run: Run, bead: BeadSettings | None = None) -> Row:
    """Return the values of a run as one flat row, by the keys that summary.json has for them, see docs/values.md.

    They are all errors and the motion, and of the bead its mean width and the error of its volume, which need no height
    map. A value that the run does not have, as the spacing of a single turn, or that is not finite is None; so are the
    bead's values where no glue is demanded during motion.

    Args:
        run: the run.
        bead: settings of the bead.

    Raises:
        InputError: the dispenser is never on.
    """
    budget = Budget(run)
    return _values(budget, Bead(run, bead, budget.analysis))


def _values(budget: Budget, bead: Bead) -> Row:
    run = budget.analysis.run
    quantities = of_axes((*ERRORS, *MOTION), run.axes, run.units)
    return {**contents(quantities, budget), **_bead(bead)}


def _bead(bead: Bead) -> Row:
    """Mean width while the dispenser is on, and the error of the volume; neither needs a height map."""
    width = None
    volume_error = None
    if bead.nominal > 0:
        width = WIDTH.content(float(bead.width[bead.dispensing].mean()))
        volume_error = VOLUME_ERROR_PERCENT.content(bead.volume_error_percent)
    return {WIDTH.statistic(MEAN).key: width, VOLUME_ERROR_PERCENT.key: volume_error}


def _has(content: dict[str, Any], key: str, value: Any) -> bool:
    """Return whether a job's content has a value at a dotted key."""
    present: Any = content
    for part in key.split("."):
        present = present.get(part) if isinstance(present, dict) else None
    # None removes a key, and an unknown key must be refused: both are changes
    return present is not None and type(present) is type(value) and bool(present == value)


@lru_cache(maxsize=8)
def _job(content: str) -> Job:  # cached, as a study's cases differ in a few values of one job
    return Job(**tomllib.loads(content))


@lru_cache(maxsize=1)
def _changed_job(content: str, overrides: tuple[tuple[str, str], ...]) -> Job:
    """Return the job with its overrides; it shares the parts that these leave unchanged, such as a built machine."""
    unchanged = _job(content)
    return unchanged.changed({key: json.loads(value) for key, value in overrides}).sharing(unchanged)


def figures(run: Run, machine: Machine | None = None) -> Row:
    """Return the figures of a run as one flat row, by the keys that studies and summary.json have, see docs/values.md.

    `status` comes first: "ok", "fault: ..." for a run that a fault ended, or "refused: ..." for one without glue; these
    have no other figure. Errors, motion and bead follow, and of a run with a job its verdict.

    Args:
        run: the run; the bead and the limits are those of its job, if it has one.
        machine: machine of the run if not its job's own; the stability margins of the verdict are computed for it.

    Raises:
        InputError: no run.
    """
    check_run(run)
    if machine is not None:
        check_type("machine", machine, Machine, "a Machine")

    def values(run: Run) -> Row:
        job = run.job
        if job is None:
            return values_row(run)
        verdict = Verdict.of_results(job, run.budget, Bead(run, job.bead, run.budget.analysis), machine)
        # errors that are not known keep no limit
        if verdict.contradiction:
            raise InputError(verdict.contradiction)
        return {**values_row(run, job.bead), **verdict_columns(verdict)}

    return judged_row(lambda: run, values)
