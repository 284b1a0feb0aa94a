"""The errors against time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gantrysim.arrays import Floats
from gantrysim.metrics.analysis import THOUSANDTH, Analysis, tracking_error
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, UM, thinned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_error(figure: Figure, analysis: Analysis) -> None:
    """Draw errors against time: tracking per axis above, rotary axes by themselves, and what the part sees below."""
    run, on = analysis.run, analysis.ticks
    kinds = [unit for unit in THOUSANDTH if unit in run.units]
    *upper, lower = figure.subplots(len(kinds) + 1, sharex=True)
    error = 1e3 * tracking_error(run)
    for panel, unit in zip(upper, kinds, strict=True):
        members = [a for a, own in enumerate(run.units) if own == unit]
        for a in members:
            panel.plot(*thinned(run.time, error[:, a]), color=AXIS_COLOURS[a], lw=0.9, label=run.axes[a])
        _clip(panel, run.time[on], error[on], members, THOUSANDTH[unit])
        panel.set(ylabel=f"commanded - encoder [{THOUSANDTH[unit]}]")
        panel.set_title(f"Tracking error of the {'axes' if unit == 'mm' else 'rotary axes'}", loc="right")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=len(members))
    for name, foot, style in (
        ("contour: nozzle", analysis.nozzle, "-"),
        ("generation: commanded", analysis.commanded, "--"),
    ):
        lateral = np.full(len(run.time), np.nan)
        lateral[on] = UM * foot.lateral
        lower.plot(*thinned(run.time, lateral), color=COLOURS[name.partition(":")[0]], lw=1.0, ls=style, label=name)
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
    colour = AXIS_COLOURS[members[int(a)]]
    axes.annotate(text, at, xytext=(8, -12 if at[1] > 0 else 6), textcoords="offset points", color=colour)


def _spans(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(start), int(end) - 1) for start, end in zip(edges[::2], edges[1::2], strict=True)]
