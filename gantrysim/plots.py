"""Plots of one run: plan view with the error magnified, errors over time, spacing by turn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.controllers.path import Floats
from gantrysim.metrics import THOUSANDTH, Analysis, tracking_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_error", "draw_plan", "draw_spacing", "save_plots"]

_UM = 1e3
_COLOURS = {"requested": "0.55", "generation": "#b8a000", "contour": "#882255", "fault": "#bb0022"}
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


def save_plots(analysis: Analysis, folder: FilePath, progress: Callable[[float], None] | None = None) -> list[FilePath]:
    """Write plan.png, error.png and, where the trace has neighbouring turns, spacing.png.

    Returns:
        The files written.
    """
    import matplotlib  # slow to import, and needed by the plots alone
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    tall = 6.5 if len(set(analysis.run.units)) == 1 else 9.0  # a panel for each kind of axes, and one for the path
    drawings = {"plan": (draw_plan, (7.0, 7.0)), "error": (draw_error, (9.0, tall))}
    if analysis.spacing.distance.size:
        drawings["spacing"] = (draw_spacing, (8.0, 4.6))
    written = []
    with matplotlib.rc_context(_STYLE):
        for name, (draw, size) in drawings.items():
            figure = Figure(figsize=size, layout="constrained")
            FigureCanvasAgg(figure)
            draw(figure, analysis)
            if analysis.run.fault is not None:
                figure.supxlabel(f"fault: {analysis.run.fault}", color=_COLOURS["fault"], fontsize="medium")
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1])
            if progress is not None:
                progress(len(written) / len(drawings))
    return written


def draw_plan(figure: Figure, analysis: Analysis) -> None:
    """Draw the requested path, and the nozzle's trace with its error to the path magnified."""
    run = analysis.run
    axes = figure.add_subplot()
    trace, offset, distance = run.nozzle[analysis.ticks], analysis.nozzle.offset, analysis.nozzle.distance
    factor = _magnification(analysis)
    drawn = trace + (factor - 1) * offset
    line = run.requested.position(np.linspace(0, run.requested.length, 4000))
    axes.plot(line[:, 0], line[:, 1], color=_COLOURS["requested"], lw=1.0, label="requested path")
    label = f"nozzle, error magnified {factor} times" if factor > 1 else "nozzle"
    axes.plot(drawn[:, 0], drawn[:, 1], color=_COLOURS["contour"], lw=1.0, label=label)
    worst = int(distance.argmax())
    worst_label = f"largest error, {_UM * distance[worst]:.0f} µm"
    axes.plot(*drawn[worst, :2], "v", ms=7, mfc="none", color=_COLOURS["fault"], ls="none", label=worst_label)
    for k, mark, name in ((0, "o", "start"), (-1, "s", "end")):
        axes.plot(*trace[k, :2], mark, ms=5, color="0.2")
        axes.annotate(name, (trace[k, 0], trace[k, 1]), xytext=(6, -4), textcoords="offset points", va="top")
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title=f"Plan view, machine {run.machine}")
    figure.legend(loc="outside lower center", ncols=3)


def _magnification(analysis: Analysis) -> int:
    """The largest round factor that keeps the drawn error below a fifth of the turns' spacing, or of the size."""
    trace = analysis.run.nozzle[analysis.ticks]
    turns = analysis.spacing.distance
    room = 0.2 * float(turns.mean()) if turns.size else 0.02 * float(np.ptp(trace[:, :2], axis=0).max())
    usual = max(float(np.percentile(analysis.nozzle.distance, 99)), 1e-9)
    return max((factor for factor in _MAGNIFICATIONS if factor * usual <= room), default=1)


def draw_error(figure: Figure, analysis: Analysis) -> None:
    """Draw errors against time: tracking per axis above, rotary axes by themselves, and what the part sees below."""
    run, on = analysis.run, analysis.ticks
    kinds = [unit for unit in THOUSANDTH if unit in run.units]
    *upper, lower = figure.subplots(len(kinds) + 1, sharex=True)
    error = 1e3 * tracking_error(run)
    for panel, unit in zip(upper, kinds, strict=True):
        members = [a for a, own in enumerate(run.units) if own == unit]
        for a in members:
            panel.plot(run.time, error[:, a], color=_AXIS_COLOURS[a], lw=0.9, label=run.axes[a])
        _clip(panel, run.time[on], error[on], members, THOUSANDTH[unit])
        panel.set(ylabel=f"commanded - encoder [{THOUSANDTH[unit]}]")
        panel.set_title(f"Tracking error of the {'axes' if unit == 'mm' else 'rotary axes'}", loc="right")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=len(members))
    for name, foot, style in (
        ("contour: nozzle", analysis.nozzle, "-"),
        ("generation: commanded", analysis.commanded, "--"),
    ):
        lateral = np.full(len(run.time), np.nan)
        lateral[on] = _UM * foot.lateral
        lower.plot(run.time, lateral, color=_COLOURS[name.partition(":")[0]], lw=1.0, ls=style, label=name)
    lower.set(xlabel="time [s]", ylabel="left of the requested path [µm]")
    lower.set_title("Error normal to the requested path", loc="right")
    lower.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    for axes in (*upper, lower):
        axes.axhline(0, color="0.4", lw=0.6)
        axes.margins(x=0.01)
        for start, end in _spans(~run.dispense):
            axes.axvspan(run.time[start], run.time[end], color="0.5", alpha=0.12, lw=0)
            axes.annotate(
                "dispenser off",
                (run.time[start], 0.03),
                xycoords=("data", "axes fraction"),
                rotation=90,
                fontsize=7,
                va="bottom",
            )


def _clip(axes: Axes, time: Floats, errors: Floats, members: list[int], unit: str) -> None:
    """Let rare peaks leave the picture, and write down how high the highest of these columns is."""
    error = errors[:, members]
    largest = np.abs(error).max()
    usual = 1.6 * float(np.percentile(np.abs(error).max(axis=1), 99.5))
    if largest <= usual or usual == 0:
        return
    axes.set_ylim(-usual, usual)
    k, a = np.unravel_index(int(np.abs(error).argmax()), error.shape)
    at = (time[k], np.sign(error[k, a]) * usual)
    text = f"peak {error[k, a]:.0f} {unit} at {time[k]:.3f} s"
    colour = _AXIS_COLOURS[members[int(a)]]
    axes.annotate(text, at, xytext=(8, -12 if at[1] > 0 else 6), textcoords="offset points", color=colour)


def _spans(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(start), int(end) - 1) for start, end in zip(edges[::2], edges[1::2], strict=True)]


def draw_spacing(figure: Figure, analysis: Analysis) -> None:
    """Draw the spacing of neighbouring turns, turn by turn."""
    axes = figure.add_subplot()
    turns, asked = analysis.spacing, analysis.run.requested.turn_spacing
    number = np.floor(turns.turn).astype(int)
    for k in np.unique(number):
        chosen = number == k
        angle = 360 * (turns.turn[chosen] - k)
        colour = _AXIS_COLOURS[k % len(_AXIS_COLOURS)]
        axes.plot(angle, turns.distance[chosen], lw=1.2, color=colour, label=f"turn {k + 1} to {k + 2}")
    if asked is not None:
        axes.axhline(asked, color="0.3", lw=1.0, ls="--", label=f"asked for: {asked:g} mm")
    axes.set(
        xlabel="angle of the tangent within the turn [deg]",
        ylabel="spacing [mm]",
        title="Spacing of neighbouring turns along the normal",
    )
    axes.set_xticks(range(0, 361, 45))
    axes.set_xlim(0, 360)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
