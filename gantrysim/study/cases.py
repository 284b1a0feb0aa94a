"""A case, one run of a study, and the row of values kept of it."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from typing import Any, Literal, Self

import numpy as np

from gantrysim.base.arrays import Floats, dot
from gantrysim.base.errors import InputError
from gantrysim.bead import Bead, BeadSettings
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import THOUSANDTH, Analysis, speed_ripple, steady
from gantrysim.metrics.budget import Budget
from gantrysim.record.run import Run

Value = str | float | int | bool | list[float] | None  # a list is a curve and goes into curves.csv
Row = dict[str, Value]
Mode = Literal["simulated", "perfect follower"]

OK = "ok"
_FAULT = "fault: "
_REFUSED = "refused: "
_THOUSANDTHS = 1e3


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
        content = job.model_dump(exclude_none=True)
        # a value that the job has already changes nothing: left out, so that equal cases have one key
        changes = {key: value for key, value in (overrides or {}).items() if not _has(content, key, value)}
        changed = tuple(sorted((key, json.dumps(value)) for key, value in changes.items()))
        return cls(job.toml(), changed, mode, perturbation, tuple(tags.items()))

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
        return _changed(self.content, self.overrides) if self.overrides else _job(self.content)


def machine_digest(case: Case) -> str:
    """Return the SHA-256 of a case's machine before any perturbation.

    Raises:
        InputError: the machine is refused.
    """
    job = _job(case.content)
    return (job.built_machine if case.machine == job.machine else Machine(case.machine)).digest


def forget_jobs() -> None:
    """Clear the cache of jobs, and with it the machines built from files that may have changed."""
    _job.cache_clear()
    _changed.cache_clear()


def measure(case: Case, values: Callable[[Run], Row] | None = None) -> Row:
    """Run a case and return its row: `status` first, "ok" or the reason for missing values, then the values.

    A case that is refused ("refused: ...") or ended by a fault ("fault: ...") has only its status.

    Args:
        case: to run.
        values: from the record to the values, by default `values_row` with the bead of the job.
    """
    return judged(lambda: simulated(case), values or (lambda run: values_row(run, case.job().bead)))


def judged(start: Callable[[], Run], values: Callable[[Run], Row]) -> Row:
    """Return status and values of a run, as `measure` does; `start` may raise an InputError."""
    try:
        run = start()
        if run.fault is not None:
            return {"status": f"{_FAULT}{run.fault}"}
        return {"status": OK, **values(run)}
    except InputError as error:
        return {"status": f"{_REFUSED}{error}"}


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
        return job.run()
    return job.run(machine=job.built_machine.perturbed(case.perturbation))


def values_row(run: Run, bead: BeadSettings | None = None) -> Row:
    """Return the values of a run as one flat row; keys end in the unit, rms, max and p95 are of magnitudes.

    program and contour are distances to the path as in `gantrysim.metrics`; servo, encoder, structure, and
    geometry where there is any, are the parts of the error normal to the path, of `gantrysim.Budget`; lag is along it,
    and following_along the encoder's share of that. steady_following_normal and _along are the following error,
    `following_error` at the nozzle, in the middle 90 % of the dispensing time, without the transients of start and end.
    A value that the run does not have, as the spacing of a single turn, is None; so are the bead's values where no
    glue is demanded during motion.

    Args:
        run: the run.
        bead: settings of the bead.

    Raises:
        InputError: the dispenser is never on.
    """
    analysis = Analysis(run)
    values = analysis.values
    budget = Budget(analysis)
    row: Row = {}
    errors = {"program": analysis.commanded.distance, "contour": analysis.nozzle.distance}
    errors |= {link: part.size for link, part in budget.parts.items() if link != "program"}
    for name, error in errors.items():
        row |= _sizes(name, error)
    row |= _sizes("lag", np.abs(budget.lag))
    row["following_along_rms_um"] = _THOUSANDTHS * values.following_along.rms
    row["following_along_max_um"] = _THOUSANDTHS * values.following_along.max
    for unit, (name, size) in zip(run.units, values.following.items(), strict=True):
        row[f"following_{name}_rms_{_ascii(unit)}"] = _THOUSANDTHS * size.rms
        row[f"following_{name}_max_{_ascii(unit)}"] = _THOUSANDTHS * size.max
    row |= _steady(analysis)
    for statistic in ("mean", "std", "min", "max"):
        spacing = values.spacing
        row[f"spacing_{statistic}_mm"] = None if spacing is None else getattr(spacing, statistic)
    row |= _bead(Bead(run, bead, analysis))
    row["speed_mean_mm_s"] = values.speed.mean
    row["speed_ripple"] = speed_ripple(run)
    row["path_length_mm"] = values.path_length
    row["duration_s"] = values.duration
    for name, place in zip("xyz", values.end_point, strict=True):
        row[f"end_{name}_mm"] = place
    return {key: _plain(value) for key, value in row.items()}


def _sizes(name: str, error: Floats) -> Row:
    return {
        f"{name}_rms_um": _THOUSANDTHS * float(np.sqrt(np.mean(error**2))),
        f"{name}_max_um": _THOUSANDTHS * float(error.max()),
        f"{name}_p95_um": _THOUSANDTHS * float(np.percentile(error, 95)),
    }


def _steady(analysis: Analysis) -> Row:
    """The following error along the path and normal to it, in the middle of the dispensing time."""
    run = analysis.run
    on = analysis.ticks
    foot = analysis.commanded.s
    middle = steady(on.size)
    error = (run.commanded_tip - run.encoder_tip)[on[middle]]
    tangent = run.requested.tangent(foot[middle])
    along = dot(error, tangent)
    normal = np.linalg.norm(error - along[:, None] * tangent, axis=1)
    return {
        f"steady_following_{name}_rms_um": _THOUSANDTHS * float(np.sqrt(np.mean(part**2)))
        for name, part in (("along", along), ("normal", normal))
    }


def _bead(bead: Bead) -> Row:
    """Mean width while the dispenser is on, and the error of the volume; neither needs a height map."""
    glue = bead.nominal > 0
    return {
        "bead_width_mean_mm": float(bead.width[bead.dispensing].mean()) if glue else None,
        "bead_volume_error_percent": bead.volume_error_percent if glue else None,
    }


def _ascii(unit: str) -> str:
    return THOUSANDTH[unit].replace("µ", "u")


def _plain(value: Value) -> Value:
    """Return None for a number that is not finite, so that a row survives being written and read."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


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
def _changed(content: str, overrides: tuple[tuple[str, str], ...]) -> Job:
    """Return the job with its overrides; it shares the parts that these leave unchanged, such as a built machine."""
    unchanged = _job(content)
    return unchanged.changed({key: json.loads(value) for key, value in overrides}).sharing(unchanged)
