"""The page of an identification, and its plots, of a log whose torque is typed in."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.identify.checks.finding import Finding
from gantrysim.identify.checks.judgement import Judgement
from gantrysim.identify.friction_law import friction_law
from gantrysim.identify.identification import Identification
from gantrysim.identify.log import Log
from gantrysim.identify.model import model_of
from gantrysim.identify.page import identification_page
from gantrysim.identify.plots import Course, draw_course, draw_friction
from gantrysim.identify.result import AxisFit, Estimate, FrictionLaw
from gantrysim.identify.torque_regression import TorqueRegression
from gantrysim.identify.whole_run import WholeRun
from gantrysim.report.plots.style import sheet
from gantrysim.report.sections import drawn_plot

from support.pages import Page
from support.soaked import suite_runs

pytestmark = pytest.mark.usefixtures("blank_pictures")

MACHINE = Machine("xy")
PERIOD = 1e-3
N = 4000
# x has a mode beyond what a log at 1 kHz shows
MODEL = replace(
    model_of(MACHINE, 0), share=0.0, lag=0.0, coulomb=0.02, excess=0.0, viscous=4e-5, difference=1e-5, offset=0.003
)
TIME = PERIOD * np.arange(N)
POSITION = 40 * np.sin(2 * np.pi * TIME)
SPEED = 80 * np.pi * np.cos(2 * np.pi * TIME)
ACCELERATION = -160 * np.pi**2 * np.sin(2 * np.pi * TIME)
FRICTION = MODEL.coulomb * np.sign(SPEED) + MODEL.viscous * SPEED + MODEL.difference * np.abs(SPEED)
TORQUE = MODEL.inertia * ACCELERATION + FRICTION - MODEL.offset
LOG = Log(("x",), PERIOD, POSITION[:, None], TORQUE[:, None], held=False, notes=("log: a note",))


def fit_of(first=0, starts=(0,)):
    names = {
        name: float(getattr(MODEL, name)) for name in ("inertia", "viscous", "coulomb", "static", "offset", "delay")
    }
    estimates = {name: Estimate(value, 0.01 * abs(value)) for name, value in names.items()}
    law = FrictionLaw(
        estimates, (), (), np.zeros(N - first), MODEL.difference * np.abs(SPEED[first:]), 2e-4, 0.02, {"time": 0.0}
    )
    noise = 1e-3 * np.random.default_rng(2).standard_normal(N - first)
    return AxisFit(
        axis="x",
        unit="mm",
        nominal=model_of(MACHINE, 0),
        model=MODEL,
        estimates=estimates,
        noise=0.0,
        expected=1e-3 / math.sqrt(12),
        used=np.arange(N - first) >= 100,
        innovations=noise,
        directions=np.sign(np.diff(POSITION[first:], append=POSITION[-1])),
        start=(MODEL.inertia, 0.0, 0.0),
        highest=100.0,
        position=POSITION[first:],
        torque=TORQUE[first:],
        held=False,
        sensitivity=None,
        predicted=MODEL,
        law=law,
        starts=starts,
        first=first,
    )


def identification(fit, *findings):
    found = Identification(MACHINE, PERIOD, (fit,))
    found.__dict__["judgements"] = (Judgement(fit.estimates, findings, PERIOD),)
    return found


def test_the_course_of_a_log_is_that_of_its_equation():
    """The low-pass of 6 ms takes (2 pi · 1 Hz · 6 ms)² / 2 = 0.07 % of the swing."""
    course = Course.of(fit_of(), LOG)
    known = np.isfinite(course.friction)
    assert known.mean() > 0.8
    assert course.speed == pytest.approx(SPEED, abs=0.4 + 1e-3 * np.abs(SPEED).max())
    viscous = np.where(SPEED > 0, MODEL.viscous_forward, MODEL.viscous_back)
    expected = MODEL.coulomb + viscous * np.abs(SPEED)
    assert course.friction[known] == pytest.approx(expected[known], rel=0.01)
    slides = np.isfinite(course.modelled)
    assert slides.mean() > 0.9
    assert course.modelled[slides] == pytest.approx(course.torque[slides], abs=0.012 * np.abs(TORQUE).max())
    # the predicted position is that of which the innovation is the error
    assert course.predicted + fit_of().innovations == pytest.approx(POSITION)
    assert np.isnan(course.residual[:100]).all()
    assert np.array_equal(course.residual[100:], fit_of().innovations[100:])


@pytest.mark.parametrize("known", suite_runs([0.0, 0.003, -0.01], 1))
def test_the_constant_torque_is_that_of_the_log(known):
    """Whatever constant torque the machine's table has."""
    sliding = TorqueRegression.of(replace(MODEL, offset=known), PERIOD, POSITION, TORQUE, held=False)
    law = friction_law(sliding, np.ones(N, bool), MODEL.scale * MODEL.stribeck, "mm")
    assert law.estimates["offset"].value == pytest.approx(MODEL.offset, rel=0.01)
    assert law.estimates["coulomb"].value == pytest.approx(MODEL.coulomb, rel=0.01)


def test_the_course_has_the_time_of_the_log():
    shifted = replace(LOG, starts=(0, 2500), begins=(1.0, 9.0))
    course = Course.of(fit_of(first=500, starts=(0, 2000)), shifted)
    assert course.time[[0, 1999, 2000, -1]] == pytest.approx([1.5, 3.499, 9.0, 10.499])


def test_a_gap_of_the_log_is_one_of_the_lines():
    shifted = replace(LOG, starts=(0, 2500), begins=(0.0, 9.0))
    fit = fit_of(starts=(0, 2500))
    with sheet(10, 8) as figure:
        panels = draw_course(figure, (fit, shifted))
        for panel in panels:
            for line in panel.lines:
                time = line.get_xdata()
                assert np.isnan(time).sum() == 1
                gap = int(np.flatnonzero(np.isnan(time))[0])
                assert 2.4 < time[gap - 1] < 2.5
                assert 9.0 <= time[gap + 1] < 9.1
        labels = [line.get_label() for panel in panels for line in panel.lines]
        assert labels == [
            "measured", "predicted one sample ahead", "measured, low-passed", "log, low-passed",
            "fitted model, sliding", "measured less predicted, in motion",
        ]  # fmt: skip


def test_friction_is_drawn_by_direction():
    with sheet(8, 5) as figure:
        axes = draw_friction(figure, (fit_of(), LOG))
        lines = {line.get_label(): line.get_data() for line in axes.lines}
    for name, viscous in (("forwards", MODEL.viscous_forward), ("back", MODEL.viscous_back)):
        speed, friction = lines[f"fitted, {name}"]
        assert friction == pytest.approx(MODEL.coulomb + viscous * speed)
        speed, friction = lines[f"log, {name}"]
        assert 300 < speed.size < 1100
        assert friction == pytest.approx(MODEL.coulomb + viscous * speed, rel=0.01)
    speed, friction = lines["nominal"]
    nominal = model_of(MACHINE, 0)
    assert friction[-1] == pytest.approx(nominal.coulomb + nominal.viscous * speed[-1], rel=1e-3)


def page_of(tmp_path, found, log=LOG, runs=()):
    identification_page(found, log, runs).write(tmp_path / "report.html")
    page = Page(tmp_path / "report.html")
    page.check()
    return page


def test_the_page_holds_values_reasons_and_what_to_record(tmp_path):
    forbidding = Finding("residual", ("static", "delay"), "it is correlated by 0.4: must be at most 0.25")
    runs = [WholeRun("x", torque=0.2, written=0.01, nominal=0.05, counts=3.21, adopted="inertia")]
    page = page_of(tmp_path, identification(fit_of(), forbidding), runs=runs)
    assert page.sections == [
        "summary", "identified-values", "not-identified", "what-to-record-next", "log-and-fit", "friction", "whole-run",
        "residual-and-response", "notes", "versions",
    ]  # fmt: skip
    assert page.texts("h1") == ["xy, identified from a log"]
    assert "4,000 samples, 1 ms apart, over 3.999 s; axis x" in page.texts("p")
    kg = 1e6 / MODEL.scale * MODEL.inertia
    assert page.section("summary").startswith("Summary 4 of 6 values are identified")
    summary = page.section("identified-values")
    assert f"Axis x: 4 of 6 values identified: inertia, whole {kg:.2f} ± {0.0196 * kg:.2f} kg" in summary
    assert "Coulomb friction 20.00 ± 0.39 mN·m" in summary
    assert summary.count("not identified: static friction, delay.") == 1
    facts = page.facts()
    assert facts["x: Coulomb friction"] == ("20.00 ± 0.39 mN·m", "nominal 17.3 mN·m")
    assert facts["x: torque not explained"] == ("5 %", "of the log&#39;s torque is missing in the whole run")
    rows = page.rows()
    assert ["x", "Coulomb friction", "17.3", "20", "19.61", "20.39", "mN·m", "identified", "fitted"] in rows
    (static,) = [row for row in rows if row[:2] == ["x", "static friction"]]
    assert static[-2:] == ["not identified: residual", "nominal"]
    (delay,) = [row for row in rows if row[:2] == ["x", "delay"]]
    assert delay[-2:] == ["not identified: residual", "no part of it"]
    assert ["x", "static friction, delay", "residual", "it is correlated by 0.4: must be at most 0.25"] in rows
    advice = {row[0]: row[1] for row in rows if len(row) == 2}
    assert advice["torque demand and encoder counts, unfiltered, at every servo tick, by one clock"] == (
        "x: static friction; x: delay"
    )
    # half the rate is 15 % above the mode of x
    assert model_of(MACHINE, 0).resonance == pytest.approx(604, abs=1)
    fast = "the torque demand, which is known between samples too, at 1,500 samples per second or more"
    assert advice[fast] == "x: mode"
    assert "log: a note." in page.section("notes")
    assert "fitted, forwards" in page.section("friction")
    assert not [one for one in page.all("p") if one.get("class") == "warning"]


def test_a_wide_interval_says_which_moves_show_the_value(tmp_path):
    fit = fit_of()
    wide = {**fit.estimates, "viscous": replace(fit.estimates["viscous"], deviation=0.5 * MODEL.viscous)}
    page = page_of(tmp_path, identification(replace(fit, estimates=wide)))
    assert ["x", "viscous friction", "interval", "half the 95 % interval is 98 % of the value"] in page.rows()
    moves = "moves at constant speeds, slow ones and up to the speed limit, forwards and back alike"
    assert [moves, "x: viscous friction"] in page.rows()


def test_a_check_of_one_axis_is_none_of_another(tmp_path):
    fit = fit_of()
    moded = {**fit.estimates, "stiffness": Estimate(MODEL.inertia * 4e6, 1.0)}
    found = Identification(MACHINE, PERIOD, (fit, replace(fit, axis="y", estimates=moded)))
    refused = Judgement(fit.estimates, (Finding("residual", ("stiffness", "delay"), "of x alone"),), PERIOD)
    found.__dict__["judgements"] = (refused, Judgement(moded, (), PERIOD))
    both = replace(LOG, axes=("x", "y"), position=np.repeat(LOG.position, 2, 1), torque=np.repeat(LOG.torque, 2, 1))
    rows = [row for row in page_of(tmp_path, found, both).rows() if len(row) == 4]
    assert ["x", "delay", "residual", "of x alone"] in rows
    assert ["y", "stiffness", "beyond the log&#39;s rate", "the log does not reach it"] in rows


def test_nothing_identified_stands_above_all(tmp_path):
    page = page_of(tmp_path, identification(fit_of(), Finding("encoder counts", (), "it loses counts")))
    (warning,) = [one["text"] for one in page.all("p") if one.get("class") == "warning"]
    assert warning.startswith("Not identified: axis x: it loses counts")
    assert "Axis x: 0 of 6 values identified; not identified: inertia, whole" in page.section("identified-values")
    assert ["x", "all", "encoder counts", "it loses counts"] in page.rows()


@pytest.mark.parametrize(
    ("check", "advice"),
    [
        ("clipped torque", "a wider range of the recorder, or weaker moves: the torque must not be cut"),
        ("smooth position", "the counts of the encoder, neither filtered nor interpolated"),
    ],
)
def test_a_log_that_is_spoiled_as_a_whole_is_to_be_recorded_again_for_all_values(tmp_path, check, advice):
    page = page_of(tmp_path, identification(fit_of(), Finding(check, (), "of the whole log")))
    (names,) = [row[1] for row in page.rows() if len(row) == 2 and row[0] == advice]
    assert names.split("; ")[-1] == "x: all values"


def test_the_plot_of_all_values_has_a_row_for_each_with_room_for_its_label(monkeypatch):
    sizes = []

    def noted_plot(draw, values, *size):
        sizes.append((values, size))
        return drawn_plot(draw, values, *size)

    monkeypatch.setattr("gantrysim.identify.page.drawn_plot", noted_plot)
    found = identification(fit_of())
    identification_page(found, LOG)
    (values, (width, height)) = sizes[0]
    assert values == found.values
    # 0.3 inch a row, nearly twice a line of 10 points, and 1.2 for axis and legend
    assert (width, height) == (10.7, pytest.approx(1.2 + 0.3 * 6))


def test_all_identified_leaves_a_judgement_to_be_recorded(tmp_path):
    fit = replace(fit_of(), nominal=replace(model_of(MACHINE, 0), share=0.0))
    page = page_of(tmp_path, identification(fit))
    assert "Every value that is fitted is identified." in page.section("not-identified")
    rows = [row for row in page.rows() if len(row) == 2 and "replay" in row[0]]
    assert rows == [["another log of other moves, for gantrysim replay", "a judgement of the machine written"]]


def test_the_page_fits_on_wide_and_narrow_screens_and_on_paper(browser, tmp_path):
    page_of(tmp_path, identification(fit_of(), Finding("residual", ("static",), "a reason of some length " * 6)))
    for width in (1280, 400):
        browser.open(tmp_path / "report.html", width, 800)
        assert browser.run("return document.documentElement.scrollWidth") == width
    browser.media("print")
    browser.resize(794, 1123)
    browser.settle()
    assert browser.run("return document.documentElement.scrollWidth") == 794
    assert browser.messages() == []
