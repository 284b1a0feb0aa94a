"""The plots of a machine study."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.machine.tolerances import in_words
from gantrysim.plots.style import COLOURS, INK, sheet
from gantrysim.study.cases import OK, Row
from gantrysim.study.machine.yields import influences
from gantrysim.study.study import Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gantrysim.report import Table
    from gantrysim.study.machine.study import MachineStudy

_GOOD, _BAD = COLOURS["structure"], COLOURS["fault"]
_BINS = (12, 40)
_WORST = 5
_ROOM = 12  # for the yield's words beyond 0 and 100 % [%]


def figures(study: MachineStudy, rows: list[Row]) -> list[Plot]:
    """Return the distribution of the figure, the factors' influence, and the figure over those that matter most."""
    nominal, others, figure = study.drawn(rows)
    good = [row for row in rows if row["status"] == OK]
    finite = np.isfinite(figure)
    if not good or not finite.any():
        return []
    criterion, unit = study.criterion, study.criterion.unit(good[0])
    label = f"{criterion.label} [{unit}]" if unit else criterion.label
    found, _ = influences(study.machines, figure)
    most = {in_words(one.factor): study.machines[one.factor] for one in found[:4]}
    return [
        Plot(
            "yield",
            "Distribution over the machines",
            "Above the share of machines that have the figure or less, below how many have it. Machines that did "
            "not finish are beyond the right end.",
            _draw_yield(figure, criterion.value(nominal), criterion.tolerance, label),
            tables=[_worst_table(study, others, figure, unit)],
        ),
        Plot(
            "influence",
            "Which factor matters",
            "Coefficients of a linear regression of the figure's rank on the ranks of all factors, all scaled to "
            "one variance: near 1 where more of a factor makes the figure larger whatever the others do, near -1 "
            "where it makes it smaller. Pale bars cannot be told from chance.",
            _draw_influence([(in_words(one.factor), one.coefficient, one.clear) for one in found]),
        ),
        Plot(
            "scatter",
            "The figure over the factors that matter most",
            "Each point is a machine.",
            _draw_scatter(most, figure, criterion.tolerance, label),
        ),
    ]


def _worst_table(study: MachineStudy, others: list[Row], figure: Floats, unit: str) -> Table:
    from gantrysim.report import Column, Table

    order = np.argsort(-figure, kind="stable")[:_WORST]
    columns: list[str | Column] = ["machine", Column(f"figure [{unit}]" if unit else "figure", ".4g")]
    columns += [Column(in_words(name) + (" [kg]" if name == "payload_kg" else ""), ".3f") for name in study.machines]
    cells = [
        [
            int(k) + 1,
            float(figure[k]) if np.isfinite(figure[k]) else None,
            *(float(values[k]) for values in study.machines.values()),
        ]
        for k in order
    ]
    return Table(columns, cells, caption="The worst machines; factors multiply the nominal machine's values.")


def _draw_yield(figure: Floats, nominal: float, tolerance: float, label: str) -> Figure:
    """Draw the distribution of a figure over machines: cumulative above, as a histogram below.

    Args:
        figure: of the machines, (n,); inf where there is none.
        nominal: that of the nominal machine.
        tolerance: of it.
        label: of the figure, with its unit.
    """
    finite = np.sort(figure[np.isfinite(figure)])
    share = 100 * np.arange(1, finite.size + 1) / figure.size
    within = 100 * float(np.mean(figure <= tolerance))
    with sheet(9.0, 6.4) as drawing:
        above, below = drawing.subplots(2, sharex=True, height_ratios=(3, 2))
        above.step(np.concatenate([finite[:1], finite]), np.concatenate([[0], share]), where="post", color=INK, lw=1.8)
        above.plot([tolerance], [within], "o", ms=7, color=_BAD, zorder=4)
        # the curve rises to the right: above it to the left and below it to the right there is room
        left = tolerance > 0.5 * (finite[0] + finite[-1])
        above.annotate(
            f"yield {within:.1f} %",
            (tolerance, within),
            xytext=(-8, 6) if left else (8, -6),
            textcoords="offset points",
            ha="right" if left else "left",
            va="bottom" if left else "top",
            color=_BAD,
            weight="bold",
        )
        bins = int(np.clip(np.sqrt(finite.size) * 1.5, *_BINS))
        low, high = min(finite[0], tolerance), max(finite[-1], tolerance)
        width = max((high - low) / bins, 1e-9 * abs(high))
        edges = tolerance + width * np.arange(
            np.floor((low - tolerance) / width), np.ceil((high - tolerance) / width) + 1
        )
        counts, edges = np.histogram(finite, np.append(edges, edges[-1] + width))
        colours = [_GOOD if edge < tolerance - 1e-9 * width else _BAD for edge in edges[:-1]]
        below.bar(edges[:-1], counts, np.diff(edges), align="edge", color=colours, alpha=0.75, edgecolor="w", lw=0.6)
        for axes in (above, below):
            axes.axvline(tolerance, color=_BAD, lw=1.2, ls="--", label=f"tolerance {tolerance:g}")
            if np.isfinite(nominal):
                axes.axvline(nominal, color=COLOURS["tracking"], lw=1.2, ls=":", label=f"nominal machine {nominal:.4g}")
        above.set(ylabel="share of machines [%]", ylim=(-_ROOM, 100 + _ROOM), yticks=range(0, 101, 20))
        below.set(ylabel="machines", xlabel=label)
        below.yaxis.get_major_locator().set_params(integer=True)
        drawing.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return drawing


def _draw_influence(found: list[tuple[str, float, bool]]) -> Figure:
    """Draw the rank coefficients of all factors as bars, the greatest on top.

    Args:
        found: name, coefficient, and whether it can be told from chance, the greatest first.
    """
    with sheet(9.0, 1.4 + 0.32 * len(found)) as drawing:
        axes = drawing.add_subplot()
        for k, (_, coefficient, clear) in enumerate(found):
            colour = _BAD if coefficient > 0 else COLOURS["tracking"]
            axes.barh(k, coefficient, color=colour, alpha=0.9 if clear else 0.25, height=0.7)
            at = coefficient + (0.015 if coefficient >= 0 else -0.015)
            axes.text(
                at,
                k,
                f"{round(coefficient, 2) + 0.0:+.2f}",
                va="center",
                ha="left" if coefficient >= 0 else "right",
                fontsize=9,
            )
        axes.axvline(0, color=INK, lw=0.8)
        axes.set_yticks(range(len(found)), [name for name, _, _ in found])
        axes.invert_yaxis()
        axes.set(xlim=(-1.12, 1.12), xlabel="standardised rank coefficient")
        axes.grid(visible=False, axis="y")
    return drawing


def _draw_scatter(factors: dict[str, Floats], figure: Floats, tolerance: float, label: str) -> Figure:
    """Draw a figure over some factors, a panel each.

    Args:
        factors: values by the factor's name, (n,).
        figure: of the machines, (n,); what is not finite is left out.
        tolerance: of the figure.
        label: of the figure, with its unit.
    """
    finite = np.isfinite(figure)
    columns = min(len(factors), 2)
    rows = -(-len(factors) // columns)
    with sheet(9.0, 0.6 + 2.9 * rows) as drawing:
        panels = drawing.subplots(rows, columns, sharey=True, squeeze=False).ravel()
        for panel, (name, values) in zip(panels, factors.items(), strict=False):
            for within, colour in ((True, _GOOD), (False, _BAD)):
                chosen = finite & ((figure <= tolerance) == within)
                panel.plot(values[chosen], figure[chosen], "o", ms=4, mew=0, alpha=0.75, color=colour)
            panel.axhline(tolerance, color=_BAD, lw=1.0, ls="--")
            panel.set_xlabel("payload [kg]" if name == "payload" else f"{name}, factor")
        for panel in panels[len(factors) :]:
            panel.set_visible(False)
        drawing.supylabel(label, fontsize="medium")
    return drawing
