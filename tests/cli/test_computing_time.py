"""How long a job takes to compute, before it does."""

import pytest
from typer.testing import CliRunner

from gantrysim import Job
from gantrysim.base import memory
from gantrysim.cli import evaluation
from gantrysim.cli.main import app

from support.soaked import suite_runs


@pytest.mark.parametrize("turns", [2, 4])
def test_the_time_of_a_job_is_that_of_its_first_ticks_times_their_number(monkeypatch, turns):
    clock = [0.0]
    simulate = evaluation.simulate

    def slow(machine, servo, setpoints, **rest):
        run = simulate(machine, servo, setpoints, **rest)
        clock[0] += 1e-3 * len(run.time)
        return run

    monkeypatch.setattr(evaluation, "simulate", slow)
    monkeypatch.setattr(evaluation, "perf_counter", lambda: clock[0])
    job = Job.load("an225", [f"turns={turns}"])
    assert evaluation.computing_time(job) == pytest.approx(
        evaluation._TIME_OVER_SIMULATION * 1e-3 * len(job.setpoints.position)
    )
    assert clock[0] <= 10.0  # of ticks that are run to see


@pytest.mark.parametrize(("seconds", "said"), suite_runs([(12.4, "about 12 s"), (150.2, "about 3 min")], 0))
def test_a_long_run_says_how_long_it_takes(tmp_path, monkeypatch, seconds, said):
    monkeypatch.setattr(evaluation, "computing_time", lambda job: seconds)
    arguments = [
        "run",
        "an225",
        "--set",
        "turns=1",
        "--no-video",
        "--no-report",
        "--no-causes",
        "--no-improve",
        "--out",
        str(tmp_path / "a"),
    ]
    short = CliRunner().invoke(app, arguments)
    assert short.exit_code == 0
    assert "of computing" not in short.stderr
    monkeypatch.setattr(memory, "LONG_RUN", 1000)
    long = CliRunner().invoke(app, arguments)
    assert long.exit_code == 0
    ticks = len(Job.load("an225", ["turns=1"]).setpoints.position)
    assert f"note: {ticks:,} servo ticks, {said} of computing\n" in long.stderr
