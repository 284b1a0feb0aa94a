"""Labels of pages at three widths: none is cut, leaves its picture, runs into another, or is too small on a phone."""

import pytest

from gantrysim import Job
from gantrysim.glue.bead import Bead
from gantrysim.job.loading import builtin_jobs
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.page import write_run_page
from gantrysim.report.writing import results_of
from gantrysim.results.run_results import RunResults

from support.labels import label_faults, noting_texts
from support.soaked import suite_runs
from support.viewer_jobs import climbing_job, viewer_job

NARROW = 400
WIDTHS = (1280, 900, NARROW)
LEAST = 11  # of a label on a phone [pixels]


@pytest.fixture(autouse=True)
def noted(browser):
    with noting_texts(browser):
        yield


def check_labels(browser, file):
    for width in WIDTHS:
        browser.open(file, width, 800)
        assert label_faults(browser, LEAST if width == NARROW else 0.0) == [], width


@pytest.mark.parametrize("job", suite_runs([viewer_job(), climbing_job()], 0), ids=lambda job: job.name)
def test_labels_of_short_jobs_are_whole_and_apart(browser, job, tmp_path):
    run = job.run()
    bead = Bead(run, job.bead, Analysis(run))
    write_run_page(tmp_path / "report.html", RunResults(job, job.built_machine, Budget(bead.analysis), bead))
    check_labels(browser, tmp_path / "report.html")


@pytest.mark.soak
@pytest.mark.parametrize("name", builtin_jobs())
def test_labels_of_built_in_jobs_are_whole_and_apart(browser, name, tmp_path):
    job = Job.load(name)
    write_run_page(tmp_path / "report.html", results_of(job, job.run()))
    check_labels(browser, tmp_path / "report.html")


@pytest.mark.parametrize(
    ("style", "fault"),
    suite_runs(
        [
            (".answer .judged { width: 60px; overflow: hidden; }", "cut: "),
            (".answer h3 { margin-bottom: -20px; }", "over one another: "),
            (".now { font-size: 9px; }", "9.0 px: "),
        ],
        1,
    ),
)
def test_labels_that_are_spoilt_are_found(browser, tmp_path, style, fault):
    job = viewer_job()
    run = job.run()
    bead = Bead(run, job.bead, Analysis(run))
    write_run_page(tmp_path / "report.html", RunResults(job, job.built_machine, Budget(bead.analysis), bead))
    page = (tmp_path / "report.html").read_text(encoding="utf-8").replace("</style>", f"{style}</style>", 1)
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    browser.open(tmp_path / "report.html", NARROW, 800)
    found = label_faults(browser, LEAST)
    assert any(text.startswith(fault) for text in found), found


@pytest.mark.soak
def test_texts_on_canvases_are_seen(browser, tmp_path):
    job = viewer_job()
    run = job.run()
    bead = Bead(run, job.bead, Analysis(run))
    write_run_page(tmp_path / "report.html", RunResults(job, job.built_machine, Budget(bead.analysis), bead))
    browser.open(tmp_path / "report.html", 1280, 800)
    draw = "document.querySelector('.stage canvas').getContext('2d').fillText(...arguments)"
    for place in (["out", -9, 40], ["first", 99, 99], ["second", 102, 101]):
        browser.run(draw, *place)
    found = label_faults(browser)
    assert [text.partition(" in ")[0] for text in found] == [
        "leaves its picture: out",
        "over one another: first | second",
    ]
