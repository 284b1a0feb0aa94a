"""The answer of a run, as the page's first screen and the card give it: good enough, what spoils it, what to change."""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass
from difflib import SequenceMatcher
from itertools import groupby
from typing import Any, NamedTuple

from gantrysim.report.headline import cause_sentences, glue_sentences, headline
from gantrysim.results.checks import FAIL, NEAR_LIMIT, PASS, WARN, Row
from gantrysim.results.glue import ploughing_remedy
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import GLUE, PATH, Verdict

_QUOTES = '"""'  # around a text of several lines in TOML
_REPLIES = {PASS: "Yes", WARN: "Barely", FAIL: "No"}  # to whether a run is good enough
_UNKNOWN = "Not known"
_FEW_LINES = 3  # of the program that stay, and are shown in full
# of a line of the program
_SAME_LINE = "same"
_NEW = "new"


class MarkedLine(NamedTuple):
    """A line to paste.

    Attributes:
        text: the line.
        change: "same" for a line of the program that stays, "new" or what it was for another one; empty for a line of
            a table.
    """

    text: str
    change: str = ""

    @property
    def is_changed(self) -> bool:
        """Whether it is a line of the program that the former text does not have."""
        return self.change not in ("", _SAME_LINE)


@dataclass(frozen=True)
class Remedy:
    """What to change in a job, and what is gained by it.

    Attributes:
        change: what to change, in words.
        outcome: the verdict on the changed job, its time and its cost, in words.
        lines: to paste into the job's file, or a command line; empty where nothing is to be changed.
        options: for the command line, after those with which the job was loaded; none where they cannot express it.
        sentence: whether the verdict is then a pass, and what remains otherwise.
        former: the program's text without the changes, where the lines hold a changed one.
    """

    change: str
    outcome: str = ""
    lines: str = ""
    options: tuple[str, ...] = ()
    sentence: str = ""
    former: str = ""

    def content(self) -> dict[str, Any]:
        """Return it for JSON; the former text stays in the job."""
        return {name: value for name, value in asdict(self).items() if name != "former"}

    @property
    def marked_lines(self) -> list[MarkedLine]:
        """The lines; those of the program are compared with the former text."""
        lines = self.lines.rstrip().split("\n")
        marked = [MarkedLine(line) for line in lines]
        if not self.former or not any(line.endswith(_QUOTES) for line in lines):
            return marked
        first = next(k for k, line in enumerate(lines) if line.endswith(_QUOTES)) + 1
        after = next((k for k in range(first, len(lines)) if lines[k].endswith(_QUOTES)), len(lines))
        former = self.former.rstrip().split("\n")
        matcher = SequenceMatcher(None, former, lines[first:after], autojunk=False)
        for kind, was_begin, was_end, begin, end in matcher.get_opcodes():
            for k in range(begin, end):
                was = was_begin + k - begin
                if kind == "equal":
                    change = _SAME_LINE
                elif kind == "replace" and was < was_end:
                    change = f"was {former[was].strip()}"
                else:
                    change = _NEW
                marked[first + k] = MarkedLine(lines[first + k], change)
        return marked

    @property
    def groups(self) -> list[tuple[bool, list[MarkedLine]]]:
        """The lines in groups of which each is either shown, or stands for lines of the program that stay."""
        grouped = [
            (stays, list(lines)) for stays, lines in groupby(self.marked_lines, lambda line: line.change == _SAME_LINE)
        ]
        return [(stays and len(lines) > _FEW_LINES, lines) for stays, lines in grouped]


@dataclass(frozen=True)
class AnswerRow:
    """A row of the verdict in a line.

    Attributes:
        state: "pass", "warn", "fail" or "not judged".
        symbol: the state as a shape.
        name: of the row.
        text: its worst value and limit, or its remark.
        place: where that is, in words; empty where it is unknown.
        also: what else does not pass, or why a value within its limit warns.
    """

    state: str
    symbol: str
    name: str
    text: str
    place: str = ""
    also: str = ""


@dataclass(frozen=True)
class Answer:
    """Whether a run is good enough, what spoils it, and what to change.

    Attributes:
        state: of the verdict.
        headline: the verdict in a line.
        rows: path, glue, stability and machine.
        spoilt: what spoils the run, in sentences; empty for a run that passes.
        remedy: what to change; None where it has not been looked for.
        title: the verdict in a few words, without its symbol.
        also_spoilt: what spoils the other one of path and glue where both do not pass.
    """

    state: str
    headline: str
    rows: tuple[AnswerRow, ...]
    spoilt: str = ""
    remedy: Remedy | None = None
    title: str = ""
    also_spoilt: str = ""

    @property
    def reply(self) -> str:
        """The verdict as the reply to whether the run is good enough."""
        is_judged = self.state != WARN or any(row.state == WARN for row in self.rows)
        return f"{_REPLIES[self.state] if is_judged else _UNKNOWN} – {self.title}"

    @classmethod
    def of(cls, results: RunResults, remedy: Remedy | None = None) -> Answer:
        """Return the answer of a run, with what a search for changes has found."""
        verdict = results.verdict
        rows = () if verdict.unjudged else tuple(map(_row, verdict.rows))
        if remedy is None and verdict.state == PASS:
            remedy = Remedy("Nothing: every value keeps its limit.")
        title = verdict.headline.partition(" ")[2]
        if verdict.unjudged:
            title = f"{verdict.state}: {'fault' if verdict.fault else 'errors not known'}"
        spoilt = _spoilt(results)
        if remedy is not None:
            spoilt = without_order(spoilt, verdict)
        return cls(verdict.state, verdict.headline, rows, spoilt, remedy, title, _also_spoilt(results))


def without_order(spoilt: str, verdict: Verdict) -> str:
    """Return what spoils a run without what to do about it by hand, as what to change is told beside it."""
    order = "" if verdict.worst_row is None else ploughing_remedy(verdict.worst_row)
    return spoilt.replace(f": {order}", "") if order else spoilt


def _row(row: Row) -> AnswerRow:
    worst = row.worst_check or next(iter(row.checks), None)
    if worst is None or row.fails_without_check:
        return AnswerRow(row.state, row.symbol, row.name, row.remark)
    others = [check.brief for check in row.checks if check is not worst and check.state == FAIL]
    also = f"also {'; '.join(others)}" if others else ""
    if row.state == WARN:
        bound = f"below {100 / NEAR_LIMIT:g}" if worst.at_least else f"above {100 * NEAR_LIMIT:g}"
        share = 100 / worst.usage if worst.at_least else 100 * worst.usage
        also = f"{share:.0f} % of its limit: warns {bound} %"
    return AnswerRow(row.state, row.symbol, row.name, worst.brief, worst.place.brief, also)


def _spoilt(results: RunResults) -> str:
    """Return what spoils a run, in sentences."""
    row = results.verdict.worst_row
    if results.verdict.unjudged:
        return results.verdict.unjudged
    if row is None:
        return _nearest(results.verdict)
    if results.verdict.disturbances:
        return headline(results)
    if sentences := _causes_of(row, results):
        return f"{row.name.capitalize()}: {_lowered_first_letter(sentences)}"
    if row.name == PATH:
        # without its causes, where on the chain it lies
        return headline(results)
    check = row.worst_check
    if check is None:
        return f"{row.remark[0].upper()}{row.remark[1:]}."
    where = f": {check.place}" if str(check.place) else ""
    return f"{check.brief[0].upper()}{check.brief[1:]}{where}."


def _nearest(verdict: Verdict) -> str:
    """Return that nothing spoils a run that passes, and what comes nearest to its limit."""
    row = max(verdict.rows, key=lambda row: row.severity)
    check = next((check for check in row.checks if check.state == PASS), None)
    if check is None:
        return "Nothing."
    share = 100 / check.usage if check.at_least else 100 * check.usage
    return f"Nothing. Nearest to its limit: {row.name}, {check.measured}, {share:.0f} % of the limit."


def _also_spoilt(results: RunResults) -> str:
    """Return what spoils the better one of path and glue, where it is as bad a state; empty where it is unknown."""
    verdict = results.verdict
    worst = verdict.worst_row
    if worst is None or verdict.unjudged or verdict.disturbances:
        return ""
    rows = [row for row in verdict.rows if row.name in (PATH, GLUE) and row.state == worst.state and row is not worst]
    causes = {row.name.capitalize(): _causes_of(row, results) for row in rows}
    return " ".join(f"{name}: {_lowered_first_letter(text)}" for name, text in causes.items() if text)


def _lowered_first_letter(text: str) -> str:
    return f"{text[0].lower()}{text[1:]}"


def _causes_of(row: Row, results: RunResults) -> str:
    """Return the causes of path or glue in sentences; empty for another row, or where they are unknown."""
    if row.name == PATH and results.causes is not None:
        return " ".join(cause_sentences(results.causes, row.worst_check))
    return " ".join(glue_sentences(row, results.glue_causes)) if row.name == GLUE else ""


def written_on() -> str:
    """Return date and time of day in the local zone, as pages and cards show them.

    That of SOURCE_DATE_EPOCH, in UTC, where the variable is set: the same content then gives the same bytes.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    moment = time.gmtime(int(epoch)) if epoch.isdigit() else time.localtime()
    return time.strftime("%Y-%m-%d %H:%M", moment)
