"""What `gantrysim run` says on what to change, with one lever in place of all."""

import pytest

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
    from gantrysim.remedy import improve as module

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
    assert printed.index("Contour error: ") < printed.index("levers, each simulated alone")
    assert printed.index("for the job file:") < printed.index("written to")


def test_the_files_are_made_once_all_is_printed_and_the_film_last(
    gantrysim_command, capsys, tmp_path, monkeypatch, rows
):
    """The page holds what to change, behind causes or budget, and the film, which is made once the page is drawn."""
    order = []
    pages = []

    class Drawn:
        def write(self, file):
            order.append("write")
            file.write_text("page")

    def draw(results, video, progress, changes, figures):
        order.append("page")
        drawn.append(figures)
        pages.append([section.title for section in run_sections(results, video, changes)])
        return Drawn()

    def plot(*_, **__):
        order.append("plots")
        printed.append(capsys.readouterr().out)

    drawn = []
    printed = []
    monkeypatch.setattr("gantrysim.report.plots.save_plots", plot)
    monkeypatch.setattr("gantrysim.report.page.run_page", draw)
    monkeypatch.setattr("gantrysim.render.save_video", lambda *_, **__: order.append("film"))
    words = [word for word in QUICK if word not in ("--no-video", "--no-report")]
    assert gantrysim_command("run", "an225", *words, "--out", tmp_path)[0] == 0
    assert order == ["plots", "page", "film", "write"]
    for text in ("verdict ", "Contour error: ", "servo: ", "for the job file:"):
        assert text in printed[0]
    (titles,) = pages
    (figures,) = drawn
    assert {"Error budget", "Bead and path", "Bead", "Errors over time"} <= set(figures)
    assert set(figures) <= set(titles)
    assert titles[:4] == ["Verdict", "Summary", "Error budget", "What to change"]
    assert "Bead and path" in titles  # which holds the film


def test_a_run_that_passes_and_one_with_faults_are_left_alone(gantrysim_command, tmp_path, rows):
    wide = [part for key, value in WIDE.items() for part in ("--set", f"tolerance.{key}={value}")]
    given = [*QUICK, "--out", tmp_path]
    assert "verdict ✓ pass" in gantrysim_command("run", "an225", *given, *wide)[1]
    stuck = ("--set", 'faults=[{kind="stuck axis", time=0.3, axis="x"}]')
    _, printed, _ = gantrysim_command("run", "an225", *given, *stuck, "--improve")
    assert "stuck axis" in printed
    assert rows == []
    assert "levers" not in printed
    gantrysim_command("run", "an225", *given, "--no-improve")
    assert rows == []


def test_long_runs_are_not_run_again_unasked(monkeypatch, gantrysim_command, tmp_path, rows):
    monkeypatch.setattr("gantrysim.base.memory.LONG_RUN", 1000)
    monkeypatch.setattr("gantrysim.job.cost.computing_time", lambda job: 1.0)
    given = [word for word in QUICK if word != "--no-causes"]
    _, printed, _ = gantrysim_command("run", "an225", *given, "--out", tmp_path)
    assert "causes skipped: the run is long; --causes finds them" in printed
    assert rows == []
    assert Wanted(causes=None, repeat=None, video=False, report=False).improve is None
