"""The 3-D view of a run's page in a browser: where it is, its cursor, colours and machine, against the run."""

import base64

import imageio.v3
import numpy as np
import pytest

from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.page import write_run_page
from gantrysim.results.colours import SHARE, WIDTH
from gantrysim.results.run_results import RunResults

from support.viewer_jobs import climbing_job

SURFACE = ".space .surface"
FIELD_OF_VIEW = 35.0  # [deg], vertical
RING = 7.0  # radius of the cursor [pixels]
INK = (27, 31, 36)
# gantrysim/report/web/theme.js, on light paper
SHIFT = 8
WITHOUT_WEBGL = """const original = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
  return kind.startsWith("webgl") ? null : original.call(this, kind, ...rest);
};"""

# presses of a key within one picture
AHEAD = """for (let press = 0; press < arguments[1]; press++) {
  const event = new KeyboardEvent("keydown", { key: "ArrowRight", shiftKey: true, bubbles: true });
  document.querySelector(arguments[0]).dispatchEvent(event);
}"""


@pytest.fixture(scope="module")
def results():
    job = climbing_job()
    bead = Bead(job.run(), job.bead, None)
    analysis = Analysis(bead.run)
    return RunResults(job, job.built_machine, Budget(analysis), Bead(bead.run, job.bead, analysis))


@pytest.fixture(scope="module")
def file(results, tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "report.html"
    write_run_page(file, results)
    return file


@pytest.fixture
def page(browser, file):
    browser.open(file)
    browser.box(SURFACE)
    browser.wait(f"document.querySelector('{SURFACE}').dataset.view", 20)
    yield browser
    assert browser.messages() == []


def view_of(page):
    """Azimuth and elevation [deg], distance, and target relative to the bead's middle [mm]."""
    page.settle()
    numbers = [float(number) for number in page.run(f"return document.querySelector('{SURFACE}').dataset.view").split()]
    return numbers[0], numbers[1], numbers[2], np.array(numbers[3:])


def in_picture(page, results, points):
    """Places of points of the work [mm] in the view [pixels], (n, 2), and their distances [mm]: a pinhole camera."""
    run = results.budget.analysis.run
    laid = run.nozzle[run.dispense]
    low = laid.min(axis=0) - [0, 0, results.bead.gap]
    middle = 0.5 * (low + laid.max(axis=0))
    azimuth, elevation, distance, target = view_of(page)
    level = np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth)), 0])
    forward = np.cos(np.radians(elevation)) * level - [0, 0, np.sin(np.radians(elevation))]
    right = np.cross(level, [0, 0, 1])
    up = np.cross(right, forward)
    relative = np.atleast_2d(points) - middle - target
    depth = distance + relative @ forward
    _, _, width, height = page.box(SURFACE)
    inside = [2, 2]  # a border of a pixel on either side
    width, height = width - inside[0], height - inside[1]
    focal = 0.5 * height / np.tan(np.radians(0.5 * FIELD_OF_VIEW))
    places = np.stack([0.5 * width + focal * relative @ right / depth, 0.5 * height - focal * relative @ up / depth], 1)
    return places, depth


def picture(page):
    """The view as it is seen, (height, width, RGB), without its border."""
    page.settle()
    data = page.driver.find_element("css selector", SURFACE).screenshot_as_png
    return imageio.v3.imread(data, extension=".png")[1:-1, 1:-1, :3].astype(float)


def overlay(page):
    """The pixels of the canvas with the cursor, (height, width, RGBA)."""
    page.settle()
    text = page.run(f"return document.querySelectorAll('{SURFACE} canvas')[1].toDataURL()")
    return imageio.v3.imread(base64.b64decode(text.partition(",")[2]), extension=".png").astype(int)


def tick_of(page, results):
    page.settle()
    time = page.text('.readout output[data-name="time"]')
    return round(float(time.removesuffix(" s")) / results.budget.analysis.run.period)


def press(page, label):
    script = "[...document.querySelectorAll('.space button')].find((b) => b.textContent === arguments[0]).click()"
    page.run(script, label)
    page.settle()


def inked(pixels, place):
    """Share of a ring around a place that has the colour of ink."""
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    x = np.rint(place[0] - 0.5 + RING * np.cos(angles)).astype(int)
    y = np.rint(place[1] - 0.5 + RING * np.sin(angles)).astype(int)
    return np.mean((np.abs(pixels[y, x, :3] - INK).max(axis=1) < 60) & (pixels[y, x, 3] > 120))


def test_the_cursor_is_where_its_sample_is(page, results):
    run = results.budget.analysis.run
    page.run(f"document.querySelector('{SURFACE}').focus()")
    page.key("Home")
    last = None
    for _ in range(3):
        page.key("ArrowRight", shift=True, presses=4)
        tick = tick_of(page, results)
        text = page.run(f"return document.querySelector('{SURFACE}').getAttribute('aria-valuetext')").replace("−", "-")
        for name, value in zip("xyz", run.nozzle[tick], strict=True):
            assert float(text.partition(f"{name} ")[2].split()[0]) == pytest.approx(value, abs=0.051)
        (place,), _ = in_picture(page, results, run.nozzle[tick])
        pixels = overlay(page)
        assert inked(pixels, place) > 0.9
        assert last is None or inked(pixels, last) < 0.5
        last = place


@pytest.mark.soak
def test_hovering_over_the_bead_moves_the_cursor_and_a_click_pins_it(page, results):
    run = results.budget.analysis.run
    left, top, _, _ = page.box(SURFACE)
    ticks = np.flatnonzero(run.dispense)
    places, depth = in_picture(page, results, run.nozzle[ticks])
    # of the half in front, which nothing of the path hides
    front = ticks[depth < np.median(depth)][10::120]
    for tick in front:
        x, y = in_picture(page, results, run.nozzle[tick])[0][0]
        page.mouse("mouseMoved", left + 1 + x, top + 1 + y)
        assert np.linalg.norm(run.nozzle[tick_of(page, results)] - run.nozzle[tick]) < 1.0
    page.click(left + 1 + x, top + 1 + y)
    pinned = tick_of(page, results)
    x, y = places[np.flatnonzero(ticks == front[0])[0]]
    page.mouse("mouseMoved", left + 1 + x, top + 1 + y)
    assert tick_of(page, results) == pinned


@pytest.mark.soak
def test_drag_and_keys_turn_the_view_and_reset_brings_it_back(page):
    first = view_of(page)
    left, top, width, height = page.box(SURFACE)
    middle = (left + 0.5 * width, top + 0.5 * height)
    page.drag(middle, (middle[0] + 50, middle[1] + 25))
    azimuth, elevation, distance, start = view_of(page)
    assert (azimuth - first[0], elevation - first[1]) == pytest.approx((-20, 10), abs=0.1)  # 0.4 deg a pixel
    assert distance == first[2]
    page.drag(middle, (middle[0] + 50, middle[1]), SHIFT)
    *turned, target = view_of(page)
    assert turned == pytest.approx([azimuth, elevation, distance])
    pixel = 2 * distance * np.tan(np.radians(0.5 * FIELD_OF_VIEW)) / (height - 2)
    assert np.linalg.norm(target - start) == pytest.approx(50 * pixel, rel=0.01)
    press(page, "reset")
    assert view_of(page)[:3] == first[:3]
    page.run(f"document.querySelector('{SURFACE}').focus()")
    for key, value in {"d": (10, 0), "w": (0, 10)}.items():
        before = view_of(page)
        page.run(
            f"document.querySelector('{SURFACE}').dispatchEvent(new KeyboardEvent('keydown', {{key: arguments[0]}}))",
            key,
        )
        after = view_of(page)
        assert (before[0] - after[0], after[1] - before[1]) == pytest.approx(value)
    press(page, "top")
    assert view_of(page)[1] == 90
    page.mouse("mouseWheel", *middle, deltaX=0, deltaY=-400)
    assert view_of(page)[2] < 0.7 * first[2]
    page.click(*middle, count=2)
    assert view_of(page)[:3] == first[:3]
    page.key("Escape")


def test_the_bead_has_the_colours_of_the_scale_that_is_chosen(page, results):
    press(page, "machine")
    press(page, "top")
    run = results.budget.analysis.run
    budget = results.budget
    bead = results.bead
    ticks = budget.analysis.ticks[40:-40:5]
    rows = np.searchsorted(budget.analysis.ticks, ticks)
    limits = results.job.limits(run.face)
    size = budget.analysis.nozzle.distance[rows] / limits.path_max
    width = np.interp(bead.length[ticks], bead.place, bead.width) / bead.nominal_section.width[0] - 1
    crest = run.nozzle[ticks]
    scales = {"path error": (SHARE, size), "width": (WIDTH, 100 * width / limits.bead_width)}
    expected = {}
    for label, (scale, values) in scales.items():
        expected[label] = scale.table()[np.rint(255 * scale.places(values)).astype(int)].astype(float)
        press(page, label)
        name = page.run(f"return document.querySelector('{SURFACE}').getAttribute('aria-label')")
        assert label.rpartition(" ")[2] in name
        places, _ = in_picture(page, results, crest)
        column, row = np.rint(places - 0.5).astype(int).T
        difference = np.abs(picture(page)[row, column] - expected[label]).max(axis=1)
        assert np.median(difference) < 12
    assert np.abs(expected["path error"] - expected["width"]).max() > 50


def test_the_needle_stands_at_the_cursor(page, results):
    run = results.budget.analysis.run
    page.run(f"document.querySelector('{SURFACE}').focus()")
    page.key("Home")
    for _ in range(2):
        # past the start, which the end of the bead hides; the view is drawn once for all, which takes long
        page.run(AHEAD, SURFACE, 16)
        tick = tick_of(page, results)
        above = run.nozzle[tick] + np.array([[0, 0, height] for height in (4.0, 5.0, 6.0, 7.0)])
        places, _ = in_picture(page, results, above)
        column, row = np.rint(places - 0.5).astype(int).T
        dark = picture(page)[row, column].mean()
        press(page, "machine")
        assert dark < picture(page)[row, column].mean() - 60
        press(page, "machine")


def test_without_webgl_a_sentence_stands_in_place_of_the_view(browser, file):
    script = browser.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": WITHOUT_WEBGL})
    try:
        browser.open(file)
        assert "no WebGL" in browser.text(".space [role=status]").replace("draws no", "no")
        assert browser.run("return document.querySelector('.plan .surface').clientHeight") > 100
        assert browser.messages() == []
    finally:
        browser.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
