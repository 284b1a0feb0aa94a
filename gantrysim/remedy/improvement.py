"""The result of `improve`: what each lever gains, their best combination, and the lines to paste."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from gantrysim.base.display import Shown, table_html
from gantrysim.base.extras import extra
from gantrysim.base.quantity import NOTHING
from gantrysim.job.job import Job
from gantrysim.remedy.bound import bound_of
from gantrysim.remedy.fastest import FastestProgram
from gantrysim.remedy.outcome import Outcome
from gantrysim.remedy.paste import controller_words, options, toml_lines
from gantrysim.remedy.trial import Skipped, Trial, shown_gains
from gantrysim.results.checks import FAIL
from gantrysim.results.row import Row
from gantrysim.results.score import row_burden, usage_of, usages_of
from gantrysim.results.verdict import Verdict

if TYPE_CHECKING:
    import pandas

AS_IT_IS = "unchanged"
USAGE = "worst value of each row in % of its limit: above 80 % a warning, above 100 % a failure"
USAGE_NOTE = f"{USAGE}; = and + mark the best combination, each lever with those before it"


@dataclass(frozen=True, repr=False)
class Improvement(Shown):
    """What to change in a job.

    Attributes:
        base: the job as it is.
        before: what its run shows.
        trials: each lever with each of its settings, alone.
        skipped: levers that were not tried, with the reason.
        combination: the levers of the best combination in the order in which they joined; each trial has the outcome
            of all up to it.
        after: what the improved job's run shows; that of the job as it is where nothing helps.
        job: the improved job.
        fastest: the fastest program as good as the combination, which the improved job then runs; None where it was
            not looked for, or there is none.
    """

    base: Job
    before: Outcome
    trials: tuple[Trial, ...]
    skipped: tuple[Skipped, ...]
    combination: tuple[Trial, ...]
    after: Outcome
    job: Job
    fastest: FastestProgram | None = None

    @property
    def verdict(self) -> Verdict:
        """The verdict on the job as it is."""
        verdict = self.before.verdict
        assert verdict is not None
        return verdict

    @property
    def improved(self) -> Verdict:
        """The verdict on the improved job."""
        verdict = self.after.verdict
        assert verdict is not None
        return verdict

    @property
    def changes_anything(self) -> bool:
        """Whether the improved job differs from the job as it is."""
        return bool(self.combination) or self.fastest is not None

    @cached_property
    def sentence(self) -> str:
        """The result in a sentence or two."""
        if self.verdict.contradiction:
            return "No lever is tried: the errors of the run are not known."
        if self.verdict.fault:
            return f"{self.verdict.fault} The run ends in a fault: no lever is tried before that is repaired."
        if self.before.burden == 0 and not self.combination:
            return f"nothing to change: the verdict is {self.verdict.state}."
        names = names_of(self.combination)
        if self.after.burden == 0:
            return f"passes with {names}."
        begin = f"best with {names}" if names else "no lever helps"
        worst = max(self.improved.rows, key=row_burden).name
        check = self.improved[worst].checks[0] if self.improved[worst].checks else self.improved[worst].remark
        fails = self.improved[worst].state == FAIL
        reach = "nothing meets the tolerance" if fails else "no combination leaves a 20 % margin"
        return (
            f"{begin}; {reach}: {worst} remains, {check}. What forbids it is {bound_of(self.job, self.after, worst)}."
        )

    @property
    def lines(self) -> dict[str, str]:
        """Lines to paste by where they belong: the job file, the command line, and the controller."""
        if not self.changes_anything:
            return {}
        lines = {
            "job file": toml_lines(self.base, self.job),
            "command line": " ".join(options(self.base, self.job)),
            "controller": controller_words(self.base, self.job),
        }
        return {name: text for name, text in lines.items() if text}

    @property
    def untried(self) -> dict[str, str]:
        """Names of the levers that were not tried, by the reason."""
        names: dict[str, list[str]] = {}
        for skipped in self.skipped:
            names.setdefault(skipped.reason, []).append(skipped.lever.name)
        return {reason: ", ".join(levers) for reason, levers in names.items()}

    @property
    def heads(self) -> tuple[str, ...]:
        """Heads of the table of trials."""
        return ("lever", "setting", *(row.name for row in self.verdict.rows), "time [s]", "cost")

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table of trials, the job as it is first and the combination last, each with its share of the limits."""
        before = (AS_IT_IS, "", *_usages(self.verdict), f"{self.before.duration:.2f}", "")
        return [before, *self.trial_rows, *self.combined_rows]

    @property
    def trial_rows(self) -> list[tuple[str, ...]]:
        """The rows of levers alone."""
        return [self._cells(trial, trial.lever.name) for trial in self.trials]

    @property
    def combined_rows(self) -> list[tuple[str, ...]]:
        """The rows of the combination, each lever with those before it."""
        return [
            self._cells(trial, f"{'+ ' if k else '= '}{trial.lever.name}") for k, trial in enumerate(self.combination)
        ]

    def _cells(self, trial: Trial, name: str) -> tuple[str, ...]:
        usages = _usages(trial.outcome.verdict, len(self.verdict.rows))
        if trial.failure:
            return (name, trial.setting, *usages, NOTHING, trial.failure)
        return (name, trial.setting, *usages, f"{trial.outcome.duration:.2f}", trial.lever.cost)

    @property
    def gains(self) -> list[str]:
        """What the improved job gains in each row, in words."""
        lines = []
        for gain in shown_gains(self.verdict, self.after.verdict):
            if not gain.quantity:
                continue
            unit = f" {gain.unit}" if gain.unit else ""
            values = f"{format(gain.before, f'z{gain.form}')} → {_value(gain.after, gain.form)}{unit}"
            lines.append(f"{gain.row}: {gain.quantity} {values}")
        lines.append(f"time: {self.before.duration:.2f} → {self.after.duration:.2f} s")
        return lines

    def facts(self) -> dict[str, str]:
        facts = {"before": self.verdict.headline, "after": self.improved.headline, "what to change": self.sentence}
        return facts | ({} if self.fastest is None else {"fastest": str(self.fastest)})

    def __str__(self) -> str:
        texts = [f"before: {self.verdict.headline}", self.sentence]
        if self.changes_anything:
            texts += [f"after: {self.improved.headline}", *self.gains]
        if self.fastest is not None:
            texts.append(str(self.fastest))
        return "\n".join([*texts, *(f"{name}:\n{text.rstrip()}" for name, text in self.lines.items())])

    def _repr_html_(self) -> str:
        facts = table_html(f"What to change in {self.base.name}", (), list(self.facts().items()))
        return facts if len(self.rows) == 1 else facts + table_html(USAGE_NOTE, self.heads, self.rows)

    def to_frame(self) -> pandas.DataFrame:
        """Return a pandas DataFrame with a row per trial, and per lever of the combination.

        Columns name the lever and its setting, and give for each row of the verdict the value of its worst check before
        and after, the share of the limit used after, and the state; then the time of the run and by how much it is
        longer, and why there is no run.

        Raises:
            InputError: pandas is not installed.
        """
        with extra("tables", "Improvement.to_frame"):
            import pandas
        records = [_record(trial, combined=False) for trial in self.trials]
        records += [_record(trial, combined=True) for trial in self.combination]
        return pandas.DataFrame(records)


def _usages(verdict: Verdict | None, rows: int = 0) -> list[str]:
    """Return the share of the limits that the worst check of each row uses, as text."""
    if verdict is None or verdict.unjudged:
        return [NOTHING] * (rows or len(verdict.rows if verdict is not None else ()))
    return [_usage(row) for row in verdict.rows]


def _usage(row: Row) -> str:
    """Return the share of its limit that a row's worst check uses; where that has no bound, the next one's too."""
    usage = usage_of(row)
    if math.isnan(usage):
        return NOTHING
    if math.isfinite(usage):
        return f"{100 * usage:.0f} %"
    finite = [other for other in usages_of(row) if math.isfinite(other)]
    return f"∞, {100 * max(finite):.0f} %" if finite else "∞"


def _value(value: float, form: str) -> str:
    return NOTHING if math.isnan(value) else format(value, f"z{form}")


def _record(trial: Trial, *, combined: bool) -> dict[str, Any]:
    record: dict[str, Any] = {"lever": trial.lever.name, "setting": trial.setting, "combined": combined}
    for gain in trial.gains:
        record |= {
            f"{gain.row}_before": gain.before,
            f"{gain.row}_after": gain.after,
            f"{gain.row}_usage": gain.usage_after,
            f"{gain.row}_state": gain.state,
        }
    return record | {"duration_s": trial.outcome.duration, "longer_by_s": trial.time, "failure": trial.failure}


def names_of(trials: Sequence[Trial]) -> str:
    """Return levers with their settings, in words."""
    return ", ".join(f"{trial.lever.name} ({trial.setting})" if trial.setting else trial.lever.name for trial in trials)
