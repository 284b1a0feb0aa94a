"""Every built-in job runs on its machine, with plausible values."""

import csv
import inspect
import json

import numpy as np
import pytest

from gantrysim import Job, Machine, Servo
from gantrysim.job.loading import builtin_jobs
from gantrysim.job.programs import PROGRAMS, build
from gantrysim.job.settings import INTEGRAL_TIME, ServoSettings
from gantrysim.machine.machine import builtin_models
from gantrysim.metrics.analysis import Analysis
from gantrysim.servo.request import DERIVED_VALUES

from support.jobs import job_run
from support.soaked import suite_runs

JOBS = (
    "an225",
    "an225-3d",
    "delta-arc",
    "fanuc-conical",
    "fanuc-spiral",
    "linuxcnc-flanges",
    "slicer-square",
    "softmc-arc",
    "softmc-basic",
    "softmc-helical",
    "stage-outline",
    "svg-gasket",
    "trio-basic",
)
SPACING = {"an225": 10.0, "an225-3d": 10.0, "fanuc-conical": 25.0, "fanuc-spiral": 20.0, "softmc-helical": 25.0}
# errors from friction at the reversals of the axes, without those of the controller [mm]
SERVO_RMS = 0.02
SERVO_MAX = 0.12
SOFT = {"delta-arc": 4.0}  # the same on a machine whose loops are as much slower
COMMANDED = 1e-9  # error of a controller that follows the path exactly [mm]
ROUNDING = ("fanuc-conical", "linuxcnc-flanges", "slicer-square")
ROUNDED = 0.06  # of one that blends corners [mm]
REPEATED = ("an225", "linuxcnc-flanges", "stage-outline")  # jobs that are equal have equal runs
COMMANDED_JOBS = ("an225", "softmc-arc", "stage-outline")
REPORTED = ("delta-arc", "svg-gasket")  # the others' kinds of path and machine: tests/report


@pytest.mark.soak
@pytest.mark.parametrize("name", JOBS)
def test_every_job_gets_a_report(name, tmp_path, gantrysim_command):
    assert (
        gantrysim_command("run", name, "--no-video", "--no-causes", "--no-improve", "--out", tmp_path / "out")[0] == 0
    )
    assert (tmp_path / "out" / "report.html").exists()


@pytest.fixture(scope="module")
def analyses():
    """Runs of the jobs by their names, each made once."""
    made = {}

    def analysis(name):
        if name not in made:
            made[name] = Analysis(job_run(name))
        return made[name]

    return analysis


def test_the_builtin_jobs_cover_all_controllers_and_machines():
    assert tuple(builtin_jobs()) == JOBS
    assert {Job.load(name).program["controller"] for name in JOBS} == set(PROGRAMS)
    assert {Job.load(name).machine for name in JOBS} == set(builtin_models())


@pytest.mark.parametrize("name", JOBS)
def test_a_job_runs_with_plausible_following_contour_and_spacing(analyses, name):
    analysis = analyses(name)
    run, values = analysis.run, analysis.values
    assert run.fault is None
    assert set(values.following) == set(Job.load(name).built_machine.axis_names)
    soft = SOFT.get(name, 1.0)
    for axis, unit in zip(run.axes, run.units, strict=True):
        spread = values.following[axis]
        assert spread.rms > 0 or axis == "z"
        assert spread.rms < soft * SERVO_RMS * (2 if unit == "deg" else 1)
    # servo and mechanics, without the controller
    beyond = np.linalg.norm(run.nozzle - run.commanded_tip, axis=1)[analysis.ticks]
    assert np.sqrt(np.mean(beyond**2)) < soft * SERVO_RMS
    assert beyond.max() < soft * SERVO_MAX
    if not name.startswith("an225"):
        assert values.program.max < (ROUNDED if name in ROUNDING else COMMANDED)
    if name in SPACING:
        assert values.spacing.mean == pytest.approx(SPACING[name], rel=0.01)
    else:
        assert values.spacing is None


@pytest.mark.parametrize("name", JOBS)
def test_a_job_written_and_read_again_gives_the_same_record(analyses, name, tmp_path):
    (tmp_path / "again.toml").write_text(Job.load(name).toml(), encoding="utf-8")
    again = Job.load(tmp_path / "again.toml")
    assert again == Job.load(name)
    if name in REPEATED:
        assert np.array_equal(again.run().nozzle, analyses(name).run.nozzle)


@pytest.mark.parametrize("name", JOBS)
def test_a_jobs_program_is_rebuilt_from_its_plain_arguments(name):
    job = Job.load(name)
    values = {key: value for key, value in job.program.items() if key != "controller"}
    again = build(job.program["controller"], json.loads(json.dumps(values)))
    assert np.array_equal(again.setpoints(1e-3).position, job.controller.setpoints(1e-3).position)


def test_the_stages_bead_is_measured_in_the_work_frame(analyses):
    """The needle stands still; in the work frame it traces the outline."""
    run = analyses("stage-outline").run
    outline = run.requested.position(np.linspace(0, run.requested.length, 50))
    for place in outline:
        assert np.linalg.norm(run.nozzle - place, axis=1).min() < 0.1
    machine = Machine("stage")
    assert np.abs(machine.tip(run.encoder) - run.nozzle).max() < SERVO_MAX


def test_a_bead_conserves_the_volume_of_glue(analyses):
    run = analyses("softmc-arc").run
    assert np.any(~run.dispense[run.dispense.argmax() :])  # the dispenser is off on the way home
    after = round(0.2 / run.period)  # a dead time and ten time constants
    off = np.flatnonzero(run.dispense)[-1] + 1
    assert run.flow[off + after :].max() < 1e-3 * run.flow_demand.max()
    assert run.flow.sum() == pytest.approx(run.flow_demand.sum(), rel=1e-3)


@pytest.mark.parametrize("name", suite_runs(JOBS, *map(JOBS.index, (*REPORTED, "stage-outline"))))
def test_the_command_runs_a_job(name, tmp_path, gantrysim_command):
    report = [] if name in REPORTED else ["--no-report"]
    status, printed, _ = gantrysim_command(
        "run", name, "-v", "--no-video", "--no-causes", "--no-improve", *report, "--out", tmp_path / "out"
    )
    assert status == 0
    assert (tmp_path / "out" / "report.html").exists() == (name in REPORTED)
    assert "contour" in printed
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert written["job"] == name
    assert written["fault"] is None
    rotary = any(key.endswith("_mdeg") for key in written["errors"])
    assert rotary == (Job.load(name).machine in ("delta", "stage", "xyzr"))
    glue = written["bead"]
    assert glue["volume_mm3"] - glue["requested_volume_mm3"] == pytest.approx(glue["volume_error_mm3"], rel=1e-9)
    clearance = glue["turn_clearance_mean_mm"]
    assert (clearance is None) == (written["motion"]["spacing_mean_mm"] is None)
    if clearance is not None:
        assert glue["gap_share_percent"] > 97 > 3 > glue["overlap_share_percent"]
    for note in written["notes"]:
        assert note.split()[0] in printed
    if name == "softmc-arc":
        with (tmp_path / "out" / "record.csv").open() as stream:
            rows = list(csv.reader(stream))
        assert rows[0][:3] == ["time [s]", "PCMD x [mm]", "PCMD y [mm]"]
        assert float(rows[2][0]) == pytest.approx(0.004)


def test_info_lists_machines_jobs_and_settings(gantrysim_command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    words = {
        "machines": (*builtin_models(), "deg/s", "mm/s²"),
        "jobs": (*JOBS, "trio.MoveSpiral"),
        "servo": ("damping", "integral_time"),
        "glue": (
            "dispenser.start_lead",
            "time-pressure",
            "needle.consistency",
            "bead.contact_angle",
            "[mm³/s]",
            "[kPa]",
        ),
        "gains": ("kp N·m/u", "crossover"),
    }
    for kind, expected in words.items():
        status, printed, _ = gantrysim_command("info", kind)
        assert status == 0
        for word in expected:
            assert word in printed
    _, printed, _ = gantrysim_command("info")
    for word in (*words, *JOBS, *builtin_models()):
        assert word in printed


def test_the_record_of_the_controller_delays_the_command(tmp_path, gantrysim_command):
    """PE compares with the command `position_error_delay` ticks ago; here every tick is recorded."""
    settings = ["program.record.gap=1", "program.group.position_error_delay=3"]
    arguments = [word for setting in settings for word in ("--set", setting)]
    bare = ["--no-video", "--no-report", "--no-causes", "--no-improve"]
    status, _, _ = gantrysim_command("run", "softmc-arc", *bare, "--out", tmp_path / "out", *arguments)
    assert status == 0
    rows = np.genfromtxt(tmp_path / "out" / "record.csv", delimiter=",", names=True)
    sent, measured, error = (rows[f"{name}_x_mm"] for name in ("PCMD", "PFB", "PE"))
    assert len(rows) == 1000
    assert error[3:] == pytest.approx(sent[:-3] - measured[3:], abs=1e-12)
    assert np.abs(sent[3:] - sent[:-3]).max() > 0.1


def test_the_servo_s_table_has_the_keywords_of_derive():
    keywords = {name: value.default for name, value in inspect.signature(Servo.derive).parameters.items()}
    del keywords["axes"], keywords["given"]
    keywords["integral_time"] = INTEGRAL_TIME  # a job has an integral term unless it says otherwise
    derived = {quantity.name: None for quantity in DERIVED_VALUES}
    fields = ServoSettings.model_fields
    assert {name: field.default for name, field in fields.items()} == keywords | derived
    assert list(fields) == [*keywords, *derived]
    assert all(field.description for field in fields.values())
