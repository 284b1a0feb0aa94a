"""Jobs and studies for the tests of tuning."""

import itertools

import numpy as np

from gantrysim import Job
from gantrysim.study.tuning import TuningStudy
from gantrysim.study.tuning.objective import case_of, trial_result

CIRCLE = """
%
O0001
N10 G17 G21 G90
N20 G02 X0 Y10 I0 J-10 F6000
N30 M30
%
"""
GAINS = ("kp", "ki", "kd", "velocity_ff", "acceleration_ff")


def circle(**servo):
    """A circle of 10 mm at 100 mm/s, on which the servo makes all of the error."""
    return Job(
        name="circle",
        program={
            "controller": "fanuc.Program",
            "start": [0.0, 10.0, 0.0],
            "acceleration": 2000.0,
            "program": CIRCLE,
        },
        servo={"integral_time": 0.03, **servo},
        dispenser={"flow": 300.0},
        simulation={"settle": 0.05},
    )


def detuned(factor, job=None, **factors):
    """The job with its gains multiplied by a factor, or by one of their own."""
    job = job or circle()
    times = {name: factors.get(name, factor) for name in GAINS}
    servo = job.built_servo
    return job.changed({f"servo.{name}": [times[name] * gain for gain in servo.per_axis(name)] for name in GAINS})


def best_of_grid(study, factors):
    """The least metric of all combinations of factors on the derived gains, and the number of runs.

    Args:
        study: for its job, its machines and its bounds.
        factors: of each gain, by its name; gains left out are 0.
    """
    derived = circle().built_servo

    def servo(times):
        return derived.with_values(
            **{name: tuple(factor * gain for gain in derived.per_axis(name)) for name, factor in times.items()}
        )

    loops = [name for name in factors if not name.endswith("_ff")]
    shares = [name for name in factors if name.endswith("_ff")]
    least, runs = np.inf, 0
    for gains in itertools.product(*(factors[name] for name in loops)):
        loop = {**dict.fromkeys(GAINS, 0.0), **dict(zip(loops, gains, strict=True))}
        if float(study.stability.excess(servo(loop)).max()) > 0:
            continue
        for chosen in itertools.product(*(factors[name] for name in shares)):
            own = servo({**loop, **dict(zip(shares, chosen, strict=True))})
            cases = [case_of(study.job, own, one) for one in study.perturbations]
            found = [trial_result(row, study.metric) for row in study.measure_together(cases)]
            runs += len(found)
            if all(one.fault is None and one.ripple <= 0.01 * study.ripple for one in found):
                least = min(least, max(one.metric for one in found))
    return least, runs


def searched(study):
    """The rows of a study, with nothing written."""
    rounds, rows = study.rounds(), []
    cases = next(rounds)
    while True:
        found = [{**dict(case.tags), **row} for case, row in zip(cases, study.measure_together(cases), strict=True)]
        rows += found
        try:
            cases = rounds.send(found)
        except StopIteration:
            return rows


def tuning(job, **more):
    """A study that is small unless the test says otherwise."""
    return TuningStudy(job, **{"budget": 40, "robust": 1, "guards": 2, "unseen": 2, **more})
