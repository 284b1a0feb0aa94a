"""How results show themselves: a short line, and a table that a browser can read."""

import base64
import io
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from gantrysim import Budget, Job, Setpoints
from gantrysim.base import memory
from gantrysim.base.display import decimals_of
from gantrysim.glue.bead import Bead
from gantrysim.machine.machine import Machine, builtin_models
from gantrysim.metrics import Analysis
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.results.colours import STATES

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
        "Setpoints": job.setpoints,
        "Verdict": run.verdict,
    }


def of(html, tag):
    """The elements of a tag in what a notebook shows, which is one element with its parts."""
    root = ElementTree.fromstring(html)
    return [element for element in root.iter() if element.tag.rpartition("}")[2] == tag]


@pytest.mark.parametrize("name", ["Run", "Analysis", "Budget", "Bead", "Servo", "Machine", "Setpoints"])
def test_a_result_shows_itself_in_a_line_and_as_a_table(shown, name):
    one = shown[name]
    text = repr(one)
    assert text.startswith(f"{name}(")
    assert len(text) < 400
    assert "\n" not in text
    (table,) = of(one._repr_html_(), "table")
    assert len(table.findall("tr")) >= 3


def test_what_is_shown_is_what_the_result_holds(shown, job):
    run, budget, servo = shown["Run"], shown["Budget"], shown["Servo"]
    assert f"{len(run.time)} of 1 ms" in repr(run)
    assert f"{1e3 * budget.values.contour.rms:.1f} µm rms" in repr(budget)
    assert all(f"{kp:.4g}" in repr(servo) for kp in servo.per_axis("kp"))
    cells = [[cell.text for cell in row] for row in ElementTree.fromstring(budget._repr_html_())[1:]]
    assert cells[-1][:2] == ["contour", f"{1e3 * budget.values.contour.rms:.1f}"]
    rows = [[cell.text for cell in row] for row in of(job.built_machine._repr_html_(), "tr")[1:]]
    assert [row[0] for row in rows] == list(job.built_machine.axis_names)


def test_a_run_shows_its_bead_and_four_rows_once_drawn(shown):
    run = shown["Run"]
    html = run._repr_html_()
    assert len(html) < 60_000
    assert run._repr_html_() is html
    (picture,) = of(html, "img")
    data = base64.b64decode(picture.get("src").removeprefix("data:image/jpeg;base64,"))
    image = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), float)
    assert image.shape == (int(picture.get("height")), int(picture.get("width")), 3)
    # paper alone has no colour
    assert np.ptp(image, axis=2).max() > 60
    check_rows(html, run.verdict)


def check_rows(html, verdict):
    """The four rows: shape and word on their colour, name, worst value."""
    rows = of(html, "tr")
    for row, expected in zip(rows, verdict.rows, strict=True):
        state, name, text = row
        assert "".join(state.itertext()) == f"{expected.symbol} {expected.state}"
        assert f"background:{STATES[expected.state]};" in state[0].get("style")
        assert (name.text, text.text) == (expected.name, expected.texts[0])
    assert of(html, "caption")[0].text == f"verdict {verdict.headline}"


def test_a_verdict_shows_its_four_rows(shown):
    check_rows(shown["Verdict"]._repr_html_(), shown["Verdict"])


def test_what_takes_long_is_not_computed_to_be_shown(shown, monkeypatch):
    """A long run, and one that states no progress, show their facts; a verdict that is known stands beside them."""
    monkeypatch.setattr(Bead, "__init__", lambda *given: 1 / 0)
    run = shown["Run"].replaced()
    for slow in (run.replaced(progress=None), run.replaced(job=None)):
        assert of(slow._repr_html_(), "table")[0][0].text == "Run"
        assert not {"budget", "verdict"} & set(vars(slow))
    monkeypatch.setattr(memory, "LONG_RUN", 100)
    assert of(run._repr_html_(), "table")[0][0].text == "Run"


@pytest.mark.parametrize("name", builtin_models())
def test_a_machine_is_drawn_with_its_needle_in_the_middle(name):
    """The needle's tip is over the work: no face of the drawing lies beyond its picture."""
    html = Machine(name)._repr_html_()
    assert len(html) < 60_000
    (picture,) = of(html, "svg")
    left, top, wide, high = map(float, picture.get("viewBox").split())
    polygons = of(html, "polygon")
    assert len(polygons) > 30
    points = np.array([point.split(",") for polygon in polygons for point in polygon.get("points").split()], float)
    assert left < points[:, 0].min() < points[:, 0].max() < left + wide
    assert top < -points[:, 1].max() < -points[:, 1].min() < top + high
    assert max(float(picture.get("width")), float(picture.get("height"))) == 320


def test_setpoints_show_where_glue_is_laid():
    """Of three sides of 30 mm the second has glue: it is drawn over the path."""
    corners = [(0.0, 0.0, 0.0), (30.0, 0.0, 0.0), (30.0, 30.0, 0.0), (0.0, 30.0, 0.0)]
    path = Chain([Line(a, b) for a, b in pairwise(corners)])
    plain = Setpoints.along(path, 30.0, 1e-2)
    on = (plain.time > 0.995) & (plain.time < 2.005)
    setpoints = Setpoints(1e-2, plain.axes, plain.position, on, requested=path, progress=plain.progress)
    html = setpoints._repr_html_()
    line, glued = (
        np.array([point.split(",") for point in part.get("points").split()], float) for part in of(html, "polyline")
    )
    np.testing.assert_array_equal(line[[0, -1]], [[0, 0], [0, 30]])
    np.testing.assert_allclose(glued[[0, -1]], [[30, 0], [30, 30]], atol=1e-9)
    assert glued[:, 0].min() == 30
    assert setpoints.facts()["dispenser on"] == "1.01 s in 1 stretch"
    assert setpoints.facts()["positions"] == "x 0 to 30, y 0 to 30"


@pytest.mark.parametrize(
    ("whole", "decimals"),
    [
        (0.0, 9),
        (1e-7, 9),
        (0.02, 6),
        (0.1, 6),
        (0.11, 5),
        (1.0, 5),
        (1.1, 4),
        (99.0, 3),
        (1e5, 0),
        (1e5 + 1, 0),
        (1e9, 0),
    ],
)
def test_decimals_show_a_hundred_thousandth_of_the_whole(whole, decimals):
    assert decimals_of(whole) == decimals
