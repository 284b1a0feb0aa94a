"""A lever that was tried: its setting, the run's outcome, and what it gains in each row of the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from gantrysim.base.quantity import number_text
from gantrysim.remedy.lever import Lever
from gantrysim.remedy.outcome import Outcome
from gantrysim.results.checks import PASS, UNJUDGED, Check, Row
from gantrysim.results.score import usage_of
from gantrysim.results.verdict import Verdict

GAIN_ARROW = " → "  # from a value to that after a change


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
