"""Program files as jobs: which controller reads them, where they lie on the work, and which line is to blame."""

import json

import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.controllers.placement import Placement
from gantrysim.job.programs import reader, suffixes

SQUARE = """G21 G90 G17
G0 X10 Y0
G1 X30 F1200
G1 Y20
G1 X10
G1 Y0
M2
"""
EXACT = 1e-9


@pytest.fixture
def square(tmp_path):
    file = tmp_path / "square.ngc"
    file.write_text(SQUARE)
    return file


def test_the_suffix_names_the_controller_and_an_option_another():
    assert reader(".ngc") == "linuxcnc.Program"
    assert reader(".NGC") == "linuxcnc.Program"
    assert reader(".bas") == "trio.Basic"
    assert reader(".prg") == "softmc.Basic"
    assert reader(".gcode") == "slicer.Program"
    assert {reader(suffix) for suffix in (".dxf", ".svg", ".csv")} == {"cad.Drawing"}
    assert reader(".nc", "fanuc") == reader(".txt", "Fanuc.Program") == "fanuc.Program"
    with pytest.raises(InputError, match=r"unknown kind of program file '\.foo'.*\.ngc"):
        reader(".foo")
    with pytest.raises(InputError, match="unknown controller of a program file 'heidenhain'"):
        reader(".nc", "heidenhain")
    assert len(set(suffixes())) == len(suffixes())


def test_a_program_file_is_a_job_that_holds_its_text(square):
    job = Job.load(square)
    assert (job.name, job.source, job.program["controller"]) == ("square", "square.ngc", "linuxcnc.Program")
    assert job.program["text"] == SQUARE
    again = Job.model_validate(job.model_dump())
    assert np.array_equal(again.setpoints.position, job.setpoints.position)
    tip = job.setpoints.position[:, :2]
    assert tip.min(axis=0) == pytest.approx([0, 0], abs=EXACT)
    assert tip.max(axis=0) == pytest.approx([30, 20], abs=1e-6)


def test_a_job_may_name_a_program_file_beside_it(square):
    file = square.with_name("mine.toml")
    file.write_text('name = "mine"\n[program]\nfile = "square.ngc"\n[servo]\nintegral_time = 0.05\n')
    job = Job.load(file)
    assert job.servo.integral_time == 0.05
    assert job.setpoints.position == pytest.approx(Job.load(square).setpoints.position, abs=EXACT)
    file.write_text('name = "mine"\n[program]\nfile = "nowhere.ngc"\n')
    with pytest.raises(InputError, match=r"nowhere\.ngc: cannot be read: No such file"):
        Job.load(file)
    file.write_text('name = "mine"\n[program]\nfile = 3\n')
    with pytest.raises(InputError, match=r"program\.file = 3: must be the path of a program file"):
        Job.load(file)


def test_a_program_is_placed_turned_and_scaled_on_the_work(square):
    placed = Job.load(square, placement={"x": 5.0, "y": -3.0, "rotate": 90.0, "scale": 0.5})
    tip = placed.plan().box
    # (10..30, 0..20) turned by 90 degrees and halved is (-10..0, 5..15), then shifted; the start stays at zero
    assert tip[0, 0] == pytest.approx(-5, abs=1e-6)
    assert tip[1, 1] == pytest.approx(12, abs=1e-6)
    free, scaled = Job.load(square).plan(), placed.plan()
    assert scaled.length < free.length
    with pytest.raises(InputError, match=r"a program of trio\.MoveSpiral cannot be placed on the work"):
        Job.load("an225", placement={"x": 1.0})


def test_a_placement_turns_quarters_exactly_and_keeps_lengths():
    one = Placement(1.0, 2.0, 90.0)
    assert one.point([[1.0, 0.0, 5.0]]).tolist() == [[1.0, 3.0, 5.0]]
    three = Placement(rotate=33.0, scale=2.0)
    vectors = np.random.default_rng(1).normal(size=(20, 3))
    assert np.linalg.norm(three.direction(vectors), axis=1) == pytest.approx(2 * np.linalg.norm(vectors, axis=1))
    for wrong, text in (({"scale": 0.0}, "placement.scale = 0"), ({"x": np.nan}, "placement.x = nan mm")):
        with pytest.raises(InputError, match=text):
            Placement(**wrong)


def test_errors_name_the_file_and_the_line(square):
    square.write_text(SQUARE.replace("G1 X10\n", "G1 X10 K\n"))
    with pytest.raises(InputError, match=r"square\.ngc: .*line 5"):
        Job.load(square).plan()
    square.write_text(SQUARE.replace("X30", "X300"))
    with pytest.raises(InputError, match=r"^square\.ngc: line 3: x = .* must lie in the travel -150 to 150 mm"):
        Job.load(square, machine="xy").plan()
    with pytest.raises(InputError, match=r"^square\.ngc: line 3: "):
        Job.load(square, machine="xy").run()


def test_a_program_at_another_speed(square):
    slow, fast = Job.load(square, speed=10.0), Job.load(square, speed=20.0)
    assert slow.plan().duration > 1.5 * fast.plan().duration


def test_the_command_checks_without_writing(gantrysim_command, square, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    status, output, _ = gantrysim_command("check", square, "--at", "1,2")
    assert status == 0
    assert "linuxcnc.Program on xy, not simulated" in output
    assert "requested path" in output
    assert sorted(tmp_path.iterdir()) == before
    status, output, errors = gantrysim_command("check", square, "--at", "140,0")
    assert status == 2
    assert errors.startswith("error: square.ngc: line 3: x = 1")
    assert "requested path" in output  # the extents, of which the error names one
    status, output, _ = gantrysim_command("check", square, "--speed", "20")
    assert (status, "does not act" in output) == (0, False)
    _, output, _ = gantrysim_command("check", square, "--speed", "900")
    assert "--speed 900 does not act in full: glue is laid at" in output
    status, _, errors = gantrysim_command("check", square, "--at", "1")
    assert status == 2
    assert "--at 1: must be X,Y or X,Y,Z [mm]" in errors


def test_the_command_runs_a_program_file(gantrysim_command, square, tmp_path):
    out = tmp_path / "out"
    status, _, _ = gantrysim_command(
        "run", square, "--no-video", "--no-report", "--no-causes", "--no-improve", "--speed", 30, "--out", out
    )
    assert status == 0
    written = json.loads((out / "summary.json").read_text())
    assert (written["job"], written["fault"]) == ("square", None)
    again = Job.load(out / "job.toml")
    assert again.program["text"] == SQUARE


def test_a_program_whose_valve_never_opens_is_noted(tmp_path, gantrysim_command):
    file = tmp_path / "part.ngc"
    file.write_text("G21 G90 G61 M64 P0\nG1 X40 F1800\nM65 P0\nG1 Y20\nM2\n")
    valve = ("--set", "program.dispense.on=['M3']")
    status, output, errors = gantrysim_command("check", file, *valve)
    assert status == 0, errors
    assert "note: no glue is laid" in " ".join(output.split())
    codes = ("--set", "program.dispense.on=['M64 P0']", "--set", "program.dispense.off=['M65 P0']")
    status, output, errors = gantrysim_command("check", file, *codes)
    assert status == 0, errors
    assert "40.000 mm with glue" in " ".join(output.split())
    assert "no glue" not in output


def test_check_tells_the_time_at_rest_in_which_dots_are_laid(gantrysim_command, tmp_path):
    file = tmp_path / "dots.csv"
    file.write_text("x,y,kind,time\n0,0,dot,0.2\n5,0,dot,0.1\n10,5,dot,0.3\n")
    status, output, errors = gantrysim_command("check", file)
    assert status == 0, errors
    text = " ".join(output.split())
    assert "0.000 mm with glue, and 0.60 s at rest" in text
    assert "no glue is laid" not in text
