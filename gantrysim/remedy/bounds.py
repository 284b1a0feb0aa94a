"""What keeps a row of the verdict from passing: a link of the chain, or the dispenser."""

from __future__ import annotations

import math

from gantrysim.base.errors import GantryError
from gantrysim.glue.dispenser.dispenser import VALVE, Dispenser
from gantrysim.job.job import Job
from gantrysim.metrics.budget import Budget
from gantrysim.remedy.lever import value_of
from gantrysim.results.glue_causes import without_dead_time, without_lag
from gantrysim.results.score import row_burden
from gantrysim.results.verdict import GLUE, PATH, STABILITY, Verdict


def bound_of(job: Job, row: str) -> str:
    """Return what keeps a row of the verdict on a job from passing, as the subject of a sentence.

    The path is bound by the link with the largest rms in a run of the job. The bead is judged again with a dispenser
    that follows its command at once, and with a machine that follows its program exactly: what makes it pass is what
    bound it.
    """
    if row == PATH:
        parts = Budget(job.run()).part_values
        link = max(parts, key=lambda name: parts[name].rms)
        return f"the {link} link, {1e3 * parts[link].rms:.1f} µm rms of the error"
    if row == GLUE:
        return _glue_bound(job)
    if row == STABILITY:
        return "the servo: its loops have too little margin"
    # the first limits the path; a rotary axis may have no limit of its own
    arguments = job.controller.arguments()
    if any(value_of(arguments, name) == math.inf for name in job.controller.ramp_arguments[:1]):
        return "the program: it limits no acceleration, so that its speed jumps"
    return "the drives: their torque or speed has too little reserve"


def _glue_bound(job: Job) -> str:
    dispenser = job.dispenser
    instant = job.model_copy(update={"dispenser": without_lag(without_dead_time(dispenser))})
    if _glue_passes(instant, job):
        return f"the dispenser, {_lag_text(dispenser)}"
    if _glue_passes(job, job, follow=True):
        return "the servo link: the machine does not follow the commanded speed"
    if dispenser.per_e:
        return "the program link: what E feeds, at rest or for each length, varies more than the bead admits"
    return "the program link: its speed changes more than the bead admits"


def _glue_passes(job: Job, base: Job, *, follow: bool = False) -> bool:
    try:
        shared = job.sharing(base)
        run = shared.follow() if follow else shared.run()
        return run.fault is None and row_burden(Verdict.of(shared, run)[GLUE]) == 0
    except GantryError:
        return False


def _lag_text(dispenser: Dispenser) -> str:
    if dispenser.drive is not None:
        return "whose motor works against the pressure of the glue"
    if dispenser.kind != VALVE:
        return "which lays drops"
    closing = 0.0 if dispenser.closing_delay == dispenser.dead_time else dispenser.closing_delay
    times = {
        "dead time": dispenser.dead_time,
        "dead time of closing": closing,
        "opening": dispenser.opening,
        "closing": dispenser.closing,
    }
    lags = ", ".join(f"{1e3 * time:.4g} ms {name}" for name, time in times.items() if time)
    return f"which lags by {lags}"
