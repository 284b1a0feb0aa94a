"""Plot of the errors over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gantrysim.base.arrays import Floats, spans
from gantrysim.base.columns import by_blocks
from gantrysim.base.quantity import UM
from gantrysim.metrics.analysis import THOUSANDTH, Analysis
from gantrysim.record.run import Run
from gantrysim.report.plots.style import COLOURS, thinned_line
from gantrysim.results.colours import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


def draw_error(figure: Figure | SubFigure, analysis: Analysis) -> tuple[Axes, ...]:
    """Draw the following errors of linear and of rotary axes, and the contour error, over time; return the axes."""
    run = analysis.run
    on = analysis.ticks
    kinds = [unit for unit in THOUSANDTH if unit in run.units]
    *upper, lower = figure.subplots(len(kinds) + 1, sharex=True)
    for panel, unit in zip(upper, kinds, strict=True):
        members = [a for a, axis_unit in enumerate(run.units) if axis_unit == unit]
        for a in members:
            time, error = thinned_line(run.time, _following(run, a))
            panel.plot(time, 1e3 * error, color=AXES[a], lw=0.9, label=run.axes[a])
        _clip(panel, analysis, members, THOUSANDTH[unit])
        panel.set(ylabel=f"following error [{THOUSANDTH[unit]}]")
        panel.set_title(f"{'Axes' if unit == 'mm' else 'Rotary axes'}: commanded minus encoder", loc="right")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=len(members))
    for name, foot, style in (("contour", analysis.nozzle, "-"), ("program", analysis.commanded, "--")):
        lateral = np.full(len(run.time), np.nan)
        lateral[on] = foot.lateral
        time, error = thinned_line(run.time, lateral)
        lower.plot(time, UM * error, color=COLOURS[name], lw=1.0, ls=style, label=name)
    lower.set(xlabel="time [s]", ylabel="lateral error, positive to the left [µm]")
    lower.set_title("Error normal to the requested path", loc="right")
    lower.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    for axes in (*upper, lower):
        for fault in (fault for fault in run.injected if fault.time <= run.time[-1]):
            axes.axvline(fault.time, color=COLOURS["fault"], lw=0.8, ls=":")
            place = (fault.time, 0.97)
            axes.annotate(fault.kind, place, xycoords=("data", "axes fraction"), rotation=90, va="top", fontsize=8)
        axes.axhline(0, color="0.4", lw=0.6)
        axes.margins(x=0.01)
        for start, after in spans(~run.dispense):
            axes.axvspan(run.time[start], run.time[after - 1], color="0.5", alpha=0.12, lw=0)
            place = (run.time[start], 0.03)
            axes.annotate("dispenser off", place, xycoords=("data", "axes fraction"), rotation=90, fontsize=8)
    return (*upper, lower)


def _following(run: Run, axis: int) -> Floats:
    """Return the following error of one axis, (n,) [mm or deg]; one at a time, as a long run has room for no more."""
    return by_blocks(lambda block: run.commanded[block, axis] - run.encoder[block, axis], len(run.time))


def _clip(axes: Axes, analysis: Analysis, members: list[int], unit: str) -> None:
    """Scale the axis to the usual errors while the dispenser is on, and annotate the largest if that is beyond."""
    run = analysis.run
    on = analysis.ticks
    size = np.zeros(on.size)
    for a in members:
        np.maximum(size, np.abs(_following(run, a)[on]), out=size)
    usual = 1.6e3 * float(np.percentile(size, 99.5))
    if 1e3 * size.max() <= usual or usual == 0:
        return
    axes.set_ylim(-usual, usual)
    k = on[size.argmax()]
    errors = 1e3 * (run.commanded[k] - run.encoder[k])
    worst = max(members, key=lambda a: abs(errors[a]))
    time = run.time[k]
    peak = errors[worst]
    place = (time, np.sign(peak) * usual)
    text = f"peak {peak:.0f} {unit} at {time:.3f} s"
    colour = AXES[worst]
    axes.annotate(text, place, xytext=(8, -12 if place[1] > 0 else 6), textcoords="offset points", color=colour)
