"""Plots of a comparison: errors along the path of both, and the spectrum of their difference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.runs.compared_run import RUN_COLOURS
from gantrysim.report.plots.style import COLOURS, INK, UM, axes_on, sheet, thinned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

OVERLAY = "overlay.png"
SPECTRUM = "spectrum.png"
_LEAST_SPAN = 0.01  # of an axis of errors, so that rounding looks like none [µm]


def draw_overlay(figure: Figure | SubFigure, comparison: Comparison) -> tuple[Axes, ...]:
    """Draw each link's lateral error along the path, measured and simulated, and their difference; return the axes."""
    names = [*comparison.parts, "contour"]
    panels = figure.subplots(len(names) + 1, sharex=True, squeeze=False)[:, 0]
    for panel, name in zip(panels[:-1], names, strict=True):
        for budget, label, colour in (
            (comparison.measured, "measured", RUN_COLOURS[0]),
            (comparison.simulated, "simulated", RUN_COLOURS[1]),
        ):
            part = budget.contour if name == "contour" else budget.parts[name]
            s = budget.analysis.nozzle.s
            panel.plot(*_line(s, budget.analysis.ticks, part.lateral), lw=0.9, color=colour, label=label)
        panel.set_title(name, loc="right")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    analysis = comparison.measured.analysis
    difference = comparison.difference["contour"][:, 0]
    panels[-1].plot(*_line(analysis.nozzle.s, analysis.ticks, difference), lw=0.9, color=COLOURS["structure"])
    panels[-1].set_title("measured less simulated", loc="right")
    panels[-1].set_xlabel("distance along the requested path [mm]")
    for panel in panels:
        panel.axhline(0, color=INK, lw=0.6)
        panel.margins(x=0.01)
        low, high = panel.get_ylim()
        panel.set_ylim(min(low, -_LEAST_SPAN / 2), max(high, _LEAST_SPAN / 2))
    figure.supylabel("lateral error, positive to the left [µm]", fontsize="medium")
    return tuple(panels)


def draw_spectrum(on: Figure | SubFigure | Axes, comparison: Comparison) -> Axes:
    """Draw the spectrum of the lateral error that the model does not explain, its peaks marked; return the axes."""
    axes = axes_on(on)
    frequency, density = comparison.spectrum
    axes.loglog(frequency[1:], UM * np.sqrt(density[1:]), lw=1.0, color=COLOURS["structure"])
    for peak in comparison.peaks:
        axes.axvline(peak.frequency, color=COLOURS["fault"], lw=0.8, ls=":")
        place = (peak.frequency, 0.98)
        text = f"{peak.frequency:.1f} Hz, {UM * peak.rms:.2g} µm"
        axes.annotate(text, place, xycoords=("data", "axes fraction"), rotation=90, va="top", fontsize=7)
    axes.set(xlabel="frequency [Hz]", ylabel="measured less simulated [µm/√Hz]")
    return axes


def has_spectrum(comparison: Comparison) -> bool:
    """Return whether a spectrum can be drawn: where no difference is left, it has no logarithm."""
    return bool(comparison.spectrum[1][1:].any())


def save_comparison(comparison: Comparison, folder: Path) -> list[str]:
    """Write the plots into a folder; return their names."""
    with sheet(9.0, 2.2 * (len(comparison.parts) + 2)) as figure:
        draw_overlay(figure, comparison)
        figure.savefig(folder / OVERLAY)
    if not has_spectrum(comparison):
        return [OVERLAY]
    with sheet(8.0, 4.6) as figure:
        draw_spectrum(figure, comparison)
        figure.savefig(folder / SPECTRUM)
    return [OVERLAY, SPECTRUM]


def _line(s: Floats, ticks: NDArray[np.intp], error: Floats) -> tuple[Floats, Floats]:
    gaps = np.flatnonzero(np.diff(ticks) > 1) + 1
    return thinned(np.insert(s, gaps, np.nan), np.insert(UM * error, gaps, np.nan))
