"""A lever: something that a user can change in a job, with its settings, its cost, and where it does not apply.

A trial is a lever that was simulated with a setting: its outcome, and what it gains in each row of the verdict.
The numbers of settings have few digits, and factors are given as text.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Any

from gantrysim.base.quantity import number_text
from gantrysim.job.job import Job
from gantrysim.remedy.outcome import Outcome
from gantrysim.results.checks import PASS, UNJUDGED, Check, Row
from gantrysim.results.score import usage_of
from gantrysim.results.verdict import GLUE, MACHINE, PATH, STABILITY, Verdict

ROWS = (PATH, GLUE, STABILITY, MACHINE)
FREE = "none"  # cost of a lever
GAIN_ARROW = " → "  # from a value to that after a change
_DIGITS = 4  # of a setting's number
_FACTOR_SIGN = "× "  # before a factor


class Effort(IntEnum):
    """What a lever takes; cheaper levers are combined first."""

    SETTING = 0  # another value in the controller or the drive
    PROCESS = 1  # cycle time, or another shape of the bead
    HARDWARE = 2  # another part of the machine


@dataclass(frozen=True)
class Setting:
    """A value of a lever.

    Attributes:
        label: in a few words, unique within the lever; empty where there is only one.
        changes: values of the job by their full dotted keys, as `Job.changed` takes them.
    """

    label: str
    changes: Mapping[str, Any]


@dataclass(frozen=True)
class State:
    """A job for which a lever is set.

    Attributes:
        job: the job.
        measure: simulates it; called where a lever asks for what the job does, at most once.
    """

    job: Job
    measure: Callable[[Job], Outcome] = field(repr=False)

    @cached_property
    def outcome(self) -> Outcome:
        """Verdict on the job, and what else its run shows."""
        return self.measure(self.job)


@dataclass(frozen=True)
class Lever:
    """Something that can be changed.

    Attributes:
        name: in a word or two.
        meaning: what it changes.
        cost: what it costs, in words.
        cost_above: what a factor above 1 costs; empty where that is `cost`.
        rows: of the verdict on which it acts.
        settings: returns the settings to try for a job, or the reason why the lever does not apply to it.
        causes: names of the causes of error against which it helps; it is tried where one of them matters, and
            always without any.
        effort: what it takes.
    """

    name: str
    meaning: str
    cost: str
    rows: tuple[str, ...]
    settings: Callable[[State], Sequence[Setting] | str] = field(repr=False)
    causes: tuple[str, ...] = ()
    effort: Effort = Effort.SETTING
    cost_above: str = ""

    def cost_of(self, label: str) -> str:
        """Return what a setting costs, by its label."""
        is_above = label.startswith(_FACTOR_SIGN) and float(label.removeprefix(_FACTOR_SIGN)) > 1
        return self.cost_above if is_above and self.cost_above else self.cost


def rounded_number(value: float) -> float:
    """Return a number of at most four significant digits, as people type it."""
    return float(f"{value:.{_DIGITS}g}")


def factor_text(factor: float) -> str:
    """Return a factor as text, such as "× 0.5"."""
    return f"{_FACTOR_SIGN}{factor:g}"


def milliseconds(seconds: float) -> str:
    """Return a time as text, such as "25 ms"."""
    return f"{1e3 * seconds:.4g} ms"


def value_of(arguments: Mapping[str, Any], dotted: str) -> Any:
    """Return the argument with a dotted name, None where there is none."""
    value: Any = arguments
    for part in dotted.split("."):
        if not isinstance(value, Mapping) or part not in value:
            return None
        value = value[part]
    return value


def scaled_numbers(value: Any, factor: float) -> Any:
    """Return a number, or the numbers of a list, times a factor; None for anything else."""
    if isinstance(value, list | tuple):
        items = [scaled_numbers(item, factor) for item in value]
        return None if None in items else items
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return rounded_number(float(value) * factor)


@dataclass(frozen=True)
class Gain:
    """What a change of the job does to a row of the verdict.

    Attributes:
        row: its name.
        quantity: of a check of it.
        unit: of its values.
        form: format of its values.
        at_least: whether its value must be at least its limit.
        before, after: values of that check; nan where it is unknown.
        usage_before, usage_after: share of the limit that the row's worst check uses.
        state: of the row, after.
        quantity_after: of the check after the change, where it is another, as too wide for too narrow.
    """

    row: str
    quantity: str = ""
    unit: str = ""
    form: str = ".1f"
    at_least: bool = False
    before: float = math.nan
    after: float = math.nan
    usage_before: float = math.nan
    usage_after: float = math.nan
    state: str = UNJUDGED
    quantity_after: str = ""

    @property
    def is_better(self) -> bool:
        """Whether the value is nearer to passing, or passes by more, afterwards."""
        return self.after > self.before if self.at_least else self.after < self.before

    @property
    def text(self) -> str:
        """Both values with their unit."""
        unit = f" {self.unit}" if self.unit else ""
        before, after = (number_text(value, self.form) for value in (self.before, self.after))
        if self.quantity_after:
            return f"{before}{unit}{GAIN_ARROW}{self.quantity_after} {after}{unit}"
        return f"{before}{GAIN_ARROW}{after}{unit}"


def gains_of(before: Verdict, after: Verdict | None) -> tuple[Gain, ...]:
    """Return what a change does to the worst check of each row; after is None for a job that is refused."""
    return tuple(_gain(row, row.checks[0] if row.checks else None, after) for row in before.rows)


def shown_gains(before: Verdict, after: Verdict | None) -> list[Gain]:
    """Return what a change does to the worst check of each row, and to the others that do not pass."""
    return [
        _gain(row, check, after)
        for row in before.rows
        for k, check in enumerate(row.checks)
        if k == 0 or check.state != PASS
    ]


def _gain(row: Row, check: Check | None, after: Verdict | None) -> Gain:
    gain = Gain(row.name, usage_before=usage_of(row))
    if check is not None:
        gain = replace(
            gain,
            quantity=check.quantity,
            unit=check.unit,
            form=check.form,
            at_least=check.at_least,
            before=check.value,
        )
    if after is None or after.unjudged:
        return gain
    changed = after[row.name]
    same = None if check is None else _check(changed, check.name)
    if same is not None:
        other = "" if same.quantity == gain.quantity else same.quantity
        gain = replace(gain, after=same.value, quantity_after=other)
    return replace(gain, usage_after=usage_of(changed), state=changed.state)


def _check(row: Row, name: str) -> Check | None:
    return next((check for check in row.checks if check.name == name), None)


@dataclass(frozen=True)
class Trial:
    """A lever with a setting, simulated.

    Attributes:
        lever: the lever.
        setting: its label.
        changes: values of the job by their dotted keys.
        outcome: of the run with them.
        gains: in the rows of the verdict, compared with the job as it is.
        time: by which the run is longer [s].
    """

    lever: Lever
    setting: str
    changes: Mapping[str, Any]
    outcome: Outcome
    gains: tuple[Gain, ...]
    time: float

    @property
    def failure(self) -> str:
        """Why there is no complete run; empty where there is one."""
        return self.outcome.failure

    @property
    def cost(self) -> str:
        """What it costs, in words."""
        return self.lever.cost_of(self.setting)


@dataclass(frozen=True)
class Skipped:
    """A lever that was not tried.

    Attributes:
        lever: the lever.
        reason: why not.
    """

    lever: Lever
    reason: str
