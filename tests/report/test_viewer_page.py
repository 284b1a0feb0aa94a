"""The viewer of a run's page in a browser: cursor, keys, legend, program lines, zoom and film, against the run."""

import base64
import json

import imageio.v2
import imageio.v3
import numpy as np
import pytest

from gantrysim.compare.runs.runs_page import compare_runs
from gantrysim.glue.bead import Bead
from gantrysim.job.basis import program_lines
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.encoding import packed
from gantrysim.report.page import write_run_page
from gantrysim.report.viewer_data import ViewerData
from gantrysim.results.run_results import RunResults

from support.compared import RADIUS, START, on_circle
from support.soaked import suite_runs
from support.viewer_jobs import TEXT, viewer_job

FPS = 25
# in the processor's time of the page's main thread, as other processes take theirs of the clock's
USABLE = 0.5  # [s]
ROWS = 100_000
LEAST_RATE = 30  # pictures of a moving cursor [1/s]
PICTURES = 60
PLAN = ".plan .surface"
BEAD = ".bead .surface"
STRIPS = ".strips"
STRIP = '.strip[data-name="contour-all"] .u-over'
SHIFT = 8
CARD = 1  # end card of a film [s]
VISIBLE = 10  # difference of a colour of 256 levels
# brightness of the film's present frame
GREY = """
const canvas = document.createElement("canvas");
const context = canvas.getContext("2d");
context.drawImage(document.querySelector("video"), 0, 0);
return context.getImageData(5, 5, 1, 1).data[1];
"""
# figures that are seen at once, and that are wider than their place
SCROLLED = """
const figures = [...document.querySelectorAll(".figures > figure")];
const shown = figures.filter((figure) => figure.clientWidth > 0 && !figure.closest("details:not([open])"));
return shown.filter((figure) => figure.scrollWidth > figure.clientWidth).map((figure) => figure.className);
"""
UNITS = {"contour": "µm", "program": "µm", "servo": "µm", "encoder": "µm", "structure": "µm", "width": "mm"}


@pytest.fixture(scope="module")
def results():
    job = viewer_job()
    bead = Bead(job.run(), job.bead, None)
    analysis = Analysis(bead.run)
    return RunResults(job, job.built_machine, Budget(analysis), Bead(bead.run, job.bead, analysis))


@pytest.fixture(scope="module")
def file(results, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    film = folder / "video.mp4"
    frames = round(FPS * float(results.bead.run.time[-1]))
    with imageio.v2.get_writer(film, fps=FPS) as writer:
        for k in range(frames):
            writer.append_data(np.full((48, 64, 3), 255 * k // frames, np.uint8))
        for _ in range(CARD * FPS):
            writer.append_data(np.zeros((48, 64, 3), np.uint8))
    write_run_page(folder / "report.html", results, film)
    return folder / "report.html"


@pytest.fixture
def page(browser, file):
    browser.open(file)
    browser.wait("document.querySelector('video').readyState > 0")  # with its size nothing moves any more
    yield browser
    assert browser.messages() == []


class Expected:
    """The run's own values at a tick, as the page should show them."""

    def __init__(self, results):
        self.run = results.budget.analysis.run
        self.ticks = results.budget.analysis.ticks
        self.budget = results.budget
        self.bead = results.bead
        self.line_at = program_lines(results.job, len(self.run.time))

    def value(self, name, tick):
        if name == "width":
            return float(np.interp(self.bead.length[tick], self.bead.place, self.bead.width))
        part = self.budget.contour if name == "contour" else self.budget.parts[name]
        rows = np.flatnonzero(self.ticks == tick)
        return 1e3 * float(part.lateral[rows[0]]) if rows.size else None


def readout(page, name):
    return page.text(f'.readout output[data-name="{name}"]')


def tick_of(page, results):
    time = float(readout(page, "time").removesuffix(" s"))
    return round(time / results.budget.analysis.run.period)


def check_readout(page, results):
    """Hold the readout to the run's values at its time; return the tick."""
    expected = Expected(results)
    tick = tick_of(page, results)
    for name, unit in UNITS.items():
        text = readout(page, name)
        value = expected.value(name, tick)
        if value is None:
            assert text == "–"
            continue
        number, shown_unit = text.replace("−", "-").split()
        assert shown_unit == unit
        decimals = len(number.partition(".")[2])
        assert float(number) == pytest.approx(value, abs=0.51 * 10.0**-decimals + 1e-3)
    line = expected.line_at(float(results.budget.analysis.run.time[tick]))
    assert readout(page, "line") == ("–" if line is None else str(line))
    assert readout(page, "dispense") == ("on" if expected.run.dispense[tick] else "off")
    return tick


def test_hovering_over_each_view_shows_the_values_there(page, results):
    run = results.budget.analysis.run
    worst = results.verdict.worst_place.time
    assert check_readout(page, results) == round(worst / run.period)
    value = results.verdict.placed_check.measured
    assert " ".join(page.text(".stage .now").split()).startswith(f"worst: {value} · t = {worst:.3f} s")
    left, top, width, height = page.box(STRIP)
    for share in (0.2, 0.5, 0.93):
        page.mouse("mouseMoved", left + share * width, top + 0.5 * height)
        tick = check_readout(page, results)
        assert tick == pytest.approx(share * (len(run.time) - 1), abs=2 * len(run.time) / width)
        place = page.run("return document.querySelector('.u-cursor-x').style.transform")
        assert float(place.split("(")[1].split("px")[0]) == pytest.approx(share * width, abs=2)
    for selector, name in ((PLAN, "contour"), (BEAD, "width")):
        left, top, width, height = page.box(selector)
        marks = set()
        for share in (0.15, 0.5, 0.85):
            page.mouse("mouseMoved", left + share * width, top + 0.75 * height)
            marks.add(check_readout(page, results))
            told = page.run("return document.querySelector(arguments[0]).getAttribute('aria-valuetext')", selector)
            assert readout(page, name) in told
        assert len(marks) > 1


def test_a_click_pins_the_cursor_and_keys_move_it(page, results):
    last = len(results.budget.analysis.run.time) - 1
    left, top, width, height = page.box(STRIP)
    page.click(left + 0.4 * width, top + 0.5 * height)
    pinned = check_readout(page, results)
    page.mouse("mouseMoved", left + 0.8 * width, top + 0.5 * height)
    assert tick_of(page, results) == pinned
    assert page.run("return document.activeElement.getAttribute('role')") == "slider"
    for key, shift, tick in (
        ("ArrowRight", False, pinned + 1),
        ("ArrowRight", True, pinned + 51),
        ("ArrowLeft", False, pinned + 50),
        ("End", False, last),
        ("ArrowRight", False, last),
        ("Home", False, 0),
        ("ArrowLeft", True, 0),
    ):
        page.key(key, shift)
        assert check_readout(page, results) == tick
        assert page.run("return document.activeElement.getAttribute('aria-valuenow')") == str(tick)
    page.key("Escape")
    page.mouse("mouseMoved", left + 0.6 * width, top + 0.5 * height)
    assert tick_of(page, results) > 0
    page.run("document.querySelector('.plan .surface').focus()")
    page.key("End")
    assert tick_of(page, results) == last


def pixels(page, selector):
    """The pixels of a canvas, (height, width, RGBA)."""
    text = page.run("return document.querySelector(arguments[0]).toDataURL()", selector)
    return imageio.v3.imread(base64.b64decode(text.partition(",")[2]), extension=".png").astype(int)


def differing(drawn, before):
    """Pixels that differ visibly, (height, width)."""
    return np.abs(drawn - before).max(axis=2) > VISIBLE


def near(drawn, colour):
    """Number of pixels of about a colour."""
    rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int(np.sum((np.abs(drawn[..., :3] - rgb).max(axis=-1) < 40) & (drawn[..., 3] > 120)))


def test_the_legend_switches_links_on_and_off(page):
    canvas = '.strip[data-name="contour-all"] canvas'
    servo = '.readout [data-link="servo"]'
    blue = "#0072b2"
    before = near(pixels(page, canvas), blue)
    assert before > 50
    page.run("document.querySelector(arguments[0]).click()", servo)
    page.settle()
    assert page.run("return document.querySelector(arguments[0]).getAttribute('aria-pressed')", servo) == "false"
    assert near(pixels(page, canvas), blue) < 0.1 * before
    assert page.run("""return document.querySelector('.strip[data-name="servo"]').hidden""")
    page.run("document.querySelector(arguments[0]).click()", servo)
    page.settle()
    assert near(pixels(page, canvas), blue) == pytest.approx(before, rel=0.05)
    assert not page.run("""return document.querySelector('.strip[data-name="servo"]').hidden""")


def test_errors_share_a_scale_until_each_gets_its_own(page):
    canvas = '.strip[data-name="encoder"] canvas'
    pink = "#e484a8"

    def height():
        rows = [row for row, drawn in enumerate(pixels(page, canvas)) if near(drawn, pink) > 2]
        return rows[-1] - rows[0]

    common = height()
    page.run("document.querySelector('.bar button').click()")
    page.settle()
    assert height() > 3 * max(common, 1)


def test_a_program_line_shows_its_stretch_of_the_path(page, results):
    run = results.budget.analysis.run
    line_at = program_lines(results.job, len(run.time))
    lines = np.array([line_at(time) or 0 for time in run.time.tolist()])
    shown = page.run("return [...document.querySelectorAll('.lines li')].map(li => [li.value, li.textContent])")
    assert shown == [[k, line] for k, line in enumerate(TEXT.rstrip("\n").split("\n"), 1)]
    usable = page.run("return [...document.querySelectorAll('.lines button')].map(b => Number(b.dataset.line))")
    assert set(usable) == set(lines.tolist()) - {0}
    arc = next(k for k, line in enumerate(TEXT.split("\n"), 1) if line.startswith("G3"))
    page.run("document.querySelector('.plan figcaption button').click()")  # the error as it is
    canvases = {name: f"{name} canvas" for name in (PLAN, '.strip[data-name="contour-all"]')}
    before = {name: pixels(page, canvas) for name, canvas in canvases.items()}
    page.run(f"""document.querySelector('.lines [data-line="{arc}"]').click()""")
    page.settle()
    assert tick_of(page, results) == np.flatnonzero(lines == arc)[0]
    assert readout(page, "line") == str(arc)
    assert page.run("return document.querySelector('.lines [aria-pressed=true]').dataset.line") == str(arc)
    assert page.run("return document.querySelector('.lines [aria-current]').dataset.line") == str(arc)
    rows, columns = np.nonzero(differing(pixels(page, canvases[PLAN]), before[PLAN]))
    nozzle = run.nozzle[lines == arc]
    wide, high = np.ptp(nozzle[:, :2], axis=0)
    # the highlighted stretch has the arc's shape, and a line's width more
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(wide / high, rel=0.35)
    strip = '.strip[data-name="contour-all"]'
    band = differing(pixels(page, canvases[strip]), before[strip]).mean(axis=0) > 0.5
    box = page.box(STRIP)
    assert band.sum() / box[2] == pytest.approx((lines == arc).mean(), abs=0.01)
    page.run(f"""document.querySelector('.lines [data-line="{arc}"]').click()""")
    page.settle()
    assert not differing(pixels(page, canvases[PLAN]), before[PLAN]).any()


def scale_of(page, results):
    """The time between the places at a quarter and at three quarters of the strips' width [s]."""
    page.key("Escape")
    left, top, width, height = page.box(STRIP)
    times = []
    for share in (0.25, 0.75):
        page.mouse("mouseMoved", left + share * width, top + 0.5 * height)
        times.append(tick_of(page, results) * results.budget.analysis.run.period)
    return times


@pytest.mark.soak
def test_drag_and_wheel_zoom_shift_drag_pans_and_double_click_resets(page, results):
    end = float(results.budget.analysis.run.time[-1])
    page.run("document.querySelector('.strips').focus()")
    assert scale_of(page, results) == pytest.approx([0.25 * end, 0.75 * end], abs=0.02 * end)
    left, top, width, height = page.box(STRIP)
    middle = top + 0.5 * height
    page.drag((left + 0.25 * width, middle), (left + 0.75 * width, middle))
    assert scale_of(page, results) == pytest.approx([0.375 * end, 0.625 * end], abs=0.02 * end)
    page.drag((left + 0.5 * width, middle), (left + 0.75 * width, middle), SHIFT)
    assert scale_of(page, results) == pytest.approx([0.25 * end, 0.5 * end], abs=0.02 * end)
    page.mouse("mouseWheel", left + 0.5 * width, middle, deltaX=0, deltaY=-500)
    begin, after = scale_of(page, results)
    assert after - begin < 0.2 * end
    page.click(left + 0.5 * width, middle, count=2)
    assert scale_of(page, results) == pytest.approx([0.25 * end, 0.75 * end], abs=0.02 * end)
    before = pixels(page, f"{PLAN} canvas")
    left, top, width, height = page.box(PLAN)
    page.drag((left + 0.3 * width, top + 0.3 * height), (left + 0.6 * width, top + 0.6 * height))
    assert differing(pixels(page, f"{PLAN} canvas"), before).any()
    page.click(left + 0.5 * width, top + 0.5 * height, count=2)
    page.key("Escape")
    assert not differing(pixels(page, f"{PLAN} canvas"), before).any()


def test_the_strips_are_drawn_over_time_or_along_the_path(page, results):
    run = results.budget.analysis.run
    page.run("document.querySelectorAll('.bar button')[1].click()")
    page.settle()
    assert page.text(".bar button:nth-of-type(2)") == "along the path"
    box = page.box(STRIP)
    s_range = results.budget.analysis.nozzle.s
    mark = float(page.run("return document.querySelector('.u-cursor-x').style.transform").split("(")[1].split("px")[0])
    s = float(readout(page, "s").split()[0])
    assert mark / box[2] == pytest.approx((s - s_range.min()) / np.ptp(s_range), abs=0.02)
    left, top, width, height = page.box(STRIP)
    ticks = results.budget.analysis.ticks
    s = np.maximum.accumulate(results.budget.analysis.nozzle.s)
    along = np.interp(np.arange(len(run.time)), ticks, s)
    for share in (0.2, 0.7, 0.9):
        page.mouse("mouseMoved", left + share * width, top + 0.5 * height)
        place = along[0] + share * np.ptp(along)
        assert along[tick_of(page, results)] == pytest.approx(place, abs=np.ptp(along) / width + 0.2)


def test_film_and_cursor_follow_each_other(page, results):
    end = float(results.budget.analysis.run.time[-1])
    page.wait("document.querySelector('video').duration > 0")
    duration = page.run("return document.querySelector('video').duration") - CARD
    # it rests at its last frame before the end card, while the cursor is at the largest error
    page.wait(f"Math.abs(document.querySelector('video').currentTime - {duration - 0.5 / FPS}) < {0.5 / FPS}")
    page.settle()
    assert page.run("return parseFloat(document.querySelector('.readout output').textContent)") < 0.9 * end
    left, top, width, height = page.box(STRIP)
    frames = round(duration * FPS)
    for share in (0.3, 0.8):
        page.mouse("mouseMoved", left + share * width, top + 0.5 * height)
        time = tick_of(page, results) * results.budget.analysis.run.period
        page.wait(f"Math.abs(document.querySelector('video').currentTime - {time * duration / end}) < 0.05")
        page.wait("!document.querySelector('video').seeking")
        page.settle()
        assert page.run(GREY) * frames / 255 == pytest.approx(round(time * FPS), abs=0.6)  # the nearest frame
    page.run(f"document.querySelector('video').currentTime = {0.5 * duration}")
    page.wait("!document.querySelector('video').seeking")
    page.settle()
    assert tick_of(page, results) * results.budget.analysis.run.period == pytest.approx(0.5 * end, abs=0.05)
    page.run("document.querySelector('video').muted = true; document.querySelector('video').play()")
    page.wait(f"document.querySelector('video').currentTime > {0.6 * duration}")
    script = (
        "const shown = document.querySelector('.readout output').textContent;"
        "return [document.querySelector('video').currentTime, parseFloat(shown)]"
    )
    film, shown = page.run(script)
    assert shown == pytest.approx(film * end / duration, abs=0.1)
    page.run("document.querySelector('video').pause()")


def test_details_are_folded_until_they_are_asked_for(page):
    opened = "return [...document.querySelectorAll('section > details')].map((details) => details.open)"
    assert set(page.run(opened)) == {False}
    page.run("document.querySelector('nav a[href=\"#servo\"]').click()")
    page.wait("document.querySelector('#servo > details').open")
    assert page.run(opened).count(True) == 1
    titles = page.run("return [...document.querySelectorAll('h2')].map((title) => title.textContent)")
    assert titles[1:3] == ["Bead and path", "Error budget"]


@pytest.mark.parametrize("scheme", suite_runs(["light", "dark"], 0))
def test_the_page_is_as_wide_as_a_small_screen(page, file, scheme):
    page.media(scheme=scheme)
    for width in (1280, 400):
        page.open(file, width)
        assert page.run("return document.documentElement.scrollWidth") == width
        assert page.run("return document.querySelector('.plan .surface').clientWidth") > 0.26 * width
        assert page.run(SCROLLED) == []
        page.run("for (const details of document.querySelectorAll('details')) details.open = true")
        assert page.run("return document.documentElement.scrollWidth") == width


def test_print_and_a_browser_without_scripts_show_figures(page, file):
    shown = "return [...document.querySelectorAll(arguments[0])].map((part) => part.getBoundingClientRect().height > 0)"
    still = page.run(shown, ".still")
    assert len(still) == 2
    assert not any(still)
    page.media("print")
    assert all(page.run(shown, ".still"))
    assert not any(page.run(shown, ".viewer"))
    page.media()
    page.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        page.driver.get(file.as_uri())
        figures = page.driver.find_elements("css selector", "figure")
        assert len(figures) == 5
        assert all(figure.size["height"] > 0 for figure in figures)
    finally:
        page.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


def moved(page):
    """Pictures in a second while the mouse moves the cursor."""
    script = (
        "const [count, done] = arguments; const over = document.querySelector('.strip .u-over');"
        "const box = over.getBoundingClientRect(); let k = 0; const start = performance.now();"
        "const step = () => { if (k === count) return done(1e3 * k / (performance.now() - start)); k++;"
        "over.dispatchEvent(new PointerEvent('pointermove', {clientX: box.left + (k * 16) % box.width,"
        "clientY: box.top + 5, bubbles: true})); requestAnimationFrame(step); }; requestAnimationFrame(step);"
    )
    return page.driver.execute_async_script(script, PICTURES)


def test_the_page_is_usable_at_once(browser, file):
    before = browser.busy()
    browser.open(file)
    duration = browser.busy() - before
    ready = browser.run("return performance.getEntriesByName('viewer-ready')[0].startTime")
    print(f"usable after {ready:.0f} ms, {1e3 * duration:.0f} ms of the processor")
    assert duration < USABLE


@pytest.mark.soak
def test_the_cursor_is_fluent_with_a_hundred_thousand_samples(browser, results, tmp_path):
    # the run, many times over, without its values of 16 bits again
    content = ViewerData(results).content()
    times = -(-ROWS // content["rows"])
    text = repeated(ViewerData(results), times)
    write_run_page(tmp_path / "report.html", results)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    (tmp_path / "long.html").write_text(
        page.replace(packed(ViewerData(results).text()), packed(text)), encoding="utf-8"
    )
    browser.open(tmp_path / "long.html")
    assert json.loads(text)["rows"] >= ROWS
    before = browser.busy()
    rate = moved(browser)
    duration = (browser.busy() - before) / PICTURES
    print(f"{rate:.0f} pictures/s, {1e3 * duration:.1f} ms of the processor each")
    assert duration < 1 / LEAST_RATE
    assert browser.messages() == []


def repeated(data, times):
    """The JSON of a viewer's data, with all its columns repeated."""
    content = json.loads(data.text())
    rows = content["rows"]
    for column in content["columns"].values():
        if column["kind"] == "runs":
            column["values"] *= times
            column["counts"] *= times
        elif column["kind"] == "ascending":
            column["data"] = ""
        elif column["kind"] == "u16":
            column["data"] = base64.b64encode(base64.b64decode(column["data"]) * times).decode()
        else:
            differences = np.frombuffer(base64.b64decode(column["data"]), "i1").copy()
            jumps = np.frombuffer(base64.b64decode(column["jumps"]), "<u2")
            if differences[0] != -128:  # from 0 on, each time
                jumps = np.concatenate([[differences[0]], jumps]).astype("<u2")
                differences[0] = -128
            column["data"] = base64.b64encode(differences.tobytes() * times).decode()
            column["jumps"] = base64.b64encode(jumps.astype("<u2").tobytes() * times).decode()
    content["rows"] = content["ticks"] = rows * times
    return json.dumps(content).replace("<", "\\u003c")


def test_one_cursor_over_two_runs(browser, tmp_path):
    """Values at the cursor against the closed form of both errors, by keys, click and legend."""
    errors = {"before": (0.030, 0.010), "after": (0.010, -0.005)}
    runs = [on_circle(*error, period) for error, period in zip(errors.values(), (0.001, 0.0016), strict=True)]
    browser.open(compare_runs(*runs, names=list(errors)).report(tmp_path / "compared"))

    def check():
        place = float(browser.text(".readout .place").removeprefix("s = ").removesuffix(" mm"))
        angle = (place - START) / RADIUS
        shown = [browser.text(f'.readout output[data-name="contour.{key}"]') for key in (0, 1, "difference")]
        numbers = [float(text.replace("−", "-").removesuffix(" µm")) for text in shown]
        expected = [1e3 * (mean + swing * np.cos(angle)) for mean, swing in errors.values()]
        assert numbers == pytest.approx([*expected, expected[1] - expected[0]], abs=0.1)
        return place

    worst = check()
    turns = (worst - START) / RADIUS / np.pi
    assert abs(turns - round(turns)) < 0.01 or worst == pytest.approx(START, abs=0.1)
    browser.run("document.querySelector('.strips').focus()")
    browser.key("ArrowLeft" if worst > START + 1 else "ArrowRight", shift=True)
    assert check() != worst
    left, top, width, height = browser.box('.strip[data-name="contour.0-all"] .u-over')
    before = browser.text(".readout .place")
    browser.click(left + 0.25 * width, top + 0.5 * height)
    browser.wait(f"document.querySelector('.readout .place').textContent !== {before!r}")
    quarter = check()
    assert (quarter - START) / (2 * np.pi * RADIUS) == pytest.approx(0.25, abs=0.01)
    left, top, width, height = browser.box(".overlay .surface")
    browser.click(left + 0.5 * width - 0.43 * height, top + 0.5 * height)  # the circle's leftmost point
    assert (check() - START) / (2 * np.pi * RADIUS) == pytest.approx(0.5, abs=0.02)
    browser.run("document.querySelector('[data-run=\"0\"]').click()")
    browser.settle()
    assert browser.run("return document.querySelector('[data-run=\"0\"]').getAttribute('aria-pressed')") == "false"
    assert browser.messages() == []
