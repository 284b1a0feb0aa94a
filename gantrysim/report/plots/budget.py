"""Plots of the error budget: the links' parts of the contour error, in total, by turn and along the path; causes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import UM, number_text
from gantrysim.job.causes import CELL_FORM
from gantrysim.metrics.budget import Budget
from gantrysim.report.plots.style import COLOURS, COLUMNS, axes_on, line_style, thinned_line
from gantrysim.results.colours import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


_LEAST_NAMED = 0.07  # smallest share of a bar with room for its number
_MOST_NAMED = 10  # largest number of labelled turns
_NOTHING = 1e-6  # largest negligible error [mm]
_VERTICAL = 0.02  # smallest vertical error that is drawn, of the largest error

_NUMBER_ROOM = 0.45  # beyond the bars for their numbers, of the largest
_LEAST_SCALE = 0.05  # half of the narrowest scale [µm]


def draw_budget(figure: Figure | SubFigure, budget: Budget) -> tuple[Axes, ...]:
    """Draw the links' shares of the contour error's mean square as a stacked bar, and below it the rms by turn.

    Negative shares, which offset others, extend to the other side of zero. Returns the axes.
    """
    turns = bool(budget.values.turns)
    shares, *below = figure.subplots(1 + turns, height_ratios=[1, 2.6][: 1 + turns], squeeze=False)[:, 0]
    draw_shares(shares, budget)
    for axes in below:
        draw_by_turn(axes, budget)
    return (shares, *below)


def draw_shares(on: Figure | SubFigure | Axes, budget: Budget) -> Axes:
    """Draw the links' shares of the contour error's mean square as a stacked bar; return the axes."""
    axes = axes_on(on)
    shares = {name: np.array([part.share]) for name, part in budget.values.parts.items()}
    stack_bars(axes, np.zeros(1), {name: 100 * share for name, share in shares.items()}, upright=False)
    end = 0.0
    for name, share in shares.items():
        if share[0] >= _LEAST_NAMED:
            axes.text(end + 50 * share[0], 0, f"{100 * share[0]:.1f} %", ha="center", va="center", color=_on(name))
        end += 100 * max(share[0], 0.0)
    axes.set(yticks=[], xlabel="share of the contour error's mean square [%]")
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, columnspacing=0.8, handlelength=1.2)
    return axes


def draw_by_turn(on: Figure | SubFigure | Axes, budget: Budget) -> Axes:
    """Draw the rms contour error of every turn as a bar of the links' shares; return the axes."""
    axes = axes_on(on)
    turns = budget.values.turns
    number = np.array([turn.turn for turn in turns])
    rms = np.array([turn.parts["contour"].rms for turn in turns])
    parts = {name: UM * rms * share for name, share in _shares_by_turn(budget).items()}
    stack_bars(axes, number, parts, upright=True)
    axes.set(xlabel="turn", ylabel="rms [µm]", title="Contour error by turn and link")
    every = -(-number.size // _MOST_NAMED)
    named = [turn for turn in turns if turn.turn % every == 0 or not turn.name.startswith("turn")]
    axes.set_xticks([turn.turn for turn in named], [turn.name.removeprefix("turn ") for turn in named])
    axes.set_xlim(number[0] - 0.6, number[-1] + 0.6)
    axes.grid(visible=False, axis="x")
    return axes


def draw_budget_along(figure: Figure | SubFigure, budget: Budget, columns: int = COLUMNS) -> tuple[Axes, ...]:
    """Draw the lateral contour error and its parts along the path: on one scale, then each on its own.

    Vertical errors, if any, are thin lines. Returns the axes.

    Args:
        figure: to draw on.
        budget: the error budget.
        columns: horizontal resolution, see `thinned`.
    """
    analysis = budget.analysis
    line = partial(_line, s=analysis.nozzle.s, ticks=analysis.ticks, columns=columns)
    shown = {name: part for name, part in budget.parts.items() if part.size.max() > _NOTHING}
    largest = max(float(budget.contour.size.max()), _NOTHING)
    ratios = [2.4] + [1.0] * len(shown)
    panels = figure.subplots(len(ratios), sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
    whole = panels[0]
    line(whole, budget.contour.lateral, lw=2.4, color=COLOURS["contour"], alpha=0.85, label="contour")
    for name, part in shown.items():
        line(whole, part.lateral, lw=1.1, color=COLOURS[name], ls=line_style(name), label=name)
    for panel, (name, part) in zip(panels[1:], shown.items(), strict=True):
        line(panel, part.lateral, lw=1.0, color=COLOURS[name])
        panel.set_ylabel(name, fontsize=9)
    for panel, part in zip(panels, (budget.contour, *shown.values()), strict=True):
        if np.abs(part.vertical).max() > max(_VERTICAL * largest, _NOTHING):
            label = "vertical" if panel is whole else "_"
            line(panel, part.vertical, lw=0.7, ls=":", color=INK, label=label)
        panel.axhline(0, color=INK, lw=0.6)
        panel.margins(x=0.01)
    _mark_turns(panels, budget)
    whole.set_ylabel("all links")
    figure.supylabel("lateral error, positive to the left [µm]", fontsize="medium")
    panels[-1].set_xlabel("distance along the requested path [mm]")
    columns = 6 if len(shown) < 5 else 3  # as wide as the panels
    whole.legend(loc="lower left", bbox_to_anchor=(0, 1.06 if _turn_starts(budget).size else 1.0), ncols=columns)
    return tuple(panels)


def _turn_starts(budget: Budget) -> Floats:
    """Return the starts of the turns on the requested path; none for a path without turns, (t,) [mm]."""
    return np.array([turn.s[0] for turn in budget.values.turns if turn.name.startswith("turn")])


def _mark_turns(panels: NDArray[np.object_], budget: Budget) -> None:
    """Mark the starts of the turns by lines, numbered over the uppermost panel."""
    starts = _turn_starts(budget)
    step = -(-starts.size // _MOST_NAMED) if starts.size else 1
    for k, start in enumerate(starts.tolist()):
        for panel in panels:
            panel.axvline(start, color=COLOURS["requested"], lw=0.8, ls=(0, (4, 3)))
        if k % step == 0:
            panels[0].annotate(
                f"turn {k + 1}", (start, 1.0), (2, 2), ("data", "axes fraction"), "offset points", fontsize=8
            )


def _line(axes: Axes, error: Floats, s: Floats, ticks: NDArray[np.intp], columns: int, **style: object) -> None:
    """Draw an error along the path, with gaps at missing ticks."""
    gaps = np.flatnonzero(np.diff(ticks) > 1) + 1
    if gaps.size:
        s = np.insert(s, gaps, np.nan)
        error = np.insert(error, gaps, np.nan)
    x, y = thinned_line(s, error, columns)
    axes.plot(x, UM * y, **style)  # type: ignore[arg-type]


def _shares_by_turn(budget: Budget) -> dict[str, Floats]:
    """The links' shares of the contour error's mean square within each stretch of `Budget.stretches`, (k,)."""
    starts = [stretch.ticks.start for stretch in budget.stretches]
    whole = budget.contour
    square = np.add.reduceat(whole.dot(whole), starts)
    products = {name: np.add.reduceat(part.dot(whole), starts) for name, part in budget.parts.items()}
    return {
        name: np.divide(product, square, out=np.zeros_like(product), where=square > 0)
        for name, product in products.items()
    }


def stack_bars(axes: Axes, places: Floats, values: dict[str, Floats], upright: bool) -> None:
    """Stack bars, positive values on one side of zero and negative ones on the other.

    Args:
        axes: axes to draw on.
        places: places of the bars, (m,).
        values: values of every link, (m,).
        upright: whether the bars are vertical.
    """
    above = np.zeros(places.size)
    below = np.zeros(places.size)
    for name, value in values.items():
        foot = np.where(value >= 0, above, below)
        if upright:
            axes.bar(places, value, 0.7, bottom=foot, color=COLOURS[name], label=name)
        else:
            axes.barh(places, value, 0.7, left=foot, color=COLOURS[name], label=name)
        above = above + np.maximum(value, 0)
        below = below + np.minimum(value, 0)
    if below.min() < 0:
        (axes.axhline if upright else axes.axvline)(0, color=INK, lw=0.8)


def _on(name: str) -> str:
    """A colour for text on a link's own."""
    return "#ffffff" if name in ("servo", "structure") else INK


def draw_causes(figure: Figure | SubFigure, worth: Mapping[str, Mapping[str, float]]) -> tuple[Axes, ...]:
    """Draw what each cause is worth in the contour error and in each link: a bar per cause, a panel per error.

    Args:
        figure: figure to draw on.
        worth: rms with the cause minus rms without it, by cause and by link or "contour"; nan where unknown [mm].

    Returns:
        The axes.
    """
    links = dict.fromkeys(link for sizes in worth.values() for link in sizes if link != "contour")
    errors = ("contour", *links)
    places = np.arange(len(worth))
    panels = figure.subplots(1, len(errors), sharey=True, squeeze=False)[0]
    for axes, error in zip(panels, errors, strict=True):
        size = np.array([UM * sizes[error] for sizes in worth.values()])
        bars = axes.barh(places, np.nan_to_num(size), 0.62, color=COLOURS[error])
        numbers = [number_text(value, CELL_FORM) for value in size]
        for text in axes.bar_label(bars, numbers, padding=3, fontsize=8):
            # inside of all others: the scale below leaves room
            text.set_in_layout(axes is panels[-1])
        low, high = (float(end) for end in (np.nanmin([0.0, *size]), np.nanmax([0.0, *size])))
        room = max(_NUMBER_ROOM * (high - low), _LEAST_SCALE)
        axes.set(xlim=(low - (room if low < 0 else 0), high + room), xlabel="worth [µm]")
        axes.set_title(error, loc="left")
        axes.axvline(0, color=INK, lw=0.8)
        axes.grid(visible=False, axis="y")
        axes.locator_params(axis="x", nbins=3)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
    panels[0].set_yticks(places, list(worth))
    panels[0].invert_yaxis()
    return tuple(panels)
