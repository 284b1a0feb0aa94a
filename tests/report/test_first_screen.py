"""The first screen of a run's page in a browser: it answers alone, links and lines to paste work; print; the card."""

import base64
import io
import re
from dataclasses import replace
from itertools import combinations

import imageio.v3
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.answer import Answer, Remedy
from gantrysim.report.card import HEIGHT, WIDTH, draw_card, save_card
from gantrysim.report.document import Changes, Section
from gantrysim.report.page import run_page
from gantrysim.report.plots.bead import draw_laid
from gantrysim.report.plots.pictures import plan_plot
from gantrysim.report.plots.plan import magnification
from gantrysim.report.viewer_data import ViewerData
from gantrysim.results.run_results import RunResults

from support.soaked import suite_runs
from support.viewer_jobs import viewer_job

LINES = "[dispenser]\narea = 2.0\n"
MOST_PAGES = 6
REMEDY = Remedy("Flow by speed (area 2 mm²).", "✓ pass; 2.00 s, as before.", LINES)


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
    browser.open(file, 1280, 800)
    return browser


def row_time(page):
    return float(re.search(r"t\s=\s([\d.]+)\ss", page.text(".stage .now"))[1])


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
    times = [k for k, text in enumerate(links) if text.split()[0] == "t"]
    assert times
    for k in times[:4]:
        page.run("document.querySelectorAll('.moment')[arguments[0]].click()", k)
        page.settle()
        assert row_time(page) == pytest.approx(float(links[k].split()[2]), abs=1e-3)
        assert page.run("return document.querySelector('.pin').textContent")
    places = [k for k, text in enumerate(links) if text.split()[0] == "x"]
    assert places
    page.run("document.querySelectorAll('.moment')[arguments[0]].click()", places[0])
    page.settle()
    x, y = (float(value) for value in re.findall(r"[xy]\s=\s([−-]?[\d.]+)", links[places[0]].replace("−", "-")))
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


def test_the_legend_of_the_plan_is_within_its_picture(results):
    longest = replace(results.verdict.placed_check, quantity="clearance of neighbouring turns too small by")
    figure = plan_plot(results.budget.analysis, longest).figure()
    figure.draw_without_rendering()
    texts = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= texts.x0
    assert texts.x1 <= figure.bbox.x1


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


APART = """
const pattern = /[\\d∞]\\s(?:µm|mm|s|%|deg|Hz|ticks)(?![\\w/])|\\b[xyzt]\\s=\\s[−\\d.]+/g;
const walker = document.createTreeWalker(document.querySelector('main'), NodeFilter.SHOW_TEXT);
const apart = [];
let found = 0;
for (let node = walker.nextNode(); node; node = walker.nextNode()) {
  if (node.parentElement.closest('script, style, pre, code, svg, title')) continue;
  for (const match of node.data.matchAll(pattern)) {
    const range = document.createRange();
    range.setStart(node, match.index);
    range.setEnd(node, match.index + match[0].length);
    const tops = new Set([...range.getClientRects()].map((box) => Math.round(box.top)));
    found += tops.size > 0;
    if (tops.size > 1) apart.push(node.data);
  }
}
return [found, apart];
"""


@pytest.mark.parametrize("width", suite_runs([1280, 700, 400, 330], 0, 3))
def test_no_line_ends_between_a_number_and_its_unit(page, width):
    page.resize(width, 800)
    page.run("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    page.settle()
    found, apart = page.run(APART)
    assert found > 40
    assert apart == []


def card_of(results, answer):
    figure = Figure((WIDTH / 100, HEIGHT / 100), dpi=100)
    FigureCanvasAgg(figure)
    draw_card(figure, results, answer)
    figure.canvas.draw()
    return figure


def test_the_card_holds_the_whole_answer_in_its_size(results, tmp_path):
    answer = Answer.of(results, REMEDY)
    save_card(tmp_path / "card.png", results, answer)
    assert imageio.v3.imread(tmp_path / "card.png").shape[:2] == (HEIGHT, WIDTH)
    costs = "Costs: an analogue output for the pump; torque; another loop in the program; cycle time. "
    long = replace(
        answer, spoilt=f"{answer.spoilt} " * 4, remedy=replace(REMEDY, change="best with " * 40, outcome=costs * 4)
    )
    for shown in (answer, long):
        figure = card_of(results, shown)
        whole = " ".join(" ".join(text.get_text() for text in figure.texts).split())
        for part in (
            shown.title,
            shown.spoilt,
            shown.remedy.change,
            shown.remedy.outcome,
            *(row.text for row in shown.rows),
        ):
            assert " ".join(part.split()) in whole
        boxes = [text.get_window_extent() for text in figure.texts]
        for box in boxes:
            assert 0.5 * WIDTH <= box.x0 < box.x1 <= WIDTH - 20
            assert 10 <= box.y0 < box.y1 <= HEIGHT - 10
        lines = [box for box, text in zip(boxes, figure.texts, strict=True) if len(text.get_text()) > 1]
        assert not any(one.overlaps(other) for one, other in combinations(lines, 2) if one.height > 0)
