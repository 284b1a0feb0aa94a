"""The report of a speed study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gantrysim.base.quantity import MEAN
from gantrysim.metrics.budget import DESCRIPTIONS
from gantrysim.metrics.error_quantities import CONTOUR, DURATION, SPEED
from gantrysim.report.document import Column, Table
from gantrysim.report.plots.style import COLOURS, INK, sheet
from gantrysim.study.cases import OK, Row
from gantrysim.study.drawing import logarithmic
from gantrysim.study.speed.answer import QUESTION, Fastest, speed_answer
from gantrysim.study.speed.saturation import durations, saturation_of
from gantrysim.study.speed.study import SpeedStudy, speed_of
from gantrysim.study.study import Details, Plot, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOGARITHMIC_FROM = 5.0  # times the least value


def report(study: SpeedStudy, rows: Sequence[Row]) -> Report:
    """Return the fastest speed within the tolerance, the runs around it, and metric and links over the speed."""
    good = sorted((row for row in rows if row["status"] == OK), key=speed_of)
    if not good:
        text = f"Not known: none of the {len(rows)} speeds tried gives a run with values: {rows[0]['status']}."
        return Report(QUESTION, text)
    fastest = Fastest.of(study, rows)
    result = fastest.result
    scaling = study.job.controller.speed_scaling
    notes = [
        *_saturation(good),
        f"Speed is {scaling}; ramps and limits of controller and axes stay those of the job; the flow changes with it.",
    ]
    if result.islands:
        islands = ", ".join(f"{speed:g}" for speed in result.islands)
        notes.insert(0, f"Not monotonic: faster runs are within the tolerance again, at {islands} mm/s.")
    chart = Plot(
        "speed",
        "Metric over the speed",
        "Every run of the search, which narrows the bracket of the fastest speed within the tolerance and the next "
        "faster one.",
        _draw_metric(study, rows, good),
    )
    links = Plot(
        "links",
        "Links over the speed",
        "Root mean square of the parts of the error normal to the requested path, one for each link of the chain; "
        "lag along the path is in none of them.",
        _draw_links(good),
    )
    sentence = speed_answer(study, rows, good, fastest)
    return Report(QUESTION, sentence, chart, _table(study, rows, good), Details(notes, plots=[links]))


def _table(study: SpeedStudy, rows: Sequence[Row], good: Sequence[Row]) -> Table:
    """Return the runs that matter: fastest within the tolerance, next faster, programmed speed, slowest."""
    by_speed = {speed_of(row): row for row in rows}
    fastest = Fastest.of(study, rows)
    criterion = fastest.criterion
    result = fastest.result
    columns: list[str | Column] = [
        "run",
        Column("speed [mm/s]"),
        criterion.axis_label(good[0]),
        "largest part",
        Column(f"its rms [{CONTOUR.unit}]", ".4g"),
        Column(SPEED.statistic(MEAN).head),
        Column(DURATION.head),
    ]
    cells = []
    runs = {
        "fastest" if result.above else "fastest tried": result.fastest,
        "next": result.above,
        "programmed": study.programmed_speed,
        "slowest": min(by_speed),
    }
    for name, speed in runs.items():
        row = by_speed.get(speed) if speed is not None else None
        if row is None:
            continue
        if row["status"] != OK:
            cells.append([name, speed, None, row["status"], None, None, None])
            continue
        sizes: dict[str, float] = {}
        for link in DESCRIPTIONS:
            size = row.get(f"{link}_rms_um")
            if link != "contour" and isinstance(size, float):
                sizes[link] = size
        most = max(sizes, key=lambda link: sizes[link])
        values = (criterion.value(row), most, sizes[most], row["speed_mean_mm_s"], row["duration_s"])
        cells.append([name, speed, *values])
    return Table(columns, cells, caption="Fastest run within the tolerance, next faster, programmed and slowest run.")


def _saturation(good: Sequence[Row]) -> list[str]:
    """Return a note of the speed from which a faster program does not shorten the job, if it was reached."""
    saturation = saturation_of(durations(good))
    if saturation is None:
        return []
    return [
        f"From {saturation.speed:g} mm/s on, ramps, clamps and axis limits keep the duration at "
        f"{saturation.duration:.4g} s."
    ]


def _draw_metric(study: SpeedStudy, rows: Sequence[Row], good: Sequence[Row]) -> Figure:
    fastest = Fastest.of(study, rows)
    criterion = fastest.criterion
    result = fastest.result
    with sheet(9.0, 4.8) as figure:
        axes = figure.add_subplot()
        speeds = [speed_of(row) for row in good]
        values = [criterion.value(row) for row in good]
        axes.plot(speeds, values, color=INK, lw=1.0, alpha=0.5)
        kinds = (("within the tolerance", True, COLOURS["structure"]), ("out of tolerance", False, COLOURS["fault"]))
        for label, within, colour in kinds:
            chosen = [k for k, row in enumerate(good) if criterion.within(row) is within]
            if chosen:
                points = [speeds[k] for k in chosen], [values[k] for k in chosen]
                axes.plot(*points, "o", ms=5, color=colour, label=label, zorder=3)
        axes.axhline(criterion.tolerance, color=COLOURS["fault"], lw=1.2, ls="--", label="tolerance")
        failed = sorted(speed_of(row) for row in rows if row["status"] != OK)
        if failed:
            transform = axes.get_xaxis_transform()
            heights = [0.97] * len(failed)
            axes.plot(failed, heights, "x", ms=7, color=COLOURS["fault"], transform=transform, label="fault or refused")
        axes.axvline(study.programmed_speed, color=COLOURS["requested"], lw=1.0, ls=":", label="programmed speed")
        if result.fastest is not None:
            axes.axvspan(min(speeds + failed), result.fastest, color=COLOURS["structure"], alpha=0.08, lw=0)
            axes.set_title(f"within the tolerance up to {result.fastest:g} mm/s", loc="right")
        logarithmic(axes, "x", [*speeds, *failed])
        if max(values) > _LOGARITHMIC_FROM * min(values):
            logarithmic(axes, "y", [*values, criterion.tolerance])
        else:
            axes.set_ylim(0, 1.1 * max(*values, criterion.tolerance))
        axes.set(xlabel="programmed path speed [mm/s]", ylabel=criterion.axis_label(good[0]))
        figure.legend(loc="outside lower center", ncols=5)
    return figure


def _draw_links(good: Sequence[Row]) -> Figure:
    speeds = [speed_of(row) for row in good]
    with sheet(9.0, 4.8) as figure:
        axes = figure.add_subplot()
        drawn: list[float] = []
        for link in (name for name in DESCRIPTIONS if f"{name}_rms_um" in good[0]):
            values = np.array([row[f"{link}_rms_um"] for row in good], float)
            if values.max() < 1e-3:  # nothing to show on a logarithmic scale
                continue
            values = np.maximum(values, 1e-3)
            drawn += values.tolist()
            if link == "contour":  # a broad band, on which the link with the largest part is drawn
                axes.plot(speeds, values, lw=7, alpha=0.25, color=COLOURS[link], label=link, zorder=1)
            else:
                axes.plot(speeds, values, "o-", ms=3.5, lw=1.4, color=COLOURS[link], label=link)
        logarithmic(axes, "x", speeds)
        logarithmic(axes, "y", drawn)
        axes.set(xlabel="programmed path speed [mm/s]", ylabel="error normal to the path, rms [µm]")
        figure.legend(loc="outside lower center", ncols=5)
    return figure
