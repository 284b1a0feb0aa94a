"""The report of a comparison: every number and curve read back out of the page, for a difference that is known."""

import dataclasses
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from svgelements import Path as SvgPath

from gantrysim import Budget, Job, Machine
from gantrysim.compare.alignment import Alignment, alignment_words, estimate_rows
from gantrysim.compare.comparison import Comparison
from gantrysim.compare.estimates import Estimate
from gantrysim.compare.measured import Trace
from gantrysim.compare.page import draw_overlay, write_comparison_page
from gantrysim.report.plots.style import COLOURS

from support.blank_pictures import save_blank
from support.jobs import job_run
from support.pages import Page

MACHINE = Machine("xy")
OFF, SWING, WAVE = 4.0, 2.0, 80.0  # to the left of the path [µm], its swing [µm] and length along the path [mm]


def known(run):
    """The known difference at every tick [µm], and the unit vectors to the left of the command."""
    step = np.gradient(run.commanded_tip[:, :2], axis=0)
    left = np.column_stack([-step[:, 1], step[:, 0], np.zeros(len(step))])
    left /= np.maximum(np.linalg.norm(left, axis=1), 1e-9)[:, None]
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(run.commanded_tip, axis=0), axis=1))])
    return OFF + SWING * np.sin(2 * np.pi * s / WAVE), left


@pytest.fixture(scope="module")
def found():
    run = job_run("fanuc-spiral")
    size, left = known(run)
    rng = np.random.default_rng(3)
    encoder = run.encoder + rng.normal(scale=5e-4, size=run.encoder.shape)
    return Comparison.of(
        Trace(
            run.time + 0.25, {"commanded": run.commanded, "encoder": encoder}, run.nozzle + 1e-3 * size[:, None] * left
        ),
        run,
        MACHINE,
        ("time",),
    )


@pytest.fixture(scope="module")
def page(found, tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "report.html"
    circle = {"measured": {"circular_deviation_um": 12.3456}, "simulated": {"circular_deviation_um": 7.8912}}
    write_comparison_page(file, found, "spiral", "log.csv", circle)
    own = Page(file)
    own.check()
    return own


def hundredths(length):
    """A length [mm] in µm, to two decimals; what rounds to zero is 0."""
    text = f"{1e3 * length:.2f}"
    return text if float(text) else "0"


def test_the_numbers_of_both_budgets(found, page):
    table = page.tables()["Error normal to the requested path, measured, simulated, and their difference"]
    assert list(table) == ["program", "servo", "structure", "contour"]
    for name, row in table.items():
        for which, budget in (("measured", found.measured), ("simulated", found.simulated)):
            part = budget.values.contour if name == "contour" else budget.values.parts[name]
            for head, value in (("rms", part.rms), ("95 %", part.p95), ("max", part.max)):
                assert row[f"{which}, {head} [µm]"] == hundredths(value)
        assert row["difference, rms [µm]"] == hundredths(found.unexplained[name].rms)
        assert row["difference, max [µm]"] == hundredths(found.unexplained[name].max)
    rest = float(table["contour"]["difference, rms [µm]"])
    assert rest == pytest.approx(np.hypot(OFF, SWING / np.sqrt(2)), rel=0.01)
    facts = page.facts()
    for name in ("measured", "simulated", "difference"):
        told = float(facts[f"Contour error, {name}"][0].split()[0])
        assert told == pytest.approx(float(table["contour"][f"{name}, rms [µm]"]), abs=0.051)
    assert facts["Time shift"] == ("+0.250000 s", "by commanded")
    values = page.tables()["Trace against run; what is not distinguished from zero is left in the trace"]
    assert float(values["time"]["against the run"]) == pytest.approx(0.25, abs=1e-6)
    assert (values["time"]["unit"], values["time"]["distinguished"]) == ("s", "yes")
    assert list(values) == ["time"]
    assert page.tables()["Values of gantrysim study circle"]["circular_deviation_um"] == {
        "measured": "12.35",
        "simulated": "7.89",
    }


def test_the_words_say_how_much_is_left_and_where(found, page):
    told = page.section("not-explained-by-the-model")
    mean, side, varying = re.search(
        r"lies ([\d.]+) µm further to the (\w+) on average; the difference varies by ([\d.]+) µm", told
    ).groups()
    assert side == "left"
    assert float(mean) == pytest.approx(OFF, rel=0.02)
    assert float(varying) == pytest.approx(SWING / np.sqrt(2), rel=0.02)
    assert re.search(r"largest first: structure [\d.]+ µm rms, servo [\d.]+ µm rms, program 0 µm", told)
    share = float(re.search(r"explains ([\d.]+) % in mean square", page.section("in-full"))[1])
    rows = page.tables()["Error normal to the requested path, measured, simulated, and their difference"]
    left, whole = (float(rows["contour"][f"{name}, rms [µm]"]) for name in ("difference", "measured"))
    assert share == pytest.approx(100 * (1 - (left / whole) ** 2), abs=0.3)


def test_a_curve_of_the_overlay_is_the_known_difference(found, page):
    # the last curve of the first plot in the colour of the structure link: measured less simulated
    plot = page.text.partition("<svg")[2].partition("</svg>")[0]
    drawn = [one for one in re.findall(r"<path[^>]*>", plot) if COLOURS["structure"] in one and "fill: none" in one][-1]
    points = np.array([[segment.end.x, segment.end.y] for segment in SvgPath(re.search(r' d="([^"]*)"', drawn)[1])])
    ticks = found.measured.analysis.ticks
    run = found.measured.analysis.run
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(run.commanded_tip, axis=0), axis=1))])[ticks]
    x = (points[:, 0] - points[0, 0]) / np.ptp(points[:, 0]) * (s[-1] - s[0]) + s[0]
    expected = np.interp(x, s, known(job_run("fanuc-spiral"))[0][ticks])
    assert np.corrcoef(expected, -points[:, 1])[0, 1] > 0.99
    assert np.polyfit(expected, points[:, 1], 1)[0] < 0  # an SVG counts downwards


@pytest.mark.soak
def test_frequencies_that_the_model_lacks_are_named(tmp_path):
    run = job_run("fanuc-spiral")
    nozzle = run.nozzle + 0.01 * np.sin(2 * np.pi * 87.0 * run.time)[:, None] * [1, 1, 0]
    found = Comparison.of(Trace(run.time, {}, nozzle), run, MACHINE)
    write_comparison_page(tmp_path / "a.html", found, "spiral", "log.csv")
    page = Page(tmp_path / "a.html")
    frequency, rms = next(iter(page.tables()["Peaks of the spectrum"].items()))
    assert float(frequency) == pytest.approx(87, abs=2)
    assert float(rms["rms [µm]"]) == pytest.approx(10 / np.sqrt(2), rel=0.15)
    assert f"Frequencies that the model lacks: {frequency} Hz (" in page.section("not-explained-by-the-model")
    assert "Circular test" not in page.text


def test_a_model_that_explains_nothing_and_one_that_explains_all(tmp_path, monkeypatch):
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save_blank)
    run = job_run("fanuc-spiral")
    exact = Comparison.of(Trace(run.time, {}, run.nozzle), run, MACHINE)
    far = Comparison.of(Trace(run.time, {}, run.nozzle), run, MACHINE)
    structure = far.simulated.parts["structure"]
    far.simulated.parts["structure"] = dataclasses.replace(structure, lateral=structure.lateral + 1.0)
    told = []
    for found in (exact, far):
        write_comparison_page(tmp_path / "a.html", found, "spiral", "log.csv")
        told.append(Page(tmp_path / "a.html").section("in-full"))
    # of one link alone
    assert "no difference is left" not in told[0]
    assert "explains 100.0 %" in told[0] or "the simulation differs by less than 0.001 µm rms" in told[0]
    assert "explains none (" in told[1]


@pytest.mark.soak
def test_errors_of_the_geometry_belong_to_structure_on_both_sides():
    job = Job.load("fanuc-spiral", ["accuracy=C7"])
    run = job.run()
    thin = slice(None, None, 3)  # another number of samples than the run's
    found = Comparison.of(
        Trace(run.time[thin], {"encoder": run.encoder[thin]}, run.nozzle[thin]), run, job.built_machine
    )
    expected = Budget(run)
    for budget in (found.measured, found.simulated):
        assert "geometry" not in budget.values.parts
        rest = sum(expected.parts[name].lateral for name in ("encoder", "geometry", "structure"))
        assert budget.values.parts["structure"].rms == pytest.approx(np.sqrt(np.mean(rest**2)), rel=0.05)


def test_the_contour_error_is_drawn_with_the_limit_of_the_run(found):
    figure = Figure()
    *links, contour, left = draw_overlay(figure, found)
    titles = [axes.get_title(loc="right") for axes in (*links, contour, left)]
    assert titles == [*found.parts, "contour", "measured less simulated"]
    run = found.simulated.analysis.run
    limit = 1e3 * run.basis.limits(run.face).path_max
    limits = [line.get_ydata()[0] for line in contour.lines if line.get_linestyle() == "--"]
    texts = [text.get_text() for text in contour.texts]
    assert limits == pytest.approx([limit, -limit]) or texts == [f"limit ± {limit:.3g} µm, beyond this scale"]


def test_an_alignment_says_what_it_takes_out_and_what_it_leaves():
    estimates = {
        "time": Estimate(0.0125, 1e-4),
        "nozzle x": Estimate(0.0203, 0.001),
        "nozzle y": Estimate(0.0004, 0.001),
        "rotation": Estimate(0.0, math.inf),
    }
    offsets = {"nozzle": np.array([0.0203, 0.0, 0.0])}
    alignment = Alignment("nozzle", "path", np.zeros(3), 0.0125, offsets, 0.0, 0.0035, estimates, noise=2e-4)
    run = SimpleNamespace(axes=("x", "y"), units=("mm", "mm"))
    assert alignment_words(alignment, run) == (
        "Aligned at equal places of the path, by nozzle: the trace's time is +0.012500 s against the run's. "
        "Taken out: nozzle offset x +20.3 ± 1 µm. Not distinguished from zero, so not taken out: nozzle offset y "
        "+0.4 ± 1 µm; rotation, which the path does not show. Rms left across the path: 3.50 µm; noise of the "
        "samples: 0.20 µm."
    )
    assert [row[-1] for row in estimate_rows(alignment, run)] == ["yes", "yes", "no", "no"]
