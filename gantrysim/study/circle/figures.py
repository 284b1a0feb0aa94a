"""The plots and tables of a circular test."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from gantrysim.arrays import Floats
from gantrysim.metrics import CircularTest, Trace, minimum_zone
from gantrysim.plots.style import AXIS_COLOURS, COLOURS, INK, UM, sheet
from gantrysim.study.cases import Row
from gantrysim.study.circle.rows import AXES, SENSES
from gantrysim.study.study import Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

    from gantrysim.report import Table
    from gantrysim.study.circle.study import CircleStudy

_PATHS = {"clockwise": AXIS_COLOURS[1], "counter-clockwise": AXIS_COLOURS[0]}
_DIVISIONS = (1, 2, 5)
_RINGS = 4  # divisions from the nominal circle to the largest deviation, at most
_INSIDE = 1.6  # radius of the nominal circle in the chart, in largest deviations


def figures(study: CircleStudy, rows: list[Row]) -> list[Plot]:
    """Return the circular-test chart, and the deviation over the angle."""
    traces = study.traces(rows)
    if len(traces) < len(SENSES):
        return []
    test = CircularTest(traces["clockwise"], traces["counter-clockwise"])
    structure = {
        str(row["direction"]): trace.deviation - np.array(row["motor_deviation_um"], float) / UM
        for row, trace in zip(rows, traces.values(), strict=True)
    }
    return [
        Plot(
            "chart",
            "Radial deviation, magnified",
            "The nominal circle is the bold ring; outside of it the path is too large. The dashed rings are the "
            "minimum zone of both paths.",
            _draw_chart(test),
            tables=[_figures_table(test), _reversals_table(traces, study.reach)],
        ),
        Plot(
            "deviation",
            "Radial deviation over the angle",
            "At 0 and 180 deg x reverses, at 90 and 270 deg y; the marks are the spikes. Below, what of it arises "
            "behind the motors.",
            _draw_deviation(traces, structure, study.reach),
        ),
    ]


def _figures_table(test: CircularTest) -> Table:
    from gantrysim.report import Column, Table

    rows: list[list[Any]] = []
    for name, trace in (("clockwise", test.clockwise), ("counter-clockwise", test.counter_clockwise)):
        deviation = UM * trace.deviation
        rows.append([name, UM * trace.circular_deviation, deviation.max(), deviation.min(), None, None])
    both = UM * test.bidirectional_circular_deviation, UM * test.mean_bidirectional_radial_deviation
    rows.append(["both", None, None, None, *both])
    heads = ("G [µm]", "Fmax [µm]", "Fmin [µm]", "G(b) [µm]", "D [µm]")
    columns: list[str | Column] = ["path", *(Column(head, ".2f") for head in heads)]
    return Table(columns, rows, caption="AnalysisValues in the manner of ISO 230-4.")


def _reversals_table(traces: dict[str, Trace], reach: float) -> Table:
    from gantrysim.report import Column, Table

    found = {name: trace.reversals(reach) for name, trace in traces.items()}
    rows = [
        [
            f"{angle:g} deg",
            AXES[k % 2],
            *(UM * value for one in found.values() for value in (one[k].step, one[k].spike)),
        ]
        for k, angle in enumerate((0, 90, 180, 270))
    ]
    columns: list[str | Column] = ["reversal at", "axis"]
    columns += [Column(f"{name}, {what} [µm]", ".2f") for name in found for what in ("step", "spike")]
    return Table(columns, rows, caption="Reversals of the axes; outward is positive.")


def _draw_chart(test: CircularTest) -> Figure:
    """Draw the radial deviation of both paths on a circle, magnified, with the zone that envelops them."""
    paths = {"clockwise": test.clockwise, "counter-clockwise": test.counter_clockwise}
    reach = UM * max(float(np.abs(trace.deviation).max()) for trace in paths.values())
    division = _division(reach)
    rings = int(np.ceil(reach / division))
    with sheet(7.4, 7.9) as figure:
        axes = cast("PolarAxes", figure.add_subplot(projection="polar"))
        for name, trace in paths.items():
            order = np.argsort(trace.angle)
            angle, deviation = np.radians(trace.angle[order]), UM * trace.deviation[order]
            closed = np.append(angle, angle[0] + 2 * np.pi), np.append(deviation, deviation[0])
            axes.plot(*closed, lw=1.3, color=_PATHS[name], label=f"{name}, G = {UM * trace.circular_deviation:.1f} µm")
        round_ = np.linspace(0, 2 * np.pi, 721)
        zone = minimum_zone(np.concatenate([trace.points for trace in paths.values()]))
        shift = np.subtract(zone.centre, test.clockwise.centre)
        for radius, label in ((zone.inner, f"minimum zone, G(b) = {UM * zone.width:.1f} µm"), (zone.outer, None)):
            off = radius - test.clockwise.radius + shift[0] * np.cos(round_) + shift[1] * np.sin(round_)
            axes.plot(round_, UM * off, lw=1.0, ls="--", color=COLOURS["structure"], label=label)
        axes.plot(
            round_, np.zeros(round_.size), lw=1.6, color=INK, label=f"nominal, radius {test.clockwise.radius:g} mm"
        )
        steps = division * np.arange(-rings, rings + 1)
        axes.set_yticks(steps, [f"{step:+g}" if step else "0" for step in steps])
        axes.tick_params(axis="y", labelsize=8)
        axes.set_rlabel_position(22.5)
        axes.set_ylim(-_INSIDE * rings * division, 1.05 * rings * division)
        places = ["+x", "45°", "+y", "135°", "-x", "225°", "-y", "315°"]
        axes.set_xticks(np.radians(range(0, 360, 45)), places)
        axes.spines["polar"].set_visible(False)
        axes.set_title(f"Radial deviation [µm], {division:g} µm per division", pad=14)
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def _draw_deviation(traces: dict[str, Trace], structure: dict[str, Floats], reach: float) -> Figure:
    """Draw the radial deviation over the angle, a panel for each direction, and what of it the structure makes below.

    Args:
        traces: of the nozzle, by direction.
        structure: radial deviation of the nozzle less that of the motors, at the points of the traces, (n,) [mm].
        reach: of the spikes after reversals [deg].
    """
    with sheet(9.0, 7.2) as figure:
        *panels, last = figure.subplots(len(traces) + 1, sharex=True, height_ratios=(3,) * len(traces) + (2,))
        for panel, (name, trace) in zip(panels, traces.items(), strict=True):
            order = np.argsort(trace.angle)
            angle = trace.angle[order]
            panel.plot(angle, UM * trace.deviation[order], color=_PATHS[name], lw=1.3)
            last.plot(angle, UM * structure[name][order], color=_PATHS[name], lw=0.7, label=name)
            for reversal in trace.reversals(reach):
                panel.axvline(reversal.angle, color=COLOURS["requested"], lw=0.8, ls=":")
                at = (reversal.angle + (-1 if trace.clockwise else 1) * reversal.spike_at) % 360
                near = int(np.abs((trace.angle - at + 180) % 360 - 180).argmin())
                top = UM * float(trace.deviation[near])
                panel.plot(at, top, "v" if reversal.spike > 0 else "^", ms=5, color=COLOURS["fault"])
                right = at < 180
                panel.annotate(
                    f"{UM * reversal.spike:+.1f}",
                    (at, top),
                    xytext=(7 if right else -7, -3),
                    textcoords="offset points",
                    ha="left" if right else "right",
                    color=COLOURS["fault"],
                    fontsize=9,
                )
            panel.set_title(f"nozzle, run {name}", loc="right")
            panel.set_ylabel("outward [µm]")
        panels[-1].sharey(panels[0])
        last.set_title("nozzle less motors: the structure's part", loc="right")
        last.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
        last.set(xlabel="angle, counter-clockwise from +x [deg]", xlim=(0, 360), ylabel="outward [µm]")
        last.set_xticks(range(0, 361, 45))
    return figure


def _division(reach: float) -> float:
    """The least of 1, 2, 5, 10, ... that has the reach in few divisions."""
    decade = 10.0 ** np.floor(np.log10(max(reach, 1e-3)) - 1)
    return next(
        float(step * decade * ten)
        for ten in (1, 10, 100)
        for step in _DIVISIONS
        if reach <= _RINGS * step * decade * ten
    )
