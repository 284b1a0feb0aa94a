"""The answer of a speed study: the fastest speed within the limits, and the setting for it."""

from __future__ import annotations

from collections.abc import Sequence

from gantrysim.study.acceptance import improve_command, settings_text
from gantrysim.study.cases import Row
from gantrysim.study.speed.saturation import saturation_of
from gantrysim.study.speed.study import SpeedAnswer, SpeedStudy, speed_of

QUESTION = "How fast can this job run within its tolerance?"


def speed_answer(study: SpeedStudy, rows: Sequence[Row], good: Sequence[Row], result: SpeedAnswer) -> str:
    """Return the answer.

    Args:
        study: the study.
        rows: of all speeds tried.
        good: rows with values, at least one.
        result: of the search.
    """
    criterion = study.criterion
    by_speed = {speed_of(row): row for row in rows}
    limit = criterion.limit(good[0])
    tried = f"from {min(by_speed):g} to {max(by_speed):g} mm/s"
    if result.fastest is None:
        nearest = min(good, key=criterion.value)
        return (
            f"No speed tried, {tried}, keeps {limit}: {speed_of(nearest):g} mm/s comes nearest "
            f"({criterion.failure(nearest)}), so speed is not the lever; {improve_command(study.job)} tries the others."
        )
    if study.programmed_speed in result.islands:
        return _answer_between(study, by_speed, limit, result)
    saturation = saturation_of(good)
    speed = result.fastest if saturation is None else min(result.fastest, saturation.speed)
    shortest = ""
    if saturation is not None and speed < result.fastest:
        shortest = f"; a faster program hardly shortens the job, {saturation.duration:.4g} s at the least"
    remark = f"{shortest}{criterion.remark(by_speed[speed])}"
    if result.above is None:
        return f"{_change(study, speed)}: every speed tried, {tried}, keeps {limit}{remark}."
    ratio = result.fastest / study.programmed_speed
    return (
        f"{_change(study, speed)}: {result.fastest:g} mm/s, {ratio:.3g} times the programmed "
        f"{study.programmed_speed:g} mm/s, is the fastest speed that keeps {limit}; {result.above:g} mm/s does not "
        f"({criterion.failure(by_speed[result.above])}){_again(result)}{remark}."
    )


def _again(result: SpeedAnswer) -> str:
    """Return which faster speeds keep the limits again, in words; empty where none does."""
    if not result.islands:
        return ""
    speeds = ", ".join(f"{speed:g}" for speed in result.islands)
    return f", though {speeds} mm/s {'does' if len(result.islands) == 1 else 'do'} again"


def _answer_between(study: SpeedStudy, by_speed: dict[float, Row], limit: str, result: SpeedAnswer) -> str:
    """Return the answer where the programmed speed keeps the limits and a slower one does not."""
    assert result.above is not None  # as there are faster speeds that keep the limits
    failure = study.criterion.failure(by_speed[result.above])
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
    if all(isinstance(value, float | int) for value in changes.values()):
        return f"Set {settings_text(changes)}"
    return f"Run with --speed {speed:g}"
