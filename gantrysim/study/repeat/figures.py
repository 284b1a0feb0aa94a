"""The plots and the table of a repeat study."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gantrysim.metrics import RepeatedPath
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, INK, UM, sheet
from gantrysim.study.cases import Row
from gantrysim.study.repeat.repeats import ALL
from gantrysim.study.study import Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gantrysim.report import Table
    from gantrysim.study.repeat.study import RepeatStudy


def figures(study: RepeatStudy, rows: list[Row]) -> list[Plot]:
    """Return accuracy and repeatability along the path, and where on the plan they are."""
    paths = study.paths(rows)
    if ALL not in paths:
        return []
    return [
        Plot(
            "along",
            "Along the path",
            "Above, how far the mean of the repeats is from the requested path, with the circle of repeatability "
            "as a band about it. Below, the repeatability, and what it is where one source is varied alone.",
            _draw_along(paths, ALL),
            tables=[_table(paths)],
        ),
        Plot(
            "plan",
            "On the plan",
            "The path coloured by the repeatability.",
            _draw_plan(paths[ALL]),
        ),
    ]


def _table(paths: dict[str, RepeatedPath]) -> Table:
    from gantrysim.report import Column, Table

    columns: list[str | Column] = ["varied", "repeats"]
    columns += [Column(head, ".2f") for head in ("ATp [µm]", "median [µm]", "RTp [µm]", "median RT [µm]")]
    rows = [
        [
            varied,
            len(path.attained),
            *(UM * value for value in (path.path_accuracy, float(np.median(path.accuracy)))),
            *(UM * value for value in (path.path_repeatability, float(np.median(path.repeatability)))),
        ]
        for varied, path in paths.items()
    ]
    return Table(columns, rows, caption="AnalysisValues in the manner of ISO 9283.")


def _draw_along(paths: dict[str, RepeatedPath], every: str) -> Figure:
    """Draw accuracy and repeatability along the path, and the repeatability by what was varied.

    Args:
        paths: by what was varied.
        every: name of that in which everything was.
    """
    path = paths[every]
    accuracy, reach = UM * path.accuracy, UM * path.repeatability
    with sheet(9.0, 6.6) as figure:
        above, below = figure.subplots(2, sharex=True)
        low, high = np.maximum(accuracy - reach, 0), accuracy + reach
        above.fill_between(path.s, low, high, color=COLOURS["tracking"], alpha=0.25, lw=0, label="± repeatability RT")
        above.plot(path.s, accuracy, color=INK, lw=1.2, label="accuracy AT: mean of the repeats to the path")
        k = int(accuracy.argmax())
        above.plot(path.s[k], accuracy[k], "v", ms=7, color=COLOURS["fault"], label=f"ATp = {accuracy[k]:.2f} µm")
        below.plot(path.s, reach, color=INK, lw=1.4, label=f"{every} varied, RTp = {reach.max():.2f} µm")
        for colour, (varied, one) in zip(AXIS_COLOURS, ((n, p) for n, p in paths.items() if n != every), strict=False):
            label = f"{varied} alone, {UM * one.path_repeatability:.2f} µm"
            below.plot(one.s, UM * one.repeatability, color=colour, lw=1.0, label=label)
        above.set(ylabel="to the requested path [µm]")
        below.set(ylabel="repeatability [µm]", xlabel="arc length along the requested path [mm]")
        for axes in (above, below):
            axes.set_ylim(bottom=0)
            axes.set_xlim(path.s[0], path.s[-1])
            axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, fontsize=9, borderaxespad=0.2)
    return figure


def _draw_plan(path: RepeatedPath) -> Figure:
    """Draw the path seen from above, coloured by the repeatability."""
    from matplotlib.collections import LineCollection

    points, reach = path.command[:, :2], UM * path.repeatability
    steps = np.diff(path.s)
    joined = steps < 1.5 * np.median(steps)  # where no glue is laid there is no line
    segments = np.stack([points[:-1], points[1:]], axis=1)[joined]
    width, depth = np.maximum(np.ptp(points, axis=0), 1e-9)
    with sheet(7.4, float(np.clip(5.6 * depth / width + 1.1, 3.0, 7.4))) as figure:
        axes = figure.add_subplot()
        lines = LineCollection(list(segments), cmap="viridis", linewidths=3.0, capstyle="round")
        lines.set_array(0.5 * (reach[:-1] + reach[1:])[joined])
        lines.set_clim(0, float(reach.max()) or 1.0)
        axes.add_collection(lines)
        k = int(reach.argmax())
        label = f"RTp = {reach[k]:.2f} µm"
        axes.plot(*points[k], "o", ms=11, mfc="none", mew=1.6, color=COLOURS["fault"], ls="none", label=label)
        k = int(path.accuracy.argmax())
        label = f"ATp = {UM * path.path_accuracy:.2f} µm"
        axes.plot(*points[k], "s", ms=11, mfc="none", mew=1.6, color=INK, ls="none", label=label)
        axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
        axes.margins(0.06)
        figure.colorbar(lines, ax=axes, label="repeatability RT [µm]", shrink=0.85)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return figure
