"""What to change in a job as a section of a report, and the job before and after beside one another."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gantrysim.base.errors import InputError
from gantrysim.base.quantity import number_text
from gantrysim.compare.runs.differences import check_changes
from gantrysim.compare.runs.runs_page import (
    RunComparison,
    checks_table,
    compare_runs,
    limits_figure,
    run_sections,
    write_sections,
)
from gantrysim.job.job import Job
from gantrysim.remedy.by_place import SpeedByPlace
from gantrysim.remedy.improve import improve, worst_rows
from gantrysim.remedy.improvement import USAGE, Improvement, options
from gantrysim.remedy.lever import FREE, GAIN_ARROW
from gantrysim.remedy.outcome import Outcome
from gantrysim.report.answer import Remedy
from gantrysim.report.document import Changes, Section, Table, lead_of
from gantrysim.results.checks import FAIL, PASS, Check
from gantrysim.results.verdict import Verdict
from gantrysim.study.acceptance import improve_command

TITLE = "What to change"
NAMES = ("before", "after")


def changes_of(job: Job, verdict: Verdict) -> Changes | None:
    """Return what to change for the two worst rows of the verdict on a job's run.

    None for a verdict that is a pass, and for a run with faults, whose cause is known.
    """
    if verdict.state == PASS or verdict.unjudged or job.faults:
        return None
    return found_changes(improve(job, rows=worst_rows(Outcome(verdict)), fastest=False, by_place=False))


def found_changes(improvement: Improvement) -> Changes:
    """Return what to change, for a run's page."""
    return Changes(remedy_of(improvement), change_section(improvement))


def change_section(improvement: Improvement) -> Section:
    """Return the section "What to change": the result, the levers combined, lines to paste, and each lever alone.

    Where anything is changed, the checks of both verdicts stand beside one another, as in `gantrysim compare`.
    """
    texts = [improvement.sentence]
    if improvement.fastest is not None:
        texts.append(f"{improvement.fastest}.")
    if improvement.note:
        texts.append(improvement.note)
    if improvement.by_place is not None:
        texts.append(_caption(f"{improvement.by_place_sentence}."))
    tables = []
    if improvement.combination:
        rows = [improvement.rows[0], *improvement.combined_rows]
        tables.append(Table(improvement.heads, rows, _caption(f"{USAGE}; each lever with those before it")))
    if improvement.changes_anything:
        # the time, which is no check
        texts.append(_caption(f"{improvement.gains[-1]}."))
        checks = checks_table(NAMES, tuple(check_changes([improvement.verdict, improvement.improved])))
        tables += [] if checks is None else [checks]
    if isinstance(improvement.by_place, SpeedByPlace):
        by_place = improvement.by_place
        tables.append(Table(by_place.heads, by_place.cells, "Speed by place", folded="Speed by place"))
    if improvement.trials:
        rows = [improvement.rows[0], *improvement.trial_rows]
        title = f"Each lever alone: {len(improvement.trials)} runs"
        tables.append(Table(improvement.heads, rows, _caption(USAGE), folded=title))
    texts += [f"Not tried, as {reason}: {names}." for reason, names in improvement.untried_levers.items()]
    lines = "\n".join(f"# {place}\n{text.rstrip()}\n" for place, text in improvement.lines.items())
    return Section(TITLE, texts, table=tables or None, code=lines or None)


def remedy_of(improvement: Improvement) -> Remedy:
    """Return what to change for the first screen: the levers, the lines to paste, and the verdict that they lead to."""
    if not improvement.changes_anything:
        return Remedy(_caption(improvement.sentence), sentence=improvement.sentence)
    after = improvement.improved
    costs = "; ".join(dict.fromkeys(trial.cost for trial in improvement.combination if trial.cost != FREE))
    before, now = (f"{outcome.duration:.2f}" for outcome in (improvement.before, improvement.after))
    time = f"time {now} s as before" if before == now else f"time {before}{GAIN_ARROW}{now} s"
    by_place = improvement.by_place
    if isinstance(by_place, SpeedByPlace) and by_place.outcome.duration < improvement.after.duration:
        command = f"{improve_command(improvement.base)} --out FOLDER"
        time = f"{time}, or {by_place.outcome.duration:.2f} s with a speed for each stretch ({command})"
    outcome = "; ".join([after.headline, *_values(improvement), time])
    lines = improvement.lines
    return Remedy(
        _caption(_change(improvement)),
        f"{outcome}. Costs: {costs}." if costs else f"{outcome}.",
        lines.get("job file") or lines.get("command line", ""),
        tuple(options(improvement.base, improvement.job)),
        improvement.sentence,
        _former_text(improvement),
    )


def _change(improvement: Improvement) -> str:
    """Return the levers, and what must be done by hand: so no lever seems to cure what it does not."""
    names = improvement.words_of(improvement.by_worst_value)
    by_hand = improvement.by_hand
    if not by_hand:
        return f"{names}."
    if improvement.lowers_worst_value:
        return f"{names}. Not enough: {by_hand}."
    order = by_hand.rpartition(": ")[2]
    return f"{order}: no setting cures that. For the rest: {names}."


def _former_text(improvement: Improvement) -> str:
    """Return the program's text without the changes, where they are in it; empty otherwise."""
    key = improvement.base.controller.text_argument
    texts = [job.program.get(key) for job in (improvement.base, improvement.job)]
    former, now = (text if isinstance(text, str) else "" for text in texts)
    return former if former != now else ""


def _values(improvement: Improvement) -> Iterator[str]:
    """Yield values before and after the changes.

    They are the worst one of each row that was no pass, all that failed of a row that is still none, and whatever is no
    pass afterwards.
    """
    former = {row.name: {check.name: check for check in row.checks} for row in improvement.verdict.rows}
    worst = {(row.name, row.checks[0].name) for row in improvement.verdict.rows if row.checks and row.state != PASS}
    for row in improvement.improved.rows:
        for check in row.checks:
            before = former[row.name].get(check.name)
            is_worst = (row.name, check.name) in worst
            failed = row.state != PASS and before is not None and before.state == FAIL
            if is_worst or failed or check.state != PASS:
                # the limit of the worst one stands with the verdict
                yield _gain_text(before, check, has_limit=check.state != PASS and not is_worst)


def _gain_text(before: Check | None, after: Check, *, has_limit: bool) -> str:
    """Return a value before and after, with its limit where that is to be told."""
    unit = f" {after.unit}" if after.unit else ""
    limit = f"{'at least' if after.at_least else 'at most'} {number_text(after.limit, after.form)}{unit}"
    bound = f", {limit}" if has_limit else ""
    if before is None:
        return f"{after.measured}{bound}"
    if before.quantity != after.quantity:
        return f"{before.measured}{GAIN_ARROW}{after.measured}{bound}"
    values = [number_text(check.value, check.form) for check in (before, after)]
    if values[0] == values[1]:
        return f"{after.quantity} still {values[1]}{unit}{bound}"
    return f"{after.quantity} {GAIN_ARROW.join(values)}{unit}{bound}"


def _caption(text: str) -> str:
    return text[0].upper() + text[1:]


def comparison_of(improvement: Improvement) -> RunComparison | None:
    """Return the runs of the job before and after, simulated again; None where nothing is changed or a fault ends one.

    The runs of a search are not kept: each would hold its record in memory.
    """
    if not improvement.changes_anything or improvement.verdict.unjudged:
        return None
    runs = [job.run() for job in (improvement.base, improvement.job)]
    return compare_runs(*runs, names=NAMES)


def write_improvement(improvement: Improvement, folder: Path) -> Path:
    """Write report.html and compare.json into a folder: what to change, and the job before and after.

    Returns:
        The path of report.html.

    Raises:
        InputError: nothing is changed, so that there is nothing to compare; or the folder cannot be written.
    """
    comparison = comparison_of(improvement)
    if comparison is None:
        reason = " ".join(filter(None, (improvement.verdict.fault, improvement.sentence)))
        raise InputError(f"improve {improvement.base.name}: {reason} There is no run to compare with")
    title = f"What to change in {improvement.base.name}"
    sections = _sections(improvement, comparison)
    return write_sections(comparison, folder, title, sections)


def _sections(improvement: Improvement, comparison: RunComparison) -> Iterator[Section]:
    """Yield the sections of a comparison with what to change after the answer."""
    lead = _caption(lead_of(improvement.sentence))
    yield Section("Summary", lead, figure=limits_figure(comparison))
    yield change_section(improvement)
    _, *others = run_sections(comparison)
    yield from others
