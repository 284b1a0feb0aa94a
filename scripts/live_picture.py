#!/usr/bin/env python3
"""Takes docs/pictures/live.png and the film live.gif: the workbench in Chromium without a window, of the test group.

The film shows what an engineer does first: sliders, 3-D, and what to change.
"""

import base64
import io
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from support.browser import chromium  # noqa: E402

PICTURES = ROOT / "docs" / "pictures"
WIDTH = 1280
HEIGHT = 800  # [pixels]
FILM = (960, 600)  # [pixels]
COLOURS = 256
FILM_COLOURS = 128
PATIENCE = 300.0  # [s]
PAUSE = 1600  # after a step of the film [ms]
STEP = 140  # between values of a slider [ms]
WHOLE = """
const bench = document.getElementById("bench");
return bench.dataset.engine === "mujoco" && Number(bench.dataset.number) > arguments[0]
  && document.getElementById("work").hidden && !bench.matches(".stale");
"""
FOUND = "return Boolean(document.querySelector('[data-proposal]')) && document.getElementById('work').hidden"
# a slider as it is dragged to a share of its range, in thousandths
SLIDE = """
const slider = document.querySelector(`input[type="range"][data-key="${arguments[0]}"]`);
slider.focus({ preventScroll: true });
slider.value = arguments[1];
slider.dispatchEvent(new Event("input", { bubbles: true }));
if (arguments[2]) slider.dispatchEvent(new Event("change", { bubbles: true }));
"""
CLICK = "document.querySelector(arguments[0]).click()"
DRAWN = "return Boolean(document.querySelector('.space .surface')?.dataset.view)"


def wait(browser, condition, *arguments):
    end = time.monotonic() + PATIENCE
    while not browser.run(condition, *arguments):
        if time.monotonic() > end:
            raise SystemExit("the workbench shows no result")
        time.sleep(0.1)


def picture(browser):
    browser.settle()
    taken = browser.driver.execute_cdp_cmd("Page.captureScreenshot", {})
    return Image.open(io.BytesIO(base64.b64decode(taken["data"]))).convert("RGB")


class Film:
    """Frames of the browser, each with how long it is shown [ms]."""

    def __init__(self, browser):
        self.browser = browser
        self.frames = []
        self.times = []

    def take(self, duration):
        self.frames.append(picture(self.browser).resize(FILM, Image.Resampling.LANCZOS))
        self.times.append(duration)

    def changed(self, script, *arguments):
        number = int(self.browser.run("return document.getElementById('bench').dataset.number"))
        self.browser.run(script, *arguments)
        wait(self.browser, WHOLE, number)

    def slide(self, key, places):
        for place in places:
            self.changed(SLIDE, key, place, place == places[-1])
            self.take(STEP)
        self.times[-1] = PAUSE

    def save(self, file):
        middle = self.frames[len(self.frames) // 2]
        sheet = Image.new("RGB", (FILM[0], 3 * FILM[1]))
        for k, frame in enumerate((self.frames[0], middle, self.frames[-1])):
            sheet.paste(frame, (0, k * FILM[1]))
        palette = sheet.quantize(FILM_COLOURS)
        first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in self.frames)
        first.save(file, save_all=True, append_images=others, duration=self.times, loop=0, optimize=True)


def shoot(browser):
    film = Film(browser)
    film.take(PAUSE)
    film.slide("program.acceleration", [550, 600, 650, 700, 750, 800])
    film.slide("override", [600, 540, 480, 420])
    browser.run(CLICK, "[data-view=space]")
    wait(browser, DRAWN)
    film.take(PAUSE)
    browser.run(CLICK, "[data-do=improve]")
    wait(browser, FOUND)
    film.take(PAUSE)
    film.changed(CLICK, "[data-proposal]")
    film.take(PAUSE)
    browser.run("window.scrollTo({ top: 0, behavior: 'instant' })")
    film.take(2 * PAUSE)
    film.save(PICTURES / "live.gif")


def main():
    command = [sys.executable, "-m", "gantrysim", "live", "an225", "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        address = re.search(r"http://\S+", server.stdout.readline())[0]
        with tempfile.TemporaryDirectory() as profile, chromium(profile) as browser:
            browser.resize(WIDTH, HEIGHT)
            browser.driver.get(address)
            wait(browser, WHOLE, 0)
            browser.run('document.getElementById("seen").click()')
            picture(browser).quantize(COLOURS).save(PICTURES / "live.png", optimize=True)
            shoot(browser)
    finally:
        server.terminate()
        server.wait()


main()
