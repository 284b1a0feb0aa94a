"""The report of a repeat study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gantrysim.base.quantity import UM
from gantrysim.metrics import Positioning, RepeatedPath
from gantrysim.metrics.analysis import THOUSANDTH
from gantrysim.metrics.error_quantities import CONTOUR
from gantrysim.metrics.parts import PART_PLACE
from gantrysim.report.document import Column, Table
from gantrysim.report.plots.style import COLOURS, colour_map, draw_limit, sheet
from gantrysim.results.colours import INK, MAGNITUDE, RUNS
from gantrysim.study.acceptance import Acceptance, Scope, improve_command, path_limit
from gantrysim.study.cases import OK, Row
from gantrysim.study.repeat.study import ALL_VARIATIONS, PHASES, RepeatStudy, has_phase
from gantrysim.study.study import Details, Plot, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# The answer of a repeat study: whether every repeat keeps the limits, and what to change where one does not.

QUESTION = "Does every repeat of this job meet the tolerance?"


def repeat_answer(study: RepeatStudy, rows: Sequence[Row], paths: dict[str, RepeatedPath]) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of all repeats.
        paths: repeated paths by varied source, with that of all sources.
    """
    path = paths[ALL_VARIATIONS]
    result = (
        f"path accuracy ATp = {UM * path.path_accuracy:.2f} µm, path repeatability RTp = "
        f"{UM * path.path_repeatability:.2f} µm over {len(path.attained)} repeats of {study.job.name}"
    )
    repeats = [Acceptance.of(row) for row in rows if row["varied"] == ALL_VARIATIONS]
    judged = [acceptance for acceptance in repeats if acceptance is not None]
    if not judged:
        return f"Not judged by a tolerance: {result}."
    scope = Scope.of(judged)
    worst = max(judged, key=lambda acceptance: acceptance.use(scope.aspects))
    accepted = sum(acceptance.keeps(scope.aspects) for acceptance in judged)
    if accepted == len(repeats):
        return (
            f"{scope.reply(worst)}, all {accepted} repeats keep {scope.words}, with at most {scope.usage(worst)}"
            f"{scope.remark(worst)}: {result}."
        )
    failures = f"; the worst is at {scope.excess(worst)}"
    # then the others have no run that could be judged
    if worst.keeps(scope.aspects):
        failures = "; the others were refused or ended in a fault"
    return f"No, {accepted} of {len(repeats)} repeats keep {scope.words}{failures}: {result}; {_lever(study, paths)}."


def _lever(study: RepeatStudy, paths: dict[str, RepeatedPath]) -> str:
    """Return which part of the error to reduce: the systematic one, or the scatter with its largest source."""
    path = paths[ALL_VARIATIONS]
    improve = f"{improve_command(study.job)} tries the levers"
    if path.path_accuracy >= path.path_repeatability:
        return f"the systematic error is the larger part, and {improve}"
    alone = {name: source.path_repeatability for name, source in paths.items() if name != ALL_VARIATIONS}
    if not alone:
        return f"the scatter is the larger part, and {improve}"
    source = max(alone, key=lambda name: alone[name])
    return f"the scatter is the larger part, most of it from the {source} ({UM * alone[source]:.2f} µm alone)"


def report(study: RepeatStudy, rows: Sequence[Row]) -> Report:
    """Return accuracy and repeatability by the source of variation, along the path and on the plan."""
    paths = study.paths(rows)
    if ALL_VARIATIONS not in paths:
        text = f"Not known: fewer than two of {study.repeats} repeats have values: {rows[0]['status']}."
        return Report(QUESTION, text)
    chart = Plot(
        "along",
        "Along the path",
        "Above, the distance from the requested path to the mean of the repeats, with the circle of repeatability "
        "as a band, and the largest error that the job's tolerance admits. Below, the repeatability with everything "
        "varied and with each source alone.",
        _draw_along(paths, UM * path_limit(study.job)),
    )
    plan = Plot("plan", "On the plan", "The path coloured by the repeatability.", _draw_plan(paths[ALL_VARIATIONS]))
    axes = study.positioning
    tables = [*([_positioning_table(axes)] if axes else []), _variation_table(study)]
    details = Details(_notes(study, rows, paths[ALL_VARIATIONS], axes), tables, [plan])
    return Report(QUESTION, repeat_answer(study, rows, paths), chart, _table(paths), details)


def _notes(study: RepeatStudy, rows: Sequence[Row], path: RepeatedPath, axes: dict[str, Positioning]) -> list[str]:
    notes = []
    if path.path_repeatability > 0:
        ratio = path.path_accuracy / path.path_repeatability
        notes.append(f"The systematic error, removable by correcting the program, is {ratio:.3g} times the scatter.")
    notes.append(
        f"After public descriptions of ISO 9283:1998, at {study.s.size} places along the dispensing path, in planes "
        "normal to it; load, speed and path are the job's, not the standard's (see gantrysim.metrics)."
    )
    if failed := sum(row["status"] != OK for row in rows):
        notes.append(f"{failed} of {len(rows)} runs failed and are left out.")
    for name, positioning in axes.items():
        notes.append(
            f"Axis {name} positions to A = {UM * positioning.accuracy:.1f} µm and repeats within "
            f"± {UM * positioning.repeatability / 2:.1f} µm from both directions, "
            f"± {UM * positioning.unidirectional_repeatability / 2:.1f} µm from one."
        )
    return notes


def _positioning_table(axes: dict[str, Positioning]) -> Table:
    symbols = ("reversal B", "R, one direction", "R, both", "systematic E", "accuracy A")
    heads = [f"{symbol} [{CONTOUR.unit}]" for symbol in symbols]
    rows: list[list[Any]] = []
    for name, axis in axes.items():
        values = (axis.reversal, axis.unidirectional_repeatability, axis.repeatability, axis.systematic, axis.accuracy)
        rows.append([name, *(UM * value for value in values)])
    caption = (
        "Positioning of the axes after public descriptions of ISO 230-2: servo, drive and geometry together, each axis "
        "alone. A repeatability of ± r in a data sheet is R / 2."
    )
    return Table(["axis", *(Column(head, ".2f") for head in heads)], rows, caption=caption)


def _table(paths: dict[str, RepeatedPath]) -> Table:
    place = Column.of(PART_PLACE[0])
    columns: list[str | Column] = ["varied", "repeats"]
    for symbol in ("AT", "RT"):
        largest = Column(f"{symbol}p [{CONTOUR.unit}]", ".2f")
        columns += [largest, place, Column(f"median {symbol} [{CONTOUR.unit}]", ".2f")]
    rows: list[list[Any]] = []
    for varied, path in paths.items():
        cells: list[Any] = [varied, len(path.attained)]
        for size in (path.accuracy, path.repeatability):
            cells += [UM * size.max(), path.s[size.argmax()], UM * np.median(size)]
        rows.append(cells)
    return Table(columns, rows, caption="Path accuracy and repeatability by varied source, after ISO 9283.")


def _variation_table(study: RepeatStudy) -> Table:
    counts = [
        f"{axis.name} {UM * count:g} {THOUSANDTH[axis.unit]}"
        for axis, count in zip(study.job.built_machine.axes, study.counts, strict=True)
        if count
    ]
    phase = "none, it starts on a servo tick"
    if has_phase(study.job):
        phase = f"{PHASES} phases of the servo period, {UM * study.job.built_servo.period:g} ms"
    rows = [
        ["friction and viscous friction, per axis", f"{100 * study.friction:g} % standard deviation"],
        ["axis zero, within one encoder count", ", ".join(counts) or "none"],
        ["start of the program", phase],
    ]
    return Table(["source", "variation"], rows, caption=f"Variation from repeat to repeat, seed {study.seed}.")


def _draw_along(paths: dict[str, RepeatedPath], limit: float) -> Figure:
    """Draw accuracy and repeatability along the path with their limit [µm], and the repeatability by varied source."""
    path = paths[ALL_VARIATIONS]
    accuracy = UM * path.accuracy
    reach = UM * path.repeatability
    with sheet(9.0, 6.6) as figure:
        above, below = figure.subplots(2, sharex=True)
        low = np.maximum(accuracy - reach, 0)
        high = accuracy + reach
        above.fill_between(path.s, low, high, color=COLOURS["requested"], alpha=0.35, lw=0, label="± repeatability RT")
        above.plot(path.s, accuracy, color=INK, lw=1.2, label="accuracy AT: mean of the repeats to the path")
        k = int(accuracy.argmax())
        above.plot(path.s[k], accuracy[k], "v", ms=7, color=COLOURS["fault"], label=f"ATp = {accuracy[k]:.2f} µm")
        below.plot(path.s, reach, color=INK, lw=1.4, label=f"{ALL_VARIATIONS} varied, RTp = {reach.max():.2f} µm")
        sources = {name: source for name, source in paths.items() if name != ALL_VARIATIONS}
        for colour, (varied, alone) in zip(RUNS, sources.items(), strict=False):
            label = f"{varied} alone, {UM * alone.path_repeatability:.2f} µm"
            below.plot(alone.s, UM * alone.repeatability, color=colour, lw=1.0, label=label)
        above.set(ylabel="to the requested path [µm]")
        below.set(ylabel="repeatability [µm]", xlabel="arc length along the requested path [mm]")
        for axes in (above, below):
            axes.set_ylim(bottom=0)
        draw_limit(above, limit, signed=False)
        for axes in (above, below):
            axes.set_xlim(path.s[0], path.s[-1])
            axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, fontsize=9, borderaxespad=0.2)
    return figure


def _draw_plan(path: RepeatedPath) -> Figure:
    """Draw the plan of the path, coloured by the repeatability."""
    from matplotlib.collections import LineCollection

    points = path.command[:, :2]
    reach = UM * path.repeatability
    steps = np.diff(path.s)
    # no line where no glue is laid
    joined = steps < 1.5 * np.median(steps)
    segments = np.stack([points[:-1], points[1:]], axis=1)[joined]
    width, depth = np.maximum(np.ptp(points, axis=0), 1e-9)
    with sheet(7.4, float(np.clip(5.6 * depth / width + 1.1, 3.0, 7.4))) as figure:
        axes = figure.add_subplot()
        lines = LineCollection(list(segments), cmap=colour_map(MAGNITUDE), linewidths=3.0, capstyle="round")
        lines.set_array(0.5 * (reach[:-1] + reach[1:])[joined])
        lines.set_clim(0, float(reach.max()) or 1.0)
        axes.add_collection(lines)
        k = int(reach.argmax())
        label = f"RTp = {reach[k]:.2f} µm"
        axes.plot(*points[k], "o", ms=11, mfc="none", mew=1.6, color=COLOURS["fault"], ls="none", label=label)
        k = int(path.accuracy.argmax())
        label = f"ATp = {UM * path.path_accuracy:.2f} µm"
        axes.plot(*points[k], "s", ms=11, mfc="none", mew=1.6, color=INK, ls="none", label=label)
        axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
        axes.margins(0.06)
        figure.colorbar(lines, ax=axes, label="repeatability RT [µm]", shrink=0.85)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return figure
