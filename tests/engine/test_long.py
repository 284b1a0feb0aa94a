"""Long runs: computed block by block, with the record in temporary files, they give what short ones do."""

import dataclasses
import io
import re
import subprocess
import sys

import numpy as np
import pytest
from rich.console import Console

from gantrysim import Job, Run, simulate
from gantrysim.base import columns, memory
from gantrysim.base.columns import Stored
from gantrysim.base.errors import InputError
from gantrysim.cli.tables import plan_table
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.glue.bead import Bead
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.glue.dispenser.syringe import Syringe
from gantrysim.job.loading import builtin_jobs
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.paths.chain import Chain
from gantrysim.paths.kinds import path_of
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints, Supervision
from gantrysim.report.folder import write_run
from gantrysim.report.summary import summary
from gantrysim.results.run_results import RunResults
from gantrysim.servo.servo import Servo

from support.memories import open_files, resident
from support.soaked import suite_runs

SAME = 1e-12  # relative, of the figures; arrays of a tick are equal to the last bit


@pytest.fixture
def long(monkeypatch):
    """Make every run of more than a thousand ticks a long one, in blocks of a prime number of ticks."""
    monkeypatch.setattr(memory, "LONG_RUN", 1000)
    monkeypatch.setattr(columns, "BLOCK", 997)


def figures(job, run):
    """All figures of a run; with a path of its own, whose tables are made anew."""
    kind, parameters = type(run.requested).__name__, run.requested.parameters()
    fresh = dataclasses.replace(run, requested=path_of(kind, parameters))
    analysis = Analysis(fresh)
    bead = Bead(fresh, job.bead, analysis)
    content = summary(RunResults(job, job.built_machine, Budget(analysis), bead))
    del content["verdict"]  # it has the lines of the program, which are not known for a long run
    return content


def assert_same(ours, theirs, name=""):
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys()
        for key in theirs:
            assert_same(ours[key], theirs[key], f"{name}.{key}")
    elif isinstance(theirs, list):
        assert len(ours) == len(theirs)
        for k, (a, b) in enumerate(zip(ours, theirs, strict=True)):
            assert_same(a, b, f"{name}[{k}]")
    elif isinstance(theirs, float):
        assert ours == pytest.approx(theirs, rel=SAME, abs=1e-15), name
    elif name == ".headline" or name.startswith(".spoilt"):
        # the lines of long programs are not known
        assert ours == re.sub(r", line \d+", "", theirs)
    else:
        assert ours == theirs, name


IN_THE_SUITE = ["an225 turns=2", "delta-arc", "stage-outline"]
SOAKED = [name for name in builtin_jobs() if name not in IN_THE_SUITE]


@pytest.mark.parametrize("given", [*IN_THE_SUITE, *(pytest.param(name, marks=pytest.mark.soak) for name in SOAKED)])
def test_a_built_in_job_in_blocks_and_files_gives_the_same_run_and_figures(given, monkeypatch):
    name, *changes = given.split()
    job = Job.load(name, changes)
    run = job.run()
    expected = figures(job, run)
    monkeypatch.setattr(memory, "LONG_RUN", 1000)
    monkeypatch.setattr(columns, "BLOCK", 997)
    again = job.run()
    assert isinstance(vars(again)["nozzle"], Stored)
    for field in dataclasses.fields(Run):
        value = getattr(run, field.name)
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(again, field.name), value, field.name)
    assert_same(figures(job, again), expected)


def test_a_long_record_is_saved_and_loaded_to_the_last_bit(long, tmp_path):
    run = Job.load("an225").run()
    run.save(tmp_path / "run.npz")
    again = Run.load(tmp_path / "run.npz")
    assert isinstance(vars(again)["nozzle"], Stored)
    assert isinstance(vars(again)["time"], Stored)
    for name, value in vars(run).items():
        if isinstance(value, Stored):
            np.testing.assert_array_equal(getattr(again, name), getattr(run, name), name)


def test_a_folder_gets_a_long_record_without_loading_it(long, tmp_path, monkeypatch):
    job = Job.load("an225", ["turns=1"])
    run, saved, save = job.run(), [], Run.save
    monkeypatch.setattr(Run, "save", lambda run, file: saved.append(run) or save(run, file))
    write_run(tmp_path, RunResults(job, job.built_machine, Budget(run)))
    (record,) = saved
    assert sum(isinstance(value, Stored) for value in vars(record).values()) > 10
    assert not any(isinstance(value, np.ndarray) and len(value) == len(run.time) for value in vars(record).values())
    again = Run.load(tmp_path / "run.npz")
    assert (again.job_sha256, again.machine_sha256) == (job.digest, job.built_machine.digest)
    np.testing.assert_array_equal(again.nozzle, run.nozzle)


def test_a_long_record_is_read_only_and_a_simulation_can_be_run_again(long, xy):
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(1e-3)
    run, again = (simulate(xy, Servo.derive(xy.axes), setpoints) for _ in range(2))
    assert not run.encoder.flags.writeable
    np.testing.assert_array_equal(run.encoder, again.encoder)


@pytest.mark.parametrize("block", [2, 13, 600])
def test_a_trace_between_two_legs_is_followed_alike_in_any_blocks(monkeypatch, block):
    """Out and back on nearly the same line."""
    path = Chain([Line((0, 0, 0), (30, 0, 0)), Line((30, 0, 0), (30, 0.01, 0)), Line((30, 0.01, 0), (0, 0.01, 0))])
    x = np.concatenate([np.linspace(0, 30, 400), np.linspace(30, 0, 400)])
    noise = np.random.default_rng(3).normal(scale=0.02, size=(x.size, 3))
    trace = np.stack([x, 0.005 + 0 * x, 0 * x], axis=1) + noise
    s = np.concatenate([np.linspace(0, 30, 400), np.linspace(30.01, 60.01, 400)])
    whole = path.follow(trace, s)
    monkeypatch.setattr(columns, "BLOCK", block)
    again = path.follow(trace, s)
    for name in ("s", "offset", "lateral", "beyond", "distance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), name)
    assert np.ptp(whole.s) > 50  # it goes back on the other leg
    rows = np.arange(3, 750, 2)
    stretches = path.stretches(lambda block: [trace[block]], s)
    np.testing.assert_array_equal(path.near(trace, s[rows], stretches[:, rows], rows).s, whole.s[rows])


NEEDLE = Needle(bore=0.84, length=25.0, consistency=50.0, index=0.6, yield_stress=20.0)


@pytest.mark.parametrize("seed", suite_runs(range(12), 0, 1))
@pytest.mark.parametrize("metering", ["volumetric", "needle", "syringe"])
@pytest.mark.first
def test_the_flow_is_the_same_in_any_blocks(monkeypatch, seed, metering):
    rng = np.random.default_rng(seed)
    on, speed = np.repeat(rng.random(20) < 0.6, 50), 100 * rng.random(1000)
    on[:50] = False
    driven = {"metering": "time-pressure", "needle": NEEDLE, "pressure": 200.0}
    demand = {"volumetric": {"flow": 2.0}, "needle": driven, "syringe": {**driven, "syringe": Syringe()}}
    if metering == "volumetric" and seed % 2:
        demand["volumetric"] = {"area": 0.1, "limit": 8.0}
    times = {name: float(rng.choice([0.0, most])) for name, most in TIMES.items()}
    dispenser = Dispenser(**demand[metering], **times)
    whole = dispenser.flows(on, speed, 1e-3)
    for block in (1, 77, 999):
        monkeypatch.setattr(columns, "BLOCK", block)
        np.testing.assert_array_equal(dispenser.flows(on, speed, 1e-3), whole)


TIMES = {
    "dead_time": 0.1234,
    "opening": 0.02,
    "closing": 0.03,
    "start_lead": 0.0137,
    "stop_lead": 0.0213,
    "advance": 0.02,
}


def test_a_program_above_the_memory_is_refused_before_anything_is_allocated(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 1e8)
    for setting, said in {
        "program.speed=0.1": r"s in periods of 0.001 s: makes .* ticks, which need about .* GB of memory, where 0.1 GB",
        "servo.period=1e-6": r"s in periods of 1e-06 s: makes",
        "simulation.settle=20000": r"20000 s in periods of 0.001 s: makes 2e\+07 ticks",
    }.items():
        job = Job.load("an225", [setting])
        with pytest.raises(InputError, match=said):
            _ = job.setpoints


def test_a_wait_at_a_gate_counts_for_its_settling_time(xy):
    limits = Supervision(settle_error=0.05, settle_time=0.02)
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(1e-3)
    gated = dataclasses.replace(setpoints, supervision=limits, gates=[500, 900])
    assert gated.run_ticks == len(setpoints.position) + 2 * 20
    assert len(simulate(xy, Servo.derive(xy.axes), gated).time) >= gated.run_ticks


def test_check_shows_ticks_machine_time_and_memory(monkeypatch):
    job = Job.load("an225")
    plan = job.plan()
    assert plan.ticks == len(job.setpoints.position)
    shown = Console(width=200, record=True, file=io.StringIO())
    shown.print(plan_table(job.name, plan))
    text = shown.export_text()
    assert f"{plan.ticks} ticks" in text
    assert f"{plan.ticks * 1e-3:.3f} s of machine time; about {plan.ticks / 1000:.0f} MB of memory" in text
    assert "temporary files" not in text
    monkeypatch.setattr(memory, "LONG_RUN", 1000)
    shown.print(plan_table(job.name, job.plan()))
    assert "MB of temporary files" in shown.export_text()


PROGRAM = """
import gc, resource, sys
from gantrysim import Job
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.summary import summary
from gantrysim.results.run_results import RunResults
job = Job.load("an225", [f"program.{item}" for item in (
    "turns=1000", "thickness=0.09", "diameter=200.0", "start=[-100.0, 0.0]", "speed=70")] + [
    "dispenser.flow=50", "bead.squashed=false"])
run = job.run()
analysis = Analysis(run)
bead = Bead(run, job.bead, analysis)
found = summary(RunResults(job, job.built_machine, Budget(analysis), bead))
assert len(found["error_budget"]["turns"]) == 1000
assert abs(found["motion"]["spacing_mean_mm"] - 0.09) < 1e-3
run.save(sys.argv[1])
print(len(run.time), 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.soak
def test_a_thousand_turns_take_less_than_a_gigabyte(tmp_path, record_property):
    """An hour and a half of machine time, with all figures, budget and bead, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, tmp_path / "run.npz"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    ticks, most = map(int, done.stdout.split())
    assert ticks > 4.9e6
    assert most < 1e9
    record_property("attack", "memory: 1,000 turns, an hour and a half of machine time, in 1 GB")
    record_property("tries", 1)


COMMAND = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "gantrysim", "run", "an225", "--out", sys.argv[1], *(
    word for item in ("program.turns=1000", "program.thickness=0.09", "program.diameter=200.0",
    "program.start=[-100.0, 0.0]", "program.speed=70", "dispenser.flow=50", "bead.squashed=false")
    for word in ("--set", item))], capture_output=True, text=True)
print(done.stdout, done.stderr, file=sys.stderr)
print(done.returncode, 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.soak
def test_a_thousand_turns_with_plots_report_and_video_take_less_than_1400_megabytes(tmp_path, record_property):
    command = [sys.executable, "-c", COMMAND, tmp_path / "out"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    status, most = map(int, done.stdout.split())
    assert status == 0, done.stderr
    assert "of computing" in done.stderr
    assert most < 1.4e9
    page, film = ((tmp_path / "out" / name).stat().st_size for name in ("report.html", "video.mp4"))
    assert page < 2e7 + 1.4 * film  # which the page holds as text
    assert len(list((tmp_path / "out" / "plots").iterdir())) == 5
    record_property("attack", "memory: 1,000 turns run by the command, with plots, report and video, in 1.4 GB")
    record_property("tries", 1)


def grown(work, times):
    """Growth of the resident memory over the second half of so many calls [B]."""
    before = 0
    for k in range(times):
        if k == times // 2:
            before = resident()
        work()
    return resident() - before


def one_run(xy, setpoints):
    run = simulate(xy, Servo.derive(xy.axes), setpoints, dispenser=Dispenser(flow=80.0))
    analysis = Analysis(run)
    return Budget(analysis).values, Bead(run, None, analysis).values


@pytest.mark.soak
@pytest.mark.parametrize("times", [40, pytest.param(1000, marks=pytest.mark.soak)])
def test_many_runs_in_one_process_do_not_grow(xy, times, record_property):
    record_property("attack", "memory: many runs in one process, which must not grow")
    record_property("tries", times)
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(1e-3)
    record = 250 * len(setpoints.position)  # of one run [B]
    assert grown(lambda: one_run(xy, setpoints), times) < 6 * record


@pytest.mark.parametrize("times", [10, pytest.param(1000, marks=pytest.mark.soak)])
def test_many_long_runs_in_one_process_leave_no_file_open(long, xy, times, record_property):
    record_property("attack", "files: many long runs in one process, which must leave none open")
    record_property("tries", times)
    setpoints = Setpoints.along(MoveSpiral(60, 1, 10, 100).requested, 100.0, 1e-3)
    assert len(setpoints.position) > memory.LONG_RUN
    one_run(xy, setpoints)
    before = open_files()
    for _ in range(times):
        one_run(xy, setpoints)
    assert open_files() <= before
