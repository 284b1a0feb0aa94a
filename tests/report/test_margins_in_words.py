"""What a page and a table say of margins of loops, and what a page leaves out of long programs and lines."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from gantrysim.cli.evaluation import _reason_to_skip
from gantrysim.cli.tables import _judged_margins
from gantrysim.remedy.by_place import PlaceSpeed, SpeedByPlace
from gantrysim.report.figures import inline_svg, section_name
from gantrysim.report.page import _text
from gantrysim.report.viewer_data import _listing
from gantrysim.servo.stability.loops import NO_LOOP


def margins(gain, phase=45.0, stable=True):
    """Margins of a loop that bears so many times its gain and no less."""
    return replace(NO_LOOP, gain=gain, gain_lower=0.0, phase=phase, stable=stable, together=gain)


MACHINE = SimpleNamespace(axes=tuple(SimpleNamespace(name=name) for name in "xyr"))


@pytest.mark.parametrize(
    ("loops", "text"),
    [
        ((margins(3.0), margins(2.0), NO_LOOP), r"Axis y has the smallest gain margin: 2\.0\d* ?\S*\."),
        ((margins(3.0), margins(1.49), NO_LOOP), r"Axis y .* 1\.49.*, below 1\.5: with another load, .* unstable\."),
        (
            (margins(3.0), margins(0.5, stable=False), margins(0.4, stable=False)),
            r"Unstable, Coulomb friction neglected: y, r\.",
        ),
        ((NO_LOOP,) * 3, r"All axes are steppers in open loop: no loop, no margins\."),
        (None, r"Stability margins are unknown: an actuator of the machine has a delay of its own, or .*"),
    ],
)
def test_the_axis_with_the_smallest_margin_is_named(loops, text):
    found = _text(MACHINE, loops).replace("\xa0", " ")
    assert re.fullmatch(text, found), found


def test_margins_of_a_table_are_judged():
    assert _judged_margins(margins(0.5, stable=False)) == "unstable"
    assert _judged_margins(margins(1.49)).startswith("low, below 1.5; phase margin 45")
    assert _judged_margins(margins(1.5)).startswith("the smallest; phase margin 45")


def test_a_short_program_is_listed_whole_and_of_a_long_one_the_lines_that_run():
    text = "G1 X1  \nG1 X2\n\nM2\n\n"
    assert _listing(text, np.array([0, 2, 2])) == {"1": "G1 X1", "2": "G1 X2", "3": "", "4": "M2"}
    assert _listing(text, np.array([0, 0])) is None
    long = "\n".join(f"line {k}" for k in range(1, 2002))
    assert _listing(long, np.array([0, 7, 2001, 7])) == {"7": "line 7", "2001": "line 2001"}
    assert len(_listing(long.rpartition("\n")[0], np.array([7]))) == 2000


@pytest.mark.drawn
@pytest.mark.parametrize(("counts", "images"), [((300, 300), 0), ((300, 600), 1)])
def test_a_line_that_would_take_megabytes_is_an_image(monkeypatch, counts, images):
    """In a page with a path that is too long, the lines of many points; points that jump do not simplify away."""
    monkeypatch.setattr("gantrysim.report.figures._PATH_LENGTH", 4500)
    monkeypatch.setattr("gantrysim.report.figures._POINTS_OF_A_LINE", 500)
    figure = Figure()
    for count in counts:
        figure.add_subplot().plot(*np.random.default_rng(1).uniform(size=(2, count)), lw=0.5)
    assert inline_svg(figure, "a", "noise").count("<image") == images


@pytest.mark.parametrize(
    ("title", "name"), [("Error budget, by link", "error-budget-by-link"), ("  A–B  ", "a-b"), ("±", "section")]
)
def test_a_section_is_named_by_its_letters(title, name):
    assert section_name(title) == name


@pytest.mark.parametrize(
    ("fault", "contradictions", "faults", "ticks", "reason"),
    [
        ("following error", (), (), 10, "the run ended in a fault"),
        (None, ("x",), ("slip",), 10, "the errors of the run are not known"),
        (None, (), ("slip",), 10, "the job has deliberate faults"),
        (None, (), (), 10, ""),
    ],
)
def test_a_run_is_not_run_again_where_that_tells_nothing(fault, contradictions, faults, ticks, reason):
    run = SimpleNamespace(fault=fault, time=np.zeros(ticks))
    budget = SimpleNamespace(analysis=SimpleNamespace(run=run), contradictions=contradictions)
    assert _reason_to_skip(SimpleNamespace(faults=faults), budget, is_default=True) == reason


def by_place(*speeds, flows=(), output=""):
    places = tuple(PlaceSpeed(3 + k, 50.0, speed, flows[k] if flows else None) for k, speed in enumerate(speeds))
    job = SimpleNamespace(controller=SimpleNamespace(flow_output=output))
    outcome = SimpleNamespace(state="pass", duration=8.0)
    return SpeedByPlace(job, outcome, "", places, 10.0, 5)


def test_stretches_of_one_speed_are_one_row_of_the_table():
    found = by_place(40.0, 40.0, 60.0, 40.0)
    assert found.rows == [(3, 4, 40.0), (5, 5, 60.0), (6, 6, 40.0)]
    assert found.changes == 3
    assert found.heads == ("from", "to", "speed [mm/s]")
    assert found.cells == [("3", "4", "40"), ("5", "5", "60"), ("6", "6", "40")]
    assert str(found) == ("pass with a speed by place: 8.00 s instead of 10.00 s, with 3 speeds from 40 to 60 mm/s")
    assert str(by_place(50.0, 50.0)) == "pass with the program's own speeds: 8.00 s instead of 10.00 s"


def test_set_points_of_the_flow_stand_beside_the_speeds():
    found = by_place(40.0, 60.0, flows=(0.2, 0.3), output="AOUT(1)")
    assert found.heads == ("from", "to", "speed [mm/s]", "AOUT(1)")
    assert found.cells == [("3", "3", "40", "0.2"), ("4", "4", "60", "0.3")]
    assert str(found).endswith("from 40 to 60 mm/s, AOUT(1) by line")
