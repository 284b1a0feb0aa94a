"""Why a lever does not apply to jobs of other kinds, and values in the words of a line to paste."""

import math
from types import SimpleNamespace

import pytest

from gantrysim import Job
from gantrysim.remedy.lever import State
from gantrysim.remedy.levers import LEVERS
from gantrysim.remedy.wording import Keys, comment_of, value_text
from gantrysim.results.verdict import GLUE

from support.remedies import AREA, CIRCLE, DOTS, SIDES, content_of, lines_job, outcome, spiral_job

PISTON = {
    "kind": "piston",
    "needle": {"bore": 0.84, "length": 12.0, "consistency": 8.0, "index": 1.0},
    "piston": {"charge": math.inf, "compliance": 0.02},
}


def of_servo(**servo):
    return lambda: lines_job(CIRCLE, servo=servo)


def own_law():
    return lines_job(CIRCLE, servo={"law": ["support.own_laws:pd"]})


def dry(**dispenser):
    return lambda: lines_job(SIDES, dispenser=dispenser)


def by_e():
    text = "M83\nM204 S1000\nM205 X5 Y5\nF3000\nG1 X40 Y0 E0.4\nG1 X40 Y40 E0.4\n"
    program = {"controller": "slicer.Program", "text": text}
    return Job.of_content(content_of(program, dispenser={"per_e": 1.0}), "job small")


def sharp():
    text = "M83\nM204 S1000\nM205 X5 Y5 J0\nF3000\nG1 X40 Y0 E0.4\nG1 X40 Y40 E0.4\n"
    return Job.of_content(content_of({"controller": "slicer.Program", "text": text}), "job small")


REASONS = [
    ("integral time", of_servo(law="pd"), "the law pd has no integral term"),
    ("loop gains", of_servo(mode="velocity"), "the drives close the loops themselves"),
    ("friction compensation", of_servo(mode="velocity"), "the drives close the loops themselves and take no torque"),
    ("learning", of_servo(mode="velocity"), "the drives close the loops themselves and take no torque"),
    ("loop gains", own_law, "the gains of a law of your own are its own"),
    ("accuracy class", of_servo(), "the machine's geometry is ideal in this job"),
    (
        "accuracy class",
        lambda: lines_job(CIRCLE, geometry={"squareness_xy": 0.01}),
        "the job gives the errors of the geometry one by one, without a class",
    ),
    ("flow by speed", dry(), "the job lays no bead"),
    ("pressure advance", dry(**PISTON), "the job lays no bead"),
    ("leads", dry(), "the job lays no bead"),
    (
        "loop period",
        lambda: spiral_job(loop_period=0.0, acceleration=math.inf, wait_resolution=0.0),
        "the program is the continuous limit of its loop",
    ),
    ("lag compensation", lambda: lines_job(DOTS, dispenser={"area": AREA}), "the dispenser has no lag"),
]


@pytest.mark.parametrize(("name", "build", "reason"), REASONS)
def test_a_lever_says_why_it_does_not_apply_to_a_job_of_another_kind(name, build, reason):
    lever = next(lever for lever in LEVERS if lever.name == name)
    settings = lever.settings(State(build(), outcome))
    assert isinstance(settings, str), settings
    assert settings.startswith(reason)


@pytest.mark.parametrize(
    ("height", "reason"), [(0.0, "the needle does not touch its bead"), (0.1, "the machine has no axis z")]
)
def test_the_lift_says_why_it_does_not_apply_by_the_height_to_which_the_needle_ploughs(height, reason):
    lever = next(lever for lever in LEVERS if lever.name == "lift")
    ploughed = SimpleNamespace(name="bead_ploughed", value=height)
    verdict = {GLUE: SimpleNamespace(checks=(ploughed,))}
    assert lever.settings(State(lines_job(SIDES), lambda _: SimpleNamespace(verdict=verdict))) == reason


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.25, "0.25"),
        (True, "true"),
        ("pid", '"pid"'),
        ([2.0, 2.0, 2.0], "2"),
        ((2.0, 3.5), "[2, 3.5]"),
        (["pid", "friction"], '["pid", "friction"]'),
        ([True, False], "[true, false]"),
        ([[1.0, 2.0], "x"], '[[1, 2], "x"]'),
    ],
)
def test_a_value_is_written_as_in_a_job(value, text):
    assert value_text(value) == text


def test_a_gain_that_the_job_leaves_to_the_machine_was_that_of_the_built_servo():
    job = lines_job(CIRCLE)
    keys = Keys(job)
    kd = [gains.kd for gains in job.built_servo.gains]
    assert keys.before("servo.kd") == (kd[0] if len(set(kd)) == 1 else kd)
    resolution = set(job.built_servo.per_axis("resolution"))
    assert keys.before("servo.resolution") == pytest.approx(resolution.pop())
    assert keys.before("servo.nonsense") is None
    assert f"was {value_text(kd)}" in comment_of(keys, "servo.kd", [2 * value for value in kd])
    assert "was" not in comment_of(keys, "servo.kd", keys.before("servo.kd"))
