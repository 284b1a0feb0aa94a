"""The speed of programs, and the same programs at another speed."""

import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers import fanuc, softmc, trio
from gantrysim.job.job import Job
from gantrysim.job.programs import build

SPEEDS = {  # of the built-in jobs [mm/s]
    "an225": 100.0,
    "an225-3d": 100.0,
    "delta-arc": 150.0,
    "fanuc-conical": 120.0,
    "fanuc-spiral": 100.0,
    "linuxcnc-flanges": 40.0,
    "slicer-square": 30.0,
    "softmc-arc": 150.0,
    "softmc-basic": 120.0,
    "softmc-helical": 200.0,
    "stage-outline": 50.0,
    "svg-gasket": 60.0,
    "trio-basic": 120.0,
}
DIGITS = 1e-7  # relative, of a speed in a program's text


def at(job, speed):
    return job.changed(
        {f"program.{key}": value for key, value in job.controller.arguments_at(speed).items()}
    ).controller


@pytest.mark.parametrize(("name", "speed"), SPEEDS.items())
def test_the_speed_of_a_job_is_that_of_its_fastest_motion_and_can_be_changed(name, speed):
    job = Job.load(name)
    own, faster = job.controller, at(job, 1.7 * speed)
    assert own.programmed_speed == speed
    assert faster.programmed_speed == pytest.approx(1.7 * speed, rel=DIGITS)
    assert at(job, speed).programmed_speed == speed
    assert faster.requested.length == pytest.approx(own.requested.length, rel=1e-12)
    assert faster.duration < own.duration


BLOCKS = """
N10 G17 G90 G01 X10F1200 (F6000 is too fast)
N20 G03 X0 Y10. I-10. J0. F.5
N30 G00 X0 Y0
N40 G01 X5 Y5 F3000.
"""


def test_feeds_of_a_fanuc_program_keep_their_proportion_and_comments_stay():
    program = fanuc.Program(BLOCKS)
    assert program.programmed_speed == 50
    assert program.arguments_at(75.0) == {
        "program": BLOCKS.replace("F1200", "F1800").replace("F.5", "F0.75").replace("F3000.", "F4500")
    }
    assert fanuc.Program(BLOCKS, dry_run=600.0).arguments_at(75.0)["dry_run"] == pytest.approx(900)


def test_feeds_of_a_list_of_blocks_change_too():
    blocks = (fanuc.Line(end=(10.0, 0.0, 0.0), feed=600.0), fanuc.Line(end=(0.0, 0.0, 0.0)), fanuc.Dwell(time=0.1))
    changed = fanuc.Program(blocks).arguments_at(5.0)["program"]
    assert [block.get("feed") for block in changed] == [300.0, None, None]


def test_feeds_are_written_as_a_controller_reads_them():
    controller = Job.load("fanuc-spiral").controller
    for speed in (1e-3 / 3, 100 / 3, 123456.789):
        text = controller.arguments_at(speed)["program"]
        word = next(word for word in text.split() if word.startswith("F"))
        assert "e" not in word
        assert sum(character.isdigit() for character in word) <= 8
        assert float(word[1:]) == pytest.approx(60 * speed, rel=1e-2 if speed < 1e-2 else 1e-6)


def test_velocities_of_a_softmc_program_keep_their_proportion_to_the_groups():
    values = Job.load("softmc-arc").controller.arguments_at(300.0)
    assert values["group.velocity"] == 300
    assert "Vtran=240\n" in values["program"]
    assert "' back home" in values["program"]


def test_velocities_of_a_list_of_commands_change_too():
    commands = (softmc.Move((10.0, 0.0), velocity=40.0), softmc.Circle(angle=90.0, centre=(0.0, 0.0)))
    program = softmc.Program(commands, softmc.Group(velocity=20.0))
    assert program.programmed_speed == 40
    values = program.arguments_at(60.0)
    assert values["group.velocity"] == 30
    assert [command.get("velocity") for command in values["program"]] == [60.0, None]
    faster = build("softmc.Program", {"program": values["program"], "group": {"velocity": 30.0}})
    assert faster.programmed_speed == 60


def test_a_program_without_a_speed_cannot_be_scaled():
    rapid = fanuc.Program("G00 X10 Y10")
    with pytest.raises(InputError, match="program: states no path speed"):
        rapid.arguments_at(10.0)


def test_a_speed_must_be_positive():
    with pytest.raises(InputError, match="speed = 0 mm/s: must be greater than 0 mm/s"):
        Job.load("an225").controller.arguments_at(0.0)


def test_only_a_move_spiral_that_is_not_bound_to_servo_ticks_runs_free():
    assert trio.MoveSpiral(60, 1, 10, 100).free_running
    assert not trio.MoveSpiral(60, 1, 10, 100, servo_period=1e-3).free_running
    assert not Job.load("softmc-arc").controller.free_running


@pytest.mark.parametrize(
    ("name", "text", "speed"),
    [
        # F of a printer's G0 is that of its travel
        ("part.gcode", "G0 X5 Y5 F6000\nM106\nG1 X30 F1200\nM107\nG0 X0 F6000\n", 20),
        ("part.ngc", "F6000 G1 Z5\nM64 P0\nF900 G1 X30\nM65 P0\nF6000 G1 Z0\n", 15),
        ("part.csv", "x [mm];y [mm];speed [mm/s]\n0;0;20\n50;0;20\n50;30;40\n", 40),
    ],
)
def test_the_programmed_speed_is_one_with_glue(name, text, speed, tmp_path):
    (tmp_path / name).write_text(text)
    job = Job.load(tmp_path / name)
    assert job.controller.programmed_speed == pytest.approx(speed)
    assert Job.load(tmp_path / name, speed=0.5 * speed).controller.programmed_speed == pytest.approx(0.5 * speed)
    flow = job.dispenser.area * speed
    assert f"{flow:.3g} mm³/s at {speed:.4g} mm/s" in job.notes[0]
