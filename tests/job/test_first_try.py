"""A first try of one's own file: which machine, how much glue, which servo, and the sentence that says so."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim import Bead, Budget, InputError, Job
from gantrysim.glue.bead import BeadSettings
from gantrysim.glue.bead.section import Section
from gantrysim.job.loaded import needle_area
from gantrysim.job.loading import builtin_jobs
from gantrysim.job.settings import INTEGRAL_TIME, MACHINES, smallest_machine
from gantrysim.machine.machine import Machine, builtin_models
from gantrysim.report.rows import bead_rows
from gantrysim.results.glue import BeadWidth

from support.soaked import suite_runs

PARTS = sorted((Path(__file__).parent / "parts").iterdir())
FLAT = "G21 G90 G17 G64 P0.05\nF1200\nG1 X30\nG1 Y20\nG1 X0\nG1 Y0\nM2\n"
RAISED = FLAT.replace("F1200", "G0 Z5\nG1 Z0 F1200")
FACE = 0.82  # outer diameter of the needle that the built-in machines draw [mm]
GAP = 0.5  # height of their nozzle above the work [mm]

OTHERS = {
    "trio": ("part.bas", "BASE(0,1)\nSPEED=50:ACCEL=1000:DECEL=1000\nMOVE(30,20)\nWAIT IDLE\n", "xy"),
    "trio with z": ("part.bas", "BASE(0,1,2)\nSPEED=50:ACCEL=1000:DECEL=1000\nMOVE(30,20,5)\nWAIT IDLE\n", "xyz"),
    "softmc": (
        "part.prg",
        "common shared bench as group Axnm = a1 Axnm = a2 Axnm = a3\nprogram\nattach bench\nen = 1\nmove {0, 0, 0}\n"
        "move {10, 0, 4}\ndetach bench\nend program\n",
        "xyz",
    ),
    "drawing": (
        "part.svg",
        '<svg xmlns="http://www.w3.org/2000/svg" width="40mm" height="40mm" viewBox="0 0 40 40">'
        '<path d="M 5 5 H 30 V 20"/></svg>',
        "xy",
    ),
}


def written(folder, text, name="part.ngc"):
    file = folder / name
    file.write_text(text)
    return file


def choice_of(job):
    return [note for note in job.notes if note.startswith("chosen")]


def test_the_table_of_machines_is_that_of_the_models_smallest_first():
    cartesian = {}
    for name in builtin_models():
        machine = Machine(name)
        if machine.kinematics.axes_are_coordinates and not machine.turns_work:
            cartesian[name] = machine.axis_names
    assert cartesian == MACHINES
    sizes = [len(axes) for axes in MACHINES.values()]
    assert sizes == sorted(sizes)
    assert [smallest_machine(axes) for axes in (("x", "y"), ("x", "z"), ("x", "r"))] == ["xy", "xyz", "xyzr"]


@pytest.mark.parametrize("part", suite_runs(PARTS, 0), ids=lambda part: part.name)
def test_ordinary_files_check_and_run_with_glue(part, gantrysim_command, tmp_path):
    status, printed, _ = gantrysim_command("check", part)
    assert status == 0
    assert printed.count("chosen, as nothing was given") == 1
    status, printed, _ = gantrysim_command(
        "run", part, "--no-video", "--no-report", "--no-causes", "--no-improve", "--out", tmp_path / "out", "-v"
    )
    assert status == 0
    assert "chosen, as nothing was given: machine xy" in printed
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["fault"] is None
    assert summary["bead"]["volume_mm3"] > 50
    assert summary["machine"].split("-")[0] == ("xy" if part.name == "flat-logo.tap" else "xyz")
    again = Job.load(tmp_path / "out" / "job.toml")
    assert choice_of(again) == []  # what was chosen is given there
    assert again.digest == Job.load(part).digest


@pytest.mark.parametrize("case", OTHERS)
def test_other_languages_and_drawings(case, tmp_path):
    name, text, machine = OTHERS[case]
    job = Job.load(written(tmp_path, text, name))
    assert job.machine == machine
    assert job.dispenser.area > 0
    job.plan()


def test_a_rotary_axis_takes_the_machine_that_turns_its_needle(tmp_path):
    text = "%\nO1\nN10 G17 G21 G90\nN20 G01 X20 C90 F1200\nN30 M30\n%\n"
    assert Job.load(written(tmp_path, text, "part.nc"), controller="fanuc").machine == "xyzr"


def test_the_needle_presses_the_chosen_bead_just_flat(tmp_path):
    job = Job.load(written(tmp_path, FLAT))
    areas = [np.array([share * job.dispenser.area]) for share in (0.98, 1.02)]
    sections = [Section(area, np.array([GAP]), 60.0, FACE) for area in areas]
    assert float(sections[0].groove[0]) == 0
    assert float(sections[0].flat[0]) == pytest.approx(FACE, rel=0.1)
    assert float(sections[1].groove[0]) > 0
    # a segment of height g that meets the surface at 60 deg has the radius 2 g; the flat adds f g
    segment = 4 * GAP**2 * (math.pi / 3 - math.sqrt(3) / 4)
    assert job.dispenser.area == pytest.approx(segment + FACE * GAP, rel=5e-3)
    thin = Job.load(written(tmp_path, FLAT), ["needle.bore=27G"])
    assert thin.dispenser.area < job.dispenser.area


def test_the_servo_is_that_of_the_built_in_jobs(tmp_path):
    assert {Job.load(name).servo.integral_time for name in builtin_jobs()} == {INTEGRAL_TIME}
    file = written(tmp_path, FLAT)
    chosen = Job.load(file)
    assert chosen.servo.integral_time == INTEGRAL_TIME
    without = Job.load(file, ["integral_time=inf"])
    assert 3 * _following_rms(chosen) < _following_rms(without)


def _following_rms(job):
    budget = Budget(job.run())
    return budget.values_of(budget.parts["servo"]).rms


def test_what_is_given_is_never_replaced(tmp_path):
    file = written(tmp_path, RAISED)
    assert Job.load(file).machine == "xyz"
    assert Job.load(file, machine="xyzr").machine == "xyzr"
    assert Job.load(file, ["machine=xyzr"]).machine == "xyzr"
    for given in ("flow=0", "area=0", "flow=30", "area=2.5"):
        dispenser = Job.load(file, [f"dispenser.{given}"]).dispenser
        key, _, value = given.partition("=")
        assert getattr(dispenser, key) == float(value)
        assert dispenser.flow + dispenser.area == float(value)
    everything = ["machine=xyz", "dispenser.flow=30", "integral_time=0.05"]
    assert choice_of(Job.load(file, everything)) == []
    own_gains = Job.load(file, ["machine=xyz", "dispenser.flow=30", "kp=0.7", "kd=0.008"])
    assert choice_of(own_gains) == []  # an integral term would follow from another kp
    assert set(own_gains.built_servo.per_axis("ki")) == {0.0}
    (note,) = choice_of(Job.load(file, ["machine=xyz", "law=pd"]))
    assert "glue" in note
    assert "machine" not in note
    assert "integral" not in note


def test_a_job_file_has_the_same_defaults_as_a_program_file(tmp_path):
    program = Job.load(written(tmp_path, RAISED))
    file = written(tmp_path, 'name = "part"\n[program]\nfile = "part.ngc"\n', "mine.toml")
    job = Job.load(file)
    assert job.digest == program.digest
    assert job.machine == program.machine == "xyz"
    assert choice_of(job) == choice_of(program)


def test_a_program_of_fanuc_has_an_acceleration_for_its_rapid_moves(tmp_path):
    """Without one they start at full speed, which no drive can follow."""
    text = "O1\nG00 Z5.\nG01 Z0. F500.\nX20. F1200.\nG00 Z5.\nM30\n"
    job = Job.load(written(tmp_path, text, "part.nc"))
    assert job.controller.acceleration == 1000
    assert "acceleration 1000 mm/s²" in choice_of(job)[0]
    assert Job.load(written(tmp_path, text, "part.nc"), {"program.acceleration": 700.0}).controller.acceleration == 700
    # up, down, along and up from rest to rest, the rapid moves at a triangle of their speed
    expected = 2 * 2 * math.sqrt(5 / 1000) + (5 / (25 / 3) + 25 / 3 / 1000) + (20 / 20 + 20 / 1000)
    assert job.controller.duration == pytest.approx(expected, rel=1e-3)


def test_the_sentence_has_the_flow_at_the_programs_speed(tmp_path):
    file = written(tmp_path, RAISED)
    (note,) = choice_of(Job.load(file))
    assert "machine xyz, the smallest for this program (--machine NAME)" in note
    assert "glue 1.02 mm² times path speed, 20.4 mm³/s at 20 mm/s" in note
    assert "--set dispenser.area=1.02 or --set dispenser.flow=100" in note
    assert "--set servo.integral_time=inf for none" in note
    (faster,) = choice_of(Job.load(file, speed=40.0))
    assert "40.8 mm³/s at 40 mm/s" in faster
    for option in ("dispenser.area=1.02", "dispenser.flow=100", "servo.integral_time=inf"):
        Job.load(file, [option])  # as the sentence has them


@pytest.mark.parametrize("height", [-3.0, -0.2, 0.0, 0.3, 100.0])
def test_a_program_of_any_height_lays_its_lowest_bead_on_the_work(height, tmp_path):
    text = RAISED.replace("Z5", f"Z{height + 5}").replace("Z0", f"Z{height}")
    job = Job.load(written(tmp_path, text))
    setpoints = job.setpoints
    z = setpoints.position[:, 2]
    # the corner below the plunge is rounded
    moves = np.abs(np.diff(setpoints.position[:, :2], axis=0)).max(axis=1) > 0
    along = z[1:][setpoints.dispense[1:] & moves]
    assert along.min() == pytest.approx(0.0, abs=1e-4)
    assert np.median(along) == pytest.approx(0.0, abs=1e-4)
    assert z.max() == pytest.approx(5.0, abs=1e-4)
    assert z.min() > -1e-4
    (note,) = choice_of(job)
    assert ("so that its lowest bead lies on the work" in note) == (height != 0)
    if height:
        word = "raised" if height < 0 else "lowered"
        assert f"program {word} by {abs(height):g} mm" in note
        assert "program.placement.z=0 for its own heights" in note


@pytest.mark.parametrize("options", [["bead.gap=0.9"], ["program.placement.z=0.1"]])
def test_a_needle_that_runs_higher_lays_the_same_glue(options, tmp_path):
    """The needle of the machine is 0.5 mm above the work, and the program's bead at -0.3 mm: 0.4 mm higher either way.

    A sessile bead of 60 deg of that section is W = sqrt(8 sin^2 A / (2 a - sin 2 a)) wide.
    """
    text = RAISED.replace("Z0", "Z0.3")
    file = written(tmp_path, text)
    usual = Job.load(file)
    higher = Job.load(file, options)
    assert usual.bead.gap is None
    assert higher.bead.gap == pytest.approx(0.9)
    assert higher.dispenser == usual.dispenser
    (note,) = choice_of(higher)
    assert "what the needle presses flat 0.5 mm above the work" in note
    before = Bead(usual.follow(), usual.bead)
    bead = Bead(higher.follow(), higher.bead)
    assert bead.nominal == pytest.approx(before.nominal, rel=1e-12)
    assert bead.requested_volume == pytest.approx(before.requested_volume, rel=1e-4)
    # the bead is another: pressed flat before, and free under the higher needle
    assert bead.width.max() < 0.95 * before.width.max()
    assert bead.height.max() > 1.05 * before.height.max()
    # in the verdict each is judged against the width that its section has under its needle
    for job, each in ((usual, before), (higher, bead)):
        limits = job.limits(each.run.face, float(each.nominal_section.width[0]))
        judged = BeadWidth(each, limits)
        assert np.abs(judged.error[judged.judged]).max() < 1.0
    # and the page gives the same wanted section and volume
    sections = [dict(row[0::2] for row in bead_rows(each.values))["bead width"] for each in (before, bead)]
    assert {text.split("; ")[1] for text in sections} == {"nominal section 1.02 mm²"}
    angle = math.radians(60)
    sessile = math.sqrt(8 * math.sin(angle) ** 2 * usual.dispenser.area / (2 * angle - math.sin(2 * angle)))
    assert float(bead.nominal_section.width[0]) == pytest.approx(sessile, rel=1e-3)
    assert float(bead.nominal_section.height[0]) < 0.9


@pytest.mark.parametrize("gap", [None, 0.3, 0.7])
def test_a_needle_that_hangs_high_at_home_lays_the_same_glue_at_any_height(gap):
    """Half its face above the work: a segment of that height, and the face times it."""
    high = SimpleNamespace(gap=30.0, needle=(FACE, 20.0))
    height = 0.5 * FACE
    radius = height / (1 - math.cos(math.radians(60)))
    segment = radius**2 * (math.radians(60) - math.sin(math.radians(120)) / 2)
    assert needle_area(high, None, BeadSettings(gap=gap)) == pytest.approx(segment + FACE * height, abs=5e-3)


def test_a_needle_at_the_height_of_the_choice_is_that_of_the_machine(tmp_path):
    file = written(tmp_path, RAISED.replace("Z0", "Z0.3"))
    assert Job.load(file, ["program.placement.z=-0.3"]).bead.gap is None
    assert Job.load(file, ["program.placement.z=-0.4"]).bead.gap == pytest.approx(0.4)
    assert Job.load(file, ["program.placement.z=0", "bead.gap=0.3"]).bead.gap == 0.3


def test_a_height_that_is_given_is_kept(tmp_path):
    text = RAISED.replace("Z0", "Z0.3")
    file = written(tmp_path, text)
    for job in (Job.load(file, ["program.placement.z=0"]), Job.load(file, placement={"x": 0.0, "y": 0.0, "z": 0.0})):
        on = job.setpoints.dispense
        assert job.setpoints.position[on, 2].min() == pytest.approx(0.3)
        assert "lowered" not in choice_of(job)[0]
    # a job file that holds its program is left alone
    content = f'name = "mine"\nmachine = "xyz"\n[program]\ncontroller = "linuxcnc.Program"\ntext = """\n{text}"""\n'
    own = Job.load(written(tmp_path, content, "mine.toml"))
    assert own.setpoints.position[own.setpoints.dispense, 2].min() == pytest.approx(0.3)
    # several layers: the lowest lies on the work
    layers = Job.load(written(tmp_path, text.replace("M2", "G1 Z1.3\nG1 X30\nM2"), "layers.ngc"))
    on = layers.setpoints.dispense
    assert layers.setpoints.position[on, 2][-1] == pytest.approx(1.0, abs=1e-3)


def test_the_command_takes_a_height_of_the_origin(gantrysim_command, tmp_path):
    file = written(tmp_path, RAISED)
    assert gantrysim_command("check", file, "--at", "1,2,3")[0] == 0
    status, _, errors = gantrysim_command("check", file, "--at", "1,2,100")
    assert status == 2
    assert "z = " in errors
    assert gantrysim_command("check", file, "--at", "1,2,3,4")[0] == 2


def test_an_axis_that_no_machine_has_is_refused_with_those_there_are(tmp_path):
    file = written(tmp_path, "G21 G90\nG1 X10 A30 F600\nM2\n")
    with pytest.raises(InputError) as caught:
        Job.load(file)
    text = str(caught.value)
    assert text.startswith("part.ngc: line 2: A30 moves an axis that a program of LinuxCNC cannot have here: ")
    assert "skip_axes = 'A' skips the word" in text
    assert "xy (x, y), xyz (x, y, z), xyzr (x, y, z, r)" in text
    assert Job.load(file, ["program.skip_axes=A"]).machine == "xy"


OWN = """
from support.own_controllers import Lines
class Flat(Lines): pass
class Tall(Lines):
    @property
    def axes(self): return ("x", "y", "z")
class Broken(Lines):
    @property
    def axes(self): raise RuntimeError("no axes")
"""


@pytest.mark.parametrize(("name", "machine"), [("Flat", "xy"), ("Tall", "xyz"), ("Broken", "xy")])
def test_a_controller_of_ones_own_is_asked_for_its_axes_where_it_may_run(name, machine, tmp_path):
    written(tmp_path, OWN, "axes_of_mine.py")
    content = f'name = "mine"\n[program]\ncontroller = "axes_of_mine.py:{name}"\nspeed = 20.0\n'
    file = written(tmp_path, content, "mine.toml")
    with pytest.raises(InputError, match="code"):
        Job.load(file)
    assert Job.load(file, allow_code=True).machine == machine


def test_the_built_in_jobs_choose_nothing():
    for name in builtin_jobs():
        assert choice_of(Job.load(name)) == []
