"""Whether the cases of a study keep the limits of their job, as the verdict judges them, in an answer's words."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from gantrysim.base.errors import InputError, positive, short_text, unknown
from gantrysim.base.quantity import MAX, P95, PER_CENT, RMS, SHARE, STD, numbers_of
from gantrysim.glue.bead.values import VOLUME_ERROR_PERCENT, WIDTH
from gantrysim.job.job import Job
from gantrysim.job.loaded import needle_face
from gantrysim.job.loading import builtin_jobs
from gantrysim.metrics.error_quantities import ERRORS, MOTION, SPACING, SPEED, SPEED_RIPPLE
from gantrysim.results.checks import FAIL, UNJUDGED, WARN
from gantrysim.results.verdict import GLUE, MACHINE, PATH, STABILITY
from gantrysim.study.cases import ASPECTS, LIMIT_USE, OK, Row, check_column, state_column, use_column
from gantrysim.study.study import Study

MOTION_LIMITS = (PATH, STABILITY, MACHINE)  # what the motion alone decides
_JOB_FILE = "job.toml"  # in the folder of a study
_AS_GOOD = 0.01  # of a use of a limit: one that is larger by less is no worse


@dataclass(frozen=True)
class Acceptance:
    """The verdict on a case, from its row.

    Attributes:
        states: "pass", "warn", "fail" or "not judged" by aspect: path, glue, stability and machine.
        uses: largest use of a limit by aspect [%]; None where nothing is judged or a limit of zero is exceeded.
        checks: worst check by aspect, in words.
    """

    states: dict[str, str]
    uses: dict[str, float | None]
    checks: dict[str, str]

    @classmethod
    def of(cls, row: Row) -> Acceptance | None:
        """Return the verdict on a case; None for one without a run that was judged."""
        if row["status"] != OK or state_column(PATH) not in row:
            return None
        uses = {aspect: row[use_column(aspect)] for aspect in ASPECTS}
        return cls(
            {aspect: str(row[state_column(aspect)]) for aspect in ASPECTS},
            {aspect: use if isinstance(use, float) else None for aspect, use in uses.items()},
            {aspect: str(row[check_column(aspect)]) for aspect in ASPECTS},
        )

    def failed(self, aspects: Iterable[str] = ASPECTS) -> list[str]:
        """Return the aspects that fail."""
        return [aspect for aspect in aspects if self.states[aspect] == FAIL]

    def keeps(self, aspects: Iterable[str] = ASPECTS) -> bool:
        """Return whether none of the aspects fails."""
        return not self.failed(aspects)

    def use(self, aspects: Iterable[str] = ASPECTS) -> float:
        """Return the largest use of a limit of some aspects [%]; inf where one fails without a number."""
        uses = [0.0]
        for aspect in aspects:
            use = self.uses[aspect]
            if use is not None:
                uses.append(use)
            elif self.states[aspect] == FAIL:
                uses.append(math.inf)
        return max(uses)

    def worst(self, aspects: Iterable[str] = ASPECTS) -> str:
        """Return the worst check of some aspects, as in "path: contour error, max 809 µm, at most 82 µm"."""
        aspect = max(aspects, key=lambda name: self.use([name]))
        return f"{aspect}: {self.checks[aspect]}"

    def warnings(self, aspects: Iterable[str] = ASPECTS) -> str:
        """Return the aspects with a warning, each with its worst check."""
        return "; ".join(f"{aspect}: {self.checks[aspect]}" for aspect in aspects if self.states[aspect] == WARN)

    def failures(self, aspects: Iterable[str] = ASPECTS) -> str:
        """Return the aspects that fail, each with its worst check."""
        return "; ".join(f"{aspect}: {self.checks[aspect]}" for aspect in self.failed(aspects))


@dataclass(frozen=True)
class Scope:
    """The limits by which the cases of a study are compared.

    Attributes:
        aspects: of the verdict, within whose limits a case must be.
        reference: the job as it is. In the other aspects, which all cases fail, no case may be worse than it; None
            where it is not known.
    """

    aspects: tuple[str, ...]
    reference: Acceptance | None = None

    @classmethod
    def of(cls, acceptances: Iterable[Acceptance | None], reference: Acceptance | None = None) -> Scope:
        """Return the whole tolerance if a case keeps it, else the limits of the motion, and glue no worse than it is.

        Glue that fails in all cases would hide which of them is the better motion.
        """
        is_whole = any(acceptance is not None and acceptance.keeps() for acceptance in acceptances)
        return cls(ASPECTS) if is_whole else cls(MOTION_LIMITS, reference)

    @property
    def _others(self) -> list[str]:
        return [aspect for aspect in ASPECTS if aspect not in self.aspects]

    def worsened(self, acceptance: Acceptance) -> list[str]:
        """Return the aspects that a case fails by more than the job as it is, of those that all cases fail."""
        if self.reference is None:
            return []
        return [
            aspect
            for aspect in self._others
            if acceptance.states[aspect] == FAIL
            and acceptance.use([aspect]) > (1 + _AS_GOOD) * self.reference.use([aspect])
        ]

    def keeps(self, acceptance: Acceptance) -> bool:
        """Return whether a case keeps the limits, and is no worse than the job in what all cases fail."""
        return acceptance.keeps(self.aspects) and not self.worsened(acceptance)

    def failures(self, acceptance: Acceptance) -> str:
        """Return what keeps a case from that, in words."""
        worse = [f"{aspect}: {acceptance.checks[aspect]}, worse than now" for aspect in self.worsened(acceptance)]
        return "; ".join(filter(None, (acceptance.failures(self.aspects), *worse)))

    @property
    def words(self) -> str:
        """The limits in words."""
        if self.aspects == ASPECTS:
            return "the job's tolerance"
        motion = "the limits of path, stability and machine"
        is_bad = self.reference is not None and self.reference.failed(self._others)
        return f"{motion}, with glue no worse than now" if is_bad else motion

    def usage(self, acceptance: Acceptance) -> str:
        """Return how much of the closest limit a case uses, in words, with the check."""
        use = acceptance.use(self.aspects)
        return f"{use:.3g} % of the closest limit used ({acceptance.worst(self.aspects)})"

    def reply(self, acceptance: Acceptance) -> str:
        """Return whether a case within the limits is good enough, in a word, as a run's verdict replies."""
        return "Barely" if any(acceptance.states[aspect] == WARN for aspect in self.aspects) else "Yes"

    def excess(self, acceptance: Acceptance) -> str:
        """Return how far a case is from its limits, as in "17 times the limit (path: ...)"."""
        use = acceptance.use(self.aspects)
        times = f"{use / PER_CENT:.3g} times the limit" if math.isfinite(use) else "more than a limit of zero"
        return f"{times} ({acceptance.worst(self.aspects)})"

    def remark(self, acceptance: Acceptance) -> str:
        """Return what else a verdict says of a case within these limits: glue that fails, aspects that are not judged.

        Empty, or a clause that begins with a semicolon.
        """
        clauses = [f"; {aspect} is not judged" for aspect in self.aspects if acceptance.states[aspect] == UNJUDGED]
        if GLUE not in self.aspects and acceptance.states[GLUE] == FAIL:
            clauses.append(f"; the glue fails all the same ({acceptance.checks[GLUE]})")
        return "".join(clauses)


def improve_command(job: Job) -> str:
    """Return the command that simulates the levers of a job: by its name, or by the file in the study's folder."""
    is_built_in = job.name in builtin_jobs() and Job.load(job.name).toml() == job.toml()
    return f"gantrysim improve {job.name if is_built_in else _JOB_FILE}"


def path_limit(job: Job) -> float:
    """Return the largest contour error that the tolerance of a job admits [mm]."""
    return job.limits(needle_face(job.built_machine, job.dispenser.needle)).path_max


def settings_text(changes: Mapping[str, Any]) -> str:
    """Return values of a job by their dotted keys as text, as in "servo.law = ["pid"]"; None is no value."""
    return ", ".join(
        f"no {key}" if value is None else f"{key} = {json.dumps(_short(value))}" for key, value in changes.items()
    )


def _short(value: Any) -> Any:
    """Return a value with few digits."""
    if isinstance(value, list):
        return [_short(item) for item in value]
    if not isinstance(value, float):
        return value
    return int(value) if value.is_integer() else float(f"{value:.4g}")


# A tolerance of a metric, one value of a case's row.

_METRIC = "contour_max"
_UNITS = {"um": "µm", "mdeg": "mdeg", "mm": "mm", "mm_s": "mm/s", "s": "s"}  # by the end of a value's name
# values of a row of which smaller is not better
_NO_METRICS = {
    number.key
    for number in numbers_of((*MOTION, WIDTH, VOLUME_ERROR_PERCENT))
    if number not in (SPACING.statistic(STD), SPEED.statistic(STD), SPEED_RIPPLE)
} | {error.statistic(SHARE).key for error in ERRORS if SHARE in error.statistics}
_PHRASES = {
    quantity.statistic(statistic).name: quantity.phrase(statistic)
    for quantity in (*ERRORS, *MOTION)
    for statistic in quantity.statistics
}


@dataclass(frozen=True)
class Criterion:
    """A metric, the smaller the better, with its largest permitted value.

    Args:
        metric: name of a value in a case's row, with or without the unit, as contour_max.
        tolerance: in the metric's unit.
    """

    metric: str
    tolerance: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "tolerance", positive("tolerance", self.tolerance))

    def key(self, row: Row) -> str:
        """Return the metric's full name.

        Args:
            row: of a case that has values.

        Raises:
            InputError: no value has that name.
        """
        names = list(row)
        values = names[names.index("status") + 1 :]  # tags come before it
        known = {key: _without_unit(key) for key in values if isinstance(row[key], float) and key not in _NO_METRICS}
        for key, name in known.items():
            if self.metric in (key, name):
                return key
        raise unknown("metric", self.metric, known.values())

    def check(self, row: Row) -> None:
        """Check that a row has the metric, if it has values at all.

        Raises:
            InputError: no value has that name.
        """
        if row["status"] == OK:
            self.key(row)

    def value(self, row: Row) -> float:
        """Return the metric; inf for a case that a fault ended or that was refused, and where the value is None."""
        if row.get("status") != OK:
            return math.inf
        value = row[self.key(row)]
        return float(value) if isinstance(value, float) else math.inf

    def within(self, row: Row) -> bool:
        """Return whether a case is within the tolerance."""
        return self.value(row) <= self.tolerance

    def warning(self, row: Row) -> str:
        """Return what a case within the tolerance is warned of, in words; empty where of nothing."""
        return ""

    def unit(self, row: Row) -> str:
        """Return the metric's unit, from its full name."""
        key = self.key(row)
        return next((unit for ending, unit in _UNITS.items() if key.endswith(f"_{ending}")), "")

    def axis_label(self, row: Row) -> str:
        """Return the metric in words, with its unit in brackets."""
        unit = self.unit(row)
        return f"{self.label} [{unit}]" if unit else self.label

    def limit(self, row: Row) -> str:
        """Return the tolerance and the metric in words, as in "the tolerance of 50 µm (largest contour error)"."""
        words = " ".join(part for part in (f"{self.tolerance:g}", self.unit(row), f"({self.label})") if part)
        return f"the tolerance of {words}"

    def failure(self, row: Row) -> str:
        """Return what a case outside the tolerance misses, in words."""
        if row["status"] != OK:
            return str(row["status"])
        unit = f" {self.unit(row)}" if self.unit(row) else ""
        return f"{self.label} {self.value(row):.4g}{unit}, at most {self.tolerance:g}{unit}"

    def remark(self, row: Row) -> str:
        """Return what else is to be said of a case within the tolerance: a clause, or empty."""
        return ""

    @property
    def label(self) -> str:
        """The metric in words."""
        name = _without_unit(self.metric)
        if name in _PHRASES:
            return _PHRASES[name]
        # a value of one axis, or one that a study adds
        words = name.split("_")
        statistic = next((known for known in (MAX, RMS, P95, STD) if known.name in words), None)
        noun = " ".join(word for word in words if statistic is None or word != statistic.name)
        return f"{statistic.adjective} {noun}" if statistic else noun


@dataclass(frozen=True)
class JobCriterion(Criterion):
    """The limits of the job itself, as the verdict judges them; the metric is the largest use of one of them.

    Args:
        scope: the limits that count.
    """

    metric: str = LIMIT_USE.name
    tolerance: float = 100.0
    scope: Scope = field(default_factory=lambda: Scope(MOTION_LIMITS))

    def key(self, row: Row) -> str:
        return LIMIT_USE.key

    def check(self, row: Row) -> None:
        """Every case is judged: nothing is refused."""

    def value(self, row: Row) -> float:
        """Return the largest use of a limit [%]; inf for a case without values, and without a number of its failure."""
        acceptance = Acceptance.of(row)
        return math.inf if acceptance is None else acceptance.use(self.scope.aspects)

    def within(self, row: Row) -> bool:
        acceptance = Acceptance.of(row)
        return acceptance is not None and self.scope.keeps(acceptance)

    def warning(self, row: Row) -> str:
        acceptance = Acceptance.of(row)
        return "" if acceptance is None else acceptance.warnings(self.scope.aspects)

    def unit(self, row: Row) -> str:
        return LIMIT_USE.unit

    def limit(self, row: Row) -> str:
        return self.scope.words

    def failure(self, row: Row) -> str:
        acceptance = Acceptance.of(row)
        return str(row["status"]) if acceptance is None else self.scope.failures(acceptance)

    def remark(self, row: Row) -> str:
        acceptance = Acceptance.of(row)
        return "" if acceptance is None else self.scope.remark(acceptance)

    @property
    def label(self) -> str:
        return LIMIT_USE.label


@dataclass(frozen=True)
class ToleranceStudy(Study):
    """Base class of studies with a tolerance.

    Args:
        job: to study.
        tolerance: of the metric, in its unit; None for the limits of the job itself.
        metric: a value of a case's row, by default contour_max; None without a tolerance.
    """

    tolerance: float | None = None
    metric: str | None = None

    @cached_property
    def criterion(self) -> Criterion:
        """The metric with its tolerance.

        Raises:
            InputError: a tolerance that is not positive, or a metric without one.
        """
        if self.tolerance is not None:
            return Criterion(self.metric or _METRIC, self.tolerance)
        if self.metric is not None:
            figure = short_text(self.metric)
            raise InputError(f"figure = {figure}: needs a tolerance; without both, the job's own limits apply")
        return JobCriterion()


def _without_unit(key: str) -> str:
    for ending in sorted(_UNITS, key=len, reverse=True):
        if key.endswith(f"_{ending}"):
            return key.removesuffix(f"_{ending}")
    return key
