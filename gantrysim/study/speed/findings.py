"""What a speed study has found, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gantrysim.metrics.budget import LINKS
from gantrysim.study.cases import OK, Row
from gantrysim.study.criterion import Criterion
from gantrysim.study.speed.search import answer

if TYPE_CHECKING:
    from gantrysim.study.speed.study import SpeedStudy

_SATURATED = 1.02  # times the least duration: as short as the limits let it be


def findings(study: SpeedStudy, rows: list[Row]) -> list[str]:
    """Return the answer, what sets the limit there, and what happens beyond."""
    good = [row for row in rows if row["status"] == OK]
    if not good:
        return [f"None of the {len(rows)} speeds tried gives a run with figures: {rows[0]['status']}"]
    criterion, found = study.criterion, answer({speed_of(row): study.criterion.within(row) for row in rows})
    unit = criterion.unit(good[0])
    limit = f"{criterion.label} of {criterion.tolerance:g} {unit}".rstrip()
    by_speed = {speed_of(row): row for row in rows}
    slow, fast = min(by_speed), max(by_speed)
    if found.fastest is None:
        first = by_speed[slow]
        return [
            f"No speed tried, from {slow:g} to {fast:g} mm/s, keeps to a {limit}: at {slow:g} mm/s "
            f"{_outcome(first, criterion)}. {_mostly(first)}".rstrip(),
            *_what_speed_is(study),
        ]
    row = by_speed[found.fastest]
    if found.above is None:
        text = f"Every speed tried, from {slow:g} to {fast:g} mm/s, keeps to a {limit}"
    else:
        text = (
            f"Up to {found.fastest:g} mm/s, {found.fastest / study.own:.3g} times the program's own "
            f"{study.own:g} mm/s, the job keeps to a {limit}; at {found.above:g} mm/s "
            f"{_outcome(by_speed[found.above], criterion)}"
        )
    paragraphs = [f"{text}. At {found.fastest:g} mm/s {_outcome(row, criterion)}. {_mostly(row)}".rstrip()]
    mean = row["speed_mean_mm_s"]
    if isinstance(mean, float):
        paragraphs[0] += f" The nozzle's mean speed is then {mean:.4g} mm/s."
    if found.islands:
        several = ", ".join(f"{speed:g}" for speed in found.islands)
        paragraphs.append(
            f"The error does not grow with the speed all the way: {several} mm/s, beyond the first speed that is "
            "not within the tolerance, is within it again."
        )
    return [*paragraphs, *_saturation(good), *_what_speed_is(study)]


def _what_speed_is(study: SpeedStudy) -> list[str]:
    what = study.job.controller.speed_scaling
    return [f"Speed here is {what}. Ramps and limits of the controller and of the axes are the job's."]


def speed_of(row: Row) -> float:
    """Return the path speed that a case's program asks for [mm/s]."""
    speed = row["speed_mm_s"]
    assert isinstance(speed, float)
    return speed


def _saturation(good: list[Row]) -> list[str]:
    """Say from where on a faster program does not make the job shorter, where that was tried."""
    durations = {speed_of(row): value for row in good if isinstance(value := row["duration_s"], float)}
    least = min(durations.values())
    enough = min(speed for speed, duration in durations.items() if duration <= _SATURATED * least)
    if enough == max(durations):
        return []
    return [
        f"From {enough:g} mm/s on a faster program does not make the job shorter than {least:.4g} s: ramps, clamps and "
        "the axes' limits set its speed."
    ]


def _outcome(row: Row, criterion: Criterion) -> str:
    """What came of a run, as a clause."""
    if row["status"] != OK:
        return f"the run ends ({row['status']})"
    return f"it is {criterion.value(row):.4g} {criterion.unit(row)}".rstrip()


def _mostly(row: Row) -> str:
    """Which link makes most of the error, as a sentence; nothing of a run without figures."""
    if row["status"] != OK:
        return ""
    sizes = {link: size for link in LINKS if isinstance(size := row[f"{link}_rms_um"], float)}
    most = max(sizes, key=lambda link: sizes[link])
    return f"Most of the error there is the {most} part, {sizes[most]:.3g} µm rms."
