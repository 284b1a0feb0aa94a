"""A row of the verdict, and its checks: a measured value against its limit, whether it passes, where it is worst."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from gantrysim.base.quantity import Quantity, number_text
from gantrysim.job.tolerance import Bound

PASS = "pass"
WARN = "warn"
FAIL = "fail"
UNJUDGED = "not judged"

SYMBOLS = {PASS: "✓", WARN: "!", FAIL: "✗", UNJUDGED: "–"}
# of states, from the best
ORDER = (PASS, UNJUDGED, WARN, FAIL)

NEAR_LIMIT = 0.8  # share of the limit from which a value that keeps it is a warning
_ROUNDING = 1e-9  # relative


def worst(states: list[str]) -> str:
    """Return the worst of some states; what is not judged is worse than a pass."""
    return max(states, key=ORDER.index, default=UNJUDGED)


@dataclass(frozen=True)
class Place:
    """Where a value is worst; what is not known is None.

    Attributes:
        axis: name of the axis.
        time: time in the run [s].
        point: of the path or the nozzle in the work frame, (x, y, z) [mm].
        line: line of the program's text.
    """

    axis: str | None = None
    time: float | None = None
    point: tuple[float, float, float] | None = None
    line: int | None = None

    def __str__(self) -> str:
        parts = []
        if self.axis is not None:
            parts.append(f"axis {self.axis}")
        if self.time is not None:
            parts.append(f"t = {number_text(self.time, '.3f')} s")
        if self.point is not None:
            x, y, z = (number_text(coordinate, ".1f") for coordinate in self.point)
            parts.append(f"x = {x}, y = {y}, z = {z} mm")
        if self.line is not None:
            parts.append(f"line {self.line}")
        return ", ".join(parts)

    @property
    def brief(self) -> str:
        """Axis, time and line, without the point; empty where none is known."""
        return str(replace(self, point=None))

    def content(self) -> dict[str, Any]:
        """Return the place for JSON."""
        point = None if self.point is None else list(self.point)
        return {"axis": self.axis, "time_s": self.time, "point_mm": point, "program_line": self.line}


@dataclass(frozen=True, kw_only=True)
class Check:
    """A value against its limit.

    Attributes:
        name: of the limit, an attribute of `Tolerance`.
        quantity: what is measured.
        value: its worst value.
        limit: its bound.
        unit: of both; empty for a ratio.
        source: "given" for a limit of the job, "default" for any other.
        at_least: whether the value must be at least the limit, else at most.
        form: format of both.
        label: name of the quantity whatever the value's sign; empty for `quantity`.
        place: of the worst value.
    """

    name: str
    quantity: str
    value: float
    limit: float
    unit: str
    source: str
    at_least: bool = False
    form: str = ".1f"
    label: str = ""
    place: Place = field(default_factory=Place)

    @classmethod
    def of(
        cls, quantity: Quantity[Any], bound: Bound, value: float, words: str = "", place: Place | None = None
    ) -> Self:
        """Return the check of a quantity, in its unit and format.

        Args:
            quantity: that is measured.
            bound: of its value, in the API's unit.
            value: its worst value, likewise.
            words: name of the value; the quantity's label by default.
            place: of the worst value.
        """
        return cls(
            name=bound.name,
            quantity=words or quantity.label,
            value=quantity.factor * value,
            limit=quantity.factor * bound.limit,
            unit=quantity.unit,
            source=bound.source,
            at_least=bound.at_least,
            form=quantity.form,
            label=quantity.label,
            place=place or Place(),
        )

    @property
    def usage(self) -> float:
        """Share of the limit that the value uses; above 1 it is exceeded; nan if it is unknown."""
        over, under = (self.limit, self.value) if self.at_least else (self.value, self.limit)
        if math.isnan(over) or math.isnan(under):
            return math.nan
        if math.isinf(under) or (over <= 0 and under >= 0):
            return 0.0
        return over / under if under > 0 else math.inf

    @property
    def state(self) -> str:
        """The check's verdict; a value above 80 % of its limit is a warning."""
        if math.isnan(self.value) or math.isnan(self.limit):
            return UNJUDGED
        if self.usage > 1 + _ROUNDING:
            return FAIL
        return WARN if self.usage > NEAR_LIMIT else PASS

    @property
    def measured(self) -> str:
        """The value in words."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.quantity} {number_text(self.value, self.form)}{unit}"

    @property
    def brief(self) -> str:
        """Value and limit in words, without place and source."""
        unit = f" {self.unit}" if self.unit else ""
        bound = "at least" if self.at_least else "at most"
        return f"{self.measured}, {bound} {number_text(self.limit, self.form)}{unit}"

    def __str__(self) -> str:
        text = f"{self.brief} ({self.source})"
        place = str(self.place)
        return f"{text}: {place}" if place else text

    def content(self) -> dict[str, Any]:
        """Return the check for JSON; an infinite number is null."""
        return {
            "name": self.name,
            "quantity": self.quantity,
            "value": finite(self.value),
            "limit": finite(self.limit),
            "unit": self.unit,
            "bound": "at least" if self.at_least else "at most",
            "limit_source": self.source,
            "state": self.state,
            "at_worst": self.place.content(),
        }


def finite(value: float) -> float | None:
    """Return a number, or None for one that JSON lacks."""
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Row:
    """The verdict on one aspect of a run.

    Attributes:
        name: "path", "glue", "stability" or "machine".
        checks: values against their limits, the worst first.
        remark: what else there is to say.
        values: further numbers for summary.json.
        state: "pass", "warn", "fail", or "not judged".
    """

    name: str
    checks: tuple[Check, ...] = ()
    remark: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    state: str = UNJUDGED

    @classmethod
    def of(cls, name: str, checks: Sequence[Check], remark: str = "", values: dict[str, Any] | None = None) -> Row:
        """Return the row of some checks, whose state is that of the worst."""
        ordered = tuple(sorted(checks, key=lambda check: -math.inf if math.isnan(check.usage) else -check.usage))
        return cls(name, ordered, remark, values or {}, worst([check.state for check in checks]))

    @property
    def symbol(self) -> str:
        """The state as a shape."""
        return SYMBOLS[self.state]

    @property
    def worst_check(self) -> Check | None:
        """The check that the row's state is due to; None where no check is judged, or the remark says why it fails."""
        judged = [check for check in self.checks if check.state == self.state]
        return None if self.state == UNJUDGED else next(iter(judged), None)

    @property
    def severity(self) -> tuple[int, float]:
        """Order of rows by what is worst: by state, then by the largest share of a limit that a check uses."""
        usages = [check.usage for check in self.checks if not math.isnan(check.usage)]
        return ORDER.index(self.state), math.inf if self.fails_without_check else max(usages, default=0.0)

    @property
    def fails_without_check(self) -> bool:
        """Whether it fails, but none of its checks does: the remark says why, as where no glue comes out."""
        return self.state == FAIL and all(check.state != FAIL for check in self.checks)

    @property
    def texts(self) -> tuple[str, ...]:
        """The worst check, the others that do not pass, and the remark, which is first if it says why the row fails."""
        shown = tuple(str(check) for k, check in enumerate(self.checks) if k == 0 or check.state != PASS)
        remark = (self.remark,) if self.remark else ()
        return (*remark, *shown) if self.fails_without_check else (*shown, *remark)

    def content(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return {
            "state": self.state,
            "remark": self.remark,
            **self.values,
            "checks": [check.content() for check in self.checks],
        }
