"""What `gantrysim run` says on what to change, with one lever in place of all."""

import json
import signal

import pytest

import gantrysim.remedy.improve as module
from gantrysim import Job
from gantrysim.cli.evaluation import Wanted
from gantrysim.remedy.levers import LEVERS
from gantrysim.report.page import run_sections
from gantrysim.results.score import row_burden

SMALL = ("diameter=40", "turns=1", "thickness=5")
QUICK = (*(word for setting in SMALL for word in ("--set", setting)), "--no-video", "--no-causes", "--no-report")
WIDE = {"path_max": 5, "path_p95": 5, "bead_width": 900, "turn_clearance": 9, "start_length": 9, "stop_length": 9}


@pytest.fixture
def rows(monkeypatch):
    """The rows that `improve` is called for, a list per call; only the flow by speed is tried."""
    asked = []

    def noted(job, **named):
        asked.append(named["rows"])
        return real(job, **named)

    real = module.improve
    monkeypatch.setattr(module, "LEVERS", [lever for lever in LEVERS if lever.name == "flow by speed"])
    monkeypatch.setattr(module, "improve", noted)
    return asked


def test_a_run_that_does_not_pass_says_what_to_change(gantrysim_command, tmp_path, rows):
    status, printed, _ = gantrysim_command("run", "an225", *QUICK, "--out", tmp_path)
    assert status == 0
    verdict = Job.load("an225", SMALL).run().verdict
    burdens = {row.name: row_burden(row) for row in verdict.rows}
    assert rows == [sorted((name for name in burdens if burdens[name] > 0), key=burdens.get, reverse=True)[:2]]
    assert (
        printed.index("spoilt by ")
        < printed.index("change ")
        < printed.index("paste into")
        < printed.index("written to")
    )
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["changes"]["change"] in " ".join(printed.split())
    assert summary["sections"]["levers"]["tables"]


def test_all_is_written_before_what_to_change_is_looked_for(gantrysim_command, capsys, tmp_path, monkeypatch, rows):
    """The page is then written again, with what to change and the same film."""
    order = []
    pages = []

    class Drawn:
        def __init__(self, results, video, changes):
            self.titles = [section.title for section in run_sections(results, video, changes)]
            self.video = video.exists()

        def write(self, file):
            order.append("page")
            pages.append(self)
            file.write_text(f"page {len(pages)}")

    def search(*arguments, **named):
        printed.append(capsys.readouterr().out)
        order.append("search")
        kept.update({file.name for file in tmp_path.iterdir()})
        return noted(*arguments, **named)

    printed = []
    kept = set()
    noted = module.improve
    monkeypatch.setattr(module, "improve", search)
    monkeypatch.setattr("gantrysim.report.plots.save_plots", lambda *_, **__: order.append("plots"))
    monkeypatch.setattr(
        "gantrysim.report.page.run_page",
        lambda results, video, progress, changes, figures: Drawn(results, video, changes),
    )
    monkeypatch.setattr("gantrysim.render.save_video", lambda machine, run, file, **_: file.write_bytes(b"film"))
    words = [word for word in QUICK if word not in ("--no-video", "--no-report")]
    assert gantrysim_command("run", "an225", *words, "--out", tmp_path)[0] == 0
    assert order == ["plots", "page", "search", "page"]
    assert kept >= {"job.toml", "run.npz", "summary.json", "report.html", "video.mp4"}
    for text in ("verdict ", "spoilt by "):
        assert text in printed[0]
    before, after = pages
    assert "What to change" not in before.titles
    assert "What to change" in after.titles
    assert (before.video, after.video) == (True, True)
    assert (tmp_path / "report.html").read_text() == "page 2"
    assert (tmp_path / "video.mp4").read_bytes() == b"film"


def test_a_run_interrupted_while_it_looks_for_changes_keeps_all(gantrysim_command, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(module, "improve", interrupted)
    words = [word for word in QUICK if word != "--no-report"]
    status, _, errors = gantrysim_command("run", "an225", *words, "--out", tmp_path / "out")
    assert (status, errors) == (130, f"interrupted: the run is complete, what is known of it is in {tmp_path}/out/\n")
    assert {"job.toml", "report.html", "run.npz", "summary.json"} <= {
        file.name for file in (tmp_path / "out").iterdir()
    }


def test_a_run_that_passes_and_one_with_faults_are_left_alone(gantrysim_command, tmp_path, rows):
    wide = [part for key, value in WIDE.items() for part in ("--set", f"tolerance.{key}={value}")]
    given = [*QUICK, "--out", tmp_path]
    assert "verdict ✓ pass" in gantrysim_command("run", "an225", *given, *wide)[1]
    stuck = ("--set", 'faults=[{kind="stuck axis", time=0.3, axis="x"}]')
    _, printed, _ = gantrysim_command("run", "an225", *given, *stuck, "--improve")
    assert "stuck axis" in printed.lower()
    assert rows == []
    assert "change " not in printed
    gantrysim_command("run", "an225", *given, "--no-improve")
    assert rows == []


def test_long_runs_are_not_run_again_unasked(monkeypatch, gantrysim_command, tmp_path, rows):
    monkeypatch.setattr("gantrysim.base.memory.LONG_RUN", 1000)
    monkeypatch.setattr("gantrysim.cli.evaluation.computing_time", lambda job: 1.0)
    given = [word for word in QUICK if word != "--no-causes"]
    _, printed, _ = gantrysim_command("run", "an225", *given, "--out", tmp_path)
    assert "causes skipped: the run is long; --causes finds them" in printed
    assert rows == []
    assert Wanted(causes=None, repeat=None, video=False, report=False).improve is None
