"""Plots of one run: plan view, error budget, errors over time, spacing of turns, bead."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.base.errors import GantryError, text_of
from gantrysim.base.files import replaced
from gantrysim.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.plots.bead import draw_bead_along, draw_height_map
from gantrysim.plots.budget import draw_budget, draw_budget_along
from gantrysim.plots.error import draw_error
from gantrysim.plots.plan import draw_plan, plan_extent
from gantrysim.plots.spacing import draw_polar_spacing, draw_spacing
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, INK, sheet, view_height

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PlotError(GantryError):
    """Plots that could not be drawn or written."""


def save_plots(
    of: Analysis | Budget,
    folder: FilePath,
    bead: Bead | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[FilePath]:
    """Write plan.png, error.png, budget.png, spacing.png of neighbouring turns, and bead.png where there is glue.

    Args:
        of: the analysis of the run, or its budget.
        folder: folder to write into.
        bead: the bead of the run.
        progress: called with the share that is done.

    Returns:
        The files written.

    Raises:
        PlotError: plots that failed; the others are written.
    """
    budget = of if isinstance(of, Budget) else Budget(of)
    analysis = budget.analysis
    tall = 6.5 if len(set(analysis.run.units)) == 1 else 9.0  # a panel for each kind of axis, and one for the path
    drawings: dict[str, tuple[Callable[[Figure], object], tuple[float, float]]] = {
        "plan": (partial(draw_plan, analysis=analysis), (7.0, view_height(*plan_extent(analysis), 7.0))),
        "error": (partial(draw_error, analysis=analysis), (9.0, tall)),
        "budget": (partial(draw_budget_along, budget=budget), (9.0, 7.5)),
    }
    if analysis.spacing.distance.size:
        drawings["spacing"] = (partial(draw_spacing, analysis=analysis), (8.0, 4.6))
    if bead is not None and bead.volume[-1] > 0:
        extent = float(np.ptp(bead.map.x)), float(np.ptp(bead.map.y))
        drawings["bead"] = (partial(draw_height_map, bead=bead), (7.0, 0.9 * view_height(*extent, 7.0)))
    written = []
    failed = []
    for done, (name, (draw, size)) in enumerate(drawings.items(), 1):
        file = folder / f"{name}.png"
        try:
            with sheet(*size) as figure, replaced(file) as new:
                draw(figure)
                if analysis.run.fault is not None:
                    figure.supxlabel(f"fault: {analysis.run.fault}", color=COLOURS["fault"], fontsize="medium")
                figure.savefig(new)
            written.append(file)
        except Exception as error:  # the others are worth having
            text = text_of(error)
            failed.append(text if file.name in text else f"{file.name}: {text}")
        if progress is not None:
            progress(done / len(drawings))
    if failed:
        raise PlotError("; ".join(failed))
    return written
