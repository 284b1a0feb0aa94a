"""The plots of a speed study."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gantrysim.metrics.budget import LINKS
from gantrysim.plots.style import COLOURS, INK, sheet
from gantrysim.study.cases import OK, Row
from gantrysim.study.drawing import logarithmic
from gantrysim.study.speed.findings import speed_of
from gantrysim.study.speed.search import answer
from gantrysim.study.study import Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gantrysim.study.speed.study import SpeedStudy

_LOGARITHMIC_FROM = 5.0  # times the least value


def figures(study: SpeedStudy, rows: list[Row]) -> list[Plot]:
    """Return the figure over the speed with the tolerance, and the links' parts over the speed."""
    good = sorted((row for row in rows if row["status"] == OK), key=speed_of)
    if not good:
        return []
    return [
        Plot(
            "speed",
            "The figure over the speed",
            "Every run of the search. The search goes on inside the bracket of the fastest speed within the "
            "tolerance and the next faster one.",
            _draw_figure(study, rows, good),
        ),
        Plot(
            "links",
            "Which link grows with the speed",
            "Root mean square of the parts of the error normal to the requested path, each from one link of the "
            "chain; lag along the path is in none of them.",
            _draw_links(good),
        ),
    ]


def _draw_figure(study: SpeedStudy, rows: list[Row], good: list[Row]) -> Figure:
    criterion = study.criterion
    found = answer({speed_of(row): criterion.within(row) for row in rows})
    with sheet(9.0, 4.8) as figure:
        axes = figure.add_subplot()
        speeds, values = [speed_of(row) for row in good], [criterion.value(row) for row in good]
        axes.plot(speeds, values, color=INK, lw=1.0, alpha=0.5)
        kinds = (("within the tolerance", True, COLOURS["structure"]), ("not within", False, COLOURS["fault"]))
        for label, within, colour in kinds:
            chosen = [k for k, row in enumerate(good) if criterion.within(row) is within]
            if chosen:
                at = [speeds[k] for k in chosen], [values[k] for k in chosen]
                axes.plot(*at, "o", ms=5, color=colour, label=label, zorder=3)
        axes.axhline(criterion.tolerance, color=COLOURS["fault"], lw=1.2, ls="--", label="tolerance")
        none = sorted(speed_of(row) for row in rows if row["status"] != OK)
        if none:
            top = [0.97] * len(none)
            blended = axes.get_xaxis_transform()
            axes.plot(none, top, "x", ms=7, color=COLOURS["fault"], transform=blended, label="fault or refused")
        axes.axvline(study.own, color=COLOURS["requested"], lw=1.0, ls=":", label="the program's own speed")
        if found.fastest is not None:
            axes.axvspan(min(speeds + none), found.fastest, color=COLOURS["structure"], alpha=0.08, lw=0)
            axes.set_title(f"within the tolerance up to {found.fastest:g} mm/s", loc="right")
        logarithmic(axes, "x", [*speeds, *none])
        if max(values) > _LOGARITHMIC_FROM * min(values):
            logarithmic(axes, "y", [*values, criterion.tolerance])
        else:
            axes.set_ylim(0, 1.1 * max(*values, criterion.tolerance))
        unit = criterion.unit(good[0])
        axes.set(xlabel="path speed of the program [mm/s]", ylabel=f"{criterion.label} [{unit}]" if unit else "")
        figure.legend(loc="outside lower center", ncols=5)
    return figure


def _draw_links(good: list[Row]) -> Figure:
    speeds = [speed_of(row) for row in good]
    with sheet(9.0, 4.8) as figure:
        axes = figure.add_subplot()
        drawn: list[float] = []
        for link in (*LINKS, "contour"):
            values = np.array([row[f"{link}_rms_um"] for row in good], float)
            if values.max() < 1e-3:  # a link that does nothing has no place on a logarithmic scale
                continue
            values = np.maximum(values, 1e-3)
            drawn += values.tolist()
            if link == "contour":  # a broad band that the link which makes most of it is drawn on
                axes.plot(speeds, values, lw=7, alpha=0.25, color=COLOURS[link], label=link, zorder=1)
            else:
                axes.plot(speeds, values, "o-", ms=3.5, lw=1.4, color=COLOURS[link], label=link)
        logarithmic(axes, "x", speeds)
        logarithmic(axes, "y", drawn)
        axes.set(xlabel="path speed of the program [mm/s]", ylabel="error normal to the path, rms [µm]")
        figure.legend(loc="outside lower center", ncols=5)
    return figure
