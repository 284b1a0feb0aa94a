"""Speed by place from end to end: found by simulation, written as a program, and run again as anyone would run it."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from gantrysim.base.errors import InputError
from gantrysim.cli.main import app
from gantrysim.job.job import Job
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.by_place import RUNS, SpeedByPlace, _Search, speed_by_place, write_by_place
from gantrysim.remedy.outcome import Motion
from gantrysim.remedy.report import remedy_of
from gantrysim.study.speed.study import speed_changes

# one tight arc between long straight lines, at 100 mm/s
ARC = 4
TEXT = "G21 G17 G90 G94 G64 P0.01\nG1 X0 Y0 F6000\nG1 X150\nG3 X160 Y10 J10 (tight)\nG1 Y150\nM2\n"
# of the bead: the arc's corner alone
SETTINGS = {
    "servo.law": ["pid", "friction"],
    "program.acceleration": 2000.0,
    "dispenser.flow": 0.0,
    "dispenser.area": 2.0,
    "tolerance.path_max": 0.008,
    "tolerance.path_p95": 0.006,
}


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    file = tmp_path_factory.mktemp("corner") / "corner.ngc"
    file.write_text(TEXT, encoding="utf-8")
    return Job.load(str(file), SETTINGS)


@pytest.fixture(scope="module")
def even(job):
    """The fastest run that passes of those at a factor of all speeds, which the arc alone makes fail."""
    bench = Bench(job)

    def outcome(factor):
        return bench.measure(job.changed(speed_changes(job, factor * 100.0)))

    assert not outcome(1.0).passes
    return next(slower for slower in map(outcome, (0.95, 0.9, 0.85, 0.8)) if slower.passes)


@pytest.fixture(scope="module")
def found(job, even):
    result = speed_by_place(job, even, Bench(job))
    assert isinstance(result, SpeedByPlace), result
    return result


JOB = 'name = "part"\nmachine = "xy"\n[program]\nfile = "part.ngc"\n'


def line_speeds(controller):
    stretches = controller.stretches(0.001)
    return dict(zip(stretches.places.tolist(), stretches.speeds.tolist(), strict=True))


def test_the_arc_alone_is_slowed_and_every_tolerance_holds(found, even):
    assert found.outcome.passes
    assert found.outcome.duration < 0.8 * even.duration
    assert found.runs <= RUNS
    speeds = {speed.place: speed.after for speed in found.speeds}
    assert speeds[ARC] < 100.0
    assert all(speeds[line] > 100.0 for line in (3, 5))
    assert line_speeds(found.job.controller) == pytest.approx(speeds, rel=1e-7)


def test_the_arc_is_about_as_fast_as_the_closed_form_allows(job, found):
    # at the programmed speed its level is e = c v² in a run of its own; 78 % of the limit of 6 µm allows v
    motion = Motion.of(job)
    analysis = motion.budget.analysis
    stretches = job.controller.stretches(job.servo.period)
    on_arc = stretches.places[stretches.at(analysis.nozzle.s)] == ARC
    level = np.percentile(np.abs(analysis.nozzle.distance[on_arc]), 80)
    largest = np.abs(analysis.nozzle.distance[on_arc]).max()
    limit = 100.0 * np.sqrt(0.78 * 0.008 / largest)
    speed = next(speed.after for speed in found.speeds if speed.place == ARC)
    assert level < largest
    assert speed == pytest.approx(limit, rel=0.05)


def test_the_written_program_runs_as_promised(job, found, tmp_path):
    file, program = write_by_place(found, tmp_path / "corner-by-place", job)
    assert (file.name, program.name) == ("corner-by-place.toml", "corner-by-place.ngc")
    again = Job.load(str(file))
    outcome = Motion.of(again, "mujoco").outcome(again)
    assert outcome.duration == found.outcome.duration
    assert [row.checks for row in outcome.verdict.rows] == [row.checks for row in found.outcome.verdict.rows]
    # the bare program with the settings of the job that it came from
    bare = Job.load(str(program), SETTINGS | {"dispenser.advance": found.job.dispenser.advance})
    assert line_speeds(bare.controller) == line_speeds(found.job.controller)
    bare_outcome = Motion.of(bare, "mujoco").outcome(bare)
    assert bare_outcome.duration == pytest.approx(outcome.duration, abs=1e-9)
    for row, other in zip(bare_outcome.verdict.rows, outcome.verdict.rows, strict=True):
        assert [check.value for check in row.checks] == pytest.approx([check.value for check in other.checks], rel=1e-9)


def test_few_words_change(found):
    before, after = (text.splitlines() for text in (TEXT, found.job.program["text"]))
    assert len(before) == len(after)
    changed = [k for k, (old, new) in enumerate(zip(before, after, strict=True), 1) if old != new]
    assert changed == [3, 4, 5]
    assert after[3].endswith("(tight)")


def test_the_user_s_own_files_are_never_overwritten(found, tmp_path):
    (tmp_path / "part.ngc").write_text(TEXT, encoding="utf-8")
    (tmp_path / "part.toml").write_text(JOB, encoding="utf-8")
    (tmp_path / "job.toml").write_text(JOB, encoding="utf-8")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for own in ("part.ngc", "part.toml", "job.toml"):
        with pytest.raises(InputError, match="is a file of the job; give another name"):
            write_by_place(found, tmp_path / ("part" if "part" in own else "job"), Job.load(str(tmp_path / own)))
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_flow_that_does_not_follow_the_speed_is_made_to(job, even):
    fixed = job.changed({"dispenser.area": 0.0, "dispenser.flow": 200.0})
    result = speed_by_place(fixed, even, Bench(fixed))
    assert isinstance(result, SpeedByPlace), result
    assert (result.job.dispenser.flow, result.job.dispenser.area) == (0.0, pytest.approx(2.0, rel=0.01))
    assert (result.glue["dispenser.flow"], result.glue["dispenser.area"]) == (0.0, result.job.dispenser.area)
    assert ", dispenser.flow = 0, dispenser.area = 2" in str(result)


def test_a_flow_by_e_follows_the_speed_already(even, tmp_path):
    """The same path with 2 mm³ of E for each mm, whose F words alone change."""
    file = tmp_path / "corner.gcode"
    text = "G21\nG90\nM83\nG1 X0 Y0 F6000\nG1 X150 E300\nG3 X160 Y10 J10 E31.4 (tight)\nG1 Y150 E280\n"
    file.write_text(text, encoding="utf-8")
    settings = {key: value for key, value in SETTINGS.items() if key not in ("dispenser.area", "dispenser.flow")}
    job = Job.load(str(file), settings | {"program.corner_tolerance": 0.01, "dispenser.e_volume": 1.0})
    found = speed_by_place(job, even, Bench(job))
    assert isinstance(found, SpeedByPlace), found
    assert found.outcome.passes
    assert found.outcome.duration < 0.9 * even.duration
    written = found.job.controller.text.splitlines()
    for line, original in zip(written, text.splitlines(), strict=True):
        assert [word for word in line.split() if word[0] != "F"] == [w for w in original.split() if w[0] != "F"]


def test_a_flow_by_an_output_is_set_line_by_line(even, tmp_path):
    """The same path with M67, whose value times 4 mm³/s is 2 mm² at each line's speed."""
    file = tmp_path / "corner.ngc"
    file.write_text(TEXT.replace("G1 X0 Y0", "M67 E0 Q50\nG1 X0 Y0"), encoding="utf-8")
    settings = {key: value for key, value in SETTINGS.items() if key not in ("dispenser.area", "dispenser.flow")}
    output = {"program.flow_output": "M67 E0", "dispenser.per_output": 4.0}
    job = Job.load(str(file), settings | output)
    result = speed_by_place(job, even, Bench(job))
    assert isinstance(result, SpeedByPlace), result
    assert result.outcome.passes
    assert result.outcome.duration < 0.95 * even.duration
    assert result.job.dispenser.per_output == 4.0
    assert result.job.dispenser.area == 0.0
    assert ", M67 E0 by line" in str(result)
    assert result.heads == ("from", "to", "speed [mm/s]", "M67 E0")
    arc = next(speed for speed in result.speeds if speed.place == ARC + 1)
    assert arc.flow == pytest.approx(2.0 * arc.after / 4.0, rel=1e-3)
    # as a stranger runs it: the program and the options of the job that it came from
    _, program = write_by_place(result, tmp_path / "corner-by-place", job)
    bare = Job.load(str(program), settings | output | {"dispenser.advance": result.job.dispenser.advance})
    outcome = Motion.of(bare, "mujoco").outcome(bare)
    assert outcome.passes
    assert outcome.duration == pytest.approx(result.outcome.duration, abs=1e-9)
    run = bare.follow()
    lines = bare.controller.lines_at(bare.setpoints.time)
    for speed in result.speeds:
        laid = run.flow_demand[:-1][(lines[:-1] == speed.place) & run.dispense[:-1]]
        assert np.median(laid) == pytest.approx(2.0 * speed.after, rel=1e-3)


def test_a_table_of_points_gets_a_column_of_speeds(even, tmp_path):
    """The same path as a table of points, whose last point of the arc is on line 5."""
    half = np.sqrt(0.5)
    rows = ["x,y,kind", "0,0,", "150,0,", f"{150 + 10 * half:.9g},{10 - 10 * half:.9g},arc", "160,10,", "160,150,"]
    file = tmp_path / "corner.csv"
    file.write_text("\n".join(rows), encoding="utf-8")
    own = {"program.speed": 100.0, "program.acceleration": [2000.0] * 3, "program.corner_tolerance": 0.001}
    job = Job.load(str(file), SETTINGS | own)
    result = speed_by_place(job, even, Bench(job))
    assert isinstance(result, SpeedByPlace), result
    assert result.outcome.passes
    assert result.outcome.duration < 0.8 * even.duration
    speeds = {speed.place: speed.after for speed in result.speeds}
    assert speeds[5] < 100.0 < min(speeds[3], speeds[6])
    _, table = write_by_place(result, tmp_path / "by-place", job)
    assert table.name == "by-place.csv"
    assert table.read_text(encoding="utf-8").splitlines()[3] == rows[3]
    bare = Job.load(str(table), SETTINGS | own | {"dispenser.advance": result.job.dispenser.advance})
    assert line_speeds(bare.controller) == line_speeds(result.job.controller)
    outcome = Motion.of(bare, "mujoco").outcome(bare)
    assert outcome.passes
    assert outcome.duration == pytest.approx(result.outcome.duration, abs=1e-9)


def test_speeds_that_stay_are_not_called_speeds_by_place(found):
    kept = replace(found, speeds=tuple(replace(speed, after=speed.before) for speed in found.speeds))
    assert str(kept).startswith("pass with the program's own speeds: ")


def test_a_program_with_one_speed_has_none_by_place(job, even):
    stage = Job.load("stage-outline")
    assert "states one speed for its whole path" in speed_by_place(stage, even, Bench(stage))


def test_nothing_is_proposed_that_is_not_as_good(job, found):
    better = replace(found.outcome, duration=0.5 * found.outcome.duration)
    assert speed_by_place(job, better, Bench(job)).startswith("no speeds by place are as good in less time")


@pytest.mark.soak
def test_the_spiral_s_program_passes_in_far_less_time_than_at_half_speed(tmp_path):
    changes = {
        "program.loop_period": 0.01,
        "program.acceleration": 4000.0,
        "program.wait_resolution": 0.0,
        "dispenser.flow": 0.0,
        "dispenser.area": 2.0,
    }
    job = Job.load("an225", changes)
    bench = Bench(job)
    half = bench.measure(job.changed({"program.speed": 50.0}))
    assert half.passes
    found = speed_by_place(job, half, bench)
    assert isinstance(found, SpeedByPlace), found
    assert found.outcome.passes
    assert found.outcome.duration < 0.65 * half.duration
    # the slow start alone spares the rest of the spiral: the ramp's lag is what the loop never makes up
    assert found.speeds[0].after < 0.5 * found.speeds[20].after
    _, program = write_by_place(found, tmp_path / "spiral", job)
    spiral = {"diameter": 120.0, "turns": 4, "thickness": 10.0}
    dispenser = found.job.dispenser
    settings = {
        f"dispenser.{key}": getattr(dispenser, key) for key in ("flow", "area", "dead_time", "opening", "closing")
    }
    settings |= {"dispenser.advance": dispenser.advance, "program.spiral": spiral, "servo.integral_time": 0.03}
    basic = Job.load(str(program), settings, "xy")
    outcome = Motion.of(basic).outcome(basic)
    assert outcome.passes
    assert outcome.duration == pytest.approx(found.outcome.duration, abs=0.01)


def test_improve_names_and_writes_it(tmp_path):
    text = str(tmp_path / "part.ngc")
    (tmp_path / "part.ngc").write_text(TEXT, encoding="utf-8")
    options = [word for key, value in SETTINGS.items() for word in ("--set", f"{key}={value}".replace("'", '"'))]
    apply = tmp_path / "better.toml"
    arguments = ["improve", text, *options, "--lever", "slower", "--no-fastest", "--by-place", "--apply", str(apply)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    words = " ".join(result.output.split())
    assert "Pass with a speed by place: " in words
    assert "s instead of " in words
    assert (tmp_path / "part.ngc").read_text(encoding="utf-8") == TEXT
    assert {path.name for path in tmp_path.iterdir()} == {
        "part.ngc",
        "better.toml",
        "better-by-place.toml",
        "better-by-place.ngc",
    }


def test_a_file_of_the_job_is_refused_before_anything_is_written(tmp_path):
    own = tmp_path / "better-by-place.ngc"
    own.write_text(TEXT, encoding="utf-8")
    options = [word for key, value in SETTINGS.items() for word in ("--set", f"{key}={value}".replace("'", '"'))]
    arguments = ["improve", str(own), *options, "--lever", "slower", "--no-fastest", "--by-place"]
    result = CliRunner().invoke(app, [*arguments, "--apply", str(tmp_path / "better.toml")])
    # the command's main function prints it, with the status 2
    assert isinstance(result.exception, InputError)
    assert str(result.exception).endswith("is a file of the job; give another name")
    assert [path.name for path in tmp_path.iterdir()] == ["better-by-place.ngc"]
    assert own.read_text(encoding="utf-8") == TEXT


@pytest.mark.parametrize("is_faster", [True, False])
def test_the_first_screen_says_where_a_speed_by_place_is_faster(job, even, found, is_faster):
    after = even if is_faster else found.outcome
    improvement = SimpleNamespace(
        changes_anything=True, combination=(), by_worst_value=(), by_hand="", words_of=lambda _: "no lever",
        base=job, job=job, sentence="", lines={}, by_place=found,
        before=even, after=after, verdict=even.verdict, improved=after.verdict,
    )  # fmt: skip
    remedy = remedy_of(improvement)
    said = f", or {found.outcome.duration:.2f} s with a speed for each stretch (gantrysim improve job.toml --out FOLDER"
    assert (said in remedy.outcome) == is_faster
    assert found.outcome.duration < even.duration


@pytest.mark.parametrize(
    ("worst", "factor"),
    # the square root of what remains to a use of 78 %, but neither too near to 1 nor too far
    [
        *((0.0, 1.2), (0.6, 1.2), (0.5, math.sqrt(0.78 / 0.5)), (0.05, 1.4)),
        *((0.9, 0.85), (1.6, math.sqrt(0.78 / 1.6)), (9, 0.5)),
    ],
)
def test_the_second_run_is_as_much_faster_or_slower_as_its_limits_admit(worst, factor):
    first = SimpleNamespace(usage=SimpleNamespace(shares=np.array([0.0, worst])))
    assert _Search._second_factor(None, first) == pytest.approx(factor)


def test_speeds_that_take_longer_than_a_run_that_passes_are_not_simulated():
    """At its own speed softmc-arc passes, and 1.2 times as fast; by place it would take six times as long."""
    job = Job.load("softmc-arc").changed({"dispenser.advance": 0.0225})
    bench = Bench(job)
    before = bench.measure(job)
    assert before.passes
    result = speed_by_place(job, before, bench)
    assert isinstance(result, SpeedByPlace)
    assert result.runs == 2
    assert result.outcome.passes
    assert result.outcome.duration < 0.9 * before.duration
