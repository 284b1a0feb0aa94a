"""Ordinary parts as a user types them: how much glue they lay, and that neither plunges nor joints spoil the bead."""

import math

import pytest

from gantrysim.job.job import Job
from gantrysim.job.plan import plan_of
from gantrysim.results.verdict import Verdict

FRAME = """G21 G90 G64 P0.05
G0 Z10
G0 X8 Y0
G1 Z0 F600
M3
G1 X72 F2400
G3 X80 Y8 J8
G1 Y42
G3 X72 Y50 I-8
G1 X8
G3 X0 Y42 J-8
G1 Y8
G3 X8 Y0 I8
M5
G0 Z10
"""
POCKET = """G21 G90 G17 G64 P0.02
G0 Z5
G0 X4 Y4
G1 Z1 F300
G1 X36 F1500
G1 Y8
G1 X4
G0 Z5
G0 X0 Y0
G1 Z0 F300
G1 X40 F1800
G1 Y25
G1 X0
G1 Y0
G0 Z5
"""
MEETING = """G21 G90 G64 P0.02 F3000
G0 Z3
G0 Z0
G1 X40
G1 Y30
G0 Z3
G0 X0 Y0
G0 Z0
G1 Y30
G1 X40
G0 Z3
"""
WAITING = """G21 G90 G64 P0.08 F4200
G0 X10 Y10 Z3
G1 Z0.4
M62 P0
G1 X55
G3 X70 Y25 J15
G1 Y48
G1 X25 Y52
G4 P0.15
G1 X10 Y30
G1 Y10
M63 P0
G0 Z5
"""
SWITCHED = """G21 G90
S1000 M3
G0 X0 Y0 Z10.
G0 X50.
G0 Z0.
G1 X100. F600
G0 Z10.
M5
M30
"""


@pytest.fixture
def load(tmp_path):
    def load(text, suffix=".ngc", overrides=()):
        file = tmp_path / f"part{suffix}"
        file.write_text(text, encoding="utf-8")
        return Job.load(file, overrides)

    return load


def laid(job):
    """Commanded way with glue [mm]."""
    return plan_of(job.built_machine, "", job.setpoints, job.controller, is_checked=False).glue


def verdict(job):
    return Verdict.of(job, job.run())


def value(row, name):
    return next(check.value for check in row.checks if check.name == name)


def test_a_frame_between_m3_and_m5_is_laid_once_around_and_passes(load):
    job = load(FRAME)
    # sides less the corners' radius of 8 mm, and a circle of the corners: the codes stop the motion
    assert laid(job) == pytest.approx(2 * (64 + 34) + 16 * math.pi, abs=1e-3)
    assert {row.state for row in verdict(job).rows} == {"pass"}
    # by feed without the codes the plunge is dry, too
    # without the codes nothing stops the motion there: the corners of the plunge and of the lift are rounded within P
    assert laid(load(FRAME.replace("M3\n", "").replace("M5\n", ""))) == pytest.approx(laid(job), abs=2 * 0.05)


def test_plunges_at_feed_leave_the_bead_of_rapid_ones(load):
    slow = verdict(load(POCKET))["glue"]
    fast = verdict(load(POCKET.replace("G1 Z1 F300", "G0 Z1").replace("G1 Z0 F300", "G0 Z0")))["glue"]
    assert slow.state == fast.state == "pass"
    for check in ("bead_width", "bead_ploughed"):
        assert value(slow, check) == pytest.approx(value(fast, check), abs=0.5)


@pytest.mark.parametrize("text", [MEETING, WAITING, WAITING.replace("M62 P0\n", "").replace("M63 P0\n", "")])
def test_strokes_that_meet_and_outlines_that_wait_plough_nothing(load, text):
    assert value(verdict(load(text))["glue"], "bead_ploughed") == 0


@pytest.mark.parametrize("text", [f"O0001\n{SWITCHED}", SWITCHED])
def test_a_spindle_that_turns_throughout_lays_glue_at_feed_alone(load, text):
    assert laid(load(text, ".nc")) == pytest.approx(50, abs=0.06)


def test_a_second_layer_at_the_height_of_the_first_is_ploughed(load):
    stroke = "G0 X0 Y0\nG0 Z0\nG1 X40\nG1 Y30\nG0 Z5\n"
    glue = verdict(load(f"G21 G90 G64 P0.02 F2400\nG0 Z5\n{stroke}{stroke}"))["glue"]
    assert glue.state == "fail"
    assert value(glue, "bead_ploughed") == pytest.approx(70, abs=1)
