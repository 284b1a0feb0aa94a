"""Results and files of a run, as the command writes them, from Python."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from gantrysim.base.errors import expanded_path
from gantrysim.base.progress import Progress, shown_progress
from gantrysim.glue.bead import Bead
from gantrysim.job.basis import Basis
from gantrysim.job.causes import causes_of
from gantrysim.job.job import Job
from gantrysim.job.losses import Losses
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.record.run import Run
from gantrysim.report.answer import Answer
from gantrysim.report.card import save_card
from gantrysim.report.document import Changes
from gantrysim.report.figures import figures_ahead
from gantrysim.report.folder import CARD, PLOTS, REPORT, output_folder, write_fault, write_run, write_summary
from gantrysim.report.page import run_page, sections_with_figures
from gantrysim.report.plots import save_plots
from gantrysim.results.glue_causes import glue_causes_of
from gantrysim.results.run_results import RunResults
from gantrysim.results.verdict import Verdict

ChangesOf = Callable[[Job, Verdict], Changes | None]


def write_report(
    job: Basis,
    run: Run,
    folder: str | os.PathLike[str],
    causes: bool = True,
    changes: ChangesOf | None = None,
    progress: Progress = None,
) -> Path | None:
    """Write job, record, summary, plots, card and page of a run into a folder.

    Args:
        job: of the run, or the basis of a run without one: there are then no job.toml, causes and changes.
        run: the record.
        folder: to write to; files of an earlier run are replaced.
        causes: whether to run the job again with one cause of error at a time switched off.
        changes: returns what to change in the job, from the verdict on its run; None to leave that out.
        progress: as in `simulate`.

    Returns:
        The path of report.html; None for a run that a fault ended before its dispenser was on, which has no page.

    Raises:
        InputError: the folder cannot be written, or the dispenser is never on in a run without a fault.
    """
    # checked as written, and shown so
    expanded_path(folder)
    target = Path(folder)
    with output_folder(target) as scratch, shown_progress("report", progress) as advance:
        if run.fault is not None and not run.dispense.any():
            write_fault(scratch, job, job.built_machine, run)
            return None
        results = results_of(job, run, causes)
        write_run(scratch, results)
        figures = figures_ahead(sections_with_figures(results), scratch / PLOTS)
        check = results.verdict.placed_check
        save_plots(results.budget, scratch / PLOTS, bead=results.bead, only_missing=True, check=check)
        proposal = changes(job, results.verdict) if changes is not None and isinstance(job, Job) else None
        if proposal is not None:
            write_summary(scratch, results, proposal)
        save_card(scratch / CARD, results, Answer.of(results, None if proposal is None else proposal.remedy))
        run_page(results, None, advance, proposal, figures).write(scratch / REPORT)
    return target / REPORT


def results_of(job: Basis, run: Run, causes: bool = True) -> RunResults:
    """Return the results of a run, of the job run again without its causes of error, and without its deliberate faults.

    Args:
        job: of the run, or the basis of a run without one, which cannot be run again.
        run: the record.
        causes: whether to find the causes; those of a run with faults are not looked for.

    Raises:
        InputError: the dispenser is never on.
    """
    analysis = Analysis(run)
    bead = Bead(run, job.bead, analysis)
    losses = None
    if run.injected and isinstance(job, Job):
        healthy = job.without_faults().run()
        losses = Losses.of(bead, Bead(healthy, job.bead)) if healthy.dispense.any() else None
    budget = Budget(analysis)
    is_known = run.fault is None and not job.faults and not budget.contradictions
    if not (causes and is_known and isinstance(job, Job)):
        return RunResults(job, job.built_machine, budget, bead, losses=losses)
    causes_known = causes_of(job, budget=budget)
    return RunResults(job, job.built_machine, budget, bead, causes_known, glue_causes_of(job, bead), losses)
