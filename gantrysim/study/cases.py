"""A case: one run of a study, and the figures that are kept of it."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from typing import Any, Literal

import numpy as np

from gantrysim.arrays import Floats, dot
from gantrysim.bead import Bead, BeadSettings
from gantrysim.errors import InputError
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine
from gantrysim.machine.perturbation import Perturbation
from gantrysim.metrics.analysis import THOUSANDTH, Analysis, speed_ripple, steady
from gantrysim.metrics.budget import Budget
from gantrysim.run import Run

Value = str | float | int | bool | list[float] | None  # a list is a curve, which goes into a file of its own
Row = dict[str, Value]
Mode = Literal["simulated", "perfect follower"]

OK = "ok"
_FAULT, _REFUSED = "fault: ", "refused: "
_THOUSANDTHS = 1e3


@dataclass(frozen=True)
class Case:
    """One run of a study: a job, what of it is changed, and what stands in the machine's place.

    It is hashable and can be sent to another process or machine. Nothing of it is built before it is measured, so a
    job that is refused can be a case.

    Attributes:
        content: of the job that the study is about, as TOML.
        overrides: values changed in it, as (dotted key, JSON of the value), sorted; what the job has anyway is no
            change, so that cases with the same result have the same key.
        mode: "simulated", or "perfect follower" for a machine that is always where it is commanded to be.
        perturbation: of the machine, or None; the servo keeps the gains of the machine as it is drawn.
        tags: columns of the row that say what the case is to the study, as (name, value).
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
    ) -> Case:
        """Return a case of a job.

        Args:
            job: that the study is about.
            overrides: values by their full dotted keys, as in {"program.loop_period": 0.01}; None for the default.
            mode: as in the class.
            perturbation: as in the class.
            tags: as in the class.
        """
        own = job.model_dump(exclude_none=True)
        changes = {key: value for key, value in (overrides or {}).items() if not _has(own, key, value)}
        changed = tuple(sorted((key, json.dumps(value)) for key, value in changes.items()))
        return cls(job.toml(), changed, mode, perturbation, tuple(tags.items()))

    @property
    def key(self) -> str:
        """What tells the case from every other with another result, tags aside: a SHA-256 in hexadecimal."""
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
        """Return the case with more tags, or other values of them."""
        return replace(self, tags=tuple({**dict(self.tags), **tags}.items()))

    def job(self) -> Job:
        """Return the job with what is changed of it.

        Raises:
            InputError: the job is refused.
        """
        return _changed(self.content, self.overrides) if self.overrides else _job(self.content)


def machine_digest(case: Case) -> str:
    """Return the SHA-256 of the machine that a case is measured on, as it is before any perturbation.

    Raises:
        InputError: the machine is refused.
    """
    job = _job(case.content)
    return (job.built_machine if case.machine == job.machine else Machine(case.machine)).digest


def forget_jobs() -> None:
    """Forget the jobs that cases share, and so the machines built of files that may have changed."""
    _job.cache_clear()
    _changed.cache_clear()


def measure(case: Case, figures: Callable[[Run], Row] | None = None) -> Row:
    """Run a case and return its figures; `status` first, "ok" or why there are none.

    A case that is refused ("refused: ..."), or that a fault ends ("fault: ..."), has its status alone.

    Args:
        case: to be run.
        figures: from the record to the row, by default `values_row` with the bead as the job has it.
    """
    return judged(lambda: simulated(case), figures or (lambda run: values_row(run, case.job().bead)))


def judged(run_it: Callable[[], Run], figures: Callable[[Run], Row]) -> Row:
    """Return the figures of a run with its status, as `measure` does; `run_it` may refuse."""
    try:
        run = run_it()
        if run.fault is not None:
            return {"status": f"{_FAULT}{run.fault}"}
        return {"status": OK, **figures(run)}
    except InputError as error:
        return {"status": f"{_REFUSED}{error}"}


def is_fault(row: Row) -> bool:
    """Return whether a fault has ended the run of a row."""
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
    """Return the figures of a run as one flat row; a key's unit stands in its name, rms, max and p95 of magnitudes.

    generation and contour are distances to the path as in `gantrysim.metrics`; tracking, measurement and structure are
    the parts of the error normal to the path, of `gantrysim.Budget`; lag is along it, and tracking_along the encoder's
    share of that. steady_tracking_normal and _along are the following error, `tracking_error` at the nozzle, in the
    middle 90 % of the dispensing time, where the start and the end have died away. A figure that the run does not
    have, as the spacing of one turn, is None; so are the bead's where no glue is asked for while it moves.

    Args:
        run: the run.
        bead: how the glue lies.

    Raises:
        InputError: the dispenser is never on.
    """
    analysis = Analysis(run)
    figures, budget = analysis.values, Budget(analysis)
    row: Row = {}
    errors = {"generation": analysis.commanded.distance, "contour": analysis.nozzle.distance}
    errors |= {link: budget.parts[link].size for link in ("tracking", "measurement", "structure")}
    for name, error in errors.items():
        row |= _sizes(name, error)
    row |= _sizes("lag", np.abs(budget.lag))
    row["tracking_along_rms_um"] = _THOUSANDTHS * figures.tracking_along.rms
    row["tracking_along_max_um"] = _THOUSANDTHS * figures.tracking_along.max
    for unit, (name, spread) in zip(run.units, figures.tracking.items(), strict=True):
        row[f"tracking_{name}_rms_{_ascii(unit)}"] = _THOUSANDTHS * spread.rms
        row[f"tracking_{name}_max_{_ascii(unit)}"] = _THOUSANDTHS * spread.max
    row |= _steady(analysis)
    for statistic in ("mean", "std", "min", "max"):
        spacing = figures.spacing
        row[f"spacing_{statistic}_mm"] = None if spacing is None else getattr(spacing, statistic)
    row |= _bead(Bead(run, bead, analysis))
    row["speed_mean_mm_s"] = figures.speed.mean
    row["speed_ripple"] = speed_ripple(run)
    row["path_length_mm"] = figures.path_length
    row["duration_s"] = figures.duration
    for name, place in zip("xyz", figures.end_point, strict=True):
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
    run, on, foot = analysis.run, analysis.ticks, analysis.commanded.s
    middle = steady(on.size)
    error = (run.commanded_tip - run.encoder_tip)[on[middle]]
    tangent = run.requested.tangent(foot[middle])
    along = dot(error, tangent)
    normal = np.linalg.norm(error - along[:, None] * tangent, axis=1)
    return {
        f"steady_tracking_{name}_rms_um": _THOUSANDTHS * float(np.sqrt(np.mean(part**2)))
        for name, part in (("along", along), ("normal", normal))
    }


def _bead(bead: Bead) -> Row:
    """Mean width while the dispenser is on, and the volume laid beyond what was asked for; neither takes a map."""
    glue = bead.nominal > 0
    return {
        "bead_width_mean_mm": float(bead.width[bead.dispensing].mean()) if glue else None,
        "bead_volume_error_percent": bead.volume_error_percent if glue else None,
    }


def _ascii(unit: str) -> str:
    return THOUSANDTH[unit].replace("µ", "u")


def _plain(value: Value) -> Value:
    """None instead of a number that is none, so that a row is the same when it has been written and read again."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _has(content: dict[str, Any], key: str, value: Any) -> bool:
    """Whether a job's content has a value at a dotted key."""
    own: Any = content
    for part in key.split("."):
        own = own.get(part) if isinstance(own, dict) else None
    # of None, which takes a key away, there is none: one that is unknown has to be refused
    return own is not None and type(own) is type(value) and bool(own == value)


@lru_cache(maxsize=8)
def _job(content: str) -> Job:
    return Job(**tomllib.loads(content))


@lru_cache(maxsize=1)
def _changed(content: str, overrides: tuple[tuple[str, str], ...]) -> Job:
    """Return the job with what is changed of it; the parts that are not are those of the job itself, built once."""
    own = _job(content)
    return own.changed({key: json.loads(value) for key, value in overrides}).sharing(own)
