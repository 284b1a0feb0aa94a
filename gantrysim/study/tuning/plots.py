"""The plots of a search. Mappings by phase hold the start and the tuned servo, in this order."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.report.plots.style import COLOURS, sheet
from gantrysim.results.colours import AXES, BAD, INK, REQUESTED, RUNS
from gantrysim.servo.servo import Servo
from gantrysim.study.drawing import logarithmic
from gantrysim.study.tuning.candidates import RANKS
from gantrysim.study.tuning.search import History, Phase
from gantrysim.study.tuning.space import SEARCHED_GAINS
from gantrysim.study.tuning.stability import Stability

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PHASE_COLOURS = {"start": REQUESTED, "tuned": RUNS[0]}
_GAIN_COLOURS = (*RUNS[:4], INK)
_RANK_STYLES: dict[int, dict[str, Any]] = {
    1: {"marker": "o", "mfc": RUNS[0], "mec": "none", "alpha": 0.7},
    2: {"marker": "o", "mfc": "none", "mec": RUNS[1]},
    3: {"marker": "D", "mfc": "none", "mec": RUNS[2]},
}
_FREQUENCIES = 1500
_LOWEST_FREQUENCY = 1e-3  # of half the servo's frequency


def draw_search(history: History, label: str, ripple: float) -> Figure:
    """Draw the metric of all candidates over the runs, and below the gains of the best one so far.

    Args:
        history: of the search.
        label: of the metric.
        ripple: largest torque ripple allowed, a share of the peak torque.
    """
    candidates = history.candidates
    finite = [candidate for candidate in candidates if math.isfinite(candidate.metric)]
    with sheet(9.0, 6.4) as figure:
        above, below = figure.subplots(2, sharex=True, height_ratios=(3, 2))
        for rank, style in _RANK_STYLES.items():
            ranked = [candidate for candidate in finite if candidate.order(ripple)[0] == rank]
            if ranked:
                runs = [candidate.runs for candidate in ranked]
                metrics = [candidate.metric for candidate in ranked]
                above.plot(runs, metrics, ls="", ms=5, label=RANKS[rank], **style)
        faults = [candidate.runs for candidate in candidates if not math.isfinite(candidate.metric)]
        if faults:
            top = above.get_xaxis_transform()
            above.plot(faults, [0.97] * len(faults), "x", ms=6, color=COLOURS["fault"], transform=top, label="fault")
        feasible = [leader for leader in history.leaders if leader.order(ripple)[0] == 1]
        if feasible:
            runs = [*(leader.runs for leader in feasible), history.runs]
            metrics = [*(leader.metric for leader in feasible), feasible[-1].metric]
            above.step(runs, metrics, where="post", color=INK, lw=1.6, label="best so far")
        if finite:
            logarithmic(above, "y", [candidate.metric for candidate in finite])
        above.set_ylabel(f"{label} [µm]")
        above.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5)
        _draw_leaders(below, history)
        below.set(xlabel="runs", xlim=(0, history.runs * 1.02))
    return figure


def _draw_leaders(axes: Axes, history: History) -> None:
    """Draw the gains of the first axis of every leader as multiples of the tuned ones."""
    runs = [leader.runs for leader in history.leaders]
    drawn = []
    for name, colour in zip(SEARCHED_GAINS, _GAIN_COLOURS, strict=True):
        values = np.array([leader.servo.per_axis(name)[0] for leader in history.leaders])
        if not values[-1] > 0:
            continue
        share = np.where(values > 0, values / values[-1], np.nan)
        drawn += share[np.isfinite(share)].tolist()
        axes.step([*runs, history.runs], [*share, 1.0], where="post", color=colour, lw=1.4, label=name)
    if drawn:
        logarithmic(axes, "y", [min(*drawn, 0.8), max(*drawn, 1.25)])
    axes.axhline(1.0, color=INK, lw=0.6)
    axes.set_ylabel("gain / tuned gain")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5)


def draw_gains(start: Servo, tuned: Servo, axes: Sequence[str]) -> Figure:
    """Draw the ratio of every tuned gain to that of the start, a bar for each axis."""
    names = SEARCHED_GAINS
    width = 0.8 / len(axes)
    old = np.array([start.per_axis(name) for name in names])
    new = np.array([tuned.per_axis(name) for name in names])
    drawn = [0.5, 2.0]
    with sheet(9.0, 3.2) as figure:
        panel = figure.add_subplot()
        for a, axis in enumerate(axes):
            k = np.flatnonzero((old[:, a] > 0) & (new[:, a] > 0))
            ratio = new[k, a] / old[k, a]
            middle = k + (a - 0.5 * (len(axes) - 1)) * width
            colour = AXES[a % len(AXES)]
            bars = panel.bar(middle, ratio - 1, 0.9 * width, bottom=1.0, color=colour, label=axis)
            panel.bar_label(bars, [f"{value:.3g}" for value in ratio], padding=2, fontsize=8)
            drawn += ratio.tolist()
        logarithmic(panel, "y", [0.6 * min(drawn), 1.6 * max(drawn)])
        panel.axhline(1.0, color=INK, lw=0.8)
        panel.set_xticks(range(len(names)), names)
        panel.set_xlim(-0.5, len(names) - 0.5)
        panel.grid(visible=False, axis="x")
        panel.set_ylabel("tuned gain / gain at the start")
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=len(axes))
    return figure


def draw_loops(stability: Stability, start: Servo, tuned: Servo, axes: Sequence[str]) -> Figure:
    """Draw the open loops near -1, and |S| over the frequency: at the start on the first machine, tuned on all.

    Args:
        stability: on the machines, the first being the job's own.
        start: servo at the start.
        tuned: tuned servo.
        axes: their names.
    """
    nyquist = 0.5 / start.period
    frequency = np.geomspace(_LOWEST_FREQUENCY * nyquist, nyquist, _FREQUENCIES)
    radius = 1 / stability.peak
    with sheet(10.7, 5.0) as figure:
        near_point, peaks = figure.subplots(1, 2, width_ratios=(1, 1.25))
        angle = np.linspace(0, 2 * np.pi, 200)
        near_point.fill(-1 + radius * np.cos(angle), radius * np.sin(angle), color=COLOURS["fault"], alpha=0.15, lw=0)
        near_point.plot(-1, 0, "+", color=COLOURS["fault"], ms=9)

        def draw(servo: Servo, machine: int, colours: Sequence[str], names: Sequence[str], dashes: str) -> None:
            loops = stability.loop(servo, frequency, machine)
            for a, name in enumerate(names):
                style = {"color": colours[a % len(colours)], "lw": 0.6 if machine else 1.6, "ls": dashes}
                near_point.plot(loops[:, a].real, loops[:, a].imag, **style)
                peaks.plot(frequency, 1 / np.abs(1 + loops[:, a]), label="_" if machine else name, **style)

        draw(start, 0, [REQUESTED], ["start", *["_"] * (len(axes) - 1)], "--")
        for machine in reversed(range(stability.machines)):
            draw(tuned, machine, AXES, [f"{axis}, tuned" for axis in axes], "-")
        near_point.set(xlim=(-3.2, 0.8), ylim=(-2.4, 2.4), xlabel="Re L", ylabel="Im L", aspect="equal")
        near_point.axhline(0, color=INK, lw=0.5)
        peaks.axhline(stability.peak, color=BAD, lw=1.2, ls="--")
        peaks.annotate(
            f"limit {stability.peak:.3g}", (frequency[0], stability.peak), xytext=(2, 3),
            textcoords="offset points", color=COLOURS["fault"], fontsize=9,
        )  # fmt: skip
        logarithmic(peaks, "x", frequency.tolist())
        logarithmic(peaks, "y", [0.02, 1.6 * stability.peak])
        peaks.set(xlabel="frequency [Hz]", ylabel="sensitivity |S|")
        peaks.legend(loc="lower right")
    return figure


def draw_machines(unseen: Mapping[Phase, Floats], searched: Mapping[Phase, Sequence[float]], label: str) -> Figure:
    """Draw the cumulative distribution of the metric over unseen machines, at the start and tuned.

    Args:
        unseen: metric on unseen machines, (n,); inf for a fault.
        searched: metric on the machines of the search.
        label: of the metric, with its unit.
    """
    drawn = [
        float(value) for metrics in (*unseen.values(), *searched.values()) for value in metrics if math.isfinite(value)
    ]
    with sheet(9.0, 4.4) as figure:
        axes = figure.add_subplot()
        for phase, values in unseen.items():
            colour = _PHASE_COLOURS[phase]
            finite = np.sort(values[np.isfinite(values)])
            if finite.size:
                share = 100 * np.arange(finite.size + 1) / values.size
                metric = np.concatenate([finite[:1], finite])
                axes.step(metric, share, where="post", color=colour, lw=1.8, label=f"{phase}, unseen machines")
            marks = [value for value in searched[phase] if math.isfinite(value)]
            if marks:
                text = f"{phase}, machines of the search"
                axes.plot(marks, [-5] * len(marks), "|", ms=11, mew=1.6, color=colour, label=text)
        if drawn:
            logarithmic(axes, "x", drawn)
        axes.set(xlabel=label, ylabel="share of machines [%]", ylim=(-10, 105), yticks=range(0, 101, 20))
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
    return figure
