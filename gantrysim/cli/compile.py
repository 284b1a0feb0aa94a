"""The command `gantrysim compile`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from gantrysim.cli.options import AllowCode
from gantrysim.cli.terminal import say, stage

if TYPE_CHECKING:
    from gantrysim.job.job import Job

Jobs = Annotated[
    list[str] | None,
    typer.Argument(help="Built-in jobs, TOML files, or program files; by default an225.", show_default=False),
]


def compile_ahead(jobs: Jobs = None, allow_code: AllowCode = False) -> None:
    """Compile the functions of a run ahead of the first one, which otherwise takes some seconds longer.

    They are kept in the user's folder of caches, or in the one that NUMBA_CACHE_DIR names, until a release changes
    them. What they compute is simulated and dropped. Jobs
    with other laws, drives, machines or faults need further functions: name yours to compile those too. So may what
    gantrysim improve changes in a job.

    Exit status: 0 if all is compiled, 2 for bad input, or without a folder that can be written.
    """
    from gantrysim.base.jit import cache_folder, count_compiled
    from gantrysim.job.job import Job

    cache_folder()
    names = jobs or ["an225"]
    before = count_compiled()
    for name in names:
        loaded = Job.load(name, allow_code=allow_code)
        with stage(loaded.name):
            _run_once(loaded)
    done = count_compiled() - before
    result = f"{done} functions compiled" if done else "nothing to compile"
    say(f"{result}: runs of {', '.join(names)} are ready")


def _run_once(job: Job) -> None:
    """Run a job and evaluate it, up to what its page draws."""
    from gantrysim.glue.bead import Bead
    from gantrysim.metrics.analysis import Analysis
    from gantrysim.metrics.budget import Budget
    from gantrysim.report.plots.style import thinned_line
    from gantrysim.report.viewer_data import ViewerData
    from gantrysim.results.run_results import RunResults

    record = job.run()
    # ended by a fault before there was anything to evaluate
    if not record.dispense.any():
        return
    analysis = Analysis(record)
    results = RunResults(job, job.built_machine, Budget(analysis), Bead(record, job.bead, analysis))
    _ = results.verdict, results.budget.values, results.bead_values, analysis.values
    # as plots and page thin the lines of longer runs
    thinned_line(record.time[analysis.ticks], results.budget.contour.lateral, columns=1)
    _ = ViewerData(results, most=1).rows
