"""The answer of a speed study: the fastest speed within the limits, and the setting for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gantrysim.study.acceptance import improve_command, settings_text
from gantrysim.study.cases import Row
from gantrysim.study.criterion import Criterion
from gantrysim.study.speed.saturation import durations, saturation_of
from gantrysim.study.speed.search import Grade, SpeedAnswer, answer_of
from gantrysim.study.speed.study import SpeedStudy, speed_of

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
        nearest = min(good, key=criterion.value)
        return (
            f"No speed tried, {tried}, keeps {limit}: {speed_of(nearest):g} mm/s comes nearest "
            f"({criterion.failure(nearest)}), so speed is not the lever; {improve_command(study.job)} tries the others."
        )
    if study.programmed_speed in result.islands:
        return _answer_between(study, by_speed, limit, fastest)
    saturation = saturation_of(durations(good))
    speed = result.fastest if saturation is None else min(result.fastest, saturation.speed)
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


def _again(result: SpeedAnswer) -> str:
    """Return which faster speeds keep the limits again, in words; empty where none does."""
    if not result.islands:
        return ""
    speeds = ", ".join(f"{speed:g}" for speed in result.islands)
    return f", though {speeds} mm/s {'does' if len(result.islands) == 1 else 'do'} again"


def _answer_between(study: SpeedStudy, by_speed: dict[float, Row], limit: str, fastest: Fastest) -> str:
    """Return the answer where the programmed speed keeps the limits and a slower one does not."""
    result = fastest.result
    assert result.above is not None  # as there are faster speeds that keep the limits
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
