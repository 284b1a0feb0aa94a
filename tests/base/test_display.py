"""How results show themselves: a short line, and a table that a browser can read."""

from xml.etree import ElementTree

import pytest

from gantrysim import Budget, Job
from gantrysim.glue.bead import Bead
from gantrysim.metrics import Analysis

from support.jobs import job_run


@pytest.fixture(scope="module")
def job():
    return Job.load("fanuc-spiral")


@pytest.fixture(scope="module")
def shown(job):
    run = job_run("fanuc-spiral")
    return {
        "Run": run,
        "Analysis": Analysis(run),
        "Budget": Budget(run),
        "Bead": Bead(run, job.bead),
        "Servo": job.built_servo,
        "Machine": job.built_machine,
    }


@pytest.mark.parametrize("name", ["Run", "Analysis", "Budget", "Bead", "Servo", "Machine"])
def test_a_result_shows_itself_in_a_line_and_as_a_table(shown, name):
    one = shown[name]
    text = repr(one)
    assert text.startswith(f"{name}(")
    assert len(text) < 400
    assert "\n" not in text
    table = ElementTree.fromstring(one._repr_html_())
    assert table.tag == "table"
    assert len(table.findall("tr")) >= 3


def test_what_is_shown_is_what_the_result_holds(shown, job):
    run, budget, servo = shown["Run"], shown["Budget"], shown["Servo"]
    assert f"{len(run.time)} of 1 ms" in repr(run)
    assert f"{1e3 * budget.values.contour.rms:.1f} µm rms" in repr(budget)
    assert all(f"{kp:.4g}" in repr(servo) for kp in servo.per_axis("kp"))
    cells = [[cell.text for cell in row] for row in ElementTree.fromstring(budget._repr_html_())[1:]]
    assert cells[-1][:2] == ["contour", f"{1e3 * budget.values.contour.rms:.1f}"]
    rows = [[cell.text for cell in row] for row in ElementTree.fromstring(job.built_machine._repr_html_())[2:]]
    assert [row[0] for row in rows] == list(job.built_machine.axis_names)
