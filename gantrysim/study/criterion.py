"""A tolerance of a metric, one value of a case's row."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

from gantrysim.base.errors import InputError, positive, unknown
from gantrysim.base.quantity import MAX, P95, RMS, SHARE, STD, numbers_of
from gantrysim.glue.bead.bead_quantities import VOLUME_ERROR_PERCENT, WIDTH
from gantrysim.metrics.error_quantities import ERRORS, MOTION, SPACING, SPEED, SPEED_RIPPLE
from gantrysim.study.acceptance import MOTION_LIMITS, Acceptance, Scope
from gantrysim.study.cases import OK, Row
from gantrysim.study.study import Study
from gantrysim.study.verdict_columns import LIMIT_USE

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
        return acceptance is not None and acceptance.keeps(self.scope.aspects)

    def warning(self, row: Row) -> str:
        acceptance = Acceptance.of(row)
        return "" if acceptance is None else acceptance.warnings(self.scope.aspects)

    def unit(self, row: Row) -> str:
        return LIMIT_USE.unit

    def limit(self, row: Row) -> str:
        return self.scope.words

    def failure(self, row: Row) -> str:
        acceptance = Acceptance.of(row)
        return str(row["status"]) if acceptance is None else acceptance.failures(self.scope.aspects)

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
            raise InputError(f"figure = {self.metric}: needs a tolerance; without both, the job's own limits apply")
        return JobCriterion()


def _without_unit(key: str) -> str:
    for ending in sorted(_UNITS, key=len, reverse=True):
        if key.endswith(f"_{ending}"):
            return key.removesuffix(f"_{ending}")
    return key
