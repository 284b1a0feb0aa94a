"""The report of a circular test: whether both directions keep the limits, and where their deviation arises."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.base.quantity import UM, number_text
from gantrysim.metrics import CircularTest, Trace, minimum_zone
from gantrysim.metrics.error_quantities import CONTOUR
from gantrysim.report.document import Column, Table
from gantrysim.report.plots.style import COLOURS, FAR_LIMIT, draw_limit, limit_text, sheet
from gantrysim.results.colours import BAD, INK, RUNS
from gantrysim.study.acceptance import MOTION_LIMITS, Acceptance, Scope, improve_command, path_limit
from gantrysim.study.cases import OK, Row
from gantrysim.study.circle.study import AXES, DECAY, SENSES, CircleStudy
from gantrysim.study.study import Details, Plot, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes


QUESTION = "Does this machine run a circle within the tolerance?"
_SCOPE = Scope(MOTION_LIMITS)  # it lays no glue
_MOTORS_SHARE = 0.5


def circle_answer(study: CircleStudy, rows: Sequence[Row], test: CircularTest, motors: dict[str, Trace]) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of both directions, with values.
        test: the paths of the nozzle.
        motors: paths of the motors by direction.
    """
    result = (
        f"circular deviation G = {UM * test.clockwise.circular_deviation:.1f} µm clockwise and "
        f"{UM * test.counter_clockwise.circular_deviation:.1f} µm counter-clockwise, bidirectional G(b) = "
        f"{UM * test.bidirectional_circular_deviation:.1f} µm, for a radius of {study.radius:g} mm at {study.speed:g} "
        f"mm/s on {study.job.built_machine.name}"
    )
    judged = {str(row["direction"]): acceptance for row in rows if (acceptance := Acceptance.of(row)) is not None}
    if len(judged) < len(rows):
        return f"Not judged by a tolerance: {result}."
    direction = max(judged, key=lambda name: judged[name].use(_SCOPE.aspects))
    worst = judged[direction]
    if worst.keeps(_SCOPE.aspects):
        spike = _largest_spike(study, {"clockwise": test.clockwise, "counter-clockwise": test.counter_clockwise})
        return (
            f"{_SCOPE.reply(worst)}, both directions keep {_SCOPE.words}, with {_SCOPE.usage(worst)}: {result}{spike}."
        )
    return (
        f"No, run {direction} it is at {_SCOPE.excess(worst)}: {result}; {_source(test, motors)}, and "
        f"{improve_command(study.job)} tries the levers."
    )


def _largest_spike(study: CircleStudy, traces: dict[str, Trace]) -> str:
    """Return the largest spike at a reversal and what acts on it: a clause, or empty where no axis reverses."""
    spikes = [
        (UM * abs(reversal.spike), AXES[reversal.axis], reversal.angle, name)
        for name, trace in traces.items()
        for reversal in trace.reversals(study.reach)
    ]
    if not spikes:
        return ""
    size, axis, angle, name = max(spikes)
    laws = improve_command(study.job).replace("improve", "study laws")
    return (
        f"; the largest spike at a reversal is {size:.1f} µm, of {axis} at {angle:g} deg {name}: a compensation of "
        f"friction acts on it, and {laws} compares the laws"
    )


def _source(test: CircularTest, motors: dict[str, Trace]) -> str:
    """Return on which side of the motors the larger circular deviation arises."""
    nozzle = {"clockwise": test.clockwise, "counter-clockwise": test.counter_clockwise}
    name = max(nozzle, key=lambda direction: nozzle[direction].circular_deviation)
    of_motors = motors[name].circular_deviation
    side = "before" if of_motors > _MOTORS_SHARE * nozzle[name].circular_deviation else "behind"
    return f"the motors' G is {UM * of_motors:.1f} µm {name}, so most of it arises {side} the motors"


_PATHS = {"clockwise": RUNS[0], "counter-clockwise": RUNS[1]}
_DIVISIONS = (1, 2, 5)
_RINGS = 4  # divisions from the nominal circle to the largest deviation, at most
_NOMINAL_RADIUS = 1.6  # radius of the nominal circle in the chart, in largest deviations


def report(study: CircleStudy, rows: Sequence[Row]) -> Report:
    """Return the circular deviations, the reversals, the chart, and the deviation over the angle."""
    traces = study.traces(rows, "radial")
    motors = study.traces(rows, "motor")
    if len(traces) < len(SENSES):
        failed = next(row for row in rows if row["status"] != OK)
        return Report(QUESTION, f"Not known: the circle run {failed['direction']} has no values: {failed['status']}.")
    test = CircularTest(traces["clockwise"], traces["counter-clockwise"])
    structure = {name: trace.deviation - motors[name].deviation for name, trace in traces.items()}
    chart = Plot(
        "chart",
        "Radial deviation, magnified",
        "The nominal circle is the bold ring; outside it the path is too large. The dark dashed rings are the "
        "minimum zone of both paths, the red ones, where they fit the scale, the largest error that the job's "
        "tolerance admits; the triangle marks the largest deviation.",
        _draw_chart(test, UM * path_limit(study.job)),
    )
    deviation = Plot(
        "deviation",
        "Radial deviation over the angle",
        "x reverses at 0 and 180 deg, y at 90 and 270 deg; the marks are the spikes. Below, the part that arises "
        "behind the motors.",
        _draw_deviation(traces, structure, study.reach, UM * path_limit(study.job)),
    )
    details = Details(_notes(study), [_reversals_table(traces, study.reach)], [deviation])
    sentence = circle_answer(study, rows, test, motors)
    return Report(QUESTION, sentence, chart, _values_table(test, traces, motors), details)


def _notes(study: CircleStudy) -> list[str]:
    notes = [
        f"Evaluated on one full circle at constant speed after {study.lead:g} deg of lead, after public descriptions "
        "of ISO 230-4:2005 and 2022: F from the nominal circle about the axes' zero, G and G(b) from minimum-zone "
        "circles, D, the error of the mean radius, from the least-squares circle of both paths.",
        "Steps and spikes at reversals are not part of the standard (see gantrysim.metrics). The motors' G is that of "
        "the motor positions; the difference to the nozzle's lies between motor and nozzle.",
    ]
    if study.decay > study.reach:
        notes.append(
            f"A spike takes {DECAY:g} s to decay, {study.decay:.0f} deg at this speed: steps and spikes are not "
            "clearly separated."
        )
    return notes


def _values_table(test: CircularTest, traces: dict[str, Trace], motors: dict[str, Trace]) -> Table:
    both = (UM * test.bidirectional_circular_deviation, UM * test.mean_bidirectional_radial_deviation)
    rows: list[list[Any]] = []
    for name, trace in traces.items():
        circular = (UM * trace.circular_deviation, UM * motors[name].circular_deviation)
        radial = (UM * trace.deviation.max(), UM * trace.deviation.min())
        rows.append([name, *circular, *radial, None, None])
    rows.append(["both", None, None, None, None, *both])
    symbols = ("G", "motors' G", "Fmax", "Fmin", "G(b)", "D")
    columns = (Column(f"{symbol} [{CONTOUR.unit}]", ".2f") for symbol in symbols)
    return Table(["path", *columns], rows, caption="Values after ISO 230-4.")


def _reversals_table(traces: dict[str, Trace], reach: float) -> Table:
    rows: list[list[Any]] = []
    for name, trace in traces.items():
        for reversal in trace.reversals(reach):
            sizes = (UM * reversal.step, UM * reversal.spike, reversal.spike_at)
            rows.append([name, f"{reversal.angle:g} deg", AXES[reversal.axis], *sizes])
    heads = ((f"step [{CONTOUR.unit}]", ".2f"), (f"spike [{CONTOUR.unit}]", ".2f"), ("spike after [deg]", ".1f"))
    columns: list[str | Column] = ["path", "reversal at", "axis", *(Column(*head) for head in heads)]
    return Table(columns, rows, caption="Reversals of the axes; outward is positive.")


def _draw_chart(test: CircularTest, limit: float) -> Figure:
    """Draw the radial deviation of both paths on a circle, magnified, with their minimum zone and its limit [µm]."""
    paths = {"clockwise": test.clockwise, "counter-clockwise": test.counter_clockwise}
    largest = UM * max(float(np.abs(trace.deviation).max()) for trace in paths.values())
    is_near = limit <= FAR_LIMIT * largest
    reach = max(largest, limit) if is_near else largest
    division = _division(reach)
    rings = int(np.ceil(reach / division))
    with sheet(7.4, 7.9) as figure:
        axes = cast("PolarAxes", figure.add_subplot(projection="polar"))
        for name, trace in paths.items():
            order = np.argsort(trace.angle)
            angle = np.radians(trace.angle[order])
            deviation = UM * trace.deviation[order]
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
        worst = max(paths.values(), key=lambda trace: float(np.abs(trace.deviation).max()))
        k = int(np.abs(worst.deviation).argmax())
        text = f"largest, {number_text(UM * worst.deviation[k], '+.1f')} µm"
        place = (np.radians(worst.angle[k]), UM * worst.deviation[k])
        axes.plot(*place, "v", ms=8, mfc="none", mew=1.6, color=COLOURS["fault"], ls="none", label=text)
        words = limit_text(limit) if is_near else f"{limit_text(limit)}, beyond this scale"
        for side in (1, -1):
            drawn = round_ if is_near else round_[:0]
            label = words if side > 0 else None
            axes.plot(drawn, np.full(drawn.size, side * limit), lw=1.4, ls="--", color=BAD, label=label)
        steps = division * np.arange(-rings, rings + 1)
        axes.set_yticks(steps, [number_text(step, "+g") for step in steps])
        axes.tick_params(axis="y", labelsize=8)
        axes.set_rlabel_position(22.5)
        axes.set_ylim(-_NOMINAL_RADIUS * rings * division, 1.05 * rings * division)
        places = ["+x", "45°", "+y", "135°", "−x", "225°", "−y", "315°"]
        axes.set_xticks(np.radians(range(0, 360, 45)), places)
        axes.spines["polar"].set_visible(False)
        axes.set_title(f"Radial deviation [µm], {division:g} µm per division", pad=14)
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def _draw_deviation(traces: dict[str, Trace], structure: dict[str, Floats], reach: float, limit: float) -> Figure:
    """Draw the radial deviation over the angle, a panel per direction, and nozzle minus motors, (n,) [mm], below.

    The panels of the directions have the limit [µm].
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
                spike = (reversal.angle + (-1 if trace.clockwise else 1) * reversal.spike_at) % 360
                near = int(np.abs((trace.angle - spike + 180) % 360 - 180).argmin())
                top = UM * float(trace.deviation[near])
                panel.plot(spike, top, "v" if reversal.spike > 0 else "^", ms=5, color=COLOURS["fault"])
                right = spike < 180
                panel.annotate(
                    number_text(UM * reversal.spike, "+.1f"),
                    (spike, top),
                    xytext=(7 if right else -7, -3),
                    textcoords="offset points",
                    ha="left" if right else "right",
                    color=COLOURS["fault"],
                    fontsize=9,
                )
            panel.set_title(f"nozzle, run {name}", loc="right")
            panel.set_ylabel("outward [µm]")
        panels[-1].sharey(panels[0])
        for panel in panels:
            draw_limit(panel, limit)
        last.set_title("nozzle minus motors", loc="right")
        last.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
        last.set(xlabel="angle, counter-clockwise from +x [deg]", xlim=(0, 360), ylabel="outward [µm]")
        last.set_xticks(range(0, 361, 45))
    return figure


def _division(reach: float) -> float:
    """Return the smallest of 1, 2, 5, 10, ... that covers the reach in few divisions."""
    decade = 10.0 ** np.floor(np.log10(max(reach, 1e-3)) - 1)
    divisions = [float(step * decade * ten) for ten in (1, 10, 100) for step in _DIVISIONS]
    return next(division for division in divisions if reach <= _RINGS * division)
