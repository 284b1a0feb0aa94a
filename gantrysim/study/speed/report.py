"""The report of a speed study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gantrysim.base.quantity import MEAN
from gantrysim.job.job import Job
from gantrysim.metrics.budget import DESCRIPTIONS
from gantrysim.metrics.error_quantities import CONTOUR, DURATION, SPEED
from gantrysim.report.document import Column, Table
from gantrysim.report.plots.style import COLOURS, sheet
from gantrysim.results.colours import BAD, GOOD, INK
from gantrysim.study.acceptance import Acceptance, Criterion, JobCriterion, Scope, improve_command, settings_text
from gantrysim.study.cases import ASPECTS, OK, Row
from gantrysim.study.drawing import logarithmic
from gantrysim.study.speed.study import Grade, SpeedAnswer, SpeedStudy, answer_of, speed_of
from gantrysim.study.study import Details, Plot, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# The speed from which a faster program does not shorten a job.

_SATURATED_DURATION = 1.02  # times the least duration: as short as the limits let it be


class Saturation(NamedTuple):
    """Where ramps, clamps and axis limits decide the duration.

    Attributes:
        speed: from which on they do [mm/s].
        duration: that remains [s].
    """

    speed: float
    duration: float


def durations(good: Sequence[Row]) -> dict[float, float]:
    """Return the duration of each speed of runs with values [s], by the speed [mm/s]."""
    return {speed_of(row): value for row in good if isinstance(value := row["duration_s"], float)}


def saturation_of(durations: Mapping[float, float]) -> Saturation | None:
    """Return the saturation of runs from the duration of each speed; None if the speeds do not reach it."""
    least = min(durations.values())
    enough = min(speed for speed, duration in durations.items() if duration <= _SATURATED_DURATION * least)
    return None if enough == max(durations) else Saturation(enough, least)


# The answer of a speed study: the fastest speed within the limits, and the setting for it.

QUESTION = "How fast can this job run within its tolerance?"


@dataclass(frozen=True)
class Fastest:
    """The fastest speeds of a study: the one of its answer, and that of the other grade.

    The answer is as good as the program at its own speed: without a warning, if that has none. A program that fails
    at its own speed is answered without a warning, where a speed tried has none.

    Attributes:
        criterion: the limits.
        grade: of the answer: without a warning, or without a failure.
        result: of that grade.
        other: of the other grade.
    """

    criterion: Criterion
    grade: Grade
    result: SpeedAnswer
    other: SpeedAnswer

    @classmethod
    def of(cls, study: SpeedStudy, rows: Sequence[Row]) -> Fastest:
        """Return the fastest speeds of a study's rows."""
        grades = study.grades(rows)
        without_failure = answer_of(grades, Grade.WARNED)
        clean = answer_of(grades, Grade.CLEAN)
        programmed = grades.get(study.programmed_speed, Grade.FAILED)
        has_warned = programmed == Grade.WARNED or clean.fastest is None
        criterion = study.criterion_of(rows)
        if has_warned:
            return cls(criterion, Grade.WARNED, without_failure, clean)
        return cls(criterion, Grade.CLEAN, clean, without_failure)

    def limit(self, row: Row) -> str:
        """Return the limits of the answer in words."""
        limit = self.criterion.limit(row)
        is_clean = self.grade == Grade.CLEAN and self.result != self.other
        return f"{limit} without a warning" if is_clean else limit

    def failure(self, row: Row) -> str:
        """Return what a case misses that is not as good as the answer, in words."""
        return self.criterion.warning(row) if self.criterion.within(row) else self.criterion.failure(row)

    @property
    def other_speed(self) -> str:
        """The fastest speed of the other grade, in words: a clause that begins with a semicolon, or empty."""
        if self.result == self.other:
            return ""
        end = "" if self.other.above else ", where the search ended"
        if self.grade == Grade.CLEAN:
            return f"; up to {self.other.fastest:g} mm/s it is kept with a warning{end}"
        if self.other.fastest is None:
            return "; no speed tried is without a warning"
        return f"; without a warning up to {self.other.fastest:g} mm/s{end}"


def speed_answer(study: SpeedStudy, rows: Sequence[Row], good: Sequence[Row], fastest: Fastest) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of all speeds tried.
        good: rows with values, at least one.
        fastest: by the search.
    """
    criterion = fastest.criterion
    result = fastest.result
    by_speed = {speed_of(row): row for row in rows}
    limit = fastest.limit(good[0])
    tried = f"from {min(by_speed):g} to {max(by_speed):g} mm/s"
    if result.fastest is None:
        nearest = _nearest(good, criterion)
        return _nearest_sentence(study.job, tried, limit, speed_of(nearest), criterion.failure(nearest))
    if isinstance(criterion, JobCriterion) and criterion.scope.aspects != ASPECTS:
        return _answer_where_all_fail(study, good, tried, criterion.scope, result.fastest)
    if study.programmed_speed in result.islands:
        return _answer_between(study, by_speed, limit, fastest)
    saturation = saturation_of(durations(good))
    speed = _proposed_speed(good, result.fastest)
    shortest = ""
    if saturation is not None and speed < result.fastest:
        shortest = f"; a faster program hardly shortens the job, {saturation.duration:.4g} s at the least"
    remark = f"{fastest.other_speed}{shortest}{criterion.remark(by_speed[speed])}"
    if result.above is None:
        return f"{_change(study, speed)}: every speed tried, {tried}, keeps {limit}{remark}."
    ratio = result.fastest / study.programmed_speed
    return (
        f"{_change(study, speed)}: {result.fastest:g} mm/s, {ratio:.3g} times the programmed "
        f"{study.programmed_speed:g} mm/s, is the fastest speed that keeps {limit}; {result.above:g} mm/s does not "
        f"({fastest.failure(by_speed[result.above])}){_again(result)}{remark}."
    )


def _nearest(good: Sequence[Row], criterion: Criterion) -> Row:
    """Return the run that comes nearest to the limits."""
    return min(good, key=criterion.value)


def _proposed_speed(good: Sequence[Row], fastest: float) -> float:
    """Return the fastest speed, or a slower one from which on the job is as short [mm/s]."""
    saturation = saturation_of(durations(good))
    return fastest if saturation is None else min(fastest, saturation.speed)


def _answer_where_all_fail(study: SpeedStudy, good: Sequence[Row], tried: str, scope: Scope, fastest: float) -> str:
    """Return the answer where no speed keeps the whole tolerance, though some keep the limits of the motion."""
    judged = {speed_of(row): acceptance for row in good if (acceptance := Acceptance.of(row)) is not None}
    nearest = min(judged, key=lambda speed: judged[speed].use())
    sentence = _nearest_sentence(study.job, tried, Scope(ASPECTS).words, nearest, judged[nearest].failures())
    return f"{sentence} By {scope.words}, {fastest:g} mm/s is the fastest."


def _nearest_sentence(job: Job, tried: str, limit: str, speed: float, failure: str) -> str:
    return (
        f"No speed tried, {tried}, keeps {limit}: {speed:g} mm/s comes nearest ({failure}), so speed is not the lever; "
        f"{improve_command(job)} tries the others."
    )


def _again(result: SpeedAnswer) -> str:
    """Return which faster speeds keep the limits again, in words; empty where none does."""
    if not result.islands:
        return ""
    speeds = ", ".join(f"{speed:g}" for speed in result.islands)
    return f", though {speeds} mm/s {'does' if len(result.islands) == 1 else 'do'} again"


def _answer_between(study: SpeedStudy, by_speed: dict[float, Row], limit: str, fastest: Fastest) -> str:
    """Return the answer where the programmed speed keeps the limits and a slower one does not."""
    result = fastest.result
    # as there are faster speeds that keep the limits
    assert result.above is not None
    failure = fastest.failure(by_speed[result.above])
    return (
        f"Keep the programmed speed: {study.programmed_speed:g} mm/s keeps {limit}, and the fastest speed tried that "
        f"does is {max(result.islands):g} mm/s; but slower is not always better: from {result.fastest:g} mm/s down "
        f"every speed tried keeps {limit}, {result.above:g} mm/s does not ({failure})."
    )


def _change(study: SpeedStudy, speed: float) -> str:
    """Return what to set for a path speed [mm/s]: values of the job, or an option where the program's text changes."""
    if speed == study.programmed_speed:
        return "Keep the programmed speed"
    changes = study.overrides(speed)
    numbers = {key: value for key, value in changes.items() if isinstance(value, float | int)}
    if len(numbers) == len(changes):
        return f"Set {settings_text(numbers)}"
    glue = [f" --set {key}={value:g}" for key, value in numbers.items() if not key.startswith("program.")]
    return f"Run with --speed {speed:g}{''.join(glue)}"


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
    """Return the runs that matter: fastest within the tolerance, next faster, proposed, programmed speed, slowest."""
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
        "next": None if result.fastest is None else result.above,
        "nearest": speed_of(_nearest(good, criterion)) if result.fastest is None else None,
        "proposed": _slower_proposal(study, good, result),
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
    caption = "Fastest run within the tolerance, next faster, the answer's own, programmed and slowest run."
    return Table(columns, cells, caption=caption)


def _slower_proposal(study: SpeedStudy, good: Sequence[Row], result: SpeedAnswer) -> float | None:
    """Return the speed of the answer where that is neither the fastest nor the programmed one [mm/s]."""
    if result.fastest is None or study.programmed_speed in result.islands:
        return None
    speed = _proposed_speed(good, result.fastest)
    return None if speed in (result.fastest, study.programmed_speed) else speed


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
        kinds = (("within the tolerance", True, GOOD), ("out of tolerance", False, BAD))
        for label, within, colour in kinds:
            chosen = [k for k, row in enumerate(good) if criterion.within(row) is within]
            if chosen:
                points = [speeds[k] for k in chosen], [values[k] for k in chosen]
                axes.plot(*points, "o", ms=5, color=colour, label=label, zorder=3)
        axes.axhline(criterion.tolerance, color=BAD, lw=1.2, ls="--", label="tolerance")
        failed = sorted(speed_of(row) for row in rows if row["status"] != OK)
        if failed:
            transform = axes.get_xaxis_transform()
            heights = [0.97] * len(failed)
            axes.plot(failed, heights, "x", ms=7, color=COLOURS["fault"], transform=transform, label="fault or refused")
        axes.axvline(study.programmed_speed, color=COLOURS["requested"], lw=1.0, ls=":", label="programmed speed")
        if result.fastest is not None:
            axes.axvspan(min(speeds + failed), result.fastest, color=GOOD, alpha=0.12, lw=0)
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
            # nothing to show on a logarithmic scale
            if values.max() < 1e-3:
                continue
            values = np.maximum(values, 1e-3)
            drawn += values.tolist()
            # a broad band, on which the link with the largest part is drawn
            if link == "contour":
                axes.plot(speeds, values, lw=7, alpha=0.25, color=COLOURS[link], label=link, zorder=1)
            else:
                axes.plot(speeds, values, "o-", ms=3.5, lw=1.4, color=COLOURS[link], label=link)
        logarithmic(axes, "x", speeds)
        logarithmic(axes, "y", drawn)
        axes.set(xlabel="programmed path speed [mm/s]", ylabel="error normal to the path, rms [µm]")
        figure.legend(loc="outside lower center", ncols=5)
    return figure
