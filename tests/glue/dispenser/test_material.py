"""A program that feeds material by E, on a dispenser that is a valve: volumes against E."""

import math

import numpy as np
import pytest

from gantrysim import InputError
from gantrysim.controllers.gcode.slicer import Program
from gantrysim.engine.simulate import perfect_follower
from gantrysim.glue.dispenser.command import Material
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.job.job import Job
from gantrysim.machine.machine import Machine

PERIOD = 1e-3
SECTION = math.pi * 1.75**2 / 4  # [mm²]
PART = """; filament_diameter = 2.85
M83
G1 F3000 X40 E2
G1 Y40 E2
G1 E-1 F1800
G0 X0 F6000
G1 E1.2 F1800
G1 Y0 E2 F3000
"""


def setpoints_of(text):
    return Program(text=text).setpoints(PERIOD).hold(0.5)


def flows(dispenser, points):
    material = Material(points.extrusion, points.extruder)
    return dispenser.flows(points.dispense, np.zeros(len(points.time)), PERIOD, material)


@pytest.mark.parametrize("lag", [0.0, 0.01])
def test_a_valve_lays_e_s_volume_without_its_retractions(lag):
    points = setpoints_of(PART)
    dispenser = Dispenser(filament=1.75, opening=lag, closing=lag)
    flow = flows(dispenser, points)
    assert flow.sum() * PERIOD == pytest.approx(6.2 * SECTION, rel=1e-9)
    assert (flow >= 0).all()
    demand = dispenser.flow_demand(points.dispense, flow, PERIOD, Material(points.extrusion))
    assert demand.sum() * PERIOD == pytest.approx(6.2 * SECTION, rel=1e-9)
    # steady on the first line: 0.05 mm of filament for each mm at 50 mm/s
    assert demand[200:300] == pytest.approx(0.05 * 50 * SECTION)


def test_the_volume_of_e_is_that_of_the_filament():
    points = setpoints_of(PART)
    by_diameter, by_volume = (flows(d, points) for d in (Dispenser(filament=1.75), Dispenser(e_volume=SECTION)))
    np.testing.assert_allclose(by_diameter, by_volume, rtol=1e-12)


def test_a_dispenser_that_follows_e_needs_e():
    points = Program(text="G1 X10 F600").setpoints(PERIOD)
    with pytest.raises(InputError, match="this one feeds nothing: the amount must be given by flow, area or pressure"):
        perfect_follower(Machine("xy"), points, dispenser=Dispenser(filament=1.75))
    with pytest.raises(InputError, match=r"area = 1 mm² and filament = 1\.75 mm: only one of flow, area"):
        Dispenser(area=1.0, filament=1.75)


def test_a_file_with_e_lays_e_s_volume_and_says_so(tmp_path):
    file = tmp_path / "part.gcode"
    file.write_text(PART.replace("G1 F3000", "M900 K0.05\nG1 F3000"))
    job = Job.load(file)
    run = job.run(engine="loop")
    volume = 6.2 * math.pi * 2.85**2 / 4
    assert run.flow[:-1].sum() * run.period == pytest.approx(volume, rel=1e-9)
    assert "glue as E feeds it, with a filament of 2.85 mm, as the program states" in job.notes[0]
    assert job.notes[-1].startswith("The dispenser is a valve: it lays E's volume, 6.379 mm³ for each mm")
    assert "pressure advance moves an extruder's motor and has no effect here" in job.notes[-1]
    # a record read back has what E fed, from which another dispenser's flow follows
    run.save(tmp_path / "run.npz")
    read = type(run).load(tmp_path / "run.npz")
    np.testing.assert_array_equal(read.extrusion, run.extrusion)
    assert run.extrusion[-1] == pytest.approx(6.2)


def test_a_file_without_a_diameter_has_the_usual_one_and_says_so(tmp_path):
    file = tmp_path / "part.gcode"
    file.write_text(PART.split("\n", 1)[1])
    job = Job.load(file)
    assert job.dispenser.filament == 1.75
    assert "a filament of 1.75 mm, which the program does not state" in job.notes[0]


def test_a_job_that_states_its_amount_keeps_it():
    job = Job.load("slicer-square")
    assert job.notes[-1].startswith("E's amount of material is not laid: dispenser.area = 1.5 mm² is; ")
    other = Job.load("slicer-square", {"dispenser.area": 0.0, "dispenser.filament": 1.75})
    run = other.follow()
    assert run.flow[:-1].sum() * run.period == pytest.approx(10.64 * SECTION, rel=1e-9)


def test_an_output_below_zero_lays_nothing():
    """As -5 V at an analogue output: no controller asks a valve for less than no flow."""
    on = np.ones(6, bool)
    material = Material(analogue=np.array([2.0, 2.0, -5.0, -5.0, 1.0, 1.0]))
    for kind in ({}, {"kind": "jet"}):
        demand = Dispenser(per_output=3.0, **kind).flow_demand(on, np.zeros(6), PERIOD, material)
        np.testing.assert_array_equal(demand, [6.0, 6.0, 0.0, 0.0, 3.0, 3.0])
    flow = Dispenser(per_output=3.0).flows(on, np.zeros(6), PERIOD, material)
    np.testing.assert_allclose(flow, [6.0, 6.0, 0.0, 0.0, 3.0, 3.0])
