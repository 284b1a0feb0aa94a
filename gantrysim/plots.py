"""Plots of one run: plan view with the error magnified, errors over time, spacing by turn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.controllers.path import Floats
from gantrysim.metrics import Figures, spacing, tracking_error
from gantrysim.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["save_plots"]

_UM = 1e3
_COLOURS = {"requested": "0.55", "generation": "#4477aa", "contour": "#d1580b", "fault": "#bb0022"}
_AXIS_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "savefig.dpi": 130,
}
_MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def save_plots(
    run: Run, figures: Figures, folder: FilePath, progress: Callable[[float], None] | None = None
) -> list[FilePath]:
    """Write plan.png, error.png and, where the trace has neighbouring turns, spacing.png.

    Returns:
        The files written.
    """
    import matplotlib  # slow to import, and needed by the plots alone
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawings = {"plan": (_plan, (7.0, 7.0)), "error": (_error, (9.0, 6.5))}
    if figures.spacing is not None:
        drawings["spacing"] = (_spacing, (8.0, 4.6))
    written = []
    with matplotlib.rc_context(_STYLE):
        for name, (draw, size) in drawings.items():
            figure = Figure(figsize=size, layout="constrained")
            FigureCanvasAgg(figure)
            draw(figure, run)
            if run.fault is not None:
                figure.text(0.5, 0.005, f"fault: {run.fault}", color=_COLOURS["fault"], ha="center", va="bottom")
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1])
            if progress is not None:
                progress(len(written) / len(drawings))
    return written


def _plan(figure: Figure, run: Run) -> None:
    """Requested path, and the nozzle's trace with its error to the path magnified."""
    axes = figure.add_subplot()
    trace = run.nozzle[run.dispense]
    foot = run.requested.project(trace)
    # the largest factor that keeps the drawn error below a fifth of the spacing of neighbouring turns
    turns = spacing(run.requested, trace).distance
    room = 0.2 * float(turns.mean()) if turns.size else 0.02 * float(np.ptp(trace[:, :2], axis=0).max())
    usual = max(float(np.percentile(foot.distance, 99)), 1e-9)
    factor = max((m for m in _MAGNIFICATIONS if m * usual <= room), default=1)
    drawn = trace + (factor - 1) * foot.offset
    line = run.requested.position(np.linspace(0, run.requested.length, 4000))
    axes.plot(line[:, 0], line[:, 1], color=_COLOURS["requested"], lw=1.0, label="requested path")
    label = f"nozzle, error x {factor}" if factor > 1 else "nozzle"
    axes.plot(drawn[:, 0], drawn[:, 1], color=_COLOURS["contour"], lw=1.0, label=label)
    axes.plot(*trace[0, :2], "o", ms=5, color="0.2")
    axes.annotate("start", (trace[0, 0], trace[0, 1]), xytext=(6, -4), textcoords="offset points", va="top")
    axes.plot(*trace[-1, :2], "s", ms=5, color="0.2")
    axes.annotate("end", (trace[-1, 0], trace[-1, 1]), xytext=(6, -4), textcoords="offset points", va="top")
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title=f"Plan view on machine {run.machine}")
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 1.0), framealpha=0.9, frameon=True)


def _error(figure: Figure, run: Run) -> None:
    """Error against time: tracking per axis above, and what the part sees below."""
    on = run.dispense
    upper, lower = figure.subplots(2, sharex=True)
    for a, name in enumerate(run.axes):
        upper.plot(run.time, _UM * tracking_error(run)[:, a], color=_AXIS_COLOURS[a], lw=0.9, label=name)
    upper.set(ylabel="commanded - encoder [µm]", title="Tracking error of the axes")
    upper.legend(loc="upper right", ncols=len(run.axes))
    lower.plot(
        run.time[on],
        _UM * _lateral(run, run.commanded_tip[on]),
        color=_COLOURS["generation"],
        lw=0.9,
        label="generation",
    )
    lower.plot(
        run.time[on], _UM * _lateral(run, run.nozzle[on]), color=_COLOURS["contour"], lw=0.9, label="contour (nozzle)"
    )
    lower.set(xlabel="time [s]", ylabel="left of the requested path [µm]", title="Error normal to the requested path")
    lower.legend(loc="upper right", ncols=2)
    for axes in (upper, lower):
        axes.axhline(0, color="0.4", lw=0.6)
        axes.margins(x=0.01)
        if not on.all():
            axes.axvspan(run.time[on][-1], run.time[-1], color="0.5", alpha=0.12, lw=0)


def _lateral(run: Run, points: Floats) -> Floats:
    return run.requested.project(points).lateral


def _spacing(figure: Figure, run: Run) -> None:
    """Spacing of neighbouring turns, turn by turn."""
    axes = figure.add_subplot()
    turns = spacing(run.requested, run.nozzle[run.dispense])
    number = np.floor(turns.turn).astype(int)
    for k in np.unique(number):
        chosen = number == k
        angle = 360 * (turns.turn[chosen] - k)
        axes.plot(
            angle,
            turns.distance[chosen],
            lw=1.2,
            color=_AXIS_COLOURS[k % len(_AXIS_COLOURS)],
            label=f"turn {k + 1} to {k + 2}",
        )
    axes.set(
        xlabel="angle of the tangent within the turn [deg]",
        ylabel="spacing [mm]",
        title="Spacing of neighbouring turns along the normal",
    )
    axes.set_xticks(range(0, 361, 45))
    axes.set_xlim(0, 360)
    _plain_ticks(axes)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _plain_ticks(axes: Axes) -> None:
    axes.ticklabel_format(axis="y", useOffset=False)
