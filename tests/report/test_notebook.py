"""The viewer of a run in a notebook: the host imports the widget's module and renders it, several times on one page."""

import base64
import json

import numpy as np
import pytest

from gantrysim import InputError

from support.viewer_jobs import viewer_job

HOST = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>notebook</title><link rel="icon" href="data:,"></head>
<body><h2 class="answer">a notebook of its own style</h2><div id="a"></div><div id="b"></div>
<script type="application/json" id="traits">TRAITS</script>
<script type="module">
const traits = JSON.parse(document.getElementById("traits").textContent);
const { default: widget } = await import("data:text/javascript;base64,CODE");
const model = { get: (name) => traits[name] };
window.ends = ["a", "b"].map((id) => widget.render({ model, el: document.getElementById(id) }));
</script></body></html>
"""
FRAMES = "[...document.querySelectorAll('iframe')]"
READY = f"{FRAMES}.length === 2 && {FRAMES}.every((f) => f.contentDocument.documentElement.className === 'live')"
FITS = f"{FRAMES}.every((f) => f.clientHeight === f.contentDocument.documentElement.scrollHeight)"


@pytest.fixture(scope="module")
def run():
    return viewer_job().run()


@pytest.fixture(scope="module")
def view(run):
    return run.view()


@pytest.fixture(scope="module")
def host(view, tmp_path_factory):
    traits = json.dumps({"page": view.page, "title": view.title}).replace("<", "\\u003c")
    code = base64.b64encode(str(view._esm).encode()).decode()
    file = tmp_path_factory.mktemp("notebook") / "host.html"
    file.write_text(HOST.replace("TRAITS", traits).replace("CODE", code), encoding="utf-8")
    return file


def test_the_view_is_the_page_s_viewer_and_verdict_alone(run, view):
    assert view.title == f"{run.job.name} on {run.machine}"
    assert run.verdict.headline[2:] in view.page
    assert view.page.count("<section") == 2
    assert len(view.page) < 1_000_000
    assert "http" not in view.page.replace("http://www.w3.org/", "")


def test_two_views_on_one_page_are_as_high_as_their_content_and_share_nothing(browser, host):
    browser.open(host)
    browser.wait(READY)
    browser.wait(FITS)
    assert browser.run("return document.querySelectorAll('[id]').length") == 3
    assert browser.run("return document.documentElement.className") == ""
    browser.resize(500, 900)
    browser.wait(FITS)
    heights = browser.run(f"return {FRAMES}.map((f) => f.clientHeight)")
    assert heights[0] == heights[1]
    assert heights[0] > 900
    # the cursor of one moves alone
    texts = f"return {FRAMES}.map((f) => f.contentDocument.querySelector('.readout').textContent)"
    first, second = browser.run(texts)
    assert first == second
    key = "new KeyboardEvent('keydown', {key: 'Home', bubbles: true})"
    browser.run(f"{FRAMES}[0].contentDocument.querySelector('.plan .surface').dispatchEvent({key})")
    # with the next picture
    browser.wait(f"{texts.removeprefix('return ')}.some((text, _, all) => text !== all[0])")
    moved, still = browser.run(texts)
    assert still == second
    assert moved != first
    browser.run("window.ends.forEach((end) => end())")
    assert browser.messages() == []


def test_a_run_that_lays_nothing_is_not_viewed(run):
    with pytest.raises(InputError, match=r"run\.view: the dispenser is never on"):
        run.replaced(dispense=np.zeros_like(run.dispense)).view()
    with pytest.raises(InputError, match=r"run\.view: the record has neither its job nor"):
        run.replaced(job=None).view()
