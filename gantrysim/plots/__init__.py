"""Plots of one run: plan view with the error magnified, errors over time, spacing by turn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath

from gantrysim.metrics import Analysis
from gantrysim.plots.budget import draw_budget, draw_budget_along
from gantrysim.plots.error import draw_error
from gantrysim.plots.plan import draw_plan
from gantrysim.plots.spacing import draw_polar_spacing, draw_spacing
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, INK, sheet

__all__ = [
    "AXIS_COLOURS",
    "COLOURS",
    "INK",
    "draw_budget",
    "draw_budget_along",
    "draw_error",
    "draw_plan",
    "draw_polar_spacing",
    "draw_spacing",
    "save_plots",
    "sheet",
]


def save_plots(analysis: Analysis, folder: FilePath, progress: Callable[[float], None] | None = None) -> list[FilePath]:
    """Write plan.png, error.png and, where the trace has neighbouring turns, spacing.png.

    Returns:
        The files written.
    """
    tall = 6.5 if len(set(analysis.run.units)) == 1 else 9.0  # a panel for each kind of axes, and one for the path
    drawings = {"plan": (draw_plan, (7.0, 7.0)), "error": (draw_error, (9.0, tall))}
    if analysis.spacing.distance.size:
        drawings["spacing"] = (draw_spacing, (8.0, 4.6))
    written = []
    for name, (draw, size) in drawings.items():
        with sheet(*size) as figure:
            draw(figure, analysis)
            if analysis.run.fault is not None:
                figure.supxlabel(f"fault: {analysis.run.fault}", color=COLOURS["fault"], fontsize="medium")
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1])
        if progress is not None:
            progress(len(written) / len(drawings))
    return written
