"""What `gantrysim run` computes, writes and shows of a record; imported only then, as plots and pictures take long."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from gantrysim.base.errors import text_of
from gantrysim.bead import Bead
from gantrysim.cli.tables import causes_table, links_table, losses_table, outcome_table, scatter_table, verdict_table
from gantrysim.cli.terminal import say, share_bar, show, warn
from gantrysim.job.causes import causes_of
from gantrysim.job.job import Job
from gantrysim.job.losses import Losses
from gantrysim.job.scatter import scatter_of, scatters
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.plots import save_plots
from gantrysim.record.run import Run
from gantrysim.render import NoOpenGLError, save_video
from gantrysim.render.encoding import NoEncoderError
from gantrysim.report.folder import PLOTS, REPORT, SUMMARY, VIDEO, write_run
from gantrysim.report.headline import headline
from gantrysim.report.page import write_run_page
from gantrysim.report.results import RunResults
from gantrysim.report.scatter import SCATTER_NOTE, add_to_summary
from gantrysim.results.checks import FAIL
from gantrysim.results.verdict import Verdict


class Wanted(NamedTuple):
    """What the caller asks for besides record, summary and error budget.

    Attributes:
        causes: worth of each cause of error.
        repeat: number of runs from which the figures' scatter is taken; None for none.
        video: video.mp4.
        report: report.html and the plots.
        fail_on: verdict from which on the command fails, "fail" or "warn"; None for none.
    """

    causes: bool
    repeat: int | None
    video: bool
    report: bool
    fail_on: str | None = None

    def refuses(self, state: str) -> bool:
        """Return whether the command fails with a verdict."""
        return self.fail_on is not None and (state == FAIL or state == self.fail_on)


class Evaluation:
    """Results of a record, and the files made of them.

    Args:
        folder: that the files are written to.
        go_on: raises an interrupt that has come; called after an error, which may be one in disguise.

    Attributes:
        shown: functions that print the results, to be called once the files are in place.
        failed: why files are missing, each in a line.
        state: the verdict in a word; empty until the results are known.
    """

    def __init__(self, folder: Path, go_on: Callable[[], None]) -> None:
        self.shown: list[Callable[[], None]] = []
        self.failed: list[str] = []
        self.state = ""
        self._folder = folder
        self._go_on = go_on

    def make(self, job: Job, record: Run, wanted: Wanted) -> None:
        """Compute the results, write their files, and keep what is to be shown; a plot, video or report may fail."""
        results = self._results(job, record, wanted)
        self.state = results.verdict.state
        write_run(self._folder, results)
        if results.scatter is not None:
            add_to_summary(self._folder / SUMMARY, results.scatter)
        if wanted.report:
            with self._optional("plot"), share_bar("plot", self._go_on) as advance:
                save_plots(results.budget, self._folder / PLOTS, bead=results.bead, progress=advance)
        self.shown += tables(results)
        if wanted.video:
            with self._optional("video"), share_bar("video", self._go_on) as advance:
                save_video(
                    results.machine,
                    record,
                    self._folder / VIDEO,
                    bead=results.bead,
                    label=job.name,
                    progress=advance,
                )
        if wanted.report:
            with self._optional("report"), share_bar("report", self._go_on) as advance:
                write_run_page(self._folder / REPORT, results, self._folder / VIDEO, advance)

    def _results(self, job: Job, record: Run, wanted: Wanted) -> RunResults:
        """Return the results of a record, of the job run again without its causes or faults, and of its repeats."""
        analysis = Analysis(record)
        budget = Budget(analysis)
        bead = Bead(record, job.bead, analysis)
        causes = losses = scatter = None
        if wanted.causes and record.fault is None:
            with share_bar("causes", self._go_on) as advance:
                causes = causes_of(job, record, advance)
        if record.injected:
            with share_bar("simulate without faults", self._go_on) as advance:
                healthy = job.without_faults().run(advance)
            losses = Losses.of(bead, Bead(healthy, job.bead)) if healthy.dispense.any() else None
        if wanted.repeat is not None and record.fault is None:
            with share_bar("repeat", self._go_on) as advance:
                scatter = scatter_of(job, wanted.repeat, record=record, progress=advance)
        return RunResults(job, job.built_machine, budget, bead, causes, losses, scatter)

    @contextmanager
    def _optional(self, kind: str) -> Iterator[None]:
        """Report an error of the block; the other files are still written."""
        try:
            yield
        except (NoOpenGLError, NoEncoderError) as error:
            missing = f"no {kind}: {error}"
            self.shown.append(lambda: warn(missing))
        except Exception as error:
            self._go_on()
            self.failed.append(f"no {kind}: {text_of(error).replace(f'{self._folder}/', '')}")


def _show_verdict(verdict: Verdict) -> None:
    """Print the verdict; of a run that ended in a fault, what happened."""
    if verdict.fault:
        say(str(verdict), wrap=True)
    else:
        show(verdict_table(verdict))


def tables(results: RunResults) -> Iterator[Callable[[], None]]:
    """Yield functions that print the results of a run."""
    job = results.job
    budget = results.budget
    record = budget.analysis.run
    yield lambda: _show_verdict(results.verdict)
    links = links_table(job.name, results.machine, budget)
    yield lambda: show(links)
    if results.losses is not None:
        losses = losses_table(record, results.losses)
        yield lambda: show(losses)
    if results.causes is not None:
        causes = causes_table(results.causes)
        yield lambda: show(causes)
    if results.scatter is not None:
        scatter = scatter_table(results.scatter)
        yield lambda: show(scatter)
    elif record.fault is None and scatters(job):
        yield lambda: say(SCATTER_NOTE, wrap=True)
    yield lambda: show(outcome_table(record, budget.analysis.values, results.bead_values, job.margins))
    yield lambda: say(headline(budget), wrap=True)
