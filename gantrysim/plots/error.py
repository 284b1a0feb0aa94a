"""Plot of the errors over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats, spans
from gantrysim.metrics.analysis import THOUSANDTH, Analysis, tracking_error
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, UM, thinned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


def draw_error(figure: Figure | SubFigure, analysis: Analysis) -> tuple[Axes, ...]:
    """Draw the following errors of linear and of rotary axes, and the contour error, over time; return the axes."""
    run, on = analysis.run, analysis.ticks
    kinds = [unit for unit in THOUSANDTH if unit in run.units]
    *upper, lower = figure.subplots(len(kinds) + 1, sharex=True)
    error = 1e3 * tracking_error(run)
    for panel, unit in zip(upper, kinds, strict=True):
        members = [a for a, own in enumerate(run.units) if own == unit]
        for a in members:
            panel.plot(*thinned(run.time, error[:, a]), color=AXIS_COLOURS[a], lw=0.9, label=run.axes[a])
        _clip(panel, run.time, error, on, members, THOUSANDTH[unit])
        panel.set(ylabel=f"following error [{THOUSANDTH[unit]}]")
        panel.set_title(f"{'Axes' if unit == 'mm' else 'Rotary axes'}: commanded minus encoder", loc="right")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=len(members))
    for name, foot, style in (("contour", analysis.nozzle, "-"), ("generation", analysis.commanded, "--")):
        lateral = np.full(len(run.time), np.nan)
        lateral[on] = UM * foot.lateral
        lower.plot(*thinned(run.time, lateral), color=COLOURS[name], lw=1.0, ls=style, label=name)
    lower.set(xlabel="time [s]", ylabel="lateral error, positive to the left [µm]")
    lower.set_title("Error normal to the requested path", loc="right")
    lower.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    for axes in (*upper, lower):
        for fault in (fault for fault in run.injected if fault.time <= run.time[-1]):
            axes.axvline(fault.time, color=COLOURS["fault"], lw=0.8, ls=":")
            place = (fault.time, 0.97)
            axes.annotate(fault.kind, place, xycoords=("data", "axes fraction"), rotation=90, va="top", fontsize=7)
        axes.axhline(0, color="0.4", lw=0.6)
        axes.margins(x=0.01)
        for start, after in spans(~run.dispense):
            axes.axvspan(run.time[start], run.time[after - 1], color="0.5", alpha=0.12, lw=0)
            place = (run.time[start], 0.03)
            axes.annotate("dispenser off", place, xycoords=("data", "axes fraction"), rotation=90, fontsize=7)
    return (*upper, lower)


def _clip(axes: Axes, time: Floats, error: Floats, on: NDArray[np.intp], members: list[int], unit: str) -> None:
    """Scale the axis to the usual errors, and annotate the largest of these columns if that is beyond.

    Args:
        axes: to scale.
        time: (n,) [s].
        error: (n, axes).
        on: ticks that count.
        members: columns that count.
        unit: of the errors.
    """
    size = np.zeros(on.size)
    for a in members:
        np.maximum(size, np.abs(error[on, a]), out=size)
    largest, usual = float(size.max()), 1.6 * float(np.percentile(size, 99.5))
    if largest <= usual or usual == 0:
        return
    axes.set_ylim(-usual, usual)
    k = int(on[size.argmax()])
    a = members[int(np.abs(error[k, members]).argmax())]
    at = (time[k], np.sign(error[k, a]) * usual)
    text = f"peak {error[k, a]:.0f} {unit} at {time[k]:.3f} s"
    colour = AXIS_COLOURS[a]
    axes.annotate(text, at, xytext=(8, -12 if at[1] > 0 else 6), textcoords="offset points", color=colour)
