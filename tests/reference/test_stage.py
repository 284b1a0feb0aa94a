"""The job on the rotary table against an independent simulation of its three coupled axes, with exact encoders."""

import dataclasses
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from gantrysim import simulate
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.servo.servo import Servo

from .compare import law_of, torques_of, within
from .contour import contour_error, polyline
from .mjcf import read_bodies, read_drives
from .stage import follow_stage, on_the_work
from .two_mass import STEP

# the only one that took less time, that another drive does not agree, notices no break of the package
pytestmark = pytest.mark.soak

FILE = Path(str(files("gantrysim.models") / "stage.xml"))
FINE = 12.5e-6  # physics step [s]

# contour error [mm] and torques as a share of the job's largest: rms, largest
AGREES = (20e-6, 200e-6), (5e-4, 3e-3)
CONVERGED = 1e-7  # of the reference, by halving its step [mm]
CHORDS = 0.2e-3  # of the path [mm]


@cache
def job():
    return Job.load("stage-outline")


@cache
def servo():
    return Servo.derive(job().built_machine.axes, frequency=20.0, integral_time=0.03, resolution=0.0)


def contour(nozzle):
    setpoints = job().setpoints
    path = polyline(lambda s: setpoints.requested.position(s)[:, :2], setpoints.requested.length)
    return contour_error(path, on_the_work(setpoints.position), nozzle)[setpoints.dispense]


@cache
def engine():
    return simulate(job().built_machine, servo(), job().setpoints, physics_step=FINE)


def reference(drives=None, bodies=None, step=STEP):
    setpoints = job().setpoints
    laws = [law_of(servo(), axis) for axis in range(3)]
    position, torques = follow_stage(
        read_drives(FILE) if drives is None else drives,
        read_bodies(FILE) if bodies is None else bodies,
        laws,
        setpoints.position,
        step,
    )
    return contour(on_the_work(position)), torques[setpoints.dispense]


def agrees(other):
    run = engine()
    assert run.fault is None
    return within((contour(run.nozzle[:, :2]), torques_of(run)), other, *AGREES)


@pytest.mark.validates(
    "the rotary stage in steps of 12.5 µs",
    "independent simulation of table and slides",
    "0.02 µm rms, 0.2 µm max",
)
def test_contour_error_and_torque_on_the_table_are_the_references():
    assert agrees(reference())


def test_the_reference_has_converged():
    assert np.abs(reference()[0] - reference(step=STEP / 2)[0]).max() < CONVERGED


def test_distances_from_the_sampled_path_are_those_of_the_follower():
    found = Analysis(engine()).nozzle.distance
    assert np.abs(contour(engine().nozzle[:, :2])) == pytest.approx(found, abs=CHORDS)


@pytest.mark.parametrize(
    "change",
    [("table", "inertia", 1.05), ("x_slide", "y", 0.9), ("y_slide", "mass", 1.1)],
    ids=str,
)
def test_other_masses_do_not_agree(change):
    name, number, factor = change
    bodies = read_bodies(FILE)
    bodies[name] = bodies[name]._replace(**{number: factor * getattr(bodies[name], number)})
    assert not agrees(reference(bodies=bodies))


@pytest.mark.parametrize(
    ("axis", "number"),
    [(0, "rotor"), (1, "rotor"), (2, "coulomb"), (0, "inductance"), (2, "inductance"), (0, "stiffness")],
)
def test_another_drive_does_not_agree(axis, number):
    drives = read_drives(FILE)
    drives[axis] = dataclasses.replace(drives[axis], **{number: 0.8 * getattr(drives[axis], number)})
    assert not agrees(reference(drives=drives))
