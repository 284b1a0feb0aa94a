"""The commands of the studies of speed, machines, circles and repeats."""

import subprocess
import sys
import tomllib
from dataclasses import MISSING, fields
from inspect import signature

import pytest

import gantrysim.study
from gantrysim.cli import study as study_commands
from gantrysim.cli.tune import tune
from gantrysim.study import CircleStudy, LawsStudy, MachineStudy, RepeatStudy, SpeedStudy
from gantrysim.study.tuning import TuningStudy

SMALL = ("an225", "--set", "diameter=60.0", "--set", "turns=1", "--workers", 1)


@pytest.mark.parametrize("name", ["Circle", "Laws", "Loop", "Machine", "Repeat", "Speed"])
def test_every_study_is_exported_by_the_package(name):
    found = getattr(gantrysim.study, f"{name}Study")
    assert found.name == name.lower()
    assert found.__module__ == f"gantrysim.study.{name.lower()}.study"
    assert f"{name}Study" in gantrysim.study.__all__
    assert f"{name}Study" in dir(gantrysim.study)


def test_studies_are_imported_lazily():
    code = (
        "import sys, gantrysim.study as s; late = 'gantrysim.study.loop.study'; "
        "assert late not in sys.modules; s.LoopStudy; assert late in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    with pytest.raises(AttributeError, match=r"LopStudy"):
        gantrysim.study.LopStudy  # noqa: B018


def test_circle_by_command(gantrysim_command, tmp_path):
    out = tmp_path / "out"
    status, printed, told = gantrysim_command(
        "study", "circle", "--machine", "xyz", "--radius", 10, "--speed", 80, "--set", "period=0.0005", "--out", out,
        "--workers", 1,
    )  # fmt: skip
    assert status == 0
    assert "discarded" not in told
    assert "resumed" not in told
    words = " ".join(printed.split())
    assert words.startswith("Does this machine run a circle within the tolerance? Yes, both directions keep the limits")
    assert "10 mm" in words
    assert (out / "curves.csv").exists()
    job = tomllib.loads((out / "job.toml").read_text())
    assert job["machine"] == "xyz"
    assert job["servo"]["period"] == 0.0005
    assert tomllib.loads((out / "study.toml").read_text())["settings"] == {"radius": 10.0, "speed": 80.0}


def test_speed_by_command(gantrysim_command, tmp_path):
    out = tmp_path / "out"
    arguments = ("--tolerance", 150, "--figure", "contour_rms", "--out", out)
    status, printed, _ = gantrysim_command("study", "speed", *SMALL, *arguments)
    assert status == 0
    assert "keeps the tolerance of 150 µm (rms contour error)" in " ".join(printed.split())


def test_machine_by_command(gantrysim_command, tmp_path):
    out = tmp_path / "out"
    arguments = (
        "--samples",
        8,
        "--tolerance",
        1e6,
        "--spread",
        "payload=0.2,friction=0.3,viscous=0,stiffness=0,motor_constant=0",
    )
    status, printed, _ = gantrysim_command("study", "machine", *SMALL, *arguments, "--seed", 7, "--out", out)
    assert status == 0
    words = " ".join(printed.split())
    limit = "the tolerance of 1e+06 µm (largest contour error)"
    answer = f"8 of 8 machines keep {limit}, a yield of 100.0 % (95 % confidence: "
    assert words.startswith(f"How many machines of this build will meet the tolerance? {answer}")
    assert "; nothing of the build needs to change." in words
    settings = tomllib.loads((out / "study.toml").read_text())["settings"]
    assert settings["seed"] == 7
    assert settings["spread"] == {
        "payload": 0.2,
        "friction": 0.3,
        "viscous": 0.0,
        "stiffness": 0.0,
        "motor_constant": 0.0,
    }


@pytest.mark.drawn
def test_repeat_by_command(gantrysim_command, tmp_path):
    out = tmp_path / "out"
    status, printed, _ = gantrysim_command("study", "repeat", *SMALL, "--repeats", 2, "--friction", 0, "--out", out)
    assert status == 0
    assert "over 2 repeats of an225" in " ".join(printed.split())
    assert "phase" in printed
    assert "Path accuracy and repeatability by varied source" in printed


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("circle", "--radius", -1), "radius = -1 mm: must be greater than 0 mm"),
        (("circle", "--machine", "xz"), "unknown model 'xz'"),
        (("speed", "--tolerance", 0), "tolerance = 0: must be greater than 0"),
        (("machine", "--spread", "mass=1"), "unknown tolerance 'mass'"),
        (("machine", "--samples", 3), "samples = 3: must be at least 12, for 9 factors"),
        (
            ("speed", "an225", "--tolerance", 50, "--figure", "nofigure"),
            "unknown metric 'nofigure': known: contour_max, contour_p95, ",
        ),
        (
            ("machine", "an225", "--tolerance", 50, "--figure", "contour_mx"),
            "unknown metric 'contour_mx': did you mean contour_max?",
        ),
        (
            ("speed", "--figure", "contour_rms"),
            "figure = 'contour_rms': needs a tolerance; without both, the job's own",
        ),
        (("machine", "--samples", 10**12), "samples = 1000000000000: must be at most 10000"),
        (("circle", "--radius", 0.001), "radius = 0.001 mm: must be at least 1.91 mm"),
        (("repeat", "--repeats", 10**12), "repeats = 1000000000000: must be at most 10000"),
        (("repeat", "--repeats", 1), "repeats = 1: must be at least 2"),
        (("repeat", "nothing"), "unknown job 'nothing'"),
        (("laws", "--payload", -1), "payload = -1 kg: must be at least 0 kg"),
        (("laws", "--friction", 0), "friction = 0: must be greater than 0"),
        (("laws", "--set", "law=pidd"), "unknown law 'pidd': did you mean pid?"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(gantrysim_command, tmp_path, arguments, text, monkeypatch):
    monkeypatch.setattr("gantrysim.study.run.run_cases", None)  # no case is run
    status, printed, messages = gantrysim_command("study", *arguments, "--out", tmp_path / "out")
    assert status == 2
    assert text in messages
    assert messages.count("\n") == 1
    assert printed == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("study", ["loop", "speed", "machine", "repeat", "laws"])
def test_a_job_that_never_dispenses_is_refused(gantrysim_command, tmp_path, study, monkeypatch):
    monkeypatch.setattr("gantrysim.study.run.run_cases", None)  # no case is run
    job = tmp_path / "dry.toml"
    job.write_text('name = "dry"\n[program]\ncontroller = "fanuc.Program"\nprogram = "G00 X5 Y5 F600\\n"\n')
    status, printed, messages = gantrysim_command("study", study, job, "--out", tmp_path / "out")
    assert status == 2
    assert "the dispenser is never on in this run" in messages
    assert messages.count("\n") == 1
    assert printed == ""
    assert not (tmp_path / "out").exists()


def test_a_study_ended_by_faults_has_the_exit_status_of_a_fault(gantrysim_command, tmp_path):
    status, _, messages = gantrysim_command(
        "study", "circle", "--set", "following_error_limit=0.01", "--workers", 1, "--out", tmp_path / "out"
    )
    assert status == 3
    assert messages.startswith("fault: none of the study's 2 cases has values: fault: following error on axis")
    assert messages.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("command", "study", "named"),
    [
        (study_commands.speed, SpeedStudy, {}),
        (study_commands.machine, MachineStudy, {}),
        (study_commands.circle, CircleStudy, {"model": "machine", "path_speed": "speed"}),
        (study_commands.repeat, RepeatStudy, {}),
        (study_commands.laws, LawsStudy, {}),
        (tune, TuningStudy, {}),
    ],
)
def test_options_have_the_defaults_of_the_study_s_fields(command, study, named):
    """They stand twice: to read them off the study would load it for every --help."""
    defaults = {field.name: field.default for field in fields(study) if field.default is not MISSING}
    options = {named.get(name, name): parameter.default for name, parameter in signature(command).parameters.items()}
    shared = sorted((options.keys() & defaults.keys()) - {"spread"})
    assert len(shared) >= 1
    assert {name: options[name] for name in shared} == {name: defaults[name] for name in shared}
