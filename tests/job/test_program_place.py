"""A program file as it is: its dialect by its content, its subprograms beside it, its place on an open machine."""

import re

import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.job.loaded import OpenValues
from gantrysim.job.loading import is_gcode, recognised_dialect
from gantrysim.job.settings import GLUE

PLAIN = "G21 G90\nG0 X10 Y5\nG1 X30 F600\nM2\n"
DIALECTS = {
    "linuxcnc.Program": (PLAIN, "$H\n$30=1000\n?\n(laser)\n" + PLAIN, "o100 while [#1 LT 3]\nG1 X#1 F100\n"),
    "slicer.Program": (
        "G28\nG1 X10 E0.5 F1200\nG1 Y10 E1\n",
        "M82\nG1 X3 F100\nG1 Y4\n",
        "G92 E0\nG1 X2\nG1 X3\n",
        "G21\nG28\nG1 X10 Y10 Z0.3 F1200\nG4\nG1 X40\nM84\n",
        "N1 M17\nN2 G1 X10 F1200\nN3 M400\n",
    ),
    "fanuc.Program": (
        "%\nO1000\nG01 X5 F60\n%\n",
        "WHILE[#1LT3]DO1\nG01X#1F60\n#1=#1+1\nEND1\n",
        "O1(pad)\nG0X1\n",
        "#1=0\nWH[#1LT3]DO1\nG01X#1F60\n#1=#1+1\nEN1\n",
        "#1=0\nN5 #1=#1+1\nG01X#1F60\nIF[#1LT3]GO5\n",
        "G0X1\nG01X9F9,R2\nY9\n",
        "G68X1R9\nG0X3\n",
    ),
}


def file_of(folder, text, name="part.ngc"):
    file = folder / name
    file.write_text(text)
    return file


@pytest.mark.parametrize("controller", DIALECTS)
def test_the_dialect_is_that_of_the_content(controller, tmp_path):
    for text in DIALECTS[controller]:
        assert is_gcode(text)
        assert recognised_dialect(text).controller == controller
    job = Job.load(file_of(tmp_path, DIALECTS[controller][0], "part.txt"))
    assert job.program["controller"] == controller
    assert f"read by {controller}, as it" in job.notes[0]
    job.plan()


FANUC_CODES = "it has words of FANUC's alone, as G65, G68, G51.1 or ,R"
FANUC_FLOW = "it has WHILE, IF or GOTO without O words"
FED = "its moves feed material by E"
PRINTER = "it has codes of printers' firmware"
READ_AS_LINUXCNC = "it has no O number and feeds no material by E"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("%\nO0001\nG0 X1", "it begins with an O number"),
        ("(O0001)\nG0 X1", READ_AS_LINUXCNC),
        ("O100 sub\nG0 X1\nO100 endsub", READ_AS_LINUXCNC),
        ("N10 IF [#1 EQ 2] GOTO 20\nG0 X1", FANUC_FLOW),
        ("WHILE [#1 LT 2] DO1\nG0 X1\nEND1", FANUC_FLOW),
        ("O1 while [#1 LT 2]\nG0 X1\nO1 endwhile", READ_AS_LINUXCNC),
        ("G65 P9010 A1\nG0 X1", FANUC_CODES),
        ("G01 X5 F60,R2\nY5", FANUC_CODES),
        ("G51.1 X0\nG0 X1", FANUC_CODES),
        ("G51.2 X0\nG0 X1", READ_AS_LINUXCNC),
        ("G0 X1 (G68 is not here)", READ_AS_LINUXCNC),
        ("G1 X1 E0.2 F600", FED),
        ("G1 X1 ; E0.2", READ_AS_LINUXCNC),
        ("M104 S200\nG0 X1", PRINTER),
        ("SET_FAN_SPEED FAN=a\nG0 X1", PRINTER),
        ("M110\nG0 X1", READ_AS_LINUXCNC),
    ],
)
def test_the_dialect_is_told_by_the_words_that_others_have_not(text, reason):
    dialect = recognised_dialect(text)
    assert dialect.reason == reason
    fanuc = reason in (FANUC_CODES, FANUC_FLOW, "it begins with an O number")
    slicer = reason in (FED, PRINTER)
    assert dialect.controller == ("fanuc.Program" if fanuc else "slicer.Program" if slicer else "linuxcnc.Program")


@pytest.mark.parametrize(
    ("text", "is_program"),
    [
        ("G0 X1\nhello\n", False),
        ("G0 X1\nG1 Y2\nhello\n", True),
        ("M3\nT1\nF600\n", False),
        ("X1 Y2\n", True),
        ("(G0 X1)\n", False),
        ("", False),
    ],
)
def test_most_lines_of_a_program_are_blocks_and_one_is_a_motion(text, is_program):
    assert is_gcode(text) == is_program


def test_a_file_that_is_neither_a_program_nor_a_job(tmp_path):
    file = file_of(tmp_path, "Dear reader,\nthis is a letter.\n", "letter.txt")
    with pytest.raises(InputError, match=r"is neither a job in TOML nor G-code, and \.txt is not a suffix"):
        Job.load(file)
    assert not is_gcode("name = 'x'\n[program]\ncontroller = 'trio.Basic'\n")


def test_lines_of_senders_and_comments_in_a_printers_file(tmp_path):
    text = "(by hand (twice)\n$X\nG28 X Y\nG0 X25 (no F yet)\nG1 X35 E1 F600\nG1 X45 E2 ; end\n"
    job = Job.load(file_of(tmp_path, text, "part.gcode"), ["acceleration=1e6", "machine=xy"])
    # 25 mm at Klipper's 25 mm/s before the first F, then 20 mm at 10 mm/s
    assert job.controller.duration == pytest.approx(1.0 + 2.0, rel=1e-3)
    assert any("1 moves before the first F run at 25 mm/s" in note for note in job.notes)


def test_subprograms_in_files_beside_the_program(tmp_path):
    file_of(tmp_path, "o<leg> sub\nG91 G1 X#1 F600\no<turn> call\no<leg> endsub\nM2\n", "leg.ngc")
    file_of(tmp_path, "o<turn> sub\nG91 G1 Y7\nG90\no<turn> endsub\nM2\n", "turn.ngc")
    job = Job.load(file_of(tmp_path, "G21 G61\no<leg> call [12]\nM2\n"))
    assert job.controller.requested.position(19.0)[0] == pytest.approx([12, 7, 0])
    assert sorted(job.program["subprograms"]) == ["leg", "turn"]
    with pytest.raises(InputError, match=r"unknown subprogram '\.\./leg'"):
        Job.load(file_of(tmp_path, "o<../leg> call\nM2\n")).plan()


def test_subprograms_of_fanuc_in_files_beside_the_program(tmp_path):
    file_of(tmp_path, "G91 G01 X5\nM98 P32\nM99\n", "O1000.nc")  # its number is that of its name
    file_of(tmp_path, "%\nO0032 (side)\nG91 G01 Y2\nM99\n%\n", "32.nc")
    file = file_of(tmp_path, "O1\nG90 G01 X10 F600\nM98 P31000\nM30\n", "part.nc")
    job = Job.load(file)
    assert sorted(job.program["subprograms"]) == ["1000", "32"]
    path = job.controller.requested
    assert path.position(path.length)[0] == pytest.approx([25, 6, 0])
    lines = job.controller.lines_at(np.array([0.5, 1.2]))  # 10 mm at 10 mm/s, then in a file of its own
    assert lines.tolist() == [2, 0]
    file_of(tmp_path, "G91 G01 X5\nN7 Y3 Q1\nM99\n", "O1000.nc")
    with pytest.raises(InputError, match=r"in block N7 of 1000, line 2: address Q is not used in G01"):
        Job.load(file)


def test_a_subprogram_that_is_not_called_is_nobodys_business(tmp_path):
    """Only what has run stands in the job that is written and sent on."""
    file_of(tmp_path, "o<leg> sub\nG91 G1 X#1 F600\no<leg> endsub\nM2\n", "leg.ngc")
    file_of(tmp_path, "o<notes> sub\n(my own)\no<notes> endsub\n", "notes.ngc")
    file_of(tmp_path, "my own", "diary.txt")
    calls = "o1 if [1 EQ 0]\no<notes> call\no<diary> call\no1 endif\no<Leg> call [12]\n"
    job = Job.load(file_of(tmp_path, f"G21 G61\n{calls}M2\n"))
    assert list(job.program["subprograms"]) == ["leg"]
    assert "my own" not in job.toml()
    assert job.controller.requested.length == pytest.approx(12)
    file_of(tmp_path, "(my own) M3\nM99\n", "42.txt")
    file_of(tmp_path, "G91 G01 X5\nM99\n", "O1000.nc")
    file = file_of(tmp_path, "O1\nG90 G01 X10 F600\nIF [1 EQ 1] GOTO 5\nM98 P42\nN5 M98 P1000\nM30\n", "part.nc")
    job = Job.load(file)
    assert list(job.program["subprograms"]) == ["1000"]
    assert "my own" not in job.toml()
    assert job.controller.requested.length == pytest.approx(15)
    alone = Job.load(file_of(tmp_path, "O1\nG01 X10 F600\nIF [1 EQ 1] GOTO 5\nM98 P42\nN5 M30\n", "part.nc"))
    assert alone.program["subprograms"] == {}


def test_programs_that_ran_in_part_are_kept_whole_and_run_again_from_the_job_alone(tmp_path):
    legs = "o<leg> sub\nG91 G1 X#1 F600\no<leg> return\n(my own)\nG1 X99\no<leg> endsub\nM2\n"
    file_of(tmp_path, legs, "leg.ngc")
    job = Job.load(file_of(tmp_path, "G21 G61\no<leg> call [12]\nM2\n(my own, too)\n"))
    assert job.program["subprograms"] == {"leg": legs}
    assert "(my own, too)" in job.program["text"]
    # Trio BASIC: what it names with RUN is kept, whether or not it ran
    file_of(tmp_path, "MOVE(5)\n' my own\n", "side.bas")
    basic = Job.load(file_of(tmp_path, 'SPEED=10\nMOVE(5)\nIF 1=0 THEN RUN "side"\n', "part.bas"))
    assert "my own" in basic.toml()
    (tmp_path / "alone").mkdir()
    for written in (job, basic):
        again = Job.load(file_of(tmp_path / "alone", written.toml(), "job.toml"))
        assert again.controller.requested.length == pytest.approx(written.controller.requested.length)


@pytest.mark.parametrize(
    ("name", "program", "call"),
    [
        ("notes.ngc", "part.ngc", "G1 X5 F600\no<notes> call\nM2\n"),
        ("O0042.nc", "part.nc", "O1\nG01 X5 F600\nM98 P42\nM30\n"),
        ("notes.bas", "part.bas", 'SPEED=10\nINCLUDE "notes"\nMOVE(5)\n'),
    ],
)
def test_a_subprogram_that_is_a_link_out_of_the_folder_is_refused(tmp_path, name, program, call):
    folder = tmp_path / "theirs"
    folder.mkdir()
    own = file_of(tmp_path, "my own", "own.txt")
    (folder / name).symlink_to(own)
    said = f"^{re.escape(str(folder / name))}: is a link to {re.escape(str(own))}, outside the folder: put a copy"
    with pytest.raises(InputError, match=said):
        Job.load(file_of(folder, call, program))


def test_a_subprogram_that_is_a_link_within_the_folder_is_read(tmp_path):
    (tmp_path / "turn.ngc").symlink_to(file_of(tmp_path, "o<turn> sub\nG91 G1 Y7 F600\no<turn> endsub\n", "v2.ngc"))
    job = Job.load(file_of(tmp_path, "o<turn> call\nM2\n"))
    assert job.controller.requested.length == pytest.approx(7)


def test_a_travel_error_of_fanuc_names_its_line(tmp_path):
    file = file_of(tmp_path, "O1\nG01 X10 F6000\nY5\nX400\nY0\n", "part.nc")
    with pytest.raises(InputError, match=r"line 4: x = 400 mm at t = .*it leaves it at"):
        Job.load(file, machine="xy").plan()


def test_a_machine_that_lacks_an_axis_of_the_program_is_named(tmp_path):
    file = file_of(tmp_path, PLAIN.replace("X30", "X30 Z2"))
    with pytest.raises(InputError, match=r"the program moves axis .z.: machine xy has x, y"):
        Job.load(file, machine="xy").plan()


def test_depths_are_laid_on_the_work(tmp_path):
    text = "G90 G0 X30 Z-5\nG1 Z3 F600\nX50 Z4\nX60\nG0 Z-5\nM30\n"
    job = Job.load(file_of(tmp_path, text), placement={"z_down": True})
    heights = text.replace("Z-", "Z+").replace("Z3", "Z-3").replace("Z4", "Z-4")
    plain = Job.load(file_of(tmp_path, heights, "up.ngc"))
    assert job.program["placement"]["z"] == plain.program["placement"]["z"] == pytest.approx(4, abs=1e-3)
    np.testing.assert_allclose(job.setpoints.position, plain.setpoints.position, atol=1e-9)


@pytest.mark.parametrize(
    ("low", "size", "height", "choice"),
    [(-150, 300, 0, ""), (20, 200, -60, "shifted"), (-400, 250, 3, "travel"), (0, 1000, 90, "travel")],
)
def test_any_extent_has_a_machine_where_none_is_named(low, size, height, choice, tmp_path):
    text = f"G21 G90 G61 F6000\nG0 X{low} Z{height + 5}\nG1 Z{height}\nG1 X{low + size}\nM2\n"
    job = Job.load(file_of(tmp_path, text))
    x = job.setpoints.position[:, 0]
    travel = job.built_machine.plain_axes[0].travel
    assert travel[0] <= x.min() <= x.max() <= travel[1]
    assert ("program shifted by" in job.notes[0]) == (choice == "shifted")
    assert ("its travel made" in job.notes[0]) == (choice == "travel")
    assert job.setpoints.position[-1, 2] == pytest.approx(0, abs=1e-3)
    assert job.built_machine.physics.jnt_range.max() >= x.max() / 1000  # also of the machine that is stepped


def test_what_is_placed_or_named_is_refused_outside_the_travel(tmp_path):
    file = file_of(tmp_path, PLAIN.replace("X30", "X300"))
    for given_values in ({"machine": "xy"}, {"placement": {"x": 0.0, "y": 0.0}}):
        with pytest.raises(InputError, match="must lie in the travel -150 to 150 mm"):
            Job.load(file, **given_values).plan()
    job = Job.load(file, ["machine=xy", "travel={x=[-5, 305]}"])
    assert job.plan().travel["x"].bounds == (-5, 305)
    with pytest.raises(InputError, match=r"travel\.x = 5 to 1 mm: must be ascending"):
        Job.load(file, ["machine=xy", "travel={x=[5, 1]}"]).plan()


def test_feeds_above_the_machines_speed_are_run_at_it(tmp_path):
    file = file_of(tmp_path, "G21 G90 G61\nG1 X100 F90000\nG1 X0\nM2\n")
    job = Job.load(file, ["program.acceleration=20000"])
    assert list(job.program["axis_speeds"][:2]) == [1000.0, 1000.0]
    assert job.plan().speeds["x"].largest == pytest.approx(1000.0, rel=1e-3)
    # ramps of 1000/20000 s over 25 mm each, and 50 mm between them
    assert job.controller.duration == pytest.approx(2 * (2 * 0.05 + 0.05), rel=5e-3)
    assert any("Feeds above the machine's speed" in note for note in job.notes)


@pytest.mark.parametrize("block", [64, 1_000_000])
def test_the_place_that_is_named_is_the_worst_of_the_whole_program(tmp_path, monkeypatch, block):
    """However many ticks are looked at together."""
    monkeypatch.setattr("gantrysim.base.columns.BLOCK", block)
    text = "G21 G90\nG0 X155\nG0 X0\nG0 X170\nG0 X0\nG0 X160\n"
    job = Job.load(file_of(tmp_path, text), ["machine=xy", "placement.x=0", "placement.y=0"])
    with pytest.raises(InputError, match=r"x = 170 mm at t = .* s: must lie in the travel -150 to 150 mm"):
        job.plan()


@pytest.mark.parametrize(
    ("content", "opened"),
    [
        ({}, {"machine", "glue", "integral_time", "travel", "speeds"}),
        (
            {"source": "a.ngc"},
            {"machine", "glue", "integral_time", "travel", "speeds", "height", "place", "acceleration"},
        ),
        ({"machine": "xy"}, {"glue", "integral_time", "speeds"}),
        ({"travel": {"x": [0, 1]}}, {"machine", "glue", "integral_time", "speeds"}),
        *(({"dispenser": {key: 0}}, {"machine", "integral_time", "travel", "speeds"}) for key in GLUE),
        *(
            ({"servo": servo}, {"machine", "glue", "travel", "speeds"})
            for servo in ({"integral_time": 0.1}, {"law": "pd"}, {"law": ["pd", "zv"]}, {"kp": 1.0})
        ),
        ({"servo": {"law": "p-pi"}}, {"machine", "glue", "integral_time", "travel", "speeds"}),
        ({"servo": {"kp": None}}, {"machine", "glue", "integral_time", "travel", "speeds"}),
        ({"program": {"axis_speeds": [1]}}, {"machine", "glue", "integral_time", "travel"}),
        (
            {"source": "a.ngc", "machine": "xy", "program": {"placement": {"y": 0.0, "z": 1.0}}},
            {"glue", "integral_time", "speeds", "gap", "acceleration"},
        ),
        (
            {"source": "a.ngc", "machine": "xy", "program": {"placement": {"z": 1.0}}, "bead": {"gap": 0.3}},
            {"glue", "integral_time", "speeds", "place", "acceleration"},
        ),
    ],
)
def test_a_file_leaves_open_what_it_does_not_state(content, opened):
    values = OpenValues.of(content)._asdict()
    assert values.pop("dialect") is None
    assert {name for name, is_open in values.items() if is_open} == opened


RISES = {
    "part.ngc": ("G21 G90 G64 P0.1\nF600\nG1 Z30\nG1 X40\nG1 Y20\nM2\n", 30.0),
    "part.gcode": ("M83\nG0 F6000 X10 Y10 Z0.2\nG1 F1800 X40 Y10 E0.9\nG1 X40 Y40 E0.9\n", 0.2),
    # from above nothing is cut below the bead
    "above.gcode": ("M83\nG0 F6000 Z5\nG0 X10 Y10 Z0.2\nG1 F1800 X40 Y10 E0.9\nG1 X40 Y40 E0.9\n", 0.2),
}


@pytest.mark.parametrize("name", RISES)
def test_a_rise_to_the_first_bead_does_not_set_its_height(tmp_path, name):
    """Where the corner at the end of the rise is cut, the nozzle passes below the bead that lies on the work."""
    text, height = RISES[name]
    job = Job.load(str(file_of(tmp_path, text, name)))
    assert job.program["placement"]["z"] == pytest.approx(-height, abs=1e-9)
    glue = job.setpoints.dispense
    assert job.machine == "xyz"
    if "z" in job.setpoints.axes:
        assert job.setpoints.position[glue, 2].min() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("above", [0.0, 0.05, 0.3, 0.5])
@pytest.mark.parametrize("text", ["G1 Z0.3\nG1 X40\nG1 Y20", "G0 Z0.3\nG1 X40\nG1 Y20", "G0 X10 Z0.3\nG1 X40\nG1 Y20"])
def test_a_rise_does_not_set_the_height_of_the_needle_where_the_place_is_given(tmp_path, text, above):
    """By hand, too, it is the height of the beads that counts: 0.5 mm, the gap at the work's, and what lies above."""
    file = file_of(tmp_path, f"G21 G90\nF1200\n{text}\nM2\n")
    job = Job.load(file, [f"program.placement.z={above - 0.3}"])
    assert job.built_machine.gap == pytest.approx(0.5)
    assert job.bead.gap == (pytest.approx(0.5 + above, abs=1e-9) if above else None)
    assert any(f"needle {0.5 + above:g} mm above the work" in note for note in job.notes) == bool(above)


def test_a_program_that_rises_from_its_start_to_the_work_lies_there(tmp_path):
    """Begun above, all of it lies at the height 0, where it has no z."""
    file_of(tmp_path, "G21 G90\nG1 Z0 F1200\nG1 X40\nG1 Y20\nM2\n")
    job = Job.load(file_of(tmp_path, 'name = "a"\n[program]\nfile = "part.ngc"\nstart = [0, 0, -0.3]\n', "a.toml"))
    assert job.program["placement"]["z"] == pytest.approx(0.0)
    assert job.program["start"] == pytest.approx([0.0, 0.0, 0.0])
