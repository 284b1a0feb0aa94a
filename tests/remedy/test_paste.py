"""Lines to paste make the improved job, with what would be chosen anew where nobody gives it."""

import pytest

from gantrysim import Job
from gantrysim.remedy.by_place import _files_of
from gantrysim.remedy.improvement import changed_values, options, toml_lines, values_to_set
from gantrysim.study.speed.study import speed_changes

from support.pasting import in_job_file, with_options

# 500 mm beside the travel, and 0.5 mm above the work
FAR = "O1\nG21 G17 G90 G94\nG0 X500 Y0 Z5\nG1 Z0.5 F600\nG1 X540 F3000\nG1 Y30\nG0 Z5\nM30\n"
FAST = "G21 G90 G64 P0.05\nG1 X140 F50000\nG1 Y60\nM2\n"
SHARED = ("machine", "travel", "program", "servo", "dispenser", "bead", "geometry", "tolerance")


def same(job, improved):
    assert {name: getattr(job, name) for name in SHARED} == {name: getattr(improved, name) for name in SHARED}


def test_a_text_in_place_of_a_file_keeps_the_place_that_was_chosen(tmp_path):
    """A program that is not in a file of its own is not laid onto the work, nor is the travel made for it."""
    file = tmp_path / "far.nc"
    file.write_text(FAR)
    base = Job.load(file)
    assert base.program["placement"]["z"] == -0.5
    assert base.travel["x"][1] > 540
    improved = base.changed(speed_changes(base, 25.0))
    lines = toml_lines(base, improved)
    assert "z = -0.5" in lines
    same(in_job_file(file, lines, tmp_path), improved)
    (option,) = options(base, improved)
    assert option == "--speed 25"
    same(with_options(file, option), improved)


def test_limits_of_speed_that_the_new_values_would_bring_are_set(tmp_path):
    """At 1.41 times its feed the program exceeds the machine's 1000 mm/s, which then are chosen as its limits."""
    file = tmp_path / "fast.ngc"
    file.write_text(FAST)
    base = Job.load(file)
    improved = base.changed({"program.feed_override": 1.41})
    assert base.loaded_with({"program.feed_override": 1.41}).program["axis_speeds"][0] == 1000
    assert "--set program.axis_speeds='[inf, inf, inf]'" in options(base, improved)
    same(with_options(file, " ".join(options(base, improved))), improved)
    same(in_job_file(file, toml_lines(base, improved), tmp_path), improved)


def test_values_that_never_make_the_job_are_not_proposed():
    base = Job.load("softmc-arc")
    other = base.changed({"servo.period": 5e-4})
    assert values_to_set(other, lambda values: base) is None


def test_a_value_that_is_a_table_is_one_option(tmp_path):
    file = tmp_path / "tools.ngc"
    file.write_text("G21 G90 G64 P0.02\nT1 M6\nG43\nG1 X140 F3000\nG1 Y60\nM2\n")
    base = Job.load(file)
    improved = base.changed({"program.tool_lengths": {"1": 12.5, "2": 8.0}})
    (option,) = options(base, improved)
    assert option == "--set program.tool_lengths='{1 = 12.5, 2 = 8.0}'"
    same(with_options(file, option), improved)
    assert "\ntool_lengths = {1 = 12.5, 2 = 8.0}  # mm;" in toml_lines(base, improved)


def test_options_of_the_command_are_among_the_lines_of_the_file(tmp_path):
    base = Job.load("softmc-arc", ["dispenser.opening=0.03"])
    improved = base.changed({"dispenser.advance": 0.03})
    assert options(base, improved) == ["--set dispenser.advance=0.03"]
    assert toml_lines(base, improved).splitlines() == [
        "[dispenser]",
        # as an option of the command has it already
        "opening = 0.03  # s; time constant of rising flow or pressure",
        f"advance = 0.03  # s, was {base.dispenser.advance:g}; lag compensation",
    ]
    same(in_job_file("softmc-arc", toml_lines(base, improved), tmp_path), improved)


@pytest.mark.parametrize("speed", [40.0, 17.3])
def test_an_option_of_the_speed_replaces_the_one_of_the_command(speed, tmp_path):
    file = tmp_path / "fast.ngc"
    file.write_text(FAST.replace("F50000", "F1800"))
    base = Job.load(file, speed=speed)
    improved = base.changed(speed_changes(base, 25.0))
    words = " ".join(options(base, improved))
    assert words.startswith("--speed ")
    same(with_options(file, words, speed=speed), improved)
    same(in_job_file(file, toml_lines(base, improved), tmp_path), improved)


def test_a_text_of_several_lines_is_pasted_as_its_lines(tmp_path):
    file = tmp_path / "fast.ngc"
    file.write_text(FAST)
    base = Job.load(file)
    text = FAST.replace("X140", "X120")
    improved = base.changed({"program.text": text})
    lines = toml_lines(base, improved)
    assert text in lines
    same(in_job_file(file, lines, tmp_path), improved)


def test_a_table_that_the_improved_job_has_not_is_emptied():
    """Else the travel that is chosen for a program that lies far away would stay, and deliberate faults would."""
    fault = {"kind": "clogged nozzle", "time": 1.0, "share": 0.5}
    base = Job.load("softmc-arc").changed({"faults": [fault], "travel": {"x": [-400.0, 400.0]}})
    improved = base.changed({"faults": [], "travel": {}})
    assert changed_values(base, improved) == {"faults": [], "travel": {}}
    assert changed_values(improved, base).keys() == {"faults", "travel"}


def test_the_files_of_a_job_are_its_own_and_its_program_s(tmp_path):
    """None of them is overwritten by a program with speeds by place."""
    part = tmp_path / "part.ngc"
    part.write_text(FAST)
    job = tmp_path / "job.toml"
    job.write_text('name = "fast"\nmachine = "xy"\n[program]\ncontroller = "linuxcnc.Program"\nfile = "part.ngc"\n')
    assert {file.resolve() for file in _files_of(Job.load(job))} == {job.resolve(), part.resolve()}
    assert {file.resolve() for file in _files_of(Job.load(part))} == {part.resolve()}
