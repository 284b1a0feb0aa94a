"""The estimate of a run's computing time, with a clock of the test's own."""

import itertools
import re

import pytest

from gantrysim import Job, memory
from gantrysim.job import effort
from gantrysim.job.effort import computing_time, in_words


@pytest.mark.parametrize("turns", [1, 3])
def test_the_first_ticks_stand_for_all(monkeypatch, turns):
    job = Job.load("an225", [f"turns={turns}"])
    clock = itertools.count(0.0, 0.5)  # half a second from call to call
    monkeypatch.setattr(effort, "perf_counter", lambda: next(clock))
    ran = []
    simulate = effort.simulate
    monkeypatch.setattr(
        effort, "simulate", lambda *arguments, **named: ran.append(simulate(*arguments, **named)) or ran[-1]
    )
    ticks = job.setpoints.run_ticks
    assert computing_time(job) == pytest.approx(ticks * (0.5 / 2000 + effort._FIGURES))
    assert [len(run.time) for run in ran] == [2, 2000]
    assert ticks > 2000
    assert ran[1].fault is None


def test_durations_are_told_in_their_unit():
    assert [in_words(seconds) for seconds in (0.4, 12.3, 89, 91, 170, 5399, 5401, 20_000)] == [
        "0 s", "12 s", "89 s", "2 min", "3 min", "90 min", "1.5 h", "5.6 h",
    ]  # fmt: skip


def test_a_long_run_begins_with_its_estimate_and_a_short_one_does_not(monkeypatch, gantrysim_command, tmp_path):
    arguments = ("run", "an225", "--set", "turns=1", "--no-video", "--no-report", "--out", tmp_path / "a")
    assert "of computing" not in gantrysim_command(*arguments)[1]
    monkeypatch.setattr(memory, "LONG", 1000)
    status, output, _ = gantrysim_command(*arguments)
    assert status == 0
    assert re.match(r"\d,\d{3} ticks: about \d+ s of computing, without video\n", output)
