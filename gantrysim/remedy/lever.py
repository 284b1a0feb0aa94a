"""A lever: something that a user can change in a job, with its settings, its cost, and where it does not apply.

The numbers of settings have few digits, and factors are given as text.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Any

from gantrysim.job.job import Job
from gantrysim.remedy.outcome import Outcome
from gantrysim.results.verdict import GLUE, MACHINE, PATH, STABILITY

ROWS = (PATH, GLUE, STABILITY, MACHINE)
FREE = "none"  # cost of a lever
_DIGITS = 4  # of a setting's number
_TIMES = "× "  # before a factor


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
        is_above = label.startswith(_TIMES) and float(label.removeprefix(_TIMES)) > 1
        return self.cost_above if is_above and self.cost_above else self.cost


def rounded_number(value: float) -> float:
    """Return a number of at most four significant digits, as people type it."""
    return float(f"{value:.{_DIGITS}g}")


def factor_text(factor: float) -> str:
    """Return a factor as text, such as "× 0.5"."""
    return f"{_TIMES}{factor:g}"


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
