"""The fastest program whose verdict is still as good, by the search of the speed study."""

from __future__ import annotations

from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.job.job import Job
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.outcome import Outcome
from gantrysim.results.checks import FAIL, WARN
from gantrysim.study.speed.report import saturation_of
from gantrysim.study.speed.study import RESOLUTION, Grade, SpeedAnswer, answer_of, next_speeds_of_grades, speed_changes

_SHORTER_SHARE = 1e-3  # share of its time by which a program must be shorter to be faster


@dataclass(frozen=True)
class FastestProgram:
    """The fastest program at which, and below which at all speeds tried, the verdict is as good as before.

    The verdict need not grow worse with the speed, so that a faster island that is good again does not count. A verdict
    without a warning is as good as another without one, and one with a warning as another that does not fail.

    Attributes:
        speed: of its fastest motion [mm/s].
        programmed_speed: the same of the job whose speed was changed [mm/s].
        search: its result for this grade; its fastest speed is above `speed` where a faster program takes as long.
        grade: as good as which it is: without a warning, or without a failure.
        other: the result of the search for the other grade.
        job: at that speed, with the same section of the bead.
        outcome: of its run.
    """

    speed: float
    programmed_speed: float
    search: SpeedAnswer
    grade: Grade
    other: SpeedAnswer
    job: Job
    outcome: Outcome

    def __str__(self) -> str:
        is_clean = self.grade == Grade.CLEAN
        end_of_search = self.search.fastest
        bound = (
            f"not at {self.search.above:.4g} mm/s"
            if self.search.above
            else f"the search ended at {end_of_search:.4g} mm/s"
        )
        if end_of_search is not None and end_of_search > self.speed:
            bound = f"a faster one takes as long; {bound}"
        other = "no speed tried is without a warning"
        if self.other.fastest is not None:
            end = "" if self.other.above else ", where the search ended"
            other = f"without a {'failure' if is_clean else 'warning'} up to {self.other.fastest:.4g} mm/s{end}"
        return (
            f"fastest program without a {'warning' if is_clean else 'failure'}: {self.speed:.4g} mm/s instead of "
            f"{self.programmed_speed:.4g} mm/s, {self.outcome.duration:.2f} s ({bound}); {other}"
        )


def fastest_program(job: Job, bench: Bench) -> FastestProgram | None:
    """Return the fastest program whose verdict is as good as that of a job, to within 1 % of its speed.

    Args:
        job: that passes, or keeps its limits with a warning.
        bench: simulates.

    Returns:
        None for a job that fails, whose program states no speed, or for which no speed tried is as good and shorter.
    """
    outcome = bench.measure(job)
    grade = _grade(outcome)
    if grade == Grade.FAILED:
        return None
    try:
        programmed = job.controller.programmed_speed
    except InputError:
        return None
    bench.task.name = "fastest"
    tried: dict[float, Outcome] = {}
    grades: dict[float, Grade] = {}
    while speeds := next_speeds_of_grades(grades, programmed, RESOLUTION):
        outcomes = bench.measure_all([job.changed(speed_changes(job, speed)) for speed in speeds])
        tried |= dict(zip(speeds, outcomes, strict=True))
        grades = {speed: _grade(other) for speed, other in tried.items()}
    result = answer_of(grades, grade)
    if result.fastest is None:
        return None
    saturation = saturation_of({speed: other.duration for speed, other in tried.items() if not other.failure})
    # beyond a limit of the controller or the ramps, a faster program takes as long
    speed = result.fastest if saturation is None else min(result.fastest, saturation.speed)
    if tried[speed].duration > (1 - _SHORTER_SHARE) * outcome.duration:
        return None
    other = answer_of(grades, Grade.WARNED if grade == Grade.CLEAN else Grade.CLEAN)
    changed = job.changed(speed_changes(job, speed))
    return FastestProgram(speed, programmed, result, grade, other, changed, tried[speed])


def _grade(outcome: Outcome) -> Grade:
    if outcome.failure or outcome.state == FAIL:
        return Grade.FAILED
    return Grade.WARNED if outcome.state == WARN else Grade.CLEAN
