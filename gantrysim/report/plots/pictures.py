"""The plots of a run that are saved as pictures and shown on its page, each drawn once for both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.base.files import replaced_file
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.plots.bead import draw_height_map
from gantrysim.report.plots.budget import draw_budget_along
from gantrysim.report.plots.error import draw_error
from gantrysim.report.plots.plan import draw_plan, plan_extent
from gantrysim.report.plots.spacing import draw_spacing
from gantrysim.report.plots.style import COLOURS, COLUMNS, RESOLUTION, common_style, sheet, thinned_line, view_height
from gantrysim.results.checks import Check

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# width of a plot across the page, and of one of two side by side [inch]
PLOT_WIDTH = 10.7
HALF_HEIGHT = 4.4
_PLAN = 7.6  # of a plan view
PAGE_COLUMNS = 350  # horizontal resolution of noisy lines on a page, which they make large


@dataclass(frozen=True)
class Plot:
    """A plot of a run.

    Attributes:
        name: stem of its file.
        draw: draws it on a figure.
        width: of the figure [inch].
        height: of the figure [inch].
        columns: horizontal resolution of its lines on a page.
        resolution: of the picture [dpi].
        fault: what ended the run, a label below the picture; empty for a complete run.
    """

    name: str
    draw: Callable[[Figure], object]
    width: float
    height: float
    columns: int = COLUMNS
    resolution: float = RESOLUTION
    fault: str = ""

    def save(self, folder: Path) -> Path:
        """Write the plot into a folder, as a PNG file; return the file."""
        figure = self._drawn_figure()
        if self.fault:
            figure.supxlabel(f"fault: {self.fault}", color=COLOURS["fault"], fontsize="medium")
        return self._write(figure, folder)

    def figure(self, folder: Path | None = None) -> Figure:
        """Return the plot for a page.

        Args:
            folder: where the picture is written on the way, if that is possible and the run is complete; None for none.
        """
        figure = self._drawn_figure()
        if folder is not None and not self.fault:
            # of one that is missing, `save` tells why
            with suppress(Exception):
                self._write(figure, folder)
        if self.columns < COLUMNS:
            _coarsen(figure, self.columns)
        return figure

    def _drawn_figure(self) -> Figure:
        with sheet(self.width, self.height) as figure:
            self.draw(figure)
        return figure

    def _write(self, figure: Figure, folder: Path) -> Path:
        file = folder / f"{self.name}.png"
        with replaced_file(file) as new, common_style():
            figure.savefig(new, format="png", dpi=self.resolution)
        return file


def run_plots(budget: Budget, bead: Bead | None, check: Check | None = None) -> Iterator[Plot]:
    """Yield the plots of a run that are saved: plan view, errors, error budget, spacing of turns, and bead.

    Args:
        budget: of the run.
        bead: of the run.
        check: value of the verdict whose place the plan view marks; None for the largest path error.
    """
    analysis = budget.analysis
    yield plan_plot(analysis, check)
    yield error_plot(analysis)
    yield budget_plot(budget)
    if analysis.spacing.distance.size:
        yield spacing_plot(analysis)
    if bead is not None and bead.has_glue:
        yield height_plot(bead)


def plan_plot(analysis: Analysis, check: Check | None = None) -> Plot:
    """Return the plan view of a run, see `run_plots`."""
    height = view_height(*plan_extent(analysis), _PLAN)
    return Plot("plan", partial(draw_plan, analysis=analysis, check=check), _PLAN, height, fault=_fault(analysis))


def error_plot(analysis: Analysis) -> Plot:
    """Return the plot of the errors over time: a panel for each kind of axis, and one for the path."""
    height = 6.5 if len(set(analysis.run.units)) == 1 else 8.5
    return Plot(
        "error", partial(draw_error, analysis=analysis), PLOT_WIDTH, height, PAGE_COLUMNS, fault=_fault(analysis)
    )


def budget_plot(budget: Budget) -> Plot:
    """Return the plot of the links' errors along the path."""
    draw = partial(draw_budget_along, budget=budget)
    return Plot("budget", draw, PLOT_WIDTH, 8.0, columns=PAGE_COLUMNS, fault=_fault(budget.analysis))


def spacing_plot(analysis: Analysis) -> Plot:
    """Return the plot of the spacing of turns, half as wide as a page."""
    draw = partial(draw_spacing, analysis=analysis)
    return Plot("spacing", draw, HALF_HEIGHT, 4.8, resolution=200.0, fault=_fault(analysis))


def height_plot(bead: Bead) -> Plot:
    """Return the height map of a bead."""
    height = 0.9 * view_height(float(np.ptp(bead.map.x)), float(np.ptp(bead.map.y)), _PLAN)
    return Plot("bead", partial(draw_height_map, bead=bead), _PLAN, height, fault=_fault(bead.analysis))


def _fault(analysis: Analysis) -> str:
    fault = analysis.run.fault
    return "" if fault is None else str(fault)


def _coarsen(figure: Figure, columns: int) -> None:
    """Thin the lines of a figure further; their envelope remains."""
    for axes in figure.axes:
        for line in axes.get_lines():
            x, y = (np.asarray(values, np.float64) for values in line.get_data())
            line.set_data(*thinned_line(x, y, columns))
