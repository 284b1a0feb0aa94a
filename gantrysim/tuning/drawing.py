"""The drawings of a search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.controllers.servo import Servo
from gantrysim.metrics.budget import LINKS, Budget, BudgetValues
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, INK, UM, sheet, thinned
from gantrysim.study.drawing import logarithmic
from gantrysim.tuning.findings import NOTHING
from gantrysim.tuning.laws import SEARCHED
from gantrysim.tuning.search import History
from gantrysim.tuning.stability import Stability

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BEFORE = "#9aa0a8"
_GAIN_COLOURS = tuple(COLOURS[link] for link in ("tracking", "generation", "structure", "measurement", "contour"))
_ALIKE = 1.01  # times, between factors that are told once
_CHANGED = 0.02  # of the logarithm, from which a change is drawn
_STAGE_COLOURS = {"before": _BEFORE, "after": COLOURS["tracking"]}
_FREQUENCIES = 1500
_LOWEST = 1e-3  # of half the servo's frequency


def draw_links(figures: Mapping[str, BudgetValues]) -> Figure:
    """Draw the rms of every link's part, from before to after, on one logarithmic scale.

    Args:
        figures: of the budget, before and after, or after alone.
    """
    names = [*LINKS, "contour"]
    size = {
        stage: [UM * (own.contour if name == "contour" else own.parts[name]).rms for name in names]
        for stage, own in figures.items()
    }
    drawn = [value for values in size.values() for value in values if value > NOTHING]
    with sheet(9.0, 3.4) as figure:
        axes = figure.add_subplot()
        for k, name in enumerate(names):
            at = [values[k] for values in size.values()]
            if max(at) <= NOTHING:
                axes.text(0.5, k, "none", transform=axes.get_yaxis_transform(), ha="center", va="center", fontsize=9)
                continue
            at = [max(value, NOTHING) for value in at]
            changed = len(at) > 1 and abs(math.log(at[0] / at[1])) > _CHANGED
            if changed:
                axes.annotate(
                    "", (at[1], k), (at[0], k), arrowprops={"arrowstyle": "-|>", "color": COLOURS[name], "lw": 2.0}
                )
                axes.plot(at[0], k, "o", ms=7, mfc="w", mec=COLOURS[name], mew=1.6, zorder=3)
            axes.plot(at[-1], k, "o", ms=8, color=COLOURS[name], zorder=4)
            texts = [f"{value:.3g}" for value in at]
            right = len(at) > 1 and at[0] > at[1]
            axes.annotate(
                texts[-1], (at[-1], k), xytext=(-9 if right else 9, 0), textcoords="offset points",
                ha="right" if right else "left", va="center", fontsize=9,
            )  # fmt: skip
            if changed:
                axes.annotate(
                    texts[0], (at[0], k), xytext=(9 if right else -9, 0), textcoords="offset points",
                    ha="left" if right else "right", va="center", fontsize=9, color="0.4",
                )  # fmt: skip
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)
        logarithmic(axes, "x", [min(drawn) / 2, 2 * max(drawn)])
        axes.set_xlabel("error normal to the path, rms [µm]; open circle before, full circle after")
    return figure


def draw_path(budgets: Mapping[str, Budget]) -> Figure:
    """Draw the contour error and its tracking part along the path, before and after."""
    with sheet(10.7, 2.4 * len(budgets) + 0.8) as figure:
        panels = figure.subplots(len(budgets), sharex=True, squeeze=False)[:, 0]
        for panel, (stage, budget) in zip(panels, budgets.items(), strict=True):
            s, ticks = budget.analysis.nozzle.s, budget.analysis.ticks
            gaps = np.flatnonzero(np.diff(ticks) > 1) + 1
            lines = (("contour", budget.contour, 1.6), ("tracking", budget.parts["tracking"], 0.9))
            for name, part, width in lines:
                line = thinned(np.insert(s, gaps, np.nan), np.insert(UM * part.lateral, gaps, np.nan))
                panel.plot(*line, color=COLOURS[name], lw=width, label=name)
            panel.axhline(0, color=INK, lw=0.6)
            panel.margins(x=0.01)
            rms = UM * budget.values.contour.rms
            panel.set_title(f"{stage}: contour {rms:.3g} µm rms", loc="right")
        panels[0].legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
        panels[-1].set_xlabel("place along the requested path [mm]")
        figure.supylabel("left of the requested path [µm]", fontsize="medium")
    return figure


def draw_search(history: History, label: str, ripple: float) -> Figure:
    """Draw the figures of all candidates over the runs, and below the gains of the best one so far.

    Args:
        history: of the search.
        label: of the figure.
        ripple: most torque ripple, a share of the peak torque.
    """
    kinds: dict[int, tuple[str, dict[str, Any]]] = {
        1: ("in order", {"marker": "o", "mfc": COLOURS["tracking"], "mec": "none", "alpha": 0.7}),
        2: ("too much torque ripple", {"marker": "o", "mfc": "none", "mec": COLOURS["generation"]}),
        3: ("margin missed", {"marker": "D", "mfc": "none", "mec": COLOURS["measurement"]}),
    }
    points = [(one.runs, one.figure, one.order(ripple)[0]) for one in history.candidates]
    finite = [value for _, value, _ in points if math.isfinite(value)]
    with sheet(9.0, 6.4) as figure:
        above, below = figure.subplots(2, sharex=True, height_ratios=(3, 2))
        for kind, (said, style) in kinds.items():
            chosen = [(runs, value) for runs, value, own in points if own == kind and math.isfinite(value)]
            if chosen:
                above.plot(*zip(*chosen, strict=True), ls="", ms=5, label=said, **style)
        faults = [runs for runs, value, _ in points if not math.isfinite(value)]
        if faults:
            high = above.get_xaxis_transform()
            above.plot(faults, [0.97] * len(faults), "x", ms=6, color=COLOURS["fault"], transform=high, label="fault")
        good = [one for one in history.leaders if one.order(ripple)[0] == 1]
        if good:
            runs, best = [one.runs for one in good], [one.figure for one in good]
            line = [*runs, history.runs], [*best, best[-1]]
            above.step(*line, where="post", color=INK, lw=1.6, label="best so far")
        if finite:
            logarithmic(above, "y", finite)
        above.set_ylabel(f"{label} [µm]")
        above.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5)
        _draw_leaders(below, history)
        below.set(xlabel="runs")
        below.set_xlim(0, history.runs * 1.02)
    return figure


def _draw_leaders(axes: Axes, history: History) -> None:
    """Draw the gains of the first axis of every leader as multiples of those found."""
    runs, drawn = [one.runs for one in history.leaders], []
    for name, colour in zip(SEARCHED, _GAIN_COLOURS, strict=True):
        values = np.array([getattr(one.servo, name)[0] for one in history.leaders])
        if not values[-1] > 0:
            continue
        share = np.where(values > 0, values / values[-1], np.nan)
        drawn += share[np.isfinite(share)].tolist()
        axes.step([*runs, history.runs], [*share, 1.0], where="post", color=colour, lw=1.4, label=name)
    if drawn:
        logarithmic(axes, "y", [min(*drawn, 0.8), max(*drawn, 1.25)])
    axes.axhline(1.0, color=INK, lw=0.6)
    axes.set_ylabel("gain over that found")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5)


def draw_gains(before: Servo, after: Servo, axes: Sequence[str]) -> Figure:
    """Draw the factor from every gain before to that after, a bar for each axis."""
    with sheet(9.0, 3.2) as figure:
        panel = figure.add_subplot()
        names = SEARCHED
        factors: list[float] = []
        width = 0.8 / len(axes)
        for k, name in enumerate(names):
            pairs = list(zip(getattr(before, name), getattr(after, name), strict=True))
            own = {a: new / old for a, (old, new) in enumerate(pairs) if old > 0 and new > 0}
            at = {a: k + (a - 0.5 * (len(axes) - 1)) * width for a in own}
            for a, factor in own.items():
                panel.bar(at[a], factor - 1, 0.9 * width, bottom=1.0, color=AXIS_COLOURS[a % len(AXIS_COLOURS)])
            if own and max(own.values()) < _ALIKE * min(own.values()):  # one number for all
                own, at = {0: next(iter(own.values()))}, {0: sum(at.values()) / len(at)}
            for a, factor in own.items():
                panel.annotate(
                    f"{factor:.3g}", (at[a], factor), xytext=(0, 2 if factor > 1 else -2), textcoords="offset points",
                    ha="center", va="bottom" if factor > 1 else "top", fontsize=8,
                )  # fmt: skip
            factors += own.values()
        logarithmic(panel, "y", [0.6 * min([0.5, *factors]), 1.6 * max([2.0, *factors])])
        panel.axhline(1.0, color=INK, lw=0.8)
        panel.set_xticks(range(len(names)), names)
        panel.set_xlim(-0.5, len(names) - 0.5)
        panel.grid(visible=False, axis="x")
        panel.set_ylabel("gain after / before")
        handles = [panel.bar(0, 0, color=AXIS_COLOURS[a % len(AXIS_COLOURS)]) for a in range(len(axes))]
        panel.legend(handles, axes, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=len(axes))
    return figure


def draw_loops(stability: Stability, servos: Mapping[str, Servo], machines: int, axes: Sequence[str]) -> Figure:
    """Draw the open loops near -1, and |S| over the frequency, before and after.

    Args:
        stability: of the machines.
        servos: before and after.
        machines: number of them, the first being the job's own.
        axes: their names.
    """
    nyquist = 0.5 / next(iter(servos.values())).period
    frequency = np.geomspace(_LOWEST * nyquist, nyquist, _FREQUENCIES)
    radius = 1 / stability.peak
    with sheet(10.7, 5.0) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.25))
        turn = np.linspace(0, 2 * np.pi, 200)
        left.fill(-1 + radius * np.cos(turn), radius * np.sin(turn), color=COLOURS["fault"], alpha=0.15, lw=0)
        left.plot(-1, 0, "+", color=COLOURS["fault"], ms=9)
        for stage, servo in servos.items():
            for machine in reversed(range(machines if stage == "after" else 1)):
                loops = stability.loop(servo, frequency, machine)
                for a, name in enumerate(axes):
                    colour = _BEFORE if stage == "before" else AXIS_COLOURS[a % len(AXIS_COLOURS)]
                    own = machine == 0
                    style = {"color": colour, "lw": 1.6 if own else 0.6, "ls": "--" if stage == "before" else "-"}
                    said = "_" if not own else f"{name}, after" if stage == "after" else "_" if a else "before"
                    left.plot(loops[:, a].real, loops[:, a].imag, **style)
                    right.plot(frequency, 1 / np.abs(1 + loops[:, a]), label=said, **style)
        left.set(xlim=(-3.2, 0.8), ylim=(-2.4, 2.4), xlabel="Re L", ylabel="Im L", aspect="equal")
        left.axhline(0, color=INK, lw=0.5)
        right.axhline(stability.peak, color=COLOURS["fault"], lw=1.2, ls="--")
        right.annotate(
            f"at most {stability.peak:.3g}", (frequency[0], stability.peak), xytext=(2, 3),
            textcoords="offset points", color=COLOURS["fault"], fontsize=9,
        )  # fmt: skip
        logarithmic(right, "x", frequency.tolist())
        logarithmic(right, "y", [0.02, 1.6 * stability.peak])
        right.set(xlabel="frequency [Hz]", ylabel="|S|, what is left of a disturbance")
        right.legend(loc="lower right")
    return figure


def draw_machines(values: Mapping[str, Floats], seen: Mapping[str, Sequence[float]], label: str) -> Figure:
    """Draw the cumulative distribution of the figure over machines not seen, before and after.

    Args:
        values: before and after, (n,); inf where there is none.
        seen: of the machines of the search.
        label: of the figure, with its unit.
    """
    every = [float(value) for own in (*values.values(), *seen.values()) for value in own if math.isfinite(value)]
    with sheet(9.0, 4.4) as figure:
        axes = figure.add_subplot()
        for stage, own in values.items():
            colour = _STAGE_COLOURS[stage]
            finite = np.sort(own[np.isfinite(own)])
            if finite.size:
                share = 100 * np.arange(finite.size + 1) / own.size
                line = np.concatenate([finite[:1], finite]), share
                axes.step(*line, where="post", color=colour, lw=1.8, label=f"{stage}, machines not seen")
            if seen[stage]:
                axes.plot(
                    seen[stage],
                    [-5] * len(seen[stage]),
                    "|",
                    ms=11,
                    mew=1.6,
                    color=colour,
                    label=f"{stage}, those of the search",
                )
        if every:
            logarithmic(axes, "x", every)
        axes.set(xlabel=label, ylabel="share of machines [%]", ylim=(-10, 105), yticks=range(0, 101, 20))
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
    return figure
