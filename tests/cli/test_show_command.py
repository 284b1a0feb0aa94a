"""`gantrysim show`: what a run has found, from the files in its folder."""

import json
import re
import shutil

import pytest

from gantrysim import Job
from gantrysim.cli.show import ASPECTS
from gantrysim.report.folder import output_folder, write_run
from gantrysim.report.writing import results_of

SMALL = ("diameter=40", "turns=1", "thickness=5")


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """The folder of a small run with causes, as `gantrysim run` writes it."""
    job = Job.load("an225", SMALL)
    folder = tmp_path_factory.mktemp("shown") / "out"
    with output_folder(folder) as scratch:
        write_run(scratch, results_of(job, job.run()))
    return folder


@pytest.fixture
def show(gantrysim_command, monkeypatch):
    """What `gantrysim show` prints, with a run or a search for causes being a failure."""
    monkeypatch.setattr(Job, "run", lambda *_, **__: pytest.fail("simulated"))
    return lambda *words: gantrysim_command("show", *words)


def test_without_an_aspect_the_answer_is_shown(show, saved):
    status, printed, _ = show(saved)
    assert status == 0
    summary = json.loads((saved / "summary.json").read_text())
    assert printed.startswith(f"verdict {summary['verdict']['headline']}\n")
    assert " ".join(summary["spoilt"]) in " ".join(printed.split())


def test_the_page_of_a_run_is_named_where_there_is_one(show, saved, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "300")
    folder = tmp_path / "out"
    shutil.copytree(saved, folder)
    page = folder / "report.html"
    page.unlink(missing_ok=True)
    without = show(folder)[1]
    page.write_text("a page")
    assert show(folder)[1] == f"{without}{page}\n"


@pytest.mark.parametrize(
    ("aspect", "words"),
    [
        ("verdict", "(default)"),
        ("budget", "requested path to nozzle"),
        ("figures", "following error x"),
        ("causes", "the command follows the requested path exactly"),
        ("glue-causes", "the nozzle passes all of its path at one speed"),
        ("notes", "servo: natural frequency"),
        ("levers", "none, gantrysim run --improve simulates them"),
        ("scatter", "none, gantrysim run --repeat 16 finds it"),
        ("faults", "none, the job has no deliberate faults"),
    ],
)
def test_an_aspect_is_shown_as_the_run_found_it(show, saved, monkeypatch, aspect, words):
    monkeypatch.setenv("COLUMNS", "200")
    status, printed, _ = show(saved, aspect)
    assert status == 0
    assert words in printed
    assert all(line == line.rstrip() for line in printed.splitlines())


def test_what_was_chosen_for_a_program_alone_is_told_whole_where_the_screen_points_to(gantrysim_command, tmp_path):
    """The run's job file gives it, so that nothing is chosen for that any more."""
    (tmp_path / "line.ngc").write_text("G21 G17 G90 G61\nG0 X0 Y0 Z5\nG1 Z0.5 F600\nG1 X20 F3000\nG0 Z5\nM2\n")
    folder = tmp_path / "out"
    quick = ("--no-video", "--no-report", "--no-causes", "--no-improve")
    _, printed, _ = gantrysim_command("run", tmp_path / "line.ngc", "--out", folder, *quick)
    assert "machine xyz" in printed.partition("chosen")[2]
    assert f"gantrysimshow{folder}notes" in "".join(printed.split())
    (chosen, *_) = json.loads((folder / "summary.json").read_text())["notes"]
    for aspect in ("notes", "all"):
        shown = " ".join(gantrysim_command("show", folder, aspect)[1].split())
        assert shown.count(" ".join(f"note: {chosen}".split())) == 1


def test_a_verdict_is_a_table_with_a_line_for_each_value(show, saved, monkeypatch):
    monkeypatch.setenv("COLUMNS", "300")
    verdict = json.loads((saved / "summary.json").read_text())["verdict"]
    title, *lines = show(saved, "verdict")[1].splitlines()
    assert title == f"verdict {verdict['headline']}"
    # state, name and value in columns; further values of a row stand below its name
    cells = [re.split(r"  +", line.strip()) for line in lines]
    named = [row[1] for row in cells if len(row) == 3]
    assert named == ["path", "glue", "stability", "machine"]


def test_all_shows_what_there_is(show, saved):
    _, printed, _ = show(saved, "all")
    assert "Causes" in printed
    assert "none, " not in printed
    assert set(ASPECTS) > {"levers", "scatter"}


def test_bad_aspects_and_folders_are_one_line(show, saved, tmp_path):
    status, printed, error = show(saved, "budgets")
    assert (status, printed) == (2, "")
    assert "unknown aspect of a run 'budgets': did you mean budget?" in error
    assert show(tmp_path / "nothing")[0] == 2
    older = tmp_path / "older"
    shutil.copytree(saved, older)
    summary = json.loads((older / "summary.json").read_text())
    del summary["sections"]
    (older / "summary.json").write_text(json.dumps(summary))
    status, _, error = show(older)
    assert status == 2
    assert "written by an earlier version" in error
    (older / "summary.json").unlink()
    assert "summary.json is missing" in show(older)[2]
