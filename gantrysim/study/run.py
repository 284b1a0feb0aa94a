"""Run a study: check its job, run its cases in rounds, and write its folder whole."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, is_dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import tomli_w

from gantrysim.base.errors import GantryError, InputError, text_of
from gantrysim.base.files import ReplacedError
from gantrysim.engine.simulate import simulate
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.report.document import Section, Table, lead_of
from gantrysim.report.drawn_page import write_page
from gantrysim.report.folder import JOB, PLOTS, REPORT, Output
from gantrysim.report.summary import versions
from gantrysim.study.cases import OK, Case, Row, forget_jobs, is_fault
from gantrysim.study.ledger import Ledger, TaggedRows
from gantrysim.study.runner import Progress, run_cases
from gantrysim.study.study import Plot, Report, Rounds, Study

# The page of a study or a tuning: answer, chart and table, then folded details.


def page_sections(report: Report, origin: Iterable[Section] = ()) -> list[Section]:
    """Return the sections of a report's page, whose title is the question: a sentence, a chart, and what they rest on.

    Args:
        report: to show.
        origin: sections on the cases and the job, the last of the details.
    """
    lead = lead_of(report.answer)
    first = [Section("Answer", lead)]
    details = []
    if report.chart is not None:
        # the tables of the chart are details: the answer has one table
        first.append(_plot_section(replace(report.chart, tables=())))
        if report.chart.tables:
            details.append(Section(f"{report.chart.title}: details", table=report.chart.tables))
    whole = None if lead == report.answer else report.answer
    if report.table is not None:
        first.append(Section("Table", whole, table=report.table))
    elif whole is not None:
        first.append(Section("In full", whole))
    if report.details.tables:
        details.append(Section("More tables", table=report.details.tables))
    details += map(_plot_section, report.details.plots)
    if report.details.notes:
        details.append(Section("Notes", report.details.notes))
    return [*first, *(replace(section, folded=True) for section in (*details, *origin))]


def _plot_section(plot: Plot) -> Section:
    if plot.viewer is None:
        return Section(plot.title, plot.text, plot.figure, plot.tables or None)
    return Section(plot.title, plot.text, table=plot.tables or None, viewer=plot.viewer, still=plot.figure)


_ROWS = "study.csv"
_CURVES = "curves.csv"
_STUDY = "study.toml"
_DPI = 130


class NoValuesError(InputError):
    """No case of a study has values.

    Attributes:
        faulted: whether a fault ended any of them.
    """

    def __init__(self, text: str, faulted: bool) -> None:
        super().__init__(text)
        self.faulted = faulted


@dataclass(frozen=True)
class Outcome:
    """The outcome of a study.

    Attributes:
        rows: rows of all cases, in order.
        report: question, answer, chart, table and details.
        written: names of the files in the folder.
        resumed: number of rows taken over from an interrupted run.
        discarded: reason why rows found in the folder were not taken over, or None.
        failed: reason why there is no report, or None; repeating the call creates it without running a case again.
    """

    rows: Sequence[Row]
    report: Report
    written: list[str]
    resumed: int
    discarded: str | None
    failed: str | None = None

    @property
    def findings(self) -> list[str]:
        """Answer and notes of the report."""
        return self.report.findings


class StudyInterrupted(KeyboardInterrupt):
    """A study was interrupted; its finished rows are kept in its folder.

    Attributes:
        done: number of finished cases.
    """

    def __init__(self, done: int) -> None:
        super().__init__(done)
        self.done = done


def run_study(
    study: Study,
    folder: Path,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Run a study, or resume an interrupted one, and write its folder completely or not at all.

    If the report fails, the folder is written without it.

    Args:
        study: study to run.
        folder: output folder, which gets study.csv (one row per case), curves.csv (lists in the rows, if any),
            study.toml and job.toml (enough to repeat the study), report.html and plots. Until they are written, a
            hidden file in the folder keeps the finished rows.
        workers: as in `run_cases`.
        progress: as in `run_cases`, over all rounds so far.

    Raises:
        InputError: a folder that may not be written to or is in use by another study, or a job that is refused.
        NoValuesError: no case has values; nothing is written.
        WorkerError: as in `run_cases`; finished rows are kept.
        StudyInterrupted: interrupted by Ctrl-C; repeating the call resumes.
        ReplacedError: interrupted by Ctrl-C when all was written.
    """
    plots = (f"{PLOTS}/{name}.png" for name in study.plots)
    output = Output("study", _ROWS, (_ROWS, _CURVES, _STUDY, JOB, REPORT, *study.texts, *plots))
    target = output.check(folder)
    # a machine's file may have changed since another study
    forget_jobs()
    # a job that is refused would be refused case by case
    _check_job(study.job)
    rounds = study.rounds()
    cases = next(rounds)
    identity = {
        "study": study.name,
        "settings": _plain(study.settings),
        "job": study.job.toml(),
        "versions": versions(study.job.built_machine),
    }
    with Ledger(target, identity, output.files) as ledger, ledger.blamed():
        # again: files that a killed command left are complete only now
        output.check(folder)
        try:
            rows = _run_rounds(study, rounds, cases, ledger, workers, progress)
            _check_values(rows)
            report, failed = _report_of(study, rows)
            with output.written(folder) as scratch:
                _write_rows(study, rows, report, scratch, identity)
                if failed is None:
                    failed = _report_failure(study, rows, report, scratch, identity)
                written = sorted(item.name for item in scratch.iterdir() if item.is_file() or any(item.iterdir()))
        except (NoValuesError, ReplacedError):
            ledger.remove()
            raise
        except KeyboardInterrupt:  # the ledger stays, and the same call resumes
            raise StudyInterrupted(len(ledger)) from None
        if failed is None:
            ledger.remove()
    return Outcome(rows, report, written, ledger.resumed, ledger.discarded, failed)


def _run_rounds(
    study: Study,
    rounds: Rounds,
    first_round: Sequence[Case],
    ledger: Ledger,
    workers: int | None,
    progress: Progress | None,
) -> Sequence[Row]:
    """Run the cases of all rounds, each chosen by the rows before, and return all rows."""
    rows = TaggedRows(ledger.rows)

    def advance(done: int, known: int) -> None:
        if progress is not None:
            progress(len(rows) + done, max(len(rows) + known, study.expected))

    cases = first_round
    while True:
        rows_of_round = run_cases(
            cases,
            ledger,
            workers=workers,
            measure=study.measure,
            measure_together=study.measure_together,
            progress=advance,
        )
        if ledger.forget_misfits(cases):
            continue
        rows.extend(rows_of_round)
        try:
            cases = rounds.send(rows_of_round)
        except StopIteration:
            return rows


def _report_of(study: Study, rows: Sequence[Row]) -> tuple[Report, str | None]:
    """Return the study's report, or an empty one and the reason where it fails.

    A report may fail on values that nobody foresaw; hours of runs must not be lost to that.
    """
    try:
        return study.report(rows), None
    except GantryError:
        raise
    except Exception as error:
        return Report(study.title, f"{len(rows)} cases."), text_of(error)


def _check_job(job: Job) -> None:
    """Refuse a job that `gantrysim run` refuses, or whose dispenser is never on.

    Raises:
        InputError: the job is refused.
    """
    Analysis(job.follow())
    # what a machine and its servo refuse, they refuse before they move: the first servo period shows it
    job.check_faults()
    simulate(job.built_machine, job.built_servo, job.setpoints.until(2), physics_step=job.simulation.physics_step)


def _check_values(rows: Sequence[Row]) -> None:
    """Refuse rows none of which has values.

    Raises:
        NoValuesError: with the status of the first fault, or else of the first case.
    """
    if any(row["status"] == OK for row in rows):
        return
    faults = [row for row in rows if is_fault(row)]
    reason = (faults or rows)[0]["status"]
    raise NoValuesError(f"none of the study's {len(rows)} cases has values: {reason}", bool(faults))


def _write_rows(study: Study, rows: Sequence[Row], report: Report, folder: Path, identity: dict[str, Any]) -> None:
    (folder / JOB).write_text(study.job.toml(), encoding="utf-8")
    content = {
        "study": study.name,
        "command": f"gantrysim {study.command} {JOB}",
        "cases": len(rows),
        "findings": report.findings,
        "settings": identity["settings"],
        "versions": identity["versions"],
    }
    (folder / _STUDY).write_text(tomli_w.dumps(content, multiline_strings=True), encoding="utf-8")
    for name in study.texts:
        (folder / name).write_text(study.text(name, rows), encoding="utf-8")
    columns, curves = _columns(rows)
    with (folder / _ROWS).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns, restval="", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    if curves:
        _write_curves(rows, curves, folder / _CURVES)


def _columns(rows: Sequence[Row]) -> tuple[list[str], list[str]]:
    """Return the names of the rows' columns of single values, and of lists."""
    curves = list(dict.fromkeys(key for row in rows for key in row if isinstance(row[key], list)))
    return [key for key in dict.fromkeys(key for row in rows for key in row) if key not in curves], curves


def _report_failure(
    study: Study, rows: Sequence[Row], report: Report, folder: Path, identity: dict[str, Any]
) -> str | None:
    """Write plots and page; return why that fails, with none of them left behind, or None."""
    try:
        _write_report(study, rows, report, folder, identity)
    except Exception as error:
        for file in ((folder / PLOTS).iterdir(), [folder / REPORT]):
            for written in file:
                written.unlink(missing_ok=True)
        return text_of(error).replace(f"{folder}/", "")
    return None


def _write_report(study: Study, rows: Sequence[Row], report: Report, folder: Path, identity: dict[str, Any]) -> None:
    for plot in report.plots:
        plot.figure.savefig(folder / PLOTS / f"{plot.name}.png", dpi=_DPI)
        # laid out by now: the page need not do it again
        plot.figure.set_layout_engine("none")
    write_page(
        folder / REPORT,
        report.question,
        f"{study.title}: {len(rows)} cases",
        page_sections(report, [*_failed_cases(rows), _origin(study, identity)]),
    )


def _failed_cases(rows: Sequence[Row]) -> list[Section]:
    """Return the section of the cases without values; nothing where all have some."""
    failed = [row for row in rows if row["status"] != OK]
    if not failed:
        return []
    columns, _ = _columns(rows)
    tags = columns[: columns.index("status") + 1]
    return [Section("Failed cases", table=Table(tags, [[row.get(key) for key in tags] for row in failed]))]


def _origin(study: Study, identity: dict[str, Any]) -> Section:
    facts = Table(["component", "version"], [[name, value] for name, value in identity["versions"].items()])
    return Section("Job and versions", code=study.job.toml(), table=facts)


def _write_curves(rows: Sequence[Row], names: list[str], file: Path) -> None:
    """Write the lists of all rows, one line per element: the number of the row, from 1, and the values."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["case", *names])
        for number, row in enumerate(rows, 1):
            cells = [row.get(name) for name in names]
            lists = [cell if isinstance(cell, list) else [] for cell in cells]
            writer.writerows([number, *values] for values in zip_longest(*lists, fillvalue=""))


def _plain(value: Any) -> Any:
    """Return settings as TOML and JSON give them back: tuples as lists, dataclasses as tables, no None."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items() if item is not None}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
