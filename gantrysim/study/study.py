"""What a study is, and how it is carried out: cases in rounds, findings, figures, and its folder written whole.

A new study is a package: in study.py a frozen dataclass that has what `Study` asks for, in findings.py what its rows
say in words, in figures.py its plots; and a command of a few lines in commands.py.
"""

from __future__ import annotations

import csv
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import tomli_w

from gantrysim.job.job import Job
from gantrysim.report.folder import JOB, PLOTS, Output, output_folder
from gantrysim.report.summary import versions
from gantrysim.study.cases import OK, Case, Row, forget_jobs
from gantrysim.study.checks import NoValuesError, check_job, check_values
from gantrysim.study.ledger import Ledger
from gantrysim.study.runner import Measure, Progress, run_cases

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gantrysim.report import Table

ROWS, CURVES, STUDY, REPORT = "study.csv", "curves.csv", "study.toml", "report.html"

_DPI = 130

Rounds = Generator[Sequence[Case], list[Row], None]


@dataclass(frozen=True)
class Plot:
    """A figure of a study.

    Attributes:
        name: of its file in the folder of plots, without the ending.
        title: heads its section of the report.
        text: what it shows, for the report; one paragraph or several.
        figure: of matplotlib.
        tables: that stand below it in the report.
    """

    name: str
    title: str
    text: str | Sequence[str]
    figure: Figure
    tables: Sequence[Table] = field(default=())


class Study(Protocol):
    """What `run_study` asks of a study; all of it follows from the study's own values and the rows alone.

    A study may also have

    - `measure_together`, from several cases to their rows, as `run_cases` takes it; `measure` is then left alone;
    - `command`, the words by which it is called, where these are not "study" and its name;
    - `texts`, names of files that it writes besides, and `text(name, rows)`, what stands in them;
    - `expected`, the number of cases that it is thought to come to in all its rounds, for the progress;
    - `news`, where it has come to, in a few words, for the progress.
    """

    @property
    def name(self) -> str:
        """One word, by which the command calls it."""

    @property
    def title(self) -> str:
        """Heads the report."""

    @property
    def job(self) -> Job:
        """The job that it is about."""

    @property
    def settings(self) -> dict[str, Any]:
        """What the study does with the job, as plain values of TOML: enough to do it again."""

    @property
    def plots(self) -> tuple[str, ...]:
        """Names of all the plots that it may draw."""

    @property
    def measure(self) -> Measure:
        """From a case to its row; as a rule `gantrysim.study.measure`."""

    def rounds(self) -> Rounds:
        """Yield the cases of one round after the other, and be sent their rows: `rows = yield cases`.

        A study without rounds yields once; one that searches chooses its next cases by the rows it was sent. What can
        be refused without a case is refused before the first yield: by then nothing is written.
        """

    def findings(self, rows: list[Row]) -> list[str]:
        """Return what the rows say, in paragraphs, the first for the reader who reads no more."""

    def figures(self, rows: list[Row]) -> list[Plot]:
        """Return the plots."""


@dataclass(frozen=True)
class Outcome:
    """What a study has come to.

    Attributes:
        rows: of all cases in their order.
        findings: paragraphs.
        written: names of the files in the folder.
        kept: number of rows that an interrupted start had left.
        discarded: why rows that lay in the folder were not taken, or None.
    """

    rows: list[Row]
    findings: list[str]
    written: list[str]
    kept: int
    discarded: str | None


class StudyInterrupted(KeyboardInterrupt):
    """A study was interrupted; its finished rows lie in its folder.

    Attributes:
        done: number of cases whose rows are kept.
    """

    def __init__(self, done: int) -> None:
        super().__init__(done)
        self.done = done


def output_of(study: Study) -> Output:
    """Return the files that a study writes."""
    drawn = (f"{PLOTS}/{name}.png" for name in study.plots)
    return Output("study", ROWS, (ROWS, CURVES, STUDY, JOB, REPORT, *getattr(study, "texts", ()), *drawn))


def run_study(
    study: Study,
    folder: Path,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Carry out a study, or go on where an interrupted one has stopped, and write its folder, whole or not at all.

    Args:
        study: to be carried out.
        folder: for study.csv (a row per case), curves.csv (the lists in the rows, if there are any), study.toml and
            job.toml (what was run, enough to run it again), report.html and plots. Until they are written, the
            finished rows lie there in a hidden file.
        workers: as in `run_cases`.
        progress: as in `run_cases`, of all rounds so far.

    Raises:
        InputError: a folder that may not be written to, or that another study is at work in, or a job that is refused
            as it stands.
        NoValuesError: no case has figures; nothing is written.
        WorkerError: as in `run_cases`; finished rows are kept.
        StudyInterrupted: by Ctrl-C; the same call goes on.
    """
    output = output_of(study)
    target = output.check(folder)
    forget_jobs()  # a machine's file may have changed since another study
    check_job(study.job)  # here, not case by case
    rounds = study.rounds()
    cases = next(rounds)
    measure, measure_together = study.measure, getattr(study, "measure_together", None)
    identity = {
        "study": study.name,
        "settings": _plain(study.settings),
        "job": study.job.toml(),
        "versions": versions(study.job.built_machine),
    }
    rows: list[Row] = []

    def tell(done: int, every: int) -> None:
        if progress is not None:
            progress(len(rows) + done, max(len(rows) + every, getattr(study, "expected", 0)))

    with Ledger(target, identity) as ledger:
        try:
            while True:
                found = run_cases(
                    cases,
                    ledger,
                    workers=workers,
                    measure=measure,
                    measure_together=measure_together,
                    progress=tell,
                )
                rows += found
                try:
                    cases = rounds.send(found)
                except StopIteration:
                    break
        except KeyboardInterrupt:
            raise StudyInterrupted(len(ledger)) from None
        try:
            check_values(rows)
        except NoValuesError:
            ledger.remove()
            raise
        findings = study.findings(rows)
        with output_folder(folder, output) as scratch:
            _write(study, rows, findings, scratch, identity)
            written = sorted(item.name for item in scratch.iterdir())
        ledger.remove()
    return Outcome(rows, findings, written, ledger.kept, ledger.discarded)


def _write(study: Study, rows: list[Row], findings: list[str], folder: Path, identity: dict[str, Any]) -> None:
    from gantrysim.report import Section, Table, write_page

    (folder / JOB).write_text(study.job.toml(), encoding="utf-8")
    described = {
        "study": study.name,
        "command": f"gantrysim {getattr(study, 'command', f'study {study.name}')} {JOB}",
        "cases": len(rows),
        "findings": findings,
        "settings": identity["settings"],
        "versions": identity["versions"],
    }
    (folder / STUDY).write_text(tomli_w.dumps(described, multiline_strings=True), encoding="utf-8")
    for name in getattr(study, "texts", ()):
        (folder / name).write_text(study.text(name, rows), encoding="utf-8")  # type: ignore[attr-defined]
    curves = list(dict.fromkeys(key for row in rows for key in row if isinstance(row[key], list)))
    columns = [key for key in dict.fromkeys(key for row in rows for key in row) if key not in curves]
    with (folder / ROWS).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns, restval="", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    if curves:
        _write_curves(rows, curves, folder / CURVES)
    plots = study.figures(rows)
    for plot in plots:
        plot.figure.savefig(folder / PLOTS / f"{plot.name}.png", dpi=_DPI)
        plot.figure.set_layout_engine("none")  # laid out by now: the report's drawing need not do it again
    sections = [Section("Findings", findings)]
    sections += [Section(plot.title, plot.text, plot.figure, plot.tables or None) for plot in plots]
    failed = [row for row in rows if row["status"] != OK]
    if failed:
        tags = columns[: columns.index("status")]
        table = Table([*tags, "status"], [[row.get(key) for key in (*tags, "status")] for row in failed])
        sections.append(Section("Cases without figures", table=table))
    facts = Table(["what", "version"], [[name, value] for name, value in identity["versions"].items()])
    sections.append(Section("What was run", code=study.job.toml(), table=facts))
    write_page(folder / REPORT, study.title, f"{len(rows)} cases of the job {study.job.name}", sections)


def _write_curves(rows: list[Row], names: list[str], file: Path) -> None:
    """Write the lists of all rows, one line for each place in them: the number of the row, from 1, and the values."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["case", *names])
        for number, row in enumerate(rows, 1):
            lists = [value if isinstance(value := row.get(name), list) else [] for name in names]
            writer.writerows([number, *values] for values in zip_longest(*lists, fillvalue=""))


def _plain(settings: dict[str, Any]) -> dict[str, Any]:
    """Tuples as lists: as TOML and JSON give them back."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {str(key): plain(item) for key, item in value.items() if item is not None}
        return [plain(item) for item in value] if isinstance(value, list | tuple) else value

    return {str(key): plain(value) for key, value in settings.items() if value is not None}
