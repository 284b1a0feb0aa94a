"""The result of `improve`: what each lever gains, their best combination, and the lines to paste."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import tomli_w

from gantrysim.base.display import Shown, table_html
from gantrysim.base.errors import InputError
from gantrysim.base.extras import extra
from gantrysim.base.quantity import NOTHING
from gantrysim.exchange.gains import DIALECTS, export_gains
from gantrysim.job.job import Job
from gantrysim.job.overrides import known_keys
from gantrysim.remedy.bounds import bound_of
from gantrysim.remedy.by_place import SpeedByPlace
from gantrysim.remedy.fastest import FastestProgram
from gantrysim.remedy.lever import Skipped, Trial, shown_gains
from gantrysim.remedy.outcome import Outcome
from gantrysim.remedy.wording import LAW, Keys, comment_of, notes_of_law, words_of
from gantrysim.results.checks import FAIL, PASS, Check, Row
from gantrysim.results.glue import ploughing_reason, ploughing_remedy
from gantrysim.results.score import row_burden, usage_of, usages_of
from gantrysim.results.verdict import Verdict

if TYPE_CHECKING:
    import pandas


# Lines to paste: what an improved job changes, as keys of a job file, options of a command, and controllers' words.

_PROGRAM = "program."
_LONGEST_VALUE = 60  # characters of a value on the command line
_VALUE_ROUNDS = 5  # in which values that follow from others are set as well
_SPEED_DIGITS = 12  # of an option --speed
_WHOLE_TABLE = "in place of the whole table, with its file"
_NONE: dict[str, Any] = {"travel": {}, "names": {}, "faults": []}  # what a job has without a table of them


def changed_values(base: Job, improved: Job) -> dict[str, Any]:
    """Return the values of an improved job that differ from those of the job, by the dotted keys of a job file."""
    before = _values(base)
    after = _values(improved)
    if "bead.gap" in before and "bead.gap" not in after:
        after["bead.gap"] = improved.built_machine.gap
    gone = {key: _NONE[key] for key in before if key not in after and key in _NONE}
    return {key: value for key, value in after.items() if key not in before or before[key] != value} | gone


def values_to_set(improved: Job, loaded: Callable[[dict[str, Any]], Job]) -> dict[str, Any] | None:
    """Return the values with which a job is loaded as the improved one; None where no values do that.

    What a job's file leaves open is chosen when it is loaded: the amount of glue for the needle, the place of the
    program, the travel of the machine. It may follow the values that are set, and what would then differ from the
    improved job is set as well.

    Args:
        improved: the improved job.
        loaded: loads the job with values by their dotted keys.
    """
    values: dict[str, Any] = {}
    for _ in range(_VALUE_ROUNDS):
        differing = changed_values(loaded(values), improved)
        if not differing:
            return values
        values |= differing
    return None


def toml_lines(base: Job, improved: Job) -> str:
    """Return the values to set in the job's file, as its tables; empty without any.

    They include the options with which the job was loaded. For a program file they are a whole job file.
    """
    values = values_to_set(improved, lambda values: base.loaded_with(values, in_file=True))
    if not values:
        return ""
    given = base.given
    head: dict[str, Any] = {}
    if given is not None and given.text_key in values:
        head = {f"{_PROGRAM}controller": improved.program["controller"]}
    elif given is not None and given.program_file:
        head = {f"{_PROGRAM}file": given.program_file}
        if given.controller is not None:
            head[f"{_PROGRAM}controller"] = given.controller
    lines = _tables(head | values, _comments(base, improved, values))
    if given is not None and given.program_file:
        return f'name = "{base.name}"\n{lines}'
    if f"{_PROGRAM}controller" not in head:
        return lines
    return lines.replace("[program]\n", f"[program]  # {_WHOLE_TABLE}\n", 1)


def _comments(base: Job, improved: Job, values: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return comments by keys: the first stands behind the key's line, others below it."""
    keys = Keys(base)
    comments = {key: [comment_of(keys, key, value)] for key, value in values.items() if "\n" not in str(value)}
    if LAW in comments:
        comments[LAW] += notes_of_law(base, improved)
    return comments


def _tables(values: Mapping[str, Any], comments: Mapping[str, Sequence[str]]) -> str:
    tables: dict[str, list[str]] = {}
    # keys without a table come first
    for key, value in sorted(values.items(), key=lambda item: "." in item[0]):
        table, _, leaf = key.rpartition(".")
        is_text = isinstance(value, str) and "\n" in value
        text = tomli_w.dumps({leaf: value}, multiline_strings=True) if is_text else f"{leaf} = {_inline(value)}\n"
        first, *others = comments.get(key) or [""]
        text = f"{text.rstrip()}  # {first}\n" if first else text
        tables.setdefault(table, []).extend([text, *(f"# {other}\n" for other in others)])
    return "\n".join("".join([f"[{table}]\n" if table else "", *lines]) for table, lines in tables.items())


def options(base: Job, improved: Job) -> list[str]:
    """Return the values to set as options of a command of gantrysim, after those with which the job was loaded.

    Speeds inside a program's text are one option --speed. None where a text differs in more than speeds.
    """
    values = values_to_set(improved, lambda values: base.loaded_with(values))
    speed: float | None = None
    # which sets the speed after all values
    is_at_speed = base.given is not None and base.given.speed is not None
    if values is None or is_at_speed or any(map(_is_long, values.values())):
        speed = float(f"{improved.controller.programmed_speed:.{_SPEED_DIGITS}g}")
        values = values_to_set(improved, lambda values: base.loaded_with(values, speed=speed))
        if values is None or any(map(_is_long, values.values())):
            return []
    words = [] if speed is None else [f"--speed {speed:.{_SPEED_DIGITS}g}"]
    return words + [f"--set {key}={_quoted_word(_inline(value))}" for key, value in values.items()]


def _is_long(value: Any) -> bool:
    """Return whether a value is a text of lines, or too long to be typed."""
    return len(_inline(value)) > _LONGEST_VALUE or "\n" in str(value)


def controller_words(base: Job, improved: Job) -> str:
    """Return the improved gains in the words of the job's controller, or a note on what it has no word for.

    Empty where the gains are those of the job, or the words cannot express those either.
    """
    advance = improved.controller.advance_words
    if advance and advance != base.controller.advance_words:
        return f"{advance}  ; at the program's begin, or in the firmware's configuration\n"
    name = str(improved.program["controller"]).split(".")[0]
    if name not in DIALECTS or base.built_servo == improved.built_servo:
        return ""
    try:
        export_gains(name, base.built_machine.axes, base.built_servo)
    except InputError:  # the words cannot express the job as it is, whatever changes
        return ""
    try:
        text, notes = export_gains(name, improved.built_machine.axes, improved.built_servo)
    except InputError as error:
        return f"{error}\n"
    return text + "".join(f"note: {note}\n" for note in notes)


def _values(job: Job) -> dict[str, Any]:
    """Return the values of a job by the dotted keys of its file."""
    content = tomllib.loads(job.toml())
    content.pop("source", None)  # a name for messages
    return _flat(content, set(known_keys(content, allow_code=True)))


def _flat(content: Mapping[str, Any], keys: Set[str], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their dotted keys; a table without keys of its own stays whole."""
    values: dict[str, Any] = {}
    for name, value in content.items():
        key = f"{prefix}{name}"
        is_value = key in keys and not any(other.startswith(f"{key}.") for other in keys)
        if isinstance(value, Mapping) and not is_value:
            values |= _flat(value, keys, f"{key}.")
        else:
            values[key] = value
    return values


def _inline(value: Any) -> str:
    """Return a value as TOML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name} = {_inline(item)}" for name, item in value.items()) + "}"
    text = tomli_w.dumps({"v": value}).removeprefix("v = ").strip()
    return " ".join(text.split()).replace("[ ", "[").replace(", ]", "]").replace(" ]", "]")


def _quoted_word(text: str) -> str:
    """Return a word for a shell."""
    return f"'{text}'" if set(text) & set(" []\"'{}$") else text


AS_IT_IS = "unchanged"
# of a failing value, by which a change that is told as its remedy lowers it; likewise where its limit is 0
_LOWERED_SHARE = 0.05
_LOWERED_TO_ZERO = 0.5
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
        note: how far the improved job's run is from that of the search, which the compiled loop made; empty where they
            agree.
        by_place: the program with a speed for each stretch, or why there is none; None where it was not looked for. It
            is a program of its own: `job`, `after` and `lines` do not have its speeds.
    """

    base: Job
    before: Outcome
    trials: tuple[Trial, ...]
    skipped: tuple[Skipped, ...]
    combination: tuple[Trial, ...]
    after: Outcome
    job: Job
    fastest: FastestProgram | None = None
    note: str = ""
    by_place: SpeedByPlace | str | None = None

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
            return "The run ends in a fault: no lever is tried before that is repaired."
        if self.before.burden == 0 and not self.combination:
            return f"nothing to change: the verdict is {self.verdict.state}."
        names = self.words_of(self.by_worst_value)
        if self.after.burden == 0:
            return f"passes with {names}."
        if missed := self._missed:
            return missed
        begin = f"best with {names}" if names else "no lever helps"
        worst = max(self.improved.rows, key=row_burden)
        reach = "nothing meets the tolerance" if worst.state == FAIL else "no combination leaves a 20 % margin"
        remains = f"{begin}; {reach}: {worst.name} still {'fails' if worst.state == FAIL else 'warns'}"
        # then the row says itself what it lacks, as dots that get no glue
        if worst.fails_without_check or not worst.checks:
            return f"{remains}, {worst.remark}."
        reason = ploughing_reason(worst)
        bound = reason or f"what forbids it is {bound_of(self.job, worst.name)}"
        return f"{remains}, {worst.checks[0].brief}. {bound[0].upper()}{bound[1:]}."

    def words_of(self, trials: Sequence[Trial]) -> str:
        """Return levers of the combination in words, each with its values before and after."""
        return words_of(trials, self.base, self.job)

    @property
    def lowers_worst_value(self) -> bool:
        """Whether the combination lowers the worst value, or there is none."""
        row = self.verdict.worst_row
        check = self.verdict.worst_check
        return row is None or check is None or _lowers(check, row.name, check.value, self.improved)

    @property
    def by_hand(self) -> str:
        """What still fails with the combination, and what to do about it by hand; empty where nothing fails."""
        row = max(self.improved.rows, key=row_burden)
        if row.state != FAIL:
            return ""
        if row.fails_without_check or not row.checks:
            return row.remark
        return ploughing_reason(row) or f"what forbids it is {bound_of(self.job, row.name)}"

    @property
    def _missed(self) -> str:
        """What to do about the worst value where no lever lowers it, and what the levers do; empty where one does."""
        row = self.verdict.worst_row
        check = self.verdict.worst_check
        if row is None or check is None or self.lowers_worst_value:
            return ""
        order = ploughing_remedy(self.improved[row.name])
        what = order or f"what forbids it is {bound_of(self.job, row.name)}"
        text = f"no lever cures {check.label or check.quantity}: {what}."
        others: dict[str, str] = {}
        for gain in shown_gains(self.verdict, self.improved):
            if gain.quantity != check.quantity and self.verdict[gain.row].state != PASS and gain.is_better:
                # the worst one of a row tells enough
                others.setdefault(gain.row, f"{gain.quantity} {gain.text}")
        if not others or not self.combination:
            return text
        names = self.words_of(self.combination)
        verb = "are" if len(self.combination) > 1 else "is"
        return f"{text} {names[0].upper()}{names[1:]} {verb} for what else fails: {', '.join(others.values())}."

    @property
    def by_worst_value(self) -> list[Trial]:
        """The levers of the combination, those first that lower the worst value."""
        row = self.verdict.worst_row
        check = self.verdict.worst_check
        if row is None or check is None:
            return list(self.combination)
        first = []
        value = check.value
        for trial in self.combination:
            verdict = trial.outcome.verdict
            now = None if verdict is None else _same_check(check, row.name, verdict)
            if verdict is not None and _lowers(check, row.name, value, verdict):
                first.append(trial)
            value = value if now is None else now.value
        return [*first, *(trial for trial in self.combination if trial not in first)]

    @property
    def by_place_sentence(self) -> str:
        """The result with speeds by place in a sentence; empty where none were looked for."""
        if self.by_place is None:
            return ""
        return f"no speed by place: {self.by_place}" if isinstance(self.by_place, str) else str(self.by_place)

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
    def untried_levers(self) -> dict[str, str]:
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
        return (name, trial.setting, *usages, f"{trial.outcome.duration:.2f}", trial.cost)

    @property
    def gains(self) -> list[str]:
        """What the improved job gains in each row, in words."""
        lines = []
        for gain in shown_gains(self.verdict, self.after.verdict):
            if not gain.quantity:
                continue
            lines.append(f"{gain.row}: {gain.quantity} {gain.text}")
        lines.append(f"time: {self.before.duration:.2f} → {self.after.duration:.2f} s")
        return lines

    def facts(self) -> dict[str, str]:
        facts = {"before": self.verdict.headline, "after": self.improved.headline, "what to change": self.sentence}
        facts |= {"note": self.note} if self.note else {}
        facts |= {"speed by place": self.by_place_sentence} if self.by_place is not None else {}
        return facts | ({} if self.fastest is None else {"fastest": str(self.fastest)})

    def __str__(self) -> str:
        texts = [f"before: {self.verdict.headline}", self.sentence]
        if self.changes_anything:
            texts += [f"after: {self.improved.headline}", *self.gains]
        if self.fastest is not None:
            texts.append(str(self.fastest))
        if self.note:
            texts.append(self.note)
        if self.by_place is not None:
            texts.append(self.by_place_sentence)
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


def _same_check(check: Check, row: str, verdict: Verdict) -> Check | None:
    return next((same for same in verdict[row].checks if same.name == check.name), None)


def _lowers(check: Check, row: str, value: float, after: Verdict) -> bool:
    """Return whether a failing check keeps its limit afterwards, or comes nearer to it than a value."""
    now = _same_check(check, row, after)
    if check.state != FAIL or now is None or now.state != FAIL:
        return True
    gained = now.value - value if check.at_least else value - now.value
    return gained > (_LOWERED_SHARE if check.limit else _LOWERED_TO_ZERO) * abs(value)


def _usages(verdict: Verdict | None, rows: int = 0) -> list[str]:
    """Return the share of the limits that the worst check of each row uses, as text."""
    if verdict is None or verdict.unjudged:
        return [NOTHING] * (rows or len(verdict.rows if verdict is not None else ()))
    return [_usage(row) for row in verdict.rows]


def _usage(row: Row) -> str:
    """Return the share of its limit that a row's worst check uses; where that has no bound, the next one's too."""
    if row.fails_without_check:
        return row.state
    usage = usage_of(row)
    if math.isnan(usage):
        return NOTHING
    if math.isfinite(usage):
        return f"{100 * usage:.0f} %"
    finite = [other for other in usages_of(row) if math.isfinite(other)]
    return f"∞, {100 * max(finite):.0f} %" if finite else "∞"


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
