"""What is likely to be written instead of the right argument: it works, or one line says what to write."""

from pathlib import Path

import numpy as np
import pytest

import gantrysim as gs
from gantrysim.base.errors import nearest, unknown_text
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.faults import StuckAxis
from gantrysim.job.job import Job

SPIRAL = MoveSpiral(40, 1, 10, 100)
EITHER = "must be Setpoints or a controller with its program"
OF_JOB = "a job or program file is run by gantrysim.Job.load"


def test_a_controller_stands_for_its_setpoints_at_the_servo_s_period(xy):
    servo = gs.Servo.derive(xy.axes, 2e-3)
    plain = gs.simulate(xy, servo, SPIRAL.setpoints(2e-3))
    for run in (gs.simulate(xy, servo, SPIRAL), *gs.simulate_batch(xy, servo, [SPIRAL, SPIRAL.setpoints(2e-3)])):
        assert run.period == 2e-3
        np.testing.assert_array_equal(run.encoder, plain.encoder)


WRONG = (
    ("machine", "xy", "must be a Machine; write gantrysim.Machine('xy')"),
    ("machine", Path("a.xml"), "must be a Machine; write gantrysim.Machine('a.xml')"),
    ("servo", None, "must be a Servo; write gantrysim.Servo.derive(machine.axes)"),
    ("setpoints", "an225", f"{EITHER}; {OF_JOB}('an225').run()"),
    (
        "setpoints",
        Job.load("an225"),
        f"{EITHER}; a Job has a machine and a servo of its own: write .run() behind it",
    ),
    ("setpoints", MoveSpiral, f"{EITHER}; write MoveSpiral(...) with its arguments"),
    (
        "setpoints",
        SPIRAL.requested,
        f"{EITHER}; a path has no speed: write Setpoints.along(path, speed, servo.period)",
    ),
    ("setpoints", 5, EITHER),
    (
        "dispenser",
        80.0,
        "must be a Dispenser or None; write gantrysim.Dispenser(flow=80.0) for a flow in mm³/s",
    ),
    ("faults", StuckAxis(time=1, axis="x"), "must be a list of faults; write faults=[fault]"),
)


@pytest.mark.parametrize(("name", "value", "text"), WRONG)
@pytest.mark.parametrize("run", [gs.simulate, gs.simulate_batch])
def test_wrong_arguments_of_a_run(xy, run, name, value, text):
    arguments = {"machine": xy, "servo": gs.Servo.derive(xy.axes), "setpoints": SPIRAL, name: value}
    told = f"{name} is of type {type(value).__name__}: {text}"
    with pytest.raises(gs.InputError) as error:
        run(**arguments)
    assert str(error.value).replace(", or a list, a tuple or an array of them", "") == told


def test_a_perfect_follower_has_no_servo_whose_period_a_controller_could_take(xy):
    with pytest.raises(gs.InputError, match=r"setpoints is a controller: .* write .setpoints\(period\) behind it"):
        gs.perfect_follower(xy, SPIRAL)
    with pytest.raises(gs.InputError, match=r"write gantrysim.Machine\('xy'\)"):
        gs.perfect_follower("xy", SPIRAL.setpoints(1e-3))


@pytest.mark.parametrize("evaluate", [gs.Budget, gs.Bead, gs.metrics.values])
@pytest.mark.parametrize(
    ("value", "text"),
    [("out/an225", "a record is read by gantrysim.Run.load"), (Job.load("an225"), "write .run() behind it")],
    ids=["path", "job"],
)
def test_wrong_arguments_of_an_evaluation(evaluate, value, text):
    with pytest.raises(gs.InputError) as error:
        evaluate(value)
    assert text in str(error.value)


@pytest.mark.parametrize("axes", ["xy", 3])
def test_axes_that_are_none(axes):
    with pytest.raises(gs.InputError, match=r"must be the axes of a machine; write Servo.derive\(machine.axes\)"):
        gs.Servo.derive(axes)


def test_a_machine_instead_of_its_axes(xy):
    with pytest.raises(gs.InputError, match=r"axes is of type Machine: .* write Servo.derive\(machine.axes\)"):
        gs.Servo.derive(xy)


def test_a_bead_without_glue_says_so(xy):
    run = gs.simulate(xy, gs.Servo.derive(xy.axes), SPIRAL)
    remark = "the run requests no glue while the nozzle moves: its bead has no values; run it with a dispenser"
    assert remark in str(gs.Bead(run))
    assert remark in gs.Bead(run)._repr_html_()
    glued = gs.simulate(xy, gs.Servo.derive(xy.axes), SPIRAL, dispenser=gs.Dispenser(flow=100))
    assert "remark" not in str(gs.Bead(glued))


def test_the_nearest_keyword_comes_first(xy):
    with pytest.raises(
        TypeError, match=r"unknown keyword 'integral_tim': did you mean integral_time\? known: integral_time, .*kp"
    ):
        gs.Servo.derive(xy.axes, integral_tim=0.03)


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("integral_tim", ["servo.integral_time"]),
        ("Servo.Integral_Time", ["servo.integral_time"]),
        ("loop_perod", ["program.loop_period"]),
        ("qqq", []),
    ],
)
def test_nearest_names(name, near):
    known = ["servo.integral_time", "servo.kp", "program.loop_period", "machine"]
    assert nearest(name, known)[:1] == near
    text = unknown_text("key", name, known)
    first = near or sorted(known)[:1]
    assert f"known: {first[0]}, " in text
    assert sorted(text.partition("known: ")[2].split(", ")) == sorted(known)


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ("[servo]\nintegral_tim = 0.03", "unknown key servo.integral_tim: did you mean integral_time"),
        ("spead = 100", "unknown key program.spead: did you mean speed"),
        ("[sevro]\nkp = 1", "unknown key sevro: did you mean servo"),
        ("[dispenser]\nflow = 3\nneedle = {boer = 1}", "unknown key dispenser.needle.boer: did you mean bore"),
        (
            "[[faults]]\nkind = 'bus sag'\ntime = 1\nshare = 0.5\ndration = 1",
            "unknown key faults.0.dration: did you mean duration",
        ),
    ],
)
def test_a_wrong_key_of_a_job_file(tmp_path, table, text):
    program = "controller = 'trio.MoveSpiral'\ndiameter = 120\nturns = 4\nthickness = 10\nspeed = 100"
    (tmp_path / "job.toml").write_text(f"name = 'mine'\n[program]\n{program}\n{table}\n")
    with pytest.raises(gs.InputError) as error:
        Job.load(tmp_path / "job.toml")
    assert text in str(error.value)


def test_a_wrong_key_of_a_machine_of_a_servo_file_and_of_an_environment(tmp_path):
    table = Path(__file__).parent.parent / "examples" / "machines" / "belt-gantry.toml"
    (tmp_path / "belt-gantry.toml").write_text(table.read_text().replace("carriage", "cariage"))
    with pytest.raises(gs.InputError, match=r"unknown key .*cariage\w*: did you mean carriage\w*"):
        gs.Machine(tmp_path / "belt-gantry.toml")
    (tmp_path / "tuned.toml").write_text("[servo]\nintegral_tim = 1\n")
    with pytest.raises(gs.InputError, match=r"unknown key integral_tim: did you mean integral_time"):
        Job.load("an225", servo=tmp_path / "tuned.toml")
    with pytest.raises(gs.InputError, match=r"unknown key servo.dampng: did you mean damping"):
        gs.env.SpiralTuningEnv(servo={"dampng": 1.0})
