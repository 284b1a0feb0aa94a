"""The first screen of a run's page in a browser: it answers alone, links and lines to paste work; print; the card."""

import base64
import io
import re
from dataclasses import replace

import imageio.v3
import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.answer import Answer, Remedy
from gantrysim.report.card import HEIGHT, WIDTH, save_card
from gantrysim.report.changes import Changes
from gantrysim.report.document import Section
from gantrysim.report.page import run_page
from gantrysim.report.plots.laid import draw_laid
from gantrysim.report.plots.pictures import plan_plot
from gantrysim.report.plots.plan import magnification
from gantrysim.report.viewer_data import ViewerData
from gantrysim.results.run_results import RunResults

from support.browser import chromium
from support.viewer_jobs import viewer_job

LINES = "[dispenser]\narea = 2.0\n"
MOST_PAGES = 6
REMEDY = Remedy("Flow by speed (area 2 mm²).", "✓ pass; 2.00 s, as before.", LINES)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened


@pytest.fixture(scope="module")
def results():
    job = viewer_job()
    run = job.run()
    bead = Bead(run, job.bead, Analysis(run))
    return RunResults(job, job.built_machine, Budget(bead.analysis), bead)


@pytest.fixture(scope="module")
def file(results, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    film = folder / "video.mp4"
    film.write_bytes(b"no film")
    page = run_page(results, film, changes=Changes(REMEDY, Section("What to change", "Flow by speed.")))
    page.write(folder / "report.html")
    return folder / "report.html"


@pytest.fixture
def page(browser, file):
    browser.media()
    browser.open(file, 1280, 800)
    return browser


def row_time(page):
    return float(re.search(r"t = ([\d.]+) s", page.text(".stage .now"))[1])


def test_it_answers_without_scrolling(page, results):
    bottoms = page.run(
        "const parts = [...document.querySelectorAll('.answer > *, .stage .surface, .now')];"
        "return parts.map((part) => part.getBoundingClientRect().bottom)"
    )
    assert max(bottoms) <= 800
    assert page.run("return document.documentElement.scrollTop") == 0
    text = " ".join(page.text(".answer").split())
    assert Answer.of(results).title == results.verdict.headline[2:]
    assert results.verdict.headline[2:] in text
    for row in results.verdict.rows:
        assert row.name in text
    assert REMEDY.change in text
    assert REMEDY.outcome in text
    assert results.verdict.worst_check.brief[1:] in text
    assert row_time(page) == pytest.approx(results.verdict.worst_place.time, abs=1e-3)


def test_times_and_places_in_sentences_move_the_cursor(page, results):
    links = page.run("return [...document.querySelectorAll('.moment')].map((link) => link.textContent)")
    times = [k for k, text in enumerate(links) if text.startswith("t = ")]
    assert times
    for k in times[:4]:
        page.run("document.querySelectorAll('.moment')[arguments[0]].click()", k)
        page.settle()
        assert row_time(page) == pytest.approx(float(links[k].split()[2]), abs=1e-3)
        assert page.run("return document.querySelector('.pin').textContent")
    places = [k for k, text in enumerate(links) if text.startswith("x = ")]
    assert places
    page.run("document.querySelectorAll('.moment')[arguments[0]].click()", places[0])
    page.settle()
    x, y = (float(value) for value in re.findall(r"[xy] = ([−-]?[\d.]+)", links[places[0]].replace("−", "-")))
    nozzle = results.budget.analysis.run.nozzle[round(row_time(page) / results.budget.analysis.run.period)]
    np.testing.assert_allclose(nozzle[:2], [x, y], atol=0.1)


def test_the_lines_to_paste_are_copied(page):
    page.driver.execute_cdp_cmd(
        "Browser.grantPermissions", {"permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]}
    )
    page.run("window.focus(); document.querySelector('.copy').click()")
    page.wait("document.querySelector('.copy').textContent === 'copied'")
    read = "navigator.clipboard.readText().then(arguments[0], (error) => arguments[0](String(error)))"
    assert page.driver.execute_async_script(read) == LINES


def test_print_has_the_answer_on_the_first_of_few_pages(page):
    size = {"paperWidth": 8.27, "paperHeight": 11.69}
    content = base64.b64decode(page.driver.execute_cdp_cmd("Page.printToPDF", size)["data"])
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", content)) <= MOST_PAGES
    page.resize(700, 1000)  # the width of the paper less its margins
    page.media("print")
    boxes = page.run(
        "return ['.answer', '.stage figure'].map((name) => {"
        "const b = document.querySelector(name).getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]; })"
    )
    answer, picture = boxes
    assert max(answer[3], picture[3]) < 1000
    assert picture[0] >= answer[2]
    assert picture[2] - picture[0] > 250


def test_plan_card_and_page_mark_the_worst_place_of_the_row_that_fails(results):
    verdict = results.verdict
    assert verdict.worst_row.name == "glue"
    place = verdict.worst_place
    tick = round(place.time / results.budget.analysis.run.period)
    x, y = results.budget.analysis.run.nozzle[tick, :2]
    plan = plan_plot(results.budget.analysis, verdict.placed_check).figure().axes[0]
    marked = next(line for line in plan.get_lines() if str(line.get_label()).startswith("worst"))
    assert str(marked.get_label()) == f"worst: {verdict.placed_check.brief}"
    largest = results.budget.analysis.nozzle.distance.argmax()
    # the error is drawn magnified there
    factor = magnification(results.budget.analysis)
    row = np.searchsorted(results.budget.analysis.ticks, tick)
    offset = results.budget.analysis.nozzle.offset[row, :2]
    np.testing.assert_allclose(marked.get_xydata()[0], [x, y] + (factor - 1) * offset, atol=1e-9)
    assert np.hypot(*(results.budget.analysis.run.nozzle[results.budget.analysis.ticks[largest], :2] - [x, y])) > 1
    laid = draw_laid(Figure(), results)
    circles = [line.get_xydata()[0] for line in laid.get_lines() if line.get_marker() == "o"]
    assert circles
    np.testing.assert_allclose(circles, [place.point[:2]] * len(circles))
    assert ViewerData(results).content()["worst"] == np.abs(ViewerData(results).rows - tick).argmin()


def test_the_film_has_the_bead_before_it_plays(page, results):
    poster = page.run("return document.querySelector('video').poster")
    picture = imageio.v3.imread(io.BytesIO(base64.b64decode(poster.partition(",")[2])))
    assert picture.shape[:2] == (450, 800)
    assert np.count_nonzero(picture.min(axis=2) < 230) > 0.01 * 800 * 450


def test_forced_colours_keep_scales_and_shapes(page):
    colours = "return ['.ramp', '.shape'].map((name) => getComputedStyle(document.querySelector(name)))"
    style = f"{colours}.map((style) => style.backgroundImage + style.backgroundColor)"
    before = page.run(style)
    features = [{"name": "forced-colors", "value": "active"}]
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    try:
        assert page.run("return matchMedia('(forced-colors: active)').matches")
        assert page.run(style) == before
    finally:
        page.media()


def test_the_card_holds_the_answer_in_its_size(results, tmp_path):
    answer = Answer.of(results, REMEDY)
    save_card(tmp_path / "card.png", results, answer)
    picture = imageio.v3.imread(tmp_path / "card.png")
    assert picture.shape[:2] == (HEIGHT, WIDTH)
    # longer texts are cut, not written over the edge
    longer = replace(answer, spoilt="too long " * 99, remedy=replace(REMEDY, change="much to do " * 99))
    save_card(tmp_path / "long.png", results, longer)
    picture = imageio.v3.imread(tmp_path / "long.png")
    assert (picture[20:, -20:, :3] == 255).all()
    assert (picture[-12:, :, :3] == 255).all()
