"""What differs between runs: keys of the job file, machines, checks of the verdict, and every value."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from gantrysim.base.quantity import MINUS, NOTHING, Quantity, number_text, numbers_of
from gantrysim.compare.runs.compared_run import ComparedRun
from gantrysim.job.job import Job
from gantrysim.results.checks import PASS, SYMBOLS, UNJUDGED, Check, Row, finite
from gantrysim.results.quantities import GROUPS, Group
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import STABILITY, Verdict
from gantrysim.servo.request import DERIVED_VALUES
from gantrysim.servo.stability.margins import GAIN_MARGIN

# What differs between the jobs of runs: keys of the job file, the machine, and the servo that they make.

JOB = "job"
MACHINE = "machine"
SERVO = "servo"

_IGNORED_KEYS = ("name", "source")  # labels: they do not act on the run
_DIGITS = 6  # significant, of a number
_SHOWN_LINE = 60  # characters of a line of a program
_DIGEST = 12  # characters of a digest that tell two apart
_UNIT = re.compile(r"\bu\b")  # of the axis
# of an axis of the machine, with its unit, in which u is the axis' own
_AXIS_VALUES = {
    "inertia": "N·m·s²/u",
    "viscous": "N·m·s/u",
    "coulomb": "N·m",
    "motor_constant": "N·m/A",
    "resistance": "ohm",
    "lag": "s",
    "bus_voltage": "V",
    "peak_torque": "N·m",
    "speed_limit": "u/s",
    "resolution": "u",
}


@dataclass(frozen=True)
class JobDifference:
    """A value that is not the same in all jobs.

    Attributes:
        kind: `JOB`, `MACHINE` or `SERVO`; of the servo are the values that the others make of it.
        key: dotted key of the job file, or name of the value with its unit.
        texts: value of each run.
    """

    kind: str
    key: str
    texts: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.key} {' → '.join(self.texts)}"


def differences_of(runs: Sequence[ComparedRun]) -> tuple[JobDifference, ...]:
    """Return what differs between the jobs of some runs: keys first, then what they make of machine and servo."""
    jobs = [run.results.job for run in runs]
    named = [*_job_values(jobs), *_machine_values(runs), *_servo_values(jobs)]
    return tuple(difference for difference in named if len(set(difference.texts)) > 1)


def _job_values(jobs: Sequence[Job]) -> Iterator[JobDifference]:
    tables = [dict(_flat(job.model_dump(exclude_none=True))) for job in jobs]
    for key in dict.fromkeys(key for table in tables for key in table):
        if key in _IGNORED_KEYS:
            continue
        values = [table.get(key) for table in tables]
        kind = MACHINE if key == "machine" else JOB
        if any(isinstance(value, str) and "\n" in value for value in values):
            if len(set(values)) > 1:
                yield from _text_differences(key, values)
        else:
            yield JobDifference(kind, key, tuple(map(_text, values)))


def _flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys with their values, those of tables and of lists of tables too."""
    for name, value in content.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{key}.")
        elif isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
            yield from _flat({str(number): item for number, item in enumerate(value)}, f"{key}.")
        else:
            yield key, value


def _text(value: Any) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    return str(value)


def _text_differences(key: str, values: Sequence[Any]) -> Iterator[JobDifference]:
    """Yield the first line that differs between texts of several lines, and their numbers of lines."""
    lines = [[] if value is None else str(value).splitlines() for value in values]
    for number, row in enumerate(zip_longest(*lines, fillvalue=NOTHING), 1):
        if len(set(row)) > 1:
            yield JobDifference(JOB, f"{key}, line {number}", tuple(line.strip()[:_SHOWN_LINE] for line in row))
            break
    counts = tuple(f"{len(text)} lines" for text in lines)
    others = sum(len(set(row)) > 1 for row in zip_longest(*lines)) - 1
    if others:
        yield JobDifference(JOB, f"{key}, {others} further lines differ; length", counts)


def _machine_values(runs: Sequence[ComparedRun]) -> Iterator[JobDifference]:
    digests = tuple((run.run.machine_sha256 or run.results.machine.digest)[:_DIGEST] for run in runs)
    names = {run.results.job.machine for run in runs}
    # else the name has said it
    if len(names) == 1:
        yield JobDifference(MACHINE, "machine, digest of its physics", digests)
    axes = [{axis.name: axis for axis in run.results.machine.axes} for run in runs]
    yield JobDifference(MACHINE, "axes", tuple(", ".join(f"{a.name} [{a.unit}]" for a in of.values()) for of in axes))
    for name in _shared_names(axes):
        unit = axes[0][name].unit
        for value, value_unit in _AXIS_VALUES.items():
            key = f"{name}: {value} [{_UNIT.sub(unit, value_unit)}]"
            yield JobDifference(MACHINE, key, tuple(_text(getattr(of[name], value)) for of in axes))


def _servo_values(jobs: Sequence[Job]) -> Iterator[JobDifference]:
    """Yield the servo's values by axis, each with its unit."""
    servos = [job.built_servo for job in jobs]
    yield JobDifference(SERVO, "laws", tuple(", ".join(map(str, servo.laws.names)) for servo in servos))
    yield JobDifference(SERVO, "servo period [ms]", tuple(_text(1e3 * servo.period) for servo in servos))
    numbers = [{axis.name: k for k, axis in enumerate(job.built_machine.axes)} for job in jobs]
    units = {axis.name: axis.unit for axis in jobs[0].built_machine.axes}
    for parameter in DERIVED_VALUES:
        for axis in _shared_names(numbers):
            values = [
                servo.per_axis(parameter.name)[number[axis]] for servo, number in zip(servos, numbers, strict=True)
            ]
            unit = _UNIT.sub(units[axis], parameter.unit)
            key = f"{axis}: {parameter.name} [{unit}]" if unit else f"{axis}: {parameter.name}"
            yield JobDifference(SERVO, key, tuple(map(_text, values)))


def _shared_names(tables: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the names that all tables have, in the order of the first."""
    return [name for name in tables[0] if all(name in table for table in tables)]


# The checks of several verdicts beside one another.

_OPEN_LOOP = "no loop is closed"

BETTER = "better"
WORSE = "worse"
SAME = "same"
MARKS = {BETTER: "▲", WORSE: "▼", SAME: "="}


@dataclass(frozen=True)
class CheckChange:
    """A value of the verdict in every run, against its limit.

    Attributes:
        row: of the verdict.
        checks: of each run; None where it has none.
    """

    row: str
    checks: tuple[Check | None, ...]

    @property
    def known(self) -> Check:
        """The first check there is."""
        return next(check for check in self.checks if check is not None)

    @property
    def quantity(self) -> str:
        """What is measured; where runs have several words for it, as too wide and too narrow, all of them."""
        return " / ".join(dict.fromkeys(check.quantity for check in self.checks if check is not None))

    @property
    def limit(self) -> str:
        """The limit in words; where runs have several, all of them."""
        texts = []
        for check in self.checks:
            if check is not None:
                bound = "at least" if check.at_least else "at most"
                texts.append(f"{bound} {self.number(check.limit)}")
        return " / ".join(dict.fromkeys(texts))

    @property
    def unit(self) -> str:
        """Unit of values and limits; empty for a ratio."""
        return self.known.unit

    def number(self, value: float) -> str:
        """Return a value without its unit."""
        return number_text(value, self.known.form)

    def value(self, run: int) -> float:
        """Return the value of a run, nan where it is unknown."""
        check = self.checks[run]
        return math.nan if check is None else check.value

    def cell(self, run: int) -> str:
        """Return the value of a run with its state as a shape."""
        check = self.checks[run]
        return NOTHING if check is None else f"{self.number(check.value)} {SYMBOLS[check.state]}"

    def change(self, run: int) -> float:
        """Return the value of a run less that of the first one."""
        return self.value(run) - self.value(0) if math.isfinite(self.value(run) - self.value(0)) else math.nan

    def judgement(self, run: int, against: int = 0) -> str:
        """Return `BETTER`, `WORSE` or `SAME` of a run against another, as shown; empty where one is unknown."""
        new = self.value(run)
        old = self.value(against)
        if math.isnan(new) or math.isnan(old):
            return ""
        if new == old or self.number(new - old) == "0":
            return SAME
        return BETTER if (new > old) == self.known.at_least else WORSE

    def change_text(self, run: int) -> str:
        """Return the change against the first run, and where the limit matters whether that is better or worse."""
        judgement = self.judgement(run)
        if not judgement:
            return NOTHING
        if judgement == SAME:
            return f"{MARKS[SAME]} {SAME}"
        size = number_text(self.change(run), f"+{self.known.form}")
        return f"{size} {MARKS[judgement]} {judgement}" if self.is_critical(run) else size

    def is_critical(self, run: int, against: int = 0) -> bool:
        """Return whether the limit matters to a run or to another: one of them does not pass it with a margin."""
        return any(check is not None and check.state != PASS for check in (self.checks[run], self.checks[against]))

    def content(self) -> dict[str, Any]:
        """Return the check of all runs for JSON."""
        return {
            "row": self.row,
            "name": self.known.name,
            "quantity": self.quantity,
            "unit": self.unit,
            "bound": "at least" if self.known.at_least else "at most",
            "limits": [None if check is None else finite(check.limit) for check in self.checks],
            "values": [finite(self.value(run)) for run in range(len(self.checks))],
            "states": [UNJUDGED if check is None else check.state for check in self.checks],
            "changes": [finite(self.change(run)) for run in range(len(self.checks))],
            "judgements": [self.judgement(run) or None for run in range(len(self.checks))],
        }


def compared_rows(verdict: Verdict) -> tuple[Row, ...]:
    """Return the rows of a verdict with the checks that may be compared with another run's.

    A machine that closes no loop, as of steppers alone, has an infinite gain margin and |S| = 1: no better loops, but
    none.
    """
    return tuple(Row(STABILITY, remark=_OPEN_LOOP) if _is_without_loop(row) else row for row in verdict.rows)


def _is_without_loop(row: Row) -> bool:
    return row.name == STABILITY and any(
        check.name == GAIN_MARGIN.name and math.isinf(check.value) for check in row.checks
    )


def check_changes(verdicts: Sequence[Verdict]) -> Iterator[CheckChange]:
    """Yield the checks of verdicts, row by row, in the order in which they come first."""
    rows_of_runs = [{row.name: row for row in compared_rows(verdict)} for verdict in verdicts]
    for row in dict.fromkeys(name for rows in rows_of_runs for name in rows):
        tables = [{check.name: check for check in rows[row].checks} for rows in rows_of_runs]
        for name in dict.fromkeys(name for table in tables for name in table):
            yield CheckChange(row, tuple(table.get(name) for table in tables))


# Every value of several runs beside one another.

_LEAST_PERCENT = 0.05
LARGE_CHANGE = 0.01  # share of a value from which a change of it is shown in a terminal


@dataclass(frozen=True)
class ValueChange:
    """A value in every run.

    Attributes:
        group: title of its group.
        quantity: the value.
        values: of each run in the quantity's unit; None where a run has none.
    """

    group: str
    quantity: Quantity[Any]
    values: tuple[float | None, ...]

    @property
    def is_large(self) -> bool:
        """Whether a run's value differs from the first one's by `LARGE`, as shown, or only one of them is known."""
        return any(map(self._differs, range(1, len(self.values))))

    def _differs(self, run: int) -> bool:
        change = self.change(run)
        if change is None:
            return self.texts[0] != self.texts[run]
        is_shown = number_text(change, self.quantity.form) != "0"
        return is_shown and abs(change) >= LARGE_CHANGE * abs(self.values[0] or 0.0)

    @property
    def texts(self) -> tuple[str, ...]:
        """The value of each run, without its unit."""
        return tuple(number_text(value, self.quantity.form) for value in self.values)

    def change(self, run: int) -> float | None:
        """Return the value of a run less that of the first one; None where either is unknown."""
        new = self.values[run]
        old = self.values[0]
        return None if new is None or old is None else new - old

    def change_text(self, run: int) -> str:
        """Return the change against the first run, and its share of that one's value."""
        change = self.change(run)
        old = self.values[0]
        if change is None or old is None:
            return NOTHING
        form = self.quantity.form if self.quantity.form.startswith("+") else f"+{self.quantity.form}"
        text = number_text(change, form)
        return with_share(text, change, old)


def with_share(text: str, change: float, value: float) -> str:
    """Return the text of a change with its share of a value, in percent with its sign, where that is not nothing.

    A value of less than two digits, as the text rounds, is nothing to take a share of.
    """
    percent = 100 * change / abs(value) if value else math.nan
    if text == "0" or not abs(percent) >= _LEAST_PERCENT:
        return text
    digit = 10.0 ** -len(text.partition(".")[2])
    if abs(value / change * float(text.replace(",", "").replace(MINUS, "-"))) < 10 * digit:
        return text
    return f"{text} ({number_text(percent, '+.1f' if abs(percent) < 10 else '+.0f')} %)"


def value_changes(results: Sequence[RunResults]) -> Iterator[ValueChange]:
    """Yield the values of runs, group by group; those that no run has are left out."""
    for group in GROUPS:
        tables = [_numbers(group, of_run) for of_run in results]
        quantities = {key: quantity for table in tables for key, (quantity, _) in table.items()}
        for key, quantity in quantities.items():
            values = tuple(table[key][1] if key in table else None for table in tables)
            if any(value is not None for value in values):
                yield ValueChange(group.title, quantity, values)


def _numbers(group: Group, results: RunResults) -> dict[str, tuple[Quantity[Any], float | None]]:
    subject = group.subject(results)
    if subject is None:
        return {}
    return {
        quantity.key: (quantity, quantity.content(quantity.get(subject))) for quantity in numbers_of(group.of(results))
    }
