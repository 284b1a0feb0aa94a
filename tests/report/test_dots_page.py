"""Dots on the page in a browser: in plan view where there is no bead, and in 3-D where they leave a plane."""

import pytest

from gantrysim import Job
from gantrysim.glue.bead import Bead
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import Budget
from gantrysim.report.page import write_run_page
from gantrysim.results.colours import RIGHT, channels
from gantrysim.results.run_results import RunResults

DOTS = "G21 G90 G61\n" + "".join(
    f"G0 Z{z + 3}\nG0 X{x}\nG0 Z{z}\nM3\nG4 P0.2\nM5\nG0 Z{z + 3}\n" for x, z in ((0, 0), (8, 4), (16, 0))
)
# number of the canvas' pixels by their colour
COLOURS = """
const canvas = document.querySelector(".bead .surface canvas");
const context = canvas.getContext("2d");
const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
const counts = {};
for (let k = 0; k < data.length; k += 4) {
  if (data[k + 3] < 255) continue;
  const colour = [data[k], data[k + 1], data[k + 2]].join(",");
  counts[colour] = (counts[colour] || 0) + 1;
}
return counts;
"""
AS_REQUESTED = ",".join(map(str, channels(RIGHT)))


@pytest.fixture(scope="module")
def results():
    content = {
        "name": "dots",
        "machine": "xyz",
        "program": {"controller": "linuxcnc.Program", "text": DOTS},
        "dispenser": {"flow": 20.0},
    }
    job = Job.of_content(content, "job dots")
    run = job.follow()
    analysis = Analysis(run)
    return RunResults(job, job.built_machine, Budget(analysis), Bead(run, job.bead, analysis))


def test_a_page_of_dots_alone_draws_them_in_plan_view_and_in_3d(browser, results, tmp_path):
    write_run_page(tmp_path / "report.html", results)
    browser.open(tmp_path / "report.html")
    browser.wait("document.querySelector('.bead .surface canvas').width > 0")
    assert browser.run("return document.querySelector('.bead figcaption').textContent").startswith(
        "Dotsvolume of 3 dots"
    )
    counts = browser.run(COLOURS)
    # three discs of the diameter of 4 mm³ in the colour of what is as requested, less their rims
    scale = browser.run("return document.querySelector('.bead .surface').clientWidth") / (16 + 2 * 3.2)
    assert counts[AS_REQUESTED] > 3 * 0.5 * (0.5 * results.bead.dots[0].diameter * scale / 2) ** 2
    browser.wait("document.querySelector('.space canvas') !== null")
    assert [message for message in browser.messages() if "GPU stall due to ReadPixels" not in message] == []
