"""The verdict in terminal, summary.json and page against the one from Python; the exit status."""

import io
import json

import pytest
from rich.console import Console

from gantrysim import Job, Run, Verdict
from gantrysim.cli.evaluation import Wanted
from gantrysim.cli.tables import verdict_table

from support.jobs import job_run
from support.pages import Page

SMALL = (
    "--set",
    "diameter=40",
    "--set",
    "turns=2",
    "--set",
    "thickness=5",
    "--no-video",
    "--no-causes",
    "--no-improve",
)


def words(text):
    return " ".join(text.split())


def test_terminal_summary_and_page_have_the_verdict_of_the_record(gantrysim_command, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    folder = tmp_path / "out"
    status, out, _ = gantrysim_command("run", "an225", *SMALL, "--out", folder, "--fail-on", "fail", "-v")
    verdict = Verdict.of(Job.of_record(folder / "job.toml"), Run.load(folder / "run.npz"))
    assert (status, verdict.state) == (4, "fail")
    content = json.loads((folder / "summary.json").read_text())
    assert next(iter(content)) == "verdict"
    assert content["verdict"] == json.loads(json.dumps(verdict.content()))
    page = Page(folder / "report.html")
    assert page.sections[0] == "verdict"
    section = page.section("verdict")
    assert words(out).startswith(f"verdict {verdict.headline}")
    for row in verdict.rows:
        assert f"{row.symbol} {row.state}" in section
        for text in row.texts:
            assert words(text) in section
            assert words(text) in words(out)
            assert text in str(verdict)


@pytest.mark.parametrize(
    ("fail_on", "refused"),
    [(None, set()), ("fail", {"fail"}), ("warn", {"warn", "fail"})],
)
def test_the_verdicts_that_the_command_refuses(fail_on, refused):
    wanted = Wanted(causes=False, repeat=None, video=False, report=False, fail_on=fail_on)
    assert {state for state in ("pass", "warn", "fail") if wanted.refuses(state)} == refused


def test_a_run_within_given_tolerances_ends_well(gantrysim_command, tmp_path):
    wide = {"path_max": 2, "bead_width": 200, "turn_clearance": 3, "start_length": 5, "stop_length": 5}
    given = [part for key, value in wide.items() for part in ("--set", f"tolerance.{key}={value}")]
    arguments = ("run", "an225", *SMALL, "--no-report", *given, "--out", tmp_path / "out")
    assert gantrysim_command(*arguments, "--fail-on", "fail")[0] == 0
    assert '"limit_source": "given"' in (tmp_path / "out" / "summary.json").read_text()


def test_another_state_to_fail_on_is_refused(gantrysim_command, tmp_path):
    status, _, err = gantrysim_command("run", "an225", "--fail-on", "maybe", "--out", tmp_path / "out")
    assert status == 2
    assert "maybe" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("width", [40, 80, 120])
def test_the_table_loses_nothing_in_a_narrow_terminal(width):
    verdict = Verdict.of(Job.load("an225"), job_run("an225"))
    console = Console(width=width, file=io.StringIO())
    with console.capture() as capture:
        console.print(verdict_table(verdict))
    shown = "".join(capture.get().split())
    lines = capture.get().splitlines()
    assert max(map(len, lines)) <= width
    for row in verdict.rows:
        assert f"{row.symbol}{row.state}{row.name}" in shown
    for number in (check for row in verdict.rows for check in row.checks if check.state == "fail"):
        assert f"{number.value:{number.form}}" in shown
