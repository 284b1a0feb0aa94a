"""The commands `gantrysim machine new` and `gantrysim info --model`, and jobs on tables."""

import re

import pytest

from gantrysim import Job, Machine
from gantrysim.results.verdict import Verdict

from support.tables import EXAMPLES

TABLE = EXAMPLES / "belt-gantry.toml"
JOB = """
name = "short"
machine = "belt.toml"

[program]
controller = "trio.MoveSpiral"
diameter = 60.0
thickness = 10.0
turns = 1
speed = 100.0
"""


def test_machine_new_writes_the_mjcf_and_says_what_it_can_do(gantrysim_command, tmp_path):
    status, out, _ = gantrysim_command("machine", "new", TABLE, "--out", tmp_path)
    assert status == 0
    assert Machine(tmp_path / "belt-gantry.xml").digest == Machine(TABLE).digest
    assert "peak force at rest [N]" in out
    assert "verdict: the drives suit the machine\n" in out
    row = next(line for line in out.splitlines() if "no-load speed" in line)
    # 48 V / 0.0538 N·m/A and 40 mm / 3 per turn; 48 V / 0.0603 N·m/A and 72 mm / 4
    assert [cell.strip() for cell in row.split("│")[2:4]] == ["1893", "2280"]
    # no accuracy class is given: the error is not known, which is not 0
    row = next(line for line in out.splitlines() if "error of the travel" in line)
    assert [cell.strip() for cell in row.split("│")[2:4]] == ["–", "–"]
    assert "91 Hz (y_flex)" in " ".join(out.split())
    status, out, _ = gantrysim_command("machine", "new", TABLE, "--out", tmp_path / "own.xml")
    assert (status, (tmp_path / "own.xml").read_text()) == (0, (tmp_path / "belt-gantry.xml").read_text())


def test_a_wrong_table_leaves_the_earlier_mjcf(gantrysim_command, tmp_path):
    (tmp_path / "a.xml").write_text("earlier")
    (tmp_path / "a.toml").write_text(TABLE.read_text().replace("bridge = 2.4\n", "bridge = 0\n"))
    status, _, errors = gantrysim_command("machine", "new", tmp_path / "a.toml")
    assert status == 2
    assert "masses.bridge = 0: must be greater than 0" in errors
    assert (tmp_path / "a.xml").read_text() == "earlier"
    status, _, errors = gantrysim_command("machine", "new", tmp_path / "a.xml")
    assert (status, "must be a TOML file" in errors) == (2, True)
    status, _, errors = gantrysim_command("machine", "new", tmp_path / "none.toml")
    assert (status, "no such file" in errors) == (2, True)


def test_info_on_a_machine_prints_the_same_facts_of_any_mjcf(gantrysim_command):
    status, out, _ = gantrysim_command("info", "--model", "xy")
    assert status == 0
    row = next(line for line in out.splitlines() if "peak force" in line)
    assert [cell.strip() for cell in row.split("│")[2:4]] == ["569.3", "569.3"]
    assert "268 Hz (y_flex), 576 Hz (x_flex)" in " ".join(out.split())
    status, _, errors = gantrysim_command("info", "--job", "an225")
    assert (status, "--job: needs --model" in errors) == (2, True)


def test_a_job_is_held_against_the_motors(gantrysim_command, tmp_path):
    """Without a limit of the acceleration the program starts with a jerk, which is too much."""
    for more, verdict in (
        ("acceleration = 1000.0", "verdict: the drives suit the machine and the job"),
        ("", r"- fail: torque reserve 0 %, at least 10.0 % \(default\): axis y, t = 0.001 s"),
    ):
        (tmp_path / "job.toml").write_text(JOB + more)
        status, out, _ = gantrysim_command("info", "--model", TABLE, "--job", tmp_path / "job.toml")
        assert status == 0
        assert "thermal load, rms to continuous [%]" in out
        assert re.search(verdict, out)


def test_a_job_names_the_table_of_its_machine(tmp_path):
    (tmp_path / "belt.toml").write_text(TABLE.read_text())
    (tmp_path / "job.toml").write_text(JOB)
    job = Job.load(tmp_path / "job.toml")
    assert job.built_machine.digest == Machine(TABLE).digest
    assert job.built_machine.name == "belt"


@pytest.mark.parametrize(
    ("settings", "state"),
    [
        ("", "fail"),
        ("acceleration = 12000.0\n[tolerance]\ntorque_reserve = 60.0", "warn"),
        ("acceleration = 1000.0", "pass"),
    ],
)
def test_the_verdict_on_the_drives_is_that_of_the_run(settings, state, gantrysim_command, tmp_path):
    """`machine new --job` and `run` judge the reserves of torque and speed alike."""
    (tmp_path / "belt.toml").write_text(TABLE.read_text())
    (tmp_path / "job.toml").write_text(JOB + settings)
    job = Job.load(tmp_path / "job.toml")
    row = Verdict.of(job, job.run())["machine"]
    assert row.state == state
    _, out, _ = gantrysim_command("machine", "new", tmp_path / "belt.toml", "--job", tmp_path / "job.toml")
    said = " ".join(out.split()).partition("verdict: ")[2]
    if state == "pass":
        assert said.startswith("the drives suit the machine and the job")
    else:
        assert said.startswith("to be changed:")
        assert all(f"- {state}: {' '.join(words.split())}" in said for words in row.texts)


def test_a_job_that_ends_in_a_fault_suits_no_drive(gantrysim_command, tmp_path):
    (tmp_path / "belt.toml").write_text(TABLE.read_text())
    (tmp_path / "job.toml").write_text(JOB + "\n[servo]\nfollowing_error_limit = 0.001\n")
    _, out, _ = gantrysim_command("machine", "new", tmp_path / "belt.toml", "--job", tmp_path / "job.toml")
    assert "verdict: to be changed: - the job ends in a fault: following error" in " ".join(out.split())
