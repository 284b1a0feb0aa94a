"""A bench simulates each motion once, whatever asks for it, and no motion again for another glue."""

import pytest

from gantrysim import Budget, Job
from gantrysim.metrics import Analysis
from gantrysim.remedy.bench import Bench

from support.remedies import rubbing


@pytest.fixture
def runs(monkeypatch):
    """The jobs that are simulated, in their order."""
    seen = []
    plain = Job.run

    def counted(job, *arguments, **options):
        seen.append(job.dispenser.area)
        return plain(job, *arguments, **options)

    monkeypatch.setattr(Job, "run", counted)
    return seen


def test_a_motion_is_simulated_once_and_serves_another_glue(runs):
    job = rubbing()
    bench = Bench(job, workers=1)
    motion = bench.motion(job)
    assert bench.motion(job) is motion
    wider = job.changed({"dispenser.area": 3.0})
    assert bench.motion_key(wider) == bench.motion_key(job)
    assert bench.motion(wider) is motion
    first, other = bench.measure_all([job, wider])
    assert other.nominal == pytest.approx(1.5 * first.nominal)
    # glue is no matter of the motion
    assert len(set(bench.motions_fail([job, wider]))) == 1
    assert len(runs) == 1
    # the motion, and what each of the two shows with a bead laid on it
    assert bench.task.done == 3


def test_only_a_run_that_is_shown_has_a_budget_to_show():
    job = rubbing()
    bench = Bench(job, workers=1)
    assert bench.shown_budget(job) is None
    assert bench.motion(job).budget is not None
    # that of a search, by its own engine
    assert bench.shown_budget(job) is None
    budget = Budget(Analysis(job.run()))
    bench.add(job, budget)
    assert bench.shown_budget(job) is budget


def test_another_servo_is_another_motion(runs):
    bench = Bench(rubbing(), workers=1)
    stiffer = rubbing().changed({"servo.integral_time": 0.01})
    bench.measure(rubbing())
    bench.measure(stiffer)
    assert bench.motion_key(stiffer) != bench.motion_key(rubbing())
    assert len(runs) == 2
