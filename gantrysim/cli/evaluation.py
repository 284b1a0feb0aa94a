"""What `gantrysim run` computes, shows and writes of a record; plots, page and film are imported only where made."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gantrysim.base import memory
from gantrysim.base.errors import text_of
from gantrysim.base.extras import MissingPackageError
from gantrysim.cli.tables import causes_table, links_table, losses_table, outcome_table, scatter_table, verdict_table
from gantrysim.cli.terminal import count_bar, say, share_bar, show, stage, warn
from gantrysim.glue.bead import Bead
from gantrysim.job.causes import causes_of
from gantrysim.job.job import Job
from gantrysim.job.losses import Losses
from gantrysim.job.scatter import scatter_of, scatters
from gantrysim.job.steps import run_notes
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.record.run import Run
from gantrysim.report.folder import CARD, PLOTS, REPORT, VIDEO, write_run, write_summary
from gantrysim.report.headline import headline
from gantrysim.report.scatter import SCATTER_NOTE
from gantrysim.results.checks import FAIL, PASS
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import Verdict

if TYPE_CHECKING:
    from gantrysim.report.answer import Changes

_LONG_RUN = "the run is long"


class Wanted(NamedTuple):
    """What the caller asks for besides record, summary and error budget.

    Attributes:
        causes: worth of each cause of error; None for where it takes seconds: not for a long run or one with faults.
        repeat: number of runs from which the figures' scatter is taken; None for none.
        video: video.mp4.
        report: report.html and the plots.
        fail_on: verdict from which on the command fails, "fail" or "warn"; None for none.
        improve: what to change in the job; None for where causes are looked for by default.
    """

    causes: bool | None
    repeat: int | None
    video: bool
    report: bool
    fail_on: str | None = None
    improve: bool | None = None

    def refuses(self, state: str) -> bool:
        """Return whether the command fails with a verdict."""
        return self.fail_on is not None and (state == FAIL or state == self.fail_on)


def _reason_to_skip(job: Job, budget: Budget, *, is_default: bool) -> str:
    """Return why a run is not run again with changes, to find causes or remedies; empty where it is."""
    record = budget.analysis.run
    if record.fault is not None:
        return "the run ended in a fault"
    if budget.contradictions:
        return "the errors of the run are not known"
    if job.faults:
        return "the job has deliberate faults"
    if is_default and len(record.time) > memory.LONG_RUN:
        return _LONG_RUN
    return ""


class Evaluation:
    """Results of a record: written before anything is shown, as what is shown takes further runs.

    Args:
        job: of the record.
        record: of a run whose dispenser was on.
        wanted: what the caller asks for.
        go_on: raises an interrupt that has come; called after an error, which may be one in disguise.

    Attributes:
        results: what is known so far.
        failed: why files are missing, each in a line.
    """

    def __init__(self, job: Job, record: Run, wanted: Wanted, go_on: Callable[[], None]) -> None:
        with stage("errors"):
            analysis = Analysis(record)
            budget = Budget(analysis)
        with stage("bead"):
            bead = Bead(record, job.bead, analysis)
        self.results = RunResults(job, job.built_machine, budget, bead)
        self.failed: list[str] = []
        self._changes: Changes | None = None
        self._record = record
        self._wanted = wanted
        self._go_on = go_on

    def write_record(self, folder: Path) -> None:
        """Write job, record and a summary of them alone into a folder."""
        with stage("record"):
            write_run(folder, self.results)

    def show(self) -> None:
        """Print verdict and tables, first those of the record alone, then those that need further runs of the job."""
        results = self.results
        job = results.job
        record = self._record
        budget = results.budget
        # computed at their first use
        with stage("figures"):
            verdict = results.verdict
            tables = (
                links_table(job.name, results.machine, budget),
                outcome_table(budget.analysis, results.bead_values, job.margins, results.dots),
            )
        show_verdict(verdict)
        for table in tables:
            show(table)
        if record.injected:
            self._find_losses()
        self._find_causes()
        if self._wanted.repeat is not None and record.fault is None:
            self._find_scatter(self._wanted.repeat)
        elif record.fault is None and scatters(job):
            say(SCATTER_NOTE, wrap=True)
        say(headline(budget, self.results.causes), wrap=True)
        say(f"servo: {job.servo_reason}", wrap=True)
        for note in run_notes(job, record):
            say(f"note: {note}")
        self._find_changes()

    def write(self, folder: Path) -> None:
        """Write the summary with all that is known, and what is drawn; that may fail, the film comes last."""
        results = self.results
        write_summary(folder, results)
        page = None
        if self._wanted.report:
            from gantrysim.report.answer import Answer
            from gantrysim.report.card import save_card
            from gantrysim.report.figures import figures_ahead
            from gantrysim.report.page import run_page, sections_with_figures
            from gantrysim.report.plots import save_plots

            figures = None
            # what fails is drawn again, where its error is reported
            with suppress(Exception), share_bar("figures", self._go_on) as advance:
                figures = figures_ahead(sections_with_figures(results), folder / PLOTS, advance)
            with self._optional("plot"), share_bar("plots", self._go_on) as advance:
                save_plots(results.budget, folder / PLOTS, results.bead, progress=advance, only_missing=True)
            with self._optional("card"):
                save_card(folder / CARD, results, Answer.of(results, self._changes and self._changes.remedy))
            with self._optional("report"), share_bar("page", self._go_on) as advance:
                video = folder / VIDEO if self._wanted.video else None
                page = run_page(results, video, advance, self._changes, figures)
        if self._wanted.video:
            self._film(folder)
        if page is not None:
            with self._optional("report"):
                page.write(folder / REPORT)

    def _film(self, folder: Path) -> None:
        from gantrysim.render import NoOpenGLError, save_video
        from gantrysim.render.encoding import NoEncoderError, encoder_file

        results = self.results
        job = results.job
        # what the page's figures took: a film of a long run needs as much
        memory.give_back()
        with self._optional("video"), share_bar("film", self._go_on) as advance:
            try:
                # before a film is prepared that cannot be written
                encoder_file()
                save_video(
                    results.machine,
                    self._record,
                    folder / VIDEO,
                    bead=results.bead,
                    label=job.name,
                    verdict=results.verdict,
                    progress=advance,
                )
            except (NoOpenGLError, NoEncoderError, MissingPackageError) as error:
                warn(f"no video: {error}")

    def _find_losses(self) -> None:
        """Run the job without its deliberate faults, and print what they cost."""
        job = self.results.job
        with share_bar("simulate without faults", self._go_on) as advance:
            healthy = job.without_faults().run(advance)
        bead = self.results.bead
        if bead is not None and healthy.dispense.any():
            losses = Losses.of(bead, Bead(healthy, job.bead))
            self.results = replace(self.results, losses=losses)
            show(losses_table(self._record, losses))

    def _find_causes(self) -> None:
        """Run the job without one cause of error at a time, and print what each is worth."""
        if self._wanted.causes is False:
            return
        is_default = self._wanted.causes is None
        reason = _reason_to_skip(self.results.job, self.results.budget, is_default=is_default)
        if reason:
            say(f"causes skipped: {reason}{'; --causes finds them' if reason == _LONG_RUN else ''}")
        else:
            with share_bar("causes", self._go_on) as advance:
                causes = causes_of(self.results.job, progress=advance, budget=self.results.budget)
            self.results = replace(self.results, causes=causes)
            show(causes_table(causes))

    def _find_scatter(self, repeat: int) -> None:
        """Run the job again with other zeros of its encoders, and print how far its figures scatter."""
        with share_bar("repeat", self._go_on) as advance:
            scatter = scatter_of(self.results.job, repeat, record=self._record, progress=advance)
        self.results = replace(self.results, scatter=scatter)
        show(scatter_table(scatter))

    def _find_changes(self) -> None:
        """Simulate what may improve the two worst rows of a verdict that is no pass, and print what to change."""
        verdict = self.results.verdict
        job = self.results.job
        is_default = self._wanted.improve is None
        wanted = self._wanted.improve is not False and verdict.state != PASS
        if not wanted or _reason_to_skip(job, self.results.budget, is_default=is_default):
            return
        from gantrysim.cli.improve import show_changes
        from gantrysim.remedy.improve import improve, worst_rows
        from gantrysim.remedy.outcome import Outcome
        from gantrysim.remedy.report import found_changes

        results = self.results
        with count_bar("improve") as advance:

            def progress(done: int, known: int, name: str) -> None:
                self._go_on()
                advance(done, known, name)

            improvement = improve(
                results.job,
                rows=worst_rows(Outcome(results.verdict)),
                causes=results.causes,
                budget=results.budget,
                fastest=False,
                progress=progress,
            )
        self._changes = found_changes(improvement)
        show_changes(improvement)

    @contextmanager
    def _optional(self, kind: str) -> Iterator[None]:
        """Report an error of the block; the other files are still written."""
        try:
            yield
        except Exception as error:
            self._go_on()
            self.failed.append(f"no {kind}: {text_of(error)}")


def show_verdict(verdict: Verdict) -> None:
    """Print the verdict; of a run that ended in a fault, what happened."""
    if verdict.unjudged:
        say(str(verdict), wrap=True)
    else:
        show(verdict_table(verdict))
