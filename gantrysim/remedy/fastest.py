"""The fastest program whose verdict is still as good."""

from __future__ import annotations

from dataclasses import dataclass

from gantrysim.base.errors import InputError
from gantrysim.job.job import Job
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.levers.speed import speed_changes
from gantrysim.remedy.outcome import Outcome
from gantrysim.results.checks import FAIL, PASS
from gantrysim.study.speed.study import answer, next_speeds

RESOLUTION = 0.02  # relative width of the bracket of the speed
_SHORTER = 1e-3  # share of its time by which a program must be shorter to be faster


@dataclass(frozen=True)
class FastestProgram:
    """The fastest program at which, and below which at all speeds tried, the verdict is as good as before.

    The verdict need not grow worse with the speed, so that a faster island that is good again does not count.

    Attributes:
        speed: of its fastest motion [mm/s].
        programmed_speed: the same of the job whose speed was changed [mm/s].
        above: the least speed tried at which the verdict is worse; None if there is none [mm/s].
        job: at that speed, with the same section of the bead.
        outcome: of its run.
    """

    speed: float
    programmed_speed: float
    above: float | None
    job: Job
    outcome: Outcome

    def __str__(self) -> str:
        bound = "no faster one was tried" if self.above is None else f"not at {self.above:.4g} mm/s"
        return (
            f"fastest program as good: {self.speed:.4g} mm/s instead of {self.programmed_speed:.4g} mm/s, "
            f"{self.outcome.duration:.2f} s ({bound})"
        )


def fastest_program(job: Job, bench: Bench) -> FastestProgram | None:
    """Return the fastest program whose verdict is as good as that of a job, to within 2 % of its speed.

    Args:
        job: that passes, or keeps its limits with a warning.
        bench: simulates.

    Returns:
        None for a job that fails, whose program states no speed, or for which no speed tried is as good and shorter.
    """
    outcome = bench.measure(job)
    if outcome.state == FAIL or outcome.failure:
        return None
    try:
        programmed = job.controller.programmed_speed
    except InputError:
        return None

    def is_as_good(other: Outcome) -> bool:
        return not other.failure and (other.passes if outcome.state == PASS else other.state != FAIL)

    bench.task.name = "fastest"
    tried: dict[float, Outcome] = {}
    while speeds := next_speeds({speed: is_as_good(other) for speed, other in tried.items()}, programmed, RESOLUTION):
        outcomes = bench.measure_all([job.changed(speed_changes(job, speed)) for speed in speeds])
        tried |= dict(zip(speeds, outcomes, strict=True))
    result = answer({speed: is_as_good(other) for speed, other in tried.items()})
    if result.fastest is None or tried[result.fastest].duration > (1 - _SHORTER) * outcome.duration:
        return None
    # beyond a limit of the controller or the ramps, a faster program takes as long
    least = tried[result.fastest].duration * (1 + _SHORTER)
    speed = min(speed for speed, other in tried.items() if speed <= result.fastest and other.duration <= least)
    return FastestProgram(speed, programmed, result.above, job.changed(speed_changes(job, speed)), tried[speed])
