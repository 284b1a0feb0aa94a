"""What `gantrysim run` computes, shows and writes of a record; plots, page and film are imported only where made."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

from gantrysim.base import memory
from gantrysim.base.errors import expanded_path, text_of
from gantrysim.base.extras import MissingPackageError
from gantrysim.cli.show import ASPECTS, show_aspect
from gantrysim.cli.tables import show_cause, show_change, show_choice, show_verdict
from gantrysim.cli.terminal import count_bar, say, share_bar, stage, warn
from gantrysim.engine.simulate import simulate
from gantrysim.glue.bead import Bead
from gantrysim.job.causes import causes_of
from gantrysim.job.job import Job
from gantrysim.job.losses import Losses
from gantrysim.job.scatter import scatter_of
from gantrysim.job.steps import run_notes
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.record.run import Run
from gantrysim.report.answer import Answer, without_order
from gantrysim.report.folder import CARD, PLOTS, REPORT, VIDEO, write_run, write_summary
from gantrysim.report.headline import headline
from gantrysim.report.summary import sections_in_text
from gantrysim.results.checks import FAIL, PASS
from gantrysim.results.glue_causes import glue_causes_of
from gantrysim.results.run_results import RunResults

if TYPE_CHECKING:
    from gantrysim.report.document import Changes
    from gantrysim.report.figures import Figures

_LONG_RUN = "the run is long"
_TRIED_SETPOINTS = 5_000  # setpoints that are run to see
# Whole time, with figures, plots and report, over the simulation's; measured on an225 with 1000 turns.
_TIME_OVER_SIMULATION = 6.0


class Wanted(NamedTuple):
    """What the caller asks for besides record, summary and error budget.

    Attributes:
        causes: worth of each cause of error; None for where it takes seconds: not for a long run or one with faults.
        repeat: number of runs from which the figures' scatter is taken; None for none.
        video: video.mp4.
        report: report.html and the plots.
        fail_on: verdict from which on the command fails, "fail" or "warn"; None for none.
        improve: what to change in the job; None for where causes are looked for by default.
        verbose: whether everything is printed.
    """

    causes: bool | None
    repeat: int | None
    video: bool
    report: bool
    fail_on: str | None = None
    improve: bool | None = None
    verbose: bool = False

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
        wanted: what the caller asks for.
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
        self._figures: dict[str, Figures] | None = None
        self._record = record
        self.wanted = wanted
        self._go_on = go_on

    def write_record(self, folder: Path) -> None:
        """Write job, record and a summary of them alone into a folder."""
        with stage("record"):
            write_run(folder, self.results)

    def find(self, folder: Path) -> None:
        """Print the verdict, run the job again for what is wanted of it, and print what spoils it.

        Args:
            folder: of the run.
        """
        record = self._record
        with stage("verdict"):
            answer = Answer.of(self.results)
        show_verdict(answer)
        if record.injected:
            self._find_losses()
        self._find_causes()
        if self.wanted.repeat is not None and record.fault is None:
            self._find_scatter(self.wanted.repeat)
        answer = Answer.of(self.results)
        if self._proposes:
            answer = replace(answer, spoilt=without_order(answer.spoilt, self.results.verdict))
        show_cause(answer, headline(self.results))
        show_choice(run_notes(self.results.job, record), str(folder))

    def show_details(self) -> None:
        """Print every aspect of the run that is known."""
        sections = {name: section.content() for name, section in sections_in_text(self.results, self._changes)}
        for name in ASPECTS:
            show_aspect(name, self.results, sections)

    def write(self, folder: Path) -> None:
        """Write the summary with all that is known, and what is drawn; that may fail, the film comes last."""
        results = self.results
        write_summary(folder, results)
        if self.wanted.report:
            from gantrysim.report.figures import figures_ahead
            from gantrysim.report.page import sections_with_figures
            from gantrysim.report.plots import save_plots

            # what fails is drawn again, where its error is reported
            with suppress(Exception), share_bar("figures", self._go_on) as advance:
                self._figures = figures_ahead(sections_with_figures(results), folder / PLOTS, advance)
            with self._optional("plot"), share_bar("plots", self._go_on) as advance:
                check = results.verdict.placed_check
                save_plots(results.budget, folder / PLOTS, results.bead, advance, only_missing=True, check=check)
        self._write_card(folder)
        if self.wanted.video:
            self._film(folder)
        self._write_page(folder, folder / VIDEO)

    def _write_card(self, folder: Path) -> None:
        if not self.wanted.report:
            return
        from gantrysim.report.card import save_card

        remedy = None if self._changes is None else self._changes.remedy
        with self._optional("card"):
            save_card(folder / CARD, self.results, Answer.of(self.results, remedy))

    def _write_page(self, folder: Path, video: Path) -> None:
        if not self.wanted.report:
            return
        from gantrysim.report.page import run_page

        film = video if self.wanted.video else None
        with self._optional("report"), share_bar("page", self._go_on) as advance:
            run_page(self.results, film, advance, self._changes, self._figures).write(folder / REPORT)

    @property
    def _proposes(self) -> bool:
        """Whether changes are looked for: where they are wanted, of a verdict that is no pass, and can be had."""
        results = self.results
        if self.wanted.improve is False or results.verdict.state == PASS:
            return False
        return not _reason_to_skip(results.job, results.budget, is_default=self.wanted.improve is None)

    def propose(self, folder: Path) -> bool:
        """Simulate what may improve the two worst rows of a verdict that is no pass; return whether that is wanted.

        Args:
            folder: of the run, as it is printed.
        """
        results = self.results
        if not self._proposes:
            return False
        from gantrysim.remedy.improve import improve, worst_rows
        from gantrysim.remedy.outcome import Outcome
        from gantrysim.remedy.report import found_changes

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
        show_change(self._changes.remedy.content(), str(folder))
        return True

    def write_proposal(self, scratch: Path, folder: Path) -> None:
        """Write summary, card and page again, with what to change.

        Args:
            scratch: folder to write to.
            folder: of the run, where the film is.
        """
        write_summary(scratch, self.results, self._changes)
        if not self.failed:
            self._write_card(scratch)
            self._write_page(scratch, expanded_path(folder) / VIDEO)

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
        """Run the job without its deliberate faults, to find what they cost."""
        job = self.results.job
        with share_bar("simulate without faults", self._go_on) as advance:
            healthy = job.without_faults().run(advance)
        bead = self.results.bead
        if bead is not None and healthy.dispense.any():
            losses = Losses.of(bead, Bead(healthy, job.bead))
            self.results = replace(self.results, losses=losses)

    def _find_causes(self) -> None:
        """Run the job without one cause of error at a time, to find what each is worth."""
        if self.wanted.causes is False:
            return
        is_default = self.wanted.causes is None
        reason = _reason_to_skip(self.results.job, self.results.budget, is_default=is_default)
        if reason:
            say(f"causes skipped: {reason}{'; --causes finds them' if reason == _LONG_RUN else ''}")
        else:
            with share_bar("causes", self._go_on) as advance:
                causes = causes_of(self.results.job, progress=advance, budget=self.results.budget)
            bead = self.results.bead
            with stage("causes of the glue's error"):
                glue_causes = None if bead is None else glue_causes_of(self.results.job, bead)
            self.results = replace(self.results, causes=causes, glue_causes=glue_causes)

    def _find_scatter(self, repeat: int) -> None:
        """Run the job again with other zeros of its encoders, to find how far its figures scatter."""
        with share_bar("repeat", self._go_on) as advance:
            scatter = scatter_of(self.results.job, repeat, record=self._record, progress=advance)
        self.results = replace(self.results, scatter=scatter)

    @contextmanager
    def _optional(self, kind: str) -> Iterator[None]:
        """Report an error of the block; the other files are still written."""
        try:
            yield
        except Exception as error:
            self._go_on()
            self.failed.append(f"no {kind}: {text_of(error)}")


def computing_time(job: Job) -> float:
    """Return about how long this machine takes for a job, its figures, plots and report, without video [s].

    The first setpoints are run to see. Waits at gates count as long as they must be.

    Raises:
        InputError: as by `gantrysim.simulate`.
    """
    first = job.setpoints.until(_TRIED_SETPOINTS)
    for _ in range(2):  # the first compiles
        start = perf_counter()
        run = simulate(job.built_machine, job.built_servo, first, physics_step=job.simulation.physics_step)
        spent = perf_counter() - start
    return _TIME_OVER_SIMULATION * spent / len(run.time) * job.setpoints.run_ticks
