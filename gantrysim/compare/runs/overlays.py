"""Plots of runs over one another: plan, errors, error budgets and causes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import UM, number_text
from gantrysim.compare.runs.compared_run import RUN_DASHES
from gantrysim.compare.runs.compared_runs import ComparedRuns
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.parts import ERROR
from gantrysim.report.plots.plan import magnification
from gantrysim.report.plots.style import COLOURS, add_legend, axes_on, draw_limit, thinned_line
from gantrysim.results.colours import BAD, INK, RUNS
from gantrysim.results.score import usage_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_MOST_POINTS = 100_000  # of a nozzle's path
_COLUMNS = 700  # horizontal resolution of noisy lines, which make a page large
_NOTHING = 1e-6  # largest negligible error [mm]
_LONGEST_USE = 250.0  # length of a bar of a limit's use [%]
_BAR = 0.8  # of the distance of two groups of bars


def run_style(number: int) -> dict[str, Any]:
    """Return colour and dashes of a run's lines."""
    dashes = RUN_DASHES[number]
    return {"color": RUNS[number], "ls": (0, dashes) if dashes else "-"}


def shared_magnification(comparison: ComparedRuns) -> int:
    """Return the factor by which errors in the plan are drawn, the same for all runs."""
    return min(magnification(run.analysis) for run in comparison.runs)


def draw_overlaid_plan(on: Figure | SubFigure | Axes, comparison: ComparedRuns) -> Axes:
    """Draw the requested paths and the nozzles' paths of all runs, their errors magnified alike; return the axes."""
    axes = axes_on(on)
    factor = shared_magnification(comparison)
    parted = {parting.run for parting in comparison.partings}
    for number, run in enumerate(comparison.runs):
        analysis = run.analysis
        if number == 0 or number in parted:
            path = analysis.run.requested
            line = path.position(np.linspace(0, path.length, 4000))
            label = "requested path" if number == 0 else "_"
            axes.plot(line[:, 0], line[:, 1], color=COLOURS["requested"], lw=0.8, label=label)
        trace = magnified_path(analysis, factor)
        axes.plot(trace[:, 0], trace[:, 1], lw=1.4, label=run.name, **run_style(number))
    axes.set_aspect("equal", adjustable="datalim")
    title = f"Plan view, errors × {factor}" if factor > 1 else "Plan view"
    axes.set(xlabel="x [mm]", ylabel="y [mm]", title=title)
    add_legend(on)
    return axes


def magnified_path(analysis: Analysis, factor: int) -> Floats:
    """Return the nozzle's path with its error magnified, NaN between stretches of dispensing, (m, 3) [mm]."""
    step = -(-analysis.ticks.size // _MOST_POINTS)
    shown = np.arange(0, analysis.ticks.size, step)
    ticks = analysis.ticks[shown]
    trace = analysis.run.nozzle[ticks] + (factor - 1) * analysis.nozzle.offset[shown]
    gaps = np.flatnonzero(np.diff(ticks) > step) + 1
    return np.insert(trace, gaps, np.nan, axis=0)


def draw_overlaid_errors(figure: Figure | SubFigure, comparison: ComparedRuns) -> tuple[Axes, ...]:
    """Draw the contour error, with the first run's limit, and every link's part of all runs; return the axes."""
    names = ["contour", *drawn_links(comparison)]
    panels = figure.subplots(len(names), sharex=True, squeeze=False, height_ratios=[2.0] + [1.0] * (len(names) - 1))[
        :, 0
    ]
    for panel, name in zip(panels, names, strict=True):
        for number, (run, track) in enumerate(zip(comparison.runs, comparison.tracks, strict=True)):
            budget = run.results.budget
            part = budget.contour if name == "contour" else budget.parts.get(name)
            if part is None:
                continue
            gaps = np.flatnonzero(np.diff(track.ticks) > 1) + 1
            error = np.insert(UM * part.lateral, gaps, np.nan)
            line = thinned_line(np.insert(track.place, gaps, np.nan), error, _COLUMNS)
            panel.plot(*line, lw=1.2 if name == "contour" else 0.9, label=run.name, **run_style(number))
        panel.axhline(0, color=INK, lw=0.6)
        panel.margins(x=0.01)
        panel.set_ylabel(name, fontsize=9)
    tolerance = comparison.verdicts[0].tolerance
    if tolerance is not None:
        draw_limit(panels[0], UM * tolerance.path_max)
    panels[0].legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=len(comparison.runs) + 1)
    panels[-1].set_xlabel("distance along the requested path [mm]" if comparison.by_path else "time [s]")
    figure.supylabel("lateral error, positive to the left [µm]", fontsize="medium")
    return tuple(panels)


def drawn_links(comparison: ComparedRuns) -> Iterator[str]:
    """Yield the links whose part of the error is not negligible in every run."""
    for name, parts in comparison.budgets.items():
        if name != "contour" and any(part is not None and part.max > _NOTHING for part in parts):
            yield name


def draw_compared_budgets(on: Figure | SubFigure | Axes, comparison: ComparedRuns) -> Axes:
    """Draw the rms of each link's part in every run as bars on one scale; return the axes."""
    sizes = {
        name: [None if part is None else ERROR.factor * part.rms for part in parts]
        for name, parts in comparison.budgets.items()
    }
    axes = _bars(on, sizes, comparison.names, ERROR.form)
    axes.set_xlabel("error normal to the requested path, rms [µm]")
    return axes


def draw_compared_causes(on: Figure | SubFigure | Axes, comparison: ComparedRuns) -> Axes:
    """Draw what each cause is worth in every run as bars on one scale; return the axes."""
    worth = {
        name: [None if value is None else ERROR.factor * value for value in values]
        for name, values in comparison.causes.items()
    }
    axes = _bars(on, worth, comparison.names, ".2f")
    axes.set_xlabel("worth of the rms contour error [µm]")
    return axes


def draw_limit_use(on: Figure | SubFigure | Axes, comparison: ComparedRuns) -> Axes:
    """Draw the largest share of a limit that each row of the verdicts uses, and the limit; return the axes."""
    rows: dict[str, list[float | None]] = {}
    for verdict in comparison.verdicts:
        for row in verdict.rows:
            usage = usage_of(row)
            rows.setdefault(row.name, []).append(None if math.isnan(usage) else 100 * usage)
    axes = _bars(on, rows, comparison.names, ".0f", _LONGEST_USE)
    axes.axvline(100, color=BAD, lw=1.4, ls="--", zorder=3)
    axes.set_xlabel("largest share of a limit that is used [%]; dashed: the limit")
    return axes


def _bars(
    on: Figure | SubFigure | Axes,
    values: Mapping[str, Sequence[float | None]],
    names: Sequence[str],
    form: str,
    longest: float = math.inf,
) -> Axes:
    """Draw groups of horizontal bars, one bar for each run, with their numbers; a longer one than `longest` is cut."""
    axes = axes_on(on)
    height = _BAR / len(names)
    for number, name in enumerate(names):
        places = np.arange(len(values)) + (number - 0.5 * (len(names) - 1)) * height
        sizes = [numbers[number] for numbers in values.values()]
        widths = [0.0 if size is None else min(size, longest) for size in sizes]
        # hatched too, so that no run is known by its colour alone
        hatch = "///" if RUN_DASHES[number] else None
        bars = axes.barh(
            places, widths, 0.92 * height, color=RUNS[number], edgecolor="white", lw=0, hatch=hatch, label=name
        )
        axes.bar_label(bars, [number_text(size, form) for size in sizes], padding=3, fontsize=8)
    axes.set_yticks(range(len(values)), list(values))
    axes.set_ylim(len(values) - 0.5, -0.5)
    axes.margins(x=0.08)
    axes.axvline(0, color=INK, lw=0.6)
    axes.grid(visible=False, axis="y")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=len(names))
    return axes
