"""The command `gantrysim identify`."""

import tomllib

import numpy as np
import pytest

from gantrysim import Job, Machine, Servo, simulate
from gantrysim.controllers.trio import Basic
from gantrysim.identify.log import Log
from gantrysim.identify.plan import excitation
from gantrysim.machine.perturbation import Perturbation
from gantrysim.record.setpoints import Setpoints

from support.soaked import suite_runs
from support.spoiled_logs import spoiled


@pytest.mark.parametrize("controller", suite_runs(["trio", "softmc", "linuxcnc"], 0))
def test_a_plan_is_a_program_file_that_is_read(gantrysim_command, tmp_path, monkeypatch, controller):
    monkeypatch.chdir(tmp_path)
    status, output, said = gantrysim_command("identify", "--plan", "--machine", "xy", "--controller", controller)
    assert (status, said) == (0, "")
    (file,) = tmp_path.iterdir()
    assert f"written to {file.name}" in output
    assert Job.load(file, (), "xy").plan().duration > 5


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "a log is missing; gantrysim identify --plan writes the program of the moves to log"),
        (("none.csv",), "log none.csv: cannot be read: No such file or directory"),
        (("--plan", "some.csv"), "--plan takes no log, got some.csv"),
        (("--plan", "--controller", "fanuc"), "unknown controller 'fanuc'"),
        (("none.csv", "--column", "x position"), "--column 'x position': must be NAME=COLUMN"),
        (("none.csv", "--machine", "none"), "unknown model 'none'"),
        (("none.csv", "--rows", "5"), "--rows 5: must be FIRST:LAST, numbers of rows from 1, as in 1000:20000"),
        (("none.csv", "--period", "-1"), "period = -1 s: must be greater than 0"),
        (("--plan", "--period", "0.001"), "--period: describes a log, and --plan takes none"),
        (("--plan", "--rows", "1:9"), "--rows: describes a log, and --plan takes none"),
    ],
)
def test_bad_input_is_a_one_line_error(gantrysim_command, tmp_path, monkeypatch, arguments, text):
    monkeypatch.chdir(tmp_path)
    status, output, said = gantrysim_command("identify", *arguments)
    assert (status, output) == (2, "")
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert text in said
    assert not list(tmp_path.iterdir())


def test_period_and_rows_describe_the_log(gantrysim_command, tmp_path):
    rows = "".join(f"{0.1 * k},{k % 7}\n" for k in range(200))
    (tmp_path / "log.csv").write_text(f"x position [mm],x torque\n{rows}", encoding="utf-8")
    command = ("identify", tmp_path / "log.csv", "--machine", "xy", "--out", tmp_path / "o")
    status, _, said = gantrysim_command(*command)
    assert (status, "has no column time" in said) == (2, True)
    status, _, said = gantrysim_command(*command, "--period", "0.001", "--rows", "101:150")
    assert (status, "has 50 samples, must have at least 100" in said) == (2, True)
    # the log is read, and is none of an axis that reverses
    status, _, said = gantrysim_command(*command, "--period", "0.001")
    assert (status, said.startswith("not identified: axis x: ")) == (1, True)
    assert not (tmp_path / "o").exists()


@pytest.mark.first
def test_a_log_gives_values_plots_and_a_machine(gantrysim_command, tmp_path):
    """A rigid log of x alone: the moves at speed, without the short strokes."""
    machine = Machine("xy")
    whole = Basic(excitation(machine, "trio")[0]).setpoints(1e-3)
    position = np.concatenate([np.zeros((100, 1)), whole.position[:3000, :1]])
    setpoints = Setpoints(1e-3, ("x",), position, np.ones(len(position), bool), whole.requested)
    true = machine.perturbed(Perturbation(friction=1.3, payload=0.4))
    Log.of(simulate(true, Servo.derive(machine.axes, 1e-3), setpoints)).save(
        tmp_path / "log.csv", {"x": "mm", "y": "mm"}
    )
    text = (tmp_path / "log.csv").read_text(encoding="utf-8").replace("y demand", "a").replace("x position", "MPOS")
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    folder = tmp_path / "found"
    status, output, said = gantrysim_command(
        "identify", tmp_path / "log.csv", "--machine", "xy", "--out", folder, "--column", "x position=MPOS [mm]"
    )
    assert (status, said) == (0, ""), said
    words = " ".join(output.split())
    assert "x: friction by the log: Coulomb and viscous" in words
    assert "x: simulated over the whole run under the log's torque" in words
    names = ["friction.png", "identified.toml", "machine.xml", "report.html", "residuals.png", "response.png"]
    assert sorted(item.name for item in folder.iterdir()) == names
    found = tomllib.loads((folder / "identified.toml").read_text(encoding="utf-8"))
    friction = found["axes"]["x"]["coulomb"]
    assert friction["value"] == pytest.approx(1.3 * 0.0173, rel=0.05)
    viscous = found["axes"]["x"]["viscous"]
    assert viscous["interval"][0] < viscous["nominal"] < viscous["interval"][1]
    assert found["whole_run"]["x"]["repeats"]
    low, high = friction["interval"]
    assert low < friction["value"] < high
    inertia = found["axes"]["x"]["inertia"]
    assert inertia["unit"] == "kg"
    assert inertia["value"] == pytest.approx(inertia["nominal"] + 0.4, rel=0.01)
    assert list(found["axes"]) == ["x"]
    # every other command takes the machine
    status, output, _ = gantrysim_command("check", "an225", "--machine", folder / "machine.xml")
    assert status == 0
    assert "an225: trio.MoveSpiral on machine" in output
    fitted = Machine(folder / "machine.xml").axes[0]
    assert fitted.coulomb == pytest.approx(friction["value"], rel=1e-4)
    if not viscous["identified"]:  # then it stays nominal
        assert fitted.viscous == pytest.approx(machine.axes[0].viscous, rel=1e-6)
    # a folder with files of another command is refused
    (folder / "identified.toml").unlink()
    status, _, said = gantrysim_command("identify", tmp_path / "log.csv", "--machine", "xy", "--out", folder,
                                        "--column", "x position=MPOS [mm]")  # fmt: skip
    assert status == 2
    assert "which no identification has written" in said


@pytest.mark.soak
def test_a_log_whose_torque_is_not_that_of_its_motion_is_named(gantrysim_command, tmp_path):
    spoiled("torque of the wrong sign", 1).save(tmp_path / "log.csv", {"y": "mm"})
    status, output, said = gantrysim_command(
        "identify", tmp_path / "log.csv", "--machine", "xy", "--out", tmp_path / "o"
    )
    assert (status, output) == (1, "")
    assert said.startswith("not identified: axis y: its torque accelerates it backwards, with an inertia of -")
    assert said.count("\n") == 1
    assert not (tmp_path / "o").exists()


@pytest.mark.soak
def test_a_log_that_is_too_slow_is_not_identified(gantrysim_command, tmp_path):
    spoiled("every third row", 1).save(tmp_path / "log.csv", {"y": "mm"})
    status, output, said = gantrysim_command(
        "identify", tmp_path / "log.csv", "--machine", "xy", "--out", tmp_path / "o"
    )
    assert status == 1
    assert said == (
        "not identified: axis y: samples of 3 ms show 167 Hz at most, the mode of the machine's table is at 324 Hz: "
        "log faster, at every servo tick\n"
    )
    assert "written to" in output  # the plots show what is wrong
    axis = tomllib.loads((tmp_path / "o" / "identified.toml").read_text(encoding="utf-8"))["axes"]["y"]
    assert not any(value["identified"] for name, value in axis.items() if name != "mode")
