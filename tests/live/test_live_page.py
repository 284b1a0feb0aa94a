"""The workbench in a browser, with its server in a process: values, edits, drops, lost servers, two tabs."""

import re
import signal
import subprocess
import sys
import time

import pytest

from gantrysim import Job
from gantrysim.report.writing import results_of
from gantrysim.results.colours import RUNS

from support.live_jobs import JOB, TEXT

PATIENCE = 60.0  # [s]
# puts a file on the page as a drag from the desktop does
DROP = """
const [name, text] = arguments;
const transfer = new DataTransfer();
transfer.items.add(new File([text], name));
document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
"""
# moves a slider as a drag does, to a share of its range
SLIDE = """
const slider = document.querySelector(`input[type="range"][data-key="${arguments[0]}"]`);
slider.value = arguments[1];
slider.dispatchEvent(new Event("input", { bubbles: true }));
slider.dispatchEvent(new Event("change", { bubbles: true }));
"""
OPEN = """
const jobs = document.getElementById("jobs");
jobs.value = JSON.stringify({ kind: "folder", name: arguments[0] });
jobs.dispatchEvent(new Event("change"));
"""
TYPE = """
const area = document.querySelector("textarea");
area.value = arguments[0];
area.dispatchEvent(new Event("input", { bubbles: true }));
"""
BENCH = "document.getElementById('bench')"
WHOLE = f"{BENCH}.dataset.engine === 'mujoco' && document.getElementById('work').hidden && !{BENCH}.matches('.stale')"


class Served:
    """A server of the workbench."""

    def __init__(self, folder, job):
        command = [sys.executable, "-m", "gantrysim", "live", job, "--no-browser"]
        self.process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
        self.address = re.search(r"http://\S+", self.process.stdout.readline())[0]

    def end(self):
        self.process.send_signal(signal.SIGINT)
        status = self.process.wait(PATIENCE)
        self.process.stdout.close()
        return status


class Page:
    """A browser that shows a server's page."""

    def __init__(self, browser, served):
        self.browser = browser
        self.address = served.address
        browser.resize(1280, 900)
        browser.driver.get(self.address)
        self.until(WHOLE)

    def until(self, condition):
        """Wait in this process: the page's policy admits no eval."""
        end = time.monotonic() + PATIENCE
        while not self.browser.run(f"return Boolean({condition})"):
            assert time.monotonic() < end, condition
            time.sleep(0.02)

    def changed(self, script, *arguments):
        """Run a script that changes the job, and wait for the whole answer."""
        number = self.number
        self.browser.run(script, *arguments)
        self.until(f"Number({BENCH}.dataset.number) > {number} && {WHOLE}")

    @property
    def number(self):
        return int(self.browser.run(f"return {BENCH}.dataset.number || -1"))

    def texts(self):
        """The verdict's texts by row."""
        script = """
        const rows = [...document.querySelectorAll("#verdict [data-row]")];
        const texts = (row) => [...row.querySelectorAll("p")].map((p) => p.textContent);
        return Object.fromEntries(rows.map((row) => [row.dataset.row, texts(row)]));
        """
        return self.browser.run(script)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("jobs")
    (made / "short.toml").write_text(JOB)
    (made / "part.ngc").write_text(TEXT)
    return made


@pytest.fixture(scope="module")
def server(folder):
    served = Served(folder, "short.toml")
    yield served
    assert served.end() == 0


@pytest.fixture
def page(browser, server):
    yield Page(browser, server)
    assert browser.messages() == []


def expected(job):
    verdict = results_of(job, job.run(), causes=False).verdict
    return {row.name: list(row.texts) for row in verdict.rows}


def slid(served, key):
    """The value that a slider has set."""
    return float(served.browser.run(f"return document.querySelector('[data-number=\"{key}\"]').value"))


def test_the_page_shows_the_commands_values_before_and_after_a_slider(page, folder):
    assert page.texts() == expected(Job.load(folder / "short.toml"))
    page.changed(SLIDE, "program.acceleration", 200)
    value = slid(page, "program.acceleration")
    assert value < 2000.0
    assert page.texts() == expected(Job.load(folder / "short.toml", {"program.acceleration": value}))
    page.changed("document.querySelector('[data-do=\"undo\"]').click()")
    assert slid(page, "program.acceleration") == 2000.0
    assert page.texts() == expected(Job.load(folder / "short.toml"))


def test_a_dropped_program_is_edited_to_be_wrong_and_right_again(page, folder):
    page.changed(DROP, "<b>part.ngc", TEXT)
    assert page.browser.run("return document.querySelector('textarea').value") == TEXT
    assert page.browser.run("return document.querySelectorAll('#jobs b').length") == 0
    page.browser.run(TYPE, TEXT.replace("G1 Y20", "G1 Y20 Q$"))
    page.until("document.querySelector('.marks .error')?.dataset.line === '6'")
    assert "line 6" in page.browser.text("#refused")
    assert page.browser.run(f"return {BENCH}.matches('.refused')")
    page.changed(TYPE, TEXT.replace("Y20", "Y30"))
    assert page.browser.run("return document.querySelectorAll('.marks .error').length") == 0
    assert page.browser.run("return document.getElementById('refused').hidden")
    (folder / "right.ngc").write_text(TEXT.replace("Y20", "Y30"))
    assert page.texts() == expected(Job.load(folder / "right.ngc"))


def test_a_reload_and_a_second_tab_show_the_same(page):
    page.changed("document.getElementById('keep').click()")
    first = page.texts()
    page.browser.driver.refresh()
    page.until(WHOLE)
    assert page.texts() == first
    assert page.browser.run("return document.querySelector('.overlay') !== null")
    window = page.browser.driver.current_window_handle
    page.browser.driver.switch_to.new_window("tab")
    page.browser.driver.get(page.address)
    page.until(WHOLE)
    assert page.texts() == first
    page.changed("document.getElementById('keep').click()")
    other = page.number
    page.browser.driver.close()
    page.browser.driver.switch_to.window(window)
    page.until(f"Number({BENCH}.dataset.number) === {other} && {WHOLE}")
    assert page.browser.run("return document.querySelector('.overlay') === null")


@pytest.mark.soak
def test_the_cursor_marks_the_line_and_a_line_its_path(page):
    page.changed(DROP, "part.ngc", TEXT)
    page.browser.run("document.querySelector('.strips').focus()")
    page.browser.key("Home")
    page.browser.key("ArrowRight", shift=True, presses=4)
    page.until("document.querySelector('.marks .current') !== null")
    line = page.browser.text('.readout output[data-name="line"]')
    top = page.browser.run("return parseFloat(document.querySelector('.marks .current').style.top)")
    assert round(top / 18) + 1 == int(line)
    assert page.browser.text('.readout output[data-name="time"]') != "NaN s"


@pytest.mark.soak
def test_the_3d_view_follows_the_cursor_and_the_job_from_where_it_was_turned_to(page):
    surface = ".space .surface"
    page.changed(DROP, "part.ngc", TEXT)
    page.browser.run("document.querySelector('[data-view=space]').click()")
    page.until(f"document.querySelector('{surface}')?.dataset.view")
    page.browser.run("document.querySelector('.strips').focus()")
    page.browser.key("Home")
    page.browser.key("ArrowRight", shift=True, presses=2)
    described = page.browser.run(f"return document.querySelector('{surface}').getAttribute('aria-valuetext')")
    assert described.startswith(f"t = {page.browser.text('.readout output[data-name=time]')}, x ")
    page.browser.box(surface)  # out of sight nothing is drawn
    page.browser.run("[...document.querySelectorAll('.space button')].find((b) => b.textContent === 'top').click()")
    page.until(f"document.querySelector('{surface}').dataset.view.startsWith('90.00000 90.00000 ')")
    near = distance(page)
    page.changed(TYPE, TEXT.replace("X30", "X60"))
    # the camera still looks down, from farther away
    page.until(f"!document.querySelector('{surface}').dataset.view.startsWith('90.00000 90.00000 {near}')")
    assert page.browser.run(f"return document.querySelector('{surface}').dataset.view").startswith("90.00000 90.00000 ")
    assert float(distance(page)) > float(near)
    page.browser.run("document.querySelector('[data-view=bead]').click()")


def distance(page):
    return page.browser.run("return document.querySelector('.space .surface').dataset.view.split(' ')[2]")


def test_a_drag_moves_the_part(page):
    page.changed(DROP, "part.ngc", TEXT)
    place = slid(page, "program.placement.x")
    page.browser.run("[...document.querySelectorAll('.choices button')].at(-1).click()")
    left, top, width, height = page.browser.box(".bead .surface")
    number = page.number
    middle = (left + 0.5 * width, top + 0.5 * height)
    page.browser.drag(middle, (middle[0] + 60, middle[1]))
    page.until(f"Number({BENCH}.dataset.number) > {number} && {WHOLE}")
    moved = slid(page, "program.placement.x")
    assert moved > place + 1.0
    page.changed("document.querySelector('[data-do=\"undo\"]').click()")
    assert slid(page, "program.placement.x") == place


def test_a_measured_trace_is_laid_beside_the_run(page, folder):
    page.changed(OPEN, "short.toml")
    job = Job.load(folder / "short.toml", {"servo.damping": 0.6})
    run = job.run()
    rows = [
        f"{t:.4f},{a:.6f},{b:.6f},{c:.6f},{d:.6f}"
        for t, (a, b), (c, d) in zip(run.time, run.commanded, run.encoder, strict=True)
    ]
    page.changed(DROP, "<b>log.csv", "\n".join(["time_s,commanded_x,commanded_y,encoder_x,encoder_y", *rows]))
    assert page.browser.text("#beside-title") == "Beside: _b_log.csv"
    assert page.browser.text("#difference").startswith("Contour error: ")
    legend = "[...document.querySelectorAll('.readout.compared button')].map((b) => b.textContent)"
    assert page.browser.run(f"return {legend}") == ["_b_log.csv", "now"]
    colours = "[...document.querySelectorAll('.readout.compared line')].map((l) => l.getAttribute('stroke'))"
    assert page.browser.run(f"return {colours}") == list(RUNS[:2])
    page.changed("document.querySelector('[data-do=apart]').click()")
    assert page.browser.run("return document.querySelector('.overlay')") is None
    assert page.browser.run("return document.getElementById('beside').hidden")


# roles of what one can operate
OPERATED = {"button", "slider", "combobox", "textbox", "spinbutton", "link", "checkbox", "DisclosureTriangle", "option"}


def nodes(page):
    """What a screen reader is told: role, name and properties of every node."""
    page.browser.driver.execute_cdp_cmd("Accessibility.enable", {})
    tree = page.browser.driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
    page.browser.driver.execute_cdp_cmd("Accessibility.disable", {})
    for node in tree:
        if not node["ignored"]:
            properties = {entry["name"]: entry["value"].get("value") for entry in node.get("properties", ())}
            yield node["role"]["value"], node.get("name", {}).get("value", ""), properties


def test_a_screen_reader_is_told_every_control_and_the_verdict(page):
    page.changed(OPEN, "short.toml")
    told = list(nodes(page))
    operated = [(role, name) for role, name, _ in told if role in OPERATED]
    assert len(operated) > 50
    assert [(role, name) for role, name in operated if not name.strip()] == []
    texts = [name for _, name, properties in told if properties.get("live") == "polite"]
    assert texts
    live = "document.getElementById('verdict')"
    assert page.browser.run(f"return {live}.getAttribute('aria-live')") == "polite"
    assert page.browser.run(f"return {live}.getAttribute('aria-busy')") == "false"
    # a bar without a value moves, which takes time from the simulation
    assert page.browser.run("return document.getElementById('progress').hasAttribute('value')")
    page.browser.run(f"window.seen = 0; new MutationObserver(() => window.seen++).observe({live}, {{childList: true}})")
    page.changed(SLIDE, "program.acceleration", 490)
    # the stability first, then the first answer; the whole one, which is the same, is not read out again
    assert page.browser.run("return window.seen") == 2


@pytest.mark.soak
def test_every_target_is_large_enough_for_a_finger(page):
    script = """
    const targets = [...document.querySelectorAll("button, select, input, summary, a[href], textarea, [tabindex='0']")];
    const sizes = targets.map((target) => [target, target.getBoundingClientRect()]).filter(([, box]) => box.width > 1);
    const small = sizes.filter(([, box]) => Math.min(box.width, box.height) < 23.5);
    return [sizes.length, small.map(([target, box]) => `${target.outerHTML.slice(0, 80)} ${box.width} ${box.height}`)];
    """
    for name in ("short.toml", "part.ngc"):
        page.changed(OPEN, name)
        count, small = page.browser.run(script)
        assert count > 40
        assert small == []


def touch(page, begin, end):
    """Drag a finger over the page."""
    send = page.browser.driver.execute_cdp_cmd
    for kind, point in (("touchStart", begin), ("touchMove", end), ("touchEnd", None)):
        points = [] if point is None else [{"x": point[0], "y": point[1]}]
        send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        page.browser.settle()


@pytest.mark.soak
def test_a_finger_moves_a_slider_the_part_and_the_cursor(page):
    page.browser.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
    try:
        page.changed(OPEN, "part.ngc")
        left, top, width, height = page.browser.box("input[type=range][data-key=override]")
        middle = (left + 0.5 * width, top + 0.5 * height)
        number = page.number
        touch(page, middle, (left + 0.25 * width, middle[1]))
        page.until(f"Number({BENCH}.dataset.number) > {number} && {WHOLE}")
        assert slid(page, "override") < 100
        left, top, width, height = page.browser.box(".bead .surface")
        middle = (left + 0.5 * width, top + 0.5 * height)
        near_path = (middle[0], top + 0.93 * height)
        touch(page, near_path, near_path)
        assert page.browser.run("return document.querySelector('.readout .pin').textContent").startswith("pinned")
        page.browser.run("[...document.querySelectorAll('.choices button')].at(-1).click()")
        place = slid(page, "program.placement.x")
        number = page.number
        touch(page, middle, (middle[0] + 50, middle[1]))
        page.until(f"Number({BENCH}.dataset.number) > {number} && {WHOLE}")
        assert slid(page, "program.placement.x") > place + 1.0
    finally:
        page.browser.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})


@pytest.mark.soak
def test_a_lost_server_is_said(browser, folder):
    served = Served(folder, "part.ngc")
    page = Page(browser, served)
    (folder / "part.ngc").write_text(TEXT.replace("Y20", "Y25"))
    page.until("document.querySelector('textarea').value.includes('Y25')")
    page.until(WHOLE)
    assert browser.messages() == []
    served.process.kill()
    served.process.wait()
    served.process.stdout.close()
    page.until("!document.getElementById('lost').hidden")
    assert "server is gone" in browser.text("#lost")


@pytest.mark.soak
def test_what_to_change_is_stopped_and_tried(page):
    page.changed(OPEN, "short.toml")
    page.browser.run("document.querySelector('[data-do=\"improve\"]').click()")
    page.until("!document.getElementById('work').hidden")
    page.browser.run("document.querySelector('[data-do=\"stop\"]').click()")
    page.until("document.getElementById('work').hidden")
    assert page.browser.run("return document.querySelector('[data-proposal]')") is None
    page.browser.run("document.querySelector('[data-do=\"improve\"]').click()")
    page.until("document.querySelector('[data-proposal]') && document.getElementById('work').hidden")
    cells = "[...document.querySelectorAll('#proposals tbody tr:first-child td')]"
    promised = page.browser.run(f"return {cells}.slice(0, 4).map((cell) => cell.textContent)")
    page.changed("document.querySelector('[data-proposal]').click()")
    assert all(float(usage.removesuffix(" %")) <= 100 for usage in promised)
    assert page.browser.run("return document.querySelectorAll('#verdict .row.is-fail').length") == 0


@pytest.mark.soak
def test_a_film_is_made_seen_and_downloaded(page):
    page.changed(DROP, "part.ngc", TEXT)
    page.browser.run("document.querySelector('[data-do=film]').click()")
    page.until("document.getElementById('video').readyState >= 1")
    assert page.browser.run("return document.getElementById('video').videoWidth") == 960
    assert page.browser.run("return document.getElementById('download').download") == "part.mp4"
    size = """
    const [done] = arguments;
    fetch(document.getElementById("download").href).then((answer) => answer.blob()).then((film) => done(film.size));
    """
    assert page.browser.driver.execute_async_script(size) > 10_000
    # before its end card it lasts the whole run: where it goes the cursor goes, and the other way round
    film = "document.getElementById('video')"
    shown = "parseFloat(document.querySelector('#readout output').textContent)"
    page.browser.run(f"{film}.currentTime = 0")
    page.until(f"{shown} === 0")
    page.browser.run(f"{film}.currentTime = 0.5 * ({film}.duration - 1)")
    page.until(f"{shown} > 0 && !{film}.seeking")
    page.browser.run("document.querySelector('.strips').focus()")
    page.browser.key("Home")
    page.until(f"{shown} === 0 && {film}.currentTime < 0.1")
    page.changed(TYPE, TEXT.replace("Y20", "Y30"))
    assert page.browser.text("#former") == "of a former value"
    page.browser.key("End")
    page.until(f"{shown} > 0")
    assert page.browser.run(f"return {film}.currentTime") < 0.1
    page.browser.run("document.getElementById('film-close').click()")


@pytest.mark.soak
def test_the_kept_run_is_seen_in_space(page):
    page.changed("document.getElementById('keep').click()")
    page.browser.run("document.querySelector('[data-view=space]').click()")
    view = "document.querySelector('.view.space .surface[data-view]')"
    page.until(f"{view} && {view}.getAttribute('aria-label').startsWith('Beads of the runs')")
    page.changed(SLIDE, "program.acceleration", 700)
    assert page.browser.run("return document.querySelector('.overlay').hidden")
    page.changed("document.getElementById('keep').click()")
    # the view that was chosen stays
    page.until(f"{view} && {view}.getAttribute('aria-label').startsWith('Bead in 3-D')")
    page.browser.run("document.querySelector('[data-view=bead]').click()")
    page.changed("document.querySelector('[data-do=\"undo\"]').click()")
    assert not page.browser.messages()


@pytest.mark.soak
def test_every_control_moves_the_job(page):
    before = page.texts()
    sliders = "[...document.querySelectorAll('input[type=range]')]"
    keys = page.browser.run(f"return {sliders}.map((slider) => slider.dataset.key)")
    assert len(keys) > 10
    for key in keys:
        page.changed(SLIDE, key, 480 if key != "program.acceleration" else 520)
        assert not page.browser.run("return document.getElementById('refused').textContent"), key
        page.changed("document.querySelector('[data-do=\"undo\"]').click()")
    assert page.texts() == before
