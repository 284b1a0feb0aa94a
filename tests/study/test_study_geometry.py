"""Errors of a machine's geometry in the studies: positioning, circles, machines of a design, causes."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gantrysim import InputError, Job
from gantrysim.cli.show import show_section
from gantrysim.job.causes import causes_of
from gantrysim.machine.geometry import Geometry
from gantrysim.machine.ideal import without_friction
from gantrysim.machine.perturbation import Perturbation
from gantrysim.report.causes import causes_section
from gantrysim.study.circle.study import CircleStudy
from gantrysim.study.machine.report import _variation_table
from gantrysim.study.machine.study import MachineStudy
from gantrysim.study.repeat import RepeatStudy
from gantrysim.study.repeat import study as positioning_module
from gantrysim.study.repeat.report import report
from gantrysim.study.repeat.study import positioning, targets_of

pytestmark = pytest.mark.usefixtures("blank_pictures")

SETTLED = 2e-4  # of a position without friction, and of its play [mm]
SECOND_ORDER = 2e-5  # errors act at the motor's position, not at the target [mm]
STEP = 2e-4  # of a step of the circle [mm]
CREEP = 1.5e-3  # of an axis in its friction [mm]
PAGE = (Path(__file__).parents[2] / "docs" / "geometry.md").read_text(encoding="utf-8")

LEAD = 10.0  # of the screws of xy [mm]
SHORT = ["turns=1", "diameter=40"]


def frictionless(geometry):
    job = Job.load("an225", [*SHORT, "servo.resolution=0"])
    machine = without_friction(job.built_machine).with_geometry(geometry)
    return job.model_copy(update={"built_machine": machine})


def test_an_axis_positions_as_its_geometry_says(monkeypatch):
    monkeypatch.setattr(positioning_module, "_SPEED", 25.0)  # no overshoot, which the play would keep
    monkeypatch.setattr(positioning_module, "_SHORTEST_TIME", 0.6)
    geometry = Geometry(travel_error=0.05, periodic_error=0.006, play=0.016, warming=4)
    found = positioning(frictionless(geometry), "x", [Perturbation()] * 2)
    t = targets_of((-150.0, 150.0))
    up = 0.05 * t / 300 + 0.006 * np.sin(2 * np.pi * t / LEAD) + 11.5e-6 * 4 * t
    assert found.targets == pytest.approx(t)
    assert found.up == pytest.approx(np.array([up, up]), abs=SETTLED)
    assert found.down == pytest.approx(np.array([up, up]) + 0.016, abs=SETTLED)
    assert found.reversal == pytest.approx(0.016, abs=SETTLED)
    assert found.unidirectional_repeatability < SETTLED
    assert found.repeatability == pytest.approx(0.016, abs=SETTLED)
    assert found.accuracy == pytest.approx(np.ptp(up) + 0.016, abs=2 * SETTLED)


def test_an_axis_of_ideal_geometry_positions_exactly():
    found = positioning(frictionless(Geometry()), "y", [Perturbation()] * 2)
    assert max(found.reversal, found.accuracy) < SETTLED


def test_an_axis_that_does_not_reach_its_targets_has_no_positioning():
    job = Job.load("an225", [*SHORT, "servo.following_error_limit=0.001"])
    with pytest.raises(InputError, match=r"^positioning of x: following error on axis x"):
        positioning(job, "x", [Perturbation()])


@pytest.mark.soak
def test_a_benchtop_machine_repeats_as_its_class_is_sold():
    study = RepeatStudy(Job.load("an225", [*SHORT, "accuracy=C7"]))
    ideal = RepeatStudy(Job.load("an225", [*SHORT, "play=0"]))
    assert list(study.positioning) == ["x", "y"]
    for name, one in study.positioning.items():
        # the encoders see the same motion: what differs is the geometry, with a play of 16 um at most
        t, other = one.targets, ideal.positioning[name]
        exact = 0.05 * t / 300 + 0.006 * np.sin(2 * np.pi * t / LEAD)
        lost = np.array([one.up - other.up, one.down - other.down]) - exact
        assert lost.min() > -SECOND_ORDER
        assert lost.max() < 0.016 + SECOND_ORDER
        assert 0.004 < one.repeatability / 2 < 0.010  # sold as 8 to 10 um
        assert one.accuracy > np.ptp(exact)
        # the servo rests beyond its target and takes back part of the play, all but what it creeps
        assert one.reversal == pytest.approx(0.016 - other.reversal, abs=CREEP)
    assert not RepeatStudy(Job.load("an225", SHORT)).positioning
    for name, own in (("ideal", ideal), ("C7", study)):
        row = re.search(rf"^\| {name} \|(.*)\|$", PAGE, flags=re.MULTILINE)[1]
        sizes = [
            (one.reversal, one.unidirectional_repeatability / 2, one.repeatability / 2, one.accuracy)
            for one in own.positioning.values()
        ]
        shown = [1e3 * size for pair in zip(*sizes, strict=True) for size in pair]
        assert [float(cell) for cell in re.findall(r"[\d.]+", row)] == pytest.approx(shown, rel=0.02, abs=0.5)


def test_the_positioning_is_reported():
    study = RepeatStudy(Job.load("an225", [*SHORT, "accuracy=C5"]), repeats=2, places=20, friction=0.0)
    rows = measured(study)
    found = report(study, rows)
    table = next(table for table in found.tables if table.columns[0] == "axis")
    for name, *cells in table.rows:
        one = study.positioning[name]
        sizes = (one.reversal, one.unidirectional_repeatability, one.repeatability, one.systematic, one.accuracy)
        assert cells == pytest.approx([1e3 * size for size in sizes])
        note = next(note for note in found.details.notes if note.startswith(f"Axis {name}"))
        assert f"± {500 * one.repeatability:.1f} µm from both directions" in note


def measured(study):
    """The rows of a study's first round."""
    return [{**dict(case.tags), **study.measure(case)} for case in next(iter(study.rounds()))]


def circle(*overrides):
    study = CircleStudy(radius=40, speed=60, overrides=overrides)
    rows = measured(study)
    return study.traces(rows, "radial")


def test_the_circle_steps_by_the_play_and_is_an_ellipse_by_the_squareness():
    ideal, real = circle(), circle("geometry.play=0.02", "geometry.squareness_xy=0.2")
    for direction, trace in real.items():
        for one, other in zip(trace.reversals(), ideal[direction].reversals(), strict=True):
            assert one.step - other.step == pytest.approx(0.02, abs=STEP)
    square = circle("geometry.squareness_xy=0.2")
    for direction, trace in square.items():
        moved = trace.deviation - ideal[direction].deviation
        assert moved == pytest.approx(0.5 * 40 * 2e-4 * np.sin(np.radians(2 * trace.angle)), abs=STEP)


def test_machines_of_a_class_are_drawn_and_shown():
    job = Job.load("an225", [*SHORT, "accuracy=C7"])
    study = MachineStudy(job, tolerance=50.0, samples=40)
    assert {"travel_error_x", "play_y", "squareness_xy", "sag"} <= set(study.machines)
    case = next(iter(study.rounds()))[7]
    assert ("play_y", study.machines["play_y"][6]) in case.tags
    assert dict(case.perturbation.geometry)["play_y"] == study.machines["play_y"][6]
    plain = MachineStudy(replace(study, job=Job.load("an225", SHORT)).job, tolerance=50.0, samples=40)
    assert not {"play_y", "sag"} & set(plain.machines)


def test_the_cause_is_worth_what_it_adds(monkeypatch, capsys):
    job = Job.load("an225", [*SHORT, "geometry.squareness_xy=2"])
    causes = causes_of(job)
    effect = causes.effects[-1]
    assert effect.cause.name == "geometry"
    assert causes.heads[4:] == ("program", "servo", "encoder", "geometry", "structure")
    assert effect.without["geometry"].max == 0
    monkeypatch.setenv("COLUMNS", "76")
    show_section(causes_section(causes).content())
    text = capsys.readouterr().out
    assert f"{1e3 * effect.without['contour'].rms:.1f}" in text  # numbers are whole on a narrow terminal
    assert "…" not in text
    assert effect.before["geometry"].rms > 0.005
    assert effect.worth["contour"].rms == pytest.approx(
        effect.before["contour"].rms - effect.without["contour"].rms, abs=1e-12
    )


def test_the_range_of_every_error_is_shown():
    study = MachineStudy(Job.load("an225", [*SHORT, "accuracy=C7"]), tolerance=50.0, samples=40)
    ranges = dict(_variation_table(study).rows)
    assert ranges["play of x"] == "0 to 0.016 mm"
    assert ranges["travel error of y"] == "-0.05 to 0.05 mm"
    assert ranges["squareness xy"] == "-0.1 to 0.1 mm/m"
    assert ranges["straightness vertical of x"] == "-0.01 to 0.01 mm"
    assert len(ranges) == 5 + 15
