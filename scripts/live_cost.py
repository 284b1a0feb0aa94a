#!/usr/bin/env python3
"""Measures the workbench in Chromium without a window: time from a slider to the new verdict and bead, bytes, memory.

Usage: live_cost.py [CHANGES], for the jobs below; then so many changes of the last one, by default 1000, for memory.
"""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from gantrysim.job.job import Job  # noqa: E402

from support.browser import chromium  # noqa: E402

JOBS = {
    "an225": "program.acceleration",
    "softmc-arc": "program.group.acceleration",
    "fanuc-spiral": "program.acceleration",
    "linuxcnc-flanges": "program.acceleration",
    "svg-gasket": "servo.damping",
}
SAMPLES = 40  # changes of each job
PATIENCE = 120.0  # [s]
# moves a slider and calls back with the times to the first and to the whole answer [ms], and the bytes of both
CHANGE = """
const [key, place, limit, done] = arguments;
const bench = document.getElementById("bench");
const before = Number(bench.dataset.number);
const slider = document.querySelector(`input[type="range"][data-key="${key}"]`);
const start = performance.now();
const times = {};
const bytes = {};
const seen = new MutationObserver(() => {
  const { engine, number } = bench.dataset;
  if (Number(number) === before || engine in times) return;
  bytes[engine] = Number(bench.dataset.bytes);
  requestAnimationFrame(() => {
    times[engine] = performance.now() - start;
    if (!("mujoco" in times)) return;
    seen.disconnect();
    done([times.loop, times.mujoco, bytes.loop, bytes.mujoco]);
  });
});
seen.observe(bench, { attributes: true });
slider.value = place;
slider.dispatchEvent(new Event("input", { bubbles: true }));
slider.dispatchEvent(new Event("change", { bubbles: true }));
"""
SHOWN = """
const { engine } = document.getElementById("bench").dataset;
return engine === "mujoco" && document.getElementById("work").hidden && document.title.includes(arguments[0]);
"""
HEAP = "return performance.memory.usedJSHeapSize"


def resident(process):
    """Resident memory of a process [MB]."""
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1024


def children(process):
    tasks = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="utf-8").split()
    return [int(task) for task in tasks]


def wait(browser, name):
    end = time.monotonic() + PATIENCE
    while not browser.run(SHOWN, name):
        if time.monotonic() > end:
            raise SystemExit(f"{name}: the workbench shows no result")
        time.sleep(0.05)


def change(browser, key, k):
    return browser.driver.execute_async_script(CHANGE, key, 300 + 37 * k % 400, PATIENCE)


def main():
    changes = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    command = [sys.executable, "-m", "gantrysim", "live", "an225", "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        address = re.search(r"http://\S+", server.stdout.readline())[0]
        with tempfile.TemporaryDirectory() as profile, chromium(profile) as browser:
            browser.driver.set_script_timeout(PATIENCE)
            browser.resize(1280, 900)
            browser.driver.get(address)
            wait(browser, "an225")
            print(
                "| job | motion [s] | first answer [ms], median, 95 % | whole answer [ms], median, 95 % "
                "| bytes, first and whole |"
            )
            print("|---|---|---|---|---|")
            for name, key in JOBS.items():
                choice = f'{{"kind":"built-in","name":"{name}"}}'
                browser.run(
                    "const jobs = document.getElementById('jobs'); jobs.value = arguments[0];"
                    "jobs.dispatchEvent(new Event('change'));",
                    choice,
                )
                wait(browser, name)
                change(browser, key, SAMPLES)
                rows = np.array([change(browser, key, k) for k in range(SAMPLES)], float)
                first, whole = (np.percentile(rows[:, column], (50, 95)) for column in (0, 1))
                sizes = np.median(rows[:, 2:], axis=0)
                print(
                    f"| {name} | {Job.load(name).setpoints.duration:.1f} | "
                    f"{first[0]:.0f}, {first[1]:.0f} | {whole[0]:.0f}, {whole[1]:.0f} | "
                    f"{sizes[0]:,.0f}, {sizes[1]:,.0f} |",
                    flush=True,
                )
            (worker,) = [child for child in children(server.pid) if resident(child) > 100]
            for count in (0, changes):
                for k in range(count):
                    change(browser, JOBS["svg-gasket"], k)
                browser.driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
                heap = browser.run(HEAP) / 2**20
                memory = f"worker {resident(worker):.0f} MB, server {resident(server.pid):.0f} MB, page {heap:.0f} MB"
                print(f"after {count} further changes: {memory}", flush=True)
    finally:
        server.terminate()
        server.wait()


main()
