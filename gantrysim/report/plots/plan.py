"""Plot of the plan view, and beside the error budget."""

from __future__ import annotations

import io
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.columns import by_blocks
from gantrysim.base.quantity import UM
from gantrysim.job.basis import Basis
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.plots.budget import draw_budget, draw_budget_along
from gantrysim.report.plots.style import COLOURS, add_legend, axes_on, colour_map, sheet
from gantrysim.results.checks import Check
from gantrysim.results.colours import INK, MAGNITUDE, SHARE
from gantrysim.results.verdict import path_row, shown_path_limit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


_MOST_POINTS = 500_000  # of the nozzle's path
_MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)

_HEIGHT = 5.6  # [inch]
# of plan and budget, with turns and without [inch]
_WIDTHS = (6.0, 6.0)
_WIDTHS_ALONG = (5.4, 8.6)
_MOST_PIECES = 20_000  # of the coloured path


def draw_plan(on: Figure | SubFigure | Axes, analysis: Analysis, check: Check | None = None) -> Axes:
    """Draw the requested path, and the nozzle's path with its error magnified; return the axes.

    Args:
        on: what to draw on.
        analysis: of the run.
        check: value of the verdict whose place is marked, see `Verdict.placed_check`; None for the largest path error.
    """
    run = analysis.run
    axes = axes_on(on)
    distance = analysis.nozzle.distance
    worst = int(distance.argmax())
    factor = magnification(analysis)
    every = np.arange(0, distance.size, -(-distance.size // _MOST_POINTS))
    shown = np.unique(np.append(every, [worst, distance.size - 1]))
    ticks = analysis.ticks[shown]
    trace = by_blocks(lambda block: run.nozzle[ticks[block]], shown.size)
    drawn = trace + (factor - 1) * by_blocks(lambda block: analysis.nozzle.offset[shown[block]], shown.size)
    line = run.requested.position(np.linspace(0, run.requested.length, 4000))
    axes.plot(line[:, 0], line[:, 1], color=COLOURS["requested"], lw=1.0, label="requested path")
    label = f"nozzle, error × {factor}" if factor > 1 else "nozzle"
    axes.plot(drawn[:, 0], drawn[:, 1], color=COLOURS["contour"], lw=1.0, label=label)
    if check is None or check.place.time is None:
        tick = int(analysis.ticks[worst])
        worst_label = f"largest error: {UM * distance[worst]:.0f} µm"
    else:
        tick = min(int(np.searchsorted(run.time, check.place.time - 0.5 * run.period)), len(run.time) - 1)
        worst_label = f"worst: {check.brief}"
    axes.plot(
        *_drawn_place(analysis, tick, factor),
        "v",
        ms=7,
        mfc="none",
        color=COLOURS["fault"],
        ls="none",
        label=worst_label,
    )
    for k, mark, name in ((0, "o", "start"), (-1, "s", "end")):
        axes.plot(*trace[k, :2], mark, ms=5, color=INK)
        axes.annotate(name, (trace[k, 0], trace[k, 1]), xytext=(6, -4), textcoords="offset points", va="top")
    # a box that shrinks would leave the title out of the layout
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", title=f"Plan view, machine {run.machine}")
    add_legend(on)
    return axes


def _drawn_place(analysis: Analysis, tick: int, factor: int) -> tuple[float, float]:
    """Return x and y at which a tick of the run is drawn; its error is magnified where the dispenser is on [mm]."""
    x, y = analysis.run.nozzle[tick, :2].tolist()
    row = int(np.searchsorted(analysis.ticks, tick))
    if row == analysis.ticks.size or analysis.ticks[row] != tick:
        return x, y
    dx, dy = ((factor - 1) * analysis.nozzle.offset[row, :2]).tolist()
    return x + dx, y + dy


def plan_extent(analysis: Analysis) -> tuple[float, float]:
    """Return the size of the requested path in plan view, along x and along y [mm]."""
    path = analysis.run.requested
    x, y = np.ptp(path.position(np.linspace(0, path.length, 1000))[:, :2], axis=0).tolist()
    return x, y


def magnification(analysis: Analysis) -> int:
    """Return the largest factor that keeps drawn errors below a fifth of the turns' spacing, or 2 % of the extent."""
    turns = analysis.spacing.distance
    if turns.size:
        room = 0.2 * float(turns.mean())
    else:
        room = 0.02 * float(np.ptp(analysis.run.nozzle[analysis.ticks, :2], axis=0).max())
    usual = max(float(np.percentile(analysis.nozzle.distance, 99)), 1e-9)
    return max((factor for factor in _MAGNIFICATIONS if factor * usual <= room), default=1)


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
    unit = float(distance.max()) or 1.0 if run.basis is None else _path_limit(run.basis, budget)
    from matplotlib.collections import LineCollection

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


def _path_limit(basis: Basis, budget: Budget) -> float:
    """Return the limit for which the path is judged worst [mm]."""
    tolerance = basis.limits(budget.analysis.run.face)
    return shown_path_limit(path_row(budget.contour_values, tolerance, lambda _: None), tolerance)


def _png(figure: Any) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()
