#!/usr/bin/env python3
"""Takes docs/pictures/live.png: the workbench in Chromium without a window, with the test group's packages."""

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

WIDTH = 1280
HEIGHT = 800  # [pixels]
COLOURS = 256
PATIENCE = 120.0  # [s]
TAKEN = """
const bench = document.getElementById("bench");
return bench.dataset.engine === "mujoco" && Number(bench.dataset.number) > arguments[0];
"""


def wait(browser, number):
    end = time.monotonic() + PATIENCE
    while not browser.run(TAKEN, number):
        if time.monotonic() > end:
            raise SystemExit("the workbench shows no result")
        time.sleep(0.1)


def main():
    command = [sys.executable, "-m", "gantrysim", "live", "an225", "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        address = re.search(r"http://\S+", server.stdout.readline())[0]
        with tempfile.TemporaryDirectory() as profile, chromium(profile) as browser:
            browser.resize(WIDTH, HEIGHT)
            browser.driver.get(address)
            wait(browser, 0)
            browser.run('document.getElementById("seen").click()')
            browser.settle()
            taken = browser.driver.execute_cdp_cmd("Page.captureScreenshot", {})
    finally:
        server.terminate()
        server.wait()
    picture = Image.open(io.BytesIO(base64.b64decode(taken["data"]))).convert("RGB").quantize(COLOURS)
    picture.save(ROOT / "docs" / "pictures" / "live.png", optimize=True)


main()
