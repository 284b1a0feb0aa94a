"""Plots of one run: plan view, error budget, errors over time, spacing of turns, bead."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath

from gantrysim.base.errors import GantryError, text_of
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.plots.bead import draw_bead_along, draw_height_map
from gantrysim.report.plots.budget import draw_budget, draw_budget_along
from gantrysim.report.plots.error import draw_error
from gantrysim.report.plots.pictures import run_plots
from gantrysim.report.plots.plan import draw_plan
from gantrysim.report.plots.spacing import draw_polar_spacing, draw_spacing
from gantrysim.report.plots.style import COLOURS, sheet, view_height
from gantrysim.results.checks import Check


class PlotError(GantryError):
    """Plots that could not be drawn or written."""


def save_plots(
    of: Analysis | Budget,
    folder: FilePath,
    bead: Bead | None = None,
    progress: Callable[[float], None] | None = None,
    only_missing: bool = False,
    check: Check | None = None,
) -> list[FilePath]:
    """Write plan.png, error.png, budget.png, spacing.png of neighbouring turns, and bead.png where there is glue.

    Args:
        of: the analysis of the run, or its budget.
        folder: folder to write into.
        bead: the bead of the run.
        progress: called with the share that is done.
        only_missing: leave the files that exist.
        check: value of the verdict whose place plan.png marks, see `Verdict.placed_check`; None for the largest path
            error.

    Returns:
        The files written.

    Raises:
        PlotError: plots that failed; the others are written.
    """
    budget = of if isinstance(of, Budget) else Budget(of)
    plots = list(run_plots(budget, bead, check))
    written = []
    failed = []
    for done, plot in enumerate(plots, 1):
        file = f"{plot.name}.png"
        try:
            if not (only_missing and (folder / file).exists()):
                written.append(plot.save(folder))
        except Exception as error:  # the others are worth having
            text = text_of(error)
            failed.append(text if file in text else f"{file}: {text}")
        if progress is not None:
            progress(done / len(plots))
    if failed:
        raise PlotError("; ".join(failed))
    return written
