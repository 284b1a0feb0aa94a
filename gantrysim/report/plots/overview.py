"""One figure of a run: the plan, coloured by its share of the tolerance, beside the error budget."""

from __future__ import annotations

import io
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection

from gantrysim.base.columns import by_blocks
from gantrysim.metrics.budget import Budget
from gantrysim.report.plots.budget import draw_budget, draw_budget_along
from gantrysim.report.plots.style import COLOURS, UM, axes_on, colour_map, sheet
from gantrysim.results.colours import MAGNITUDE, SHARE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_HEIGHT = 5.6  # [inch]
# of plan and budget, with turns and without [inch]
_WIDTHS = (6.0, 6.0)
_WIDTHS_ALONG = (5.4, 8.6)
_MOST_PIECES = 20_000  # of the coloured path


def overview(budget: Budget) -> Figure:
    """Return a figure with the nozzle's path, coloured by its error, and the error budget beside it.

    A notebook shows it, whether pyplot is in use or not.

    Args:
        budget: of the run.
    """
    # a path without turns has no bars by turn: its parts are drawn along it, with a wider legend
    draw = draw_budget if budget.values.turns else draw_budget_along
    widths = _WIDTHS if budget.values.turns else _WIDTHS_ALONG
    with sheet(sum(widths), _HEIGHT) as figure:
        plan, shares = figure.subfigures(1, 2, squeeze=False, width_ratios=widths)[0]
        draw_coloured_plan(plan, budget)
        draw(shares, budget)
        fault = budget.analysis.run.fault
        if fault is not None:
            figure.supxlabel(f"fault: {fault}", color=COLOURS["fault"], fontsize="medium")
    # IPython calls it; matplotlib's own hook exists only once pyplot is imported
    figure._repr_png_ = partial(_png, figure)  # type: ignore[attr-defined]
    return figure


def draw_coloured_plan(on: Figure | SubFigure | Axes, budget: Budget) -> Axes:
    """Draw the requested path, and the nozzle's coloured by its share of the tolerance; return the axes."""
    analysis = budget.analysis
    run = analysis.run
    axes = axes_on(on)
    line = run.requested.position(np.linspace(0, run.requested.length, 4000))
    axes.plot(line[:, 0], line[:, 1], color=COLOURS["requested"], lw=0.8, label="requested path")
    distance = analysis.nozzle.distance
    step = -(-distance.size // _MOST_PIECES)
    shown = np.arange(0, distance.size, step)
    ticks = analysis.ticks[shown]
    trace = by_blocks(lambda block: run.nozzle[ticks[block], :2], shown.size)
    pieces = np.stack([trace[:-1], trace[1:]], axis=1)
    # not across moves with the dispenser off
    joined = np.diff(ticks) <= step
    # without a job or a rig there is no tolerance
    scale = MAGNITUDE if run.basis is None else SHARE
    unit = float(distance.max()) or 1.0 if run.basis is None else run.basis.limits(run.face).path_max
    coloured = LineCollection(list(pieces[joined]), cmap=colour_map(scale), linewidths=2.4)
    coloured.set_array(scale.places(np.maximum(distance[shown[:-1]], distance[shown[1:]])[joined] / unit))
    coloured.set_clim(0, 1)
    axes.add_collection(coloured)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", title=f"Plan view, machine {run.machine}")
    bar = axes.figure.colorbar(coloured, ax=axes, label="contour error [µm]", shrink=0.8)
    labels = [f"{UM * unit * tick:.3g}{', tolerance' if scale is SHARE and tick == 1 else ''}" for tick in scale.ticks]
    bar.set_ticks(scale.places(np.array(scale.ticks)).tolist(), labels=labels)
    return axes


def _png(figure: Any) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()
