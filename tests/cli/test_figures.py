"""The figures of a page are drawn by one process or by two, and each but once."""

from contextlib import contextmanager

import pytest

from gantrysim import Job
from gantrysim.base import memory
from gantrysim.cli import figures
from gantrysim.cli.figures import draw_figures, figures_beside
from gantrysim.report import figures as report_figures
from gantrysim.report.writing import results_of

TITLES = {"Error budget", "Bead and path", "Spacing of neighbouring turns", "Bead", "Errors over time"}


@pytest.fixture(scope="module")
def results():
    job = Job.load("an225", ["diameter=40", "turns=2", "thickness=5"])
    return results_of(job, job.run(), causes=False)


@pytest.fixture
def drawn(monkeypatch):
    """The titles of the sections that are drawn, in order."""
    titles = []
    monkeypatch.setattr(report_figures, "figures_of", lambda section, *_: titles.append(section.title) or [{}])
    return titles


def copying(copies):
    """Compute in this process what a copy would, and keep it."""

    @contextmanager
    def beside(compute):
        copies.append(compute())
        yield lambda: copies[-1]

    return beside


@contextmanager
def nowhere(_):
    yield lambda: None


def test_two_processes_share_the_figures(results, drawn, tmp_path, monkeypatch):
    copies = []
    monkeypatch.setattr(figures, "beside", copying(copies))
    assert set(draw_figures(results, tmp_path, lambda: None)) == TITLES
    assert sorted(drawn) == sorted(TITLES)
    (copy,) = copies
    assert len(copy) == 2


def test_where_there_is_no_copy_one_process_draws_all(results, drawn, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "beside", nowhere)
    assert set(draw_figures(results, tmp_path, lambda: None)) == TITLES
    assert sorted(drawn) == sorted(TITLES)


def test_all_figures_are_drawn_beside_a_search(results, drawn, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "beside", copying([]))
    with figures_beside(results, tmp_path) as ahead:
        assert set(ahead()) == TITLES


def test_a_long_run_is_drawn_by_one_process(results, drawn, tmp_path, monkeypatch):
    copies = []
    monkeypatch.setattr(figures, "beside", copying(copies))
    monkeypatch.setattr(memory, "LONG", 100)
    with figures_beside(results, tmp_path) as ahead:
        assert ahead() is None
    assert set(draw_figures(results, tmp_path, lambda: None)) == TITLES
    assert copies == []


def test_a_figure_that_fails_is_left_to_the_page(results, tmp_path, monkeypatch):
    def failing(section, *_):
        if section.title == "Bead":
            raise ValueError("no numbers")
        return [{}]

    monkeypatch.setattr(report_figures, "figures_of", failing)
    monkeypatch.setattr(figures, "beside", nowhere)
    assert set(draw_figures(results, tmp_path, lambda: None)) == TITLES - {"Bead"}
