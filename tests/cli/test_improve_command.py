"""The command `gantrysim improve`: what it prints, the job that it writes, and what it refuses."""

import json

import pytest

from gantrysim import Job, Verdict
from gantrysim.cli.show import show_section
from gantrysim.cli.terminal import FAULT, INPUT_ERROR
from gantrysim.remedy.improve import improve
from gantrysim.remedy.report import change_section

from support.pages import Page
from support.remedies import SIDES, fixed_flow, lines_job

QUICK = ("--lever", "flow by speed", "--workers", 1)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(fixed_flow().toml())
    return path


def letters(text):
    return "".join(text.split())


def test_the_written_job_runs_to_the_promised_verdict(gantrysim_command, monkeypatch, tmp_path, file):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    status, printed, said = gantrysim_command("improve", file, *QUICK, "--apply", "better.toml", "--out", "compared")
    assert (status, said) == (0, "")
    before, _, after = printed.partition("What to change")
    assert "verdict ✗ fail: glue" in before
    assert "unchanged" in after
    flow = "flow by speed: 200 mm³/s constant → 2 mm² (area) × path speed"
    assert f"passes with {flow}, lag compensation 0 → 20 ms." in after
    assert "--set dispenser.flow=0.0 --set dispenser.area=2.0 --set dispenser.advance=0.02" in after
    assert "written to better.toml: gantrysim run better.toml" in after
    job = Job.load("better.toml")
    promised = Verdict.of(job, job.run())
    compared = json.loads((tmp_path / "compared" / "compare.json").read_text())
    assert compared["runs"] == ["before", "after"]
    assert compared["better"] == "after"
    assert compared["verdicts"][1] == promised.headline
    page = Page(tmp_path / "compared" / "report.html")
    page.check()
    assert page.sections[:2] == ["summary", "what-to-change"]
    assert "beads-and-errors" in page.sections[:4]
    assert "--set dispenser.flow=0.0" in page.section("what-to-change")
    assert all(letters(line) in letters(after) for line in promised.lines)
    status, ran, _ = gantrysim_command(
        "run", "better.toml", "--no-video", "--no-report", "--no-causes", "-v", "--out", "out"
    )
    assert status == 0
    assert all(letters(line) in letters(ran) for line in promised.lines)


def test_only_a_job_file_is_replaced(gantrysim_command, tmp_path, file, monkeypatch):
    monkeypatch.setattr("gantrysim.remedy.improve.improve", lambda *_, **__: pytest.fail("simulated"))
    notes = tmp_path / "notes.toml"
    notes.write_text("[mine]\nkept = true\n")
    for name, reason in (("notes.toml", "exists and is not a job file"), ("better.txt", "must end in .toml")):
        status, printed, said = gantrysim_command("improve", file, "--apply", tmp_path / name)
        assert (status, printed) == (INPUT_ERROR, "")
        assert reason in " ".join(said.split())
    assert notes.read_text() == "[mine]\nkept = true\n"


def test_a_job_file_is_replaced(gantrysim_command, file):
    assert gantrysim_command("improve", file, *QUICK, "--apply", file)[0] == 0
    assert Job.load(file).dispenser.area == 2.0


def test_a_fault_is_told_and_writes_nothing(gantrysim_command, tmp_path):
    file = tmp_path / "faulted.toml"
    file.write_text(lines_job(SIDES, servo={"following_error_limit": 1e-4}).toml())
    status, printed, _ = gantrysim_command("improve", file, "--apply", tmp_path / "better.toml")
    assert status == FAULT
    assert "no lever is tried before that is repaired" in " ".join(printed.split())
    assert printed.count("Fault:") == 1
    assert not (tmp_path / "better.toml").exists()


def test_an_unknown_lever_is_answered_with_the_nearest(gantrysim_command, file):
    status, _, said = gantrysim_command("improve", file, "--lever", "lead")
    assert status == INPUT_ERROR
    assert "unknown lever 'lead': did you mean leads?" in " ".join(said.split())


@pytest.mark.parametrize("width", [40, 80, 120])
def test_the_table_of_levers_is_whole(width, monkeypatch, capsys):
    result = improve(fixed_flow(), levers=["flow by speed", "leads"], workers=1)
    monkeypatch.setenv("COLUMNS", str(width))
    show_section(change_section(result).content())
    text = capsys.readouterr().out
    assert max(map(len, text.partition("# job file")[0].splitlines())) <= max(width, 80)
    for name, setting, *cells, cost in result.rows:
        assert all(word in text.split() for word in f"{name} {setting} {cost}".split())
        assert "".join(cells).replace(" ", "") in letters(text)


def test_a_run_that_ends_in_a_fault_is_told_without_a_table(gantrysim_command, file):
    status, printed, said = gantrysim_command("improve", file, *QUICK, "--set", "servo.following_error_limit=0.001")
    assert said == ""
    assert status in (0, FAULT)
    words = " ".join(printed.split())
    assert words.startswith("verdict ✗ fail: Fault: following error on axis x at t = 0.00")
    assert "What to change" not in words
    assert "unchanged" not in words
