"""Whole jobs against an independent simulation: two masses per axis, winding, friction, counts and sampled law.

The reference takes the MJCF's numbers, the setpoints and the servo's gains, and shares no code with gantrysim. With an
exact encoder both motions are smooth functions of the input, and differ by the engine's error of first order in its
step. With counts they are not: a shift of the reference's setpoints by 1e-9 mm changes its contour error by as much as
it differs from the engine's (0.2 µm rms, above 1 µm at times). Then the runs are compared one by one in the mean
square, and in the mean over several positions of the encoder's zero within a count, which leaves the scatter out.
"""

import dataclasses
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from gantrysim import Machine, simulate
from gantrysim.job.job import Job
from gantrysim.metrics.analysis import Analysis
from gantrysim.servo.servo import Servo

from .compare import law_of, sizes, torques_of, within
from .contour import contour_error, polyline
from .law import notch_coefficients
from .mjcf import read_drives
from .two_mass import STEP, follow
from support.soaked import suite_runs

JOBS = ("an225", "softmc-arc", "fanuc-spiral")
FINE = 12.5e-6  # physics step [s]

# of contour errors [mm], and of torque demands and motor torques as a share of the job's largest: rms, largest
COUNTED, COUNTED_TORQUE = (0.5e-3, 1e-3), (5e-3, 0.03)
EXACT, EXACT_TORQUE = (0.1e-3, 0.5e-3), (3e-3, 0.03)  # in the MJCF's step, 0.25 ms
EXACT_FINE, EXACT_FINE_TORQUE = (5e-6, 50e-6), (3e-4, 3e-3)  # in steps of 12.5 µs

CONVERGED = 1e-7  # of the reference, by halving its step [mm]
CHORDS = 0.2e-3  # of the path [mm]
AMPLIFIED = 0.05e-3  # rms by which counts change a contour error at the least cause [mm]
SAME = 1e-12
TORQUE_MEAN = 20  # ticks over which torques with counts are averaged
ZEROS = (np.arange(8) + 0.5) / 8  # of the encoder [counts]


@cache
def job_of(name):
    return Job.load(name)


@cache
def path_of(name):
    return polyline(
        lambda s: job_of(name).setpoints.requested.position(s)[:, :2], job_of(name).setpoints.requested.length
    )


def drives_of(name="xy"):
    return read_drives(Path(str(files("gantrysim.models") / f"{name}.xml")))


def exact(servo):
    return servo.with_values(resolution=(0.0,) * servo.axes)


def contour(name, nozzle):
    """Contour error while the dispenser is on [mm]."""
    setpoints = job_of(name).setpoints
    return contour_error(path_of(name), setpoints.position, nozzle)[setpoints.dispense]


def reference(name, servo, drives=None, laws=None, shift=0.0, step=STEP):
    """Contour error [mm] and torques [N·m] of the reference, while the dispenser is on."""
    setpoints = job_of(name).setpoints
    drives = drives_of() if drives is None else drives
    laws = [law_of(servo, axis) for axis in range(servo.axes)] if laws is None else laws
    axes = [
        follow(drive, law, setpoints.position[:, axis] + shift, step)
        for axis, (drive, law) in enumerate(zip(drives, laws, strict=True))
    ]
    nozzle, *torques = (
        np.stack([getattr(axis, value) for axis in axes], axis=1) for value in ("load", "demand", "torque")
    )
    return contour(name, nozzle - shift), np.hstack(torques)[setpoints.dispense]


def engine(name, servo, shift=0.0, **options):
    """The same of gantrysim."""
    setpoints = job_of(name).setpoints
    shifted = dataclasses.replace(setpoints, position=setpoints.position + shift)
    run = simulate(job_of(name).built_machine, servo, shifted, **options)
    assert run.fault is None
    return contour(name, run.nozzle[:, :2] - shift), torques_of(run)


def stiff(name, **changes):
    """A servo with an exact encoder whose motion depends on every number of the plant."""
    axes = job_of(name).built_machine.axes
    return Servo.derive(axes, frequency=20.0, integral_time=0.03, resolution=0.0).with_values(**changes)


@cache
def fine(name):
    return engine(name, stiff(name), physics_step=FINE)


@pytest.mark.parametrize("name", ["xy", "xyz", "xyzr"])
def test_masses_and_damping_read_from_the_mjcf_are_those_of_the_compiled_machine(name):
    for drive, axis in zip(drives_of(name), Machine(name).axes, strict=True):
        if drive.slide:
            mass = drive.nut + drive.rotor * drive.gear**2 + drive.load
            assert axis.inertia == pytest.approx(mass / drive.gear / 1e3, rel=SAME)
            damping = drive.damping + drive.rotor_damping * drive.gear**2
            assert axis.viscous == pytest.approx(damping / drive.gear / 1e3, rel=SAME)


@pytest.mark.parametrize("name", suite_runs(["softmc-arc", "fanuc-spiral"], 0))
def test_the_reference_has_converged(name):
    servo = exact(job_of(name).built_servo)
    assert sizes(reference(name, servo)[0] - reference(name, servo, step=STEP / 2)[0])[1] < CONVERGED


@pytest.mark.soak
@pytest.mark.parametrize("name", JOBS)
def test_distances_from_the_sampled_path_are_those_of_the_follower(name):
    job = job_of(name)
    run = simulate(job.built_machine, job.built_servo, job.setpoints)
    assert np.abs(contour(name, run.nozzle[:, :2])) == pytest.approx(Analysis(run).nozzle.distance, abs=CHORDS)


@pytest.mark.validates(
    "whole jobs with exact encoders, contour error",
    "independent two-mass simulation, no code shared",
    "0.1 µm rms, 0.5 µm max",
)
@pytest.mark.parametrize("name", suite_runs(JOBS, 0))
def test_with_an_exact_encoder_contour_error_and_torque_are_the_references(name):
    servo = exact(job_of(name).built_servo)
    assert within(engine(name, servo), reference(name, servo), EXACT, EXACT_TORQUE)


@pytest.mark.validates(
    "the same in steps of 12.5 µs",
    "the same",
    "0.005 µm rms, 0.05 µm max",
)
@pytest.mark.parametrize("name", suite_runs(JOBS, 1))
def test_in_fine_steps_they_agree_much_more_closely(name):
    assert within(fine(name), reference(name, stiff(name)), EXACT_FINE, EXACT_FINE_TORQUE)


def test_counts_amplify_a_shift_far_below_a_count_and_an_exact_encoder_does_not():
    for servo in (job_of("softmc-arc").built_servo, exact(job_of("softmc-arc").built_servo)):
        moved, _ = reference("softmc-arc", servo, shift=1e-9)
        found = sizes(reference("softmc-arc", servo)[0] - moved)
        assert (found[0] > AMPLIFIED) if servo.drives[0].resolution else (found[1] < CONVERGED)


@pytest.mark.validates(
    "whole jobs with counts, mean over 8 encoder zeros",
    "the same",
    "0.5 µm rms, 1 µm max",
)
@pytest.mark.parametrize("name", suite_runs(["an225", "fanuc-spiral"], 0))
def test_with_counts_contour_error_and_torque_are_the_references(name):
    servo = job_of(name).built_servo
    runs = [
        (engine(name, servo, shift), reference(name, servo, shift=shift))
        for shift in ZEROS * servo.drives[0].resolution
    ]
    for one, other in runs:
        assert sizes(one[0] - other[0])[0] <= COUNTED[0]
    means = [
        (np.mean([run[k][0] for run in runs], axis=0), averaged(np.mean([run[k][1] for run in runs], axis=0)))
        for k in range(2)
    ]
    assert within(*means, COUNTED, COUNTED_TORQUE)


def averaged(torques):
    """The mean of each TORQUE_MEAN consecutive ticks."""
    sums = np.cumsum(torques, axis=0)
    return (sums[TORQUE_MEAN:] - sums[:-TORQUE_MEAN]) / TORQUE_MEAN


def drives_with(**factors):
    return [
        dataclasses.replace(drive, **{name: factor * getattr(drive, name) for name, factor in factors.items()})
        for drive in drives_of()
    ]


BREAKS = {
    "twice the load": {"load": 2.0},
    "a tenth more rotor": {"rotor": 1.1},
    "no winding": {"inductance": 0.05},
    "a stiff spring": {"stiffness": 4.0},
    "no damping of the guides": {"damping": 0.0},
    "no damping of the motor": {"rotor_damping": 0.0},
    "half the damping of the spring": {"flex_damping": 0.5},
    "no friction": dict.fromkeys(("bristle", "bristle_damping", "coulomb", "static"), 1e-9),
    "a tenth more static friction": {"static": 1.1},
    "no damping of the bristles": {"bristle_damping": 0.0},
}


@pytest.mark.parametrize("factors", suite_runs(BREAKS.values(), 0), ids=BREAKS)
def test_another_plant_does_not_agree(factors):
    name = "softmc-arc"
    other = reference(name, stiff(name), drives_with(**factors))
    assert not within(fine(name), other, EXACT_FINE, EXACT_FINE_TORQUE)


@pytest.mark.soak
@pytest.mark.parametrize("factors", [BREAKS["twice the load"], BREAKS["no friction"]])
def test_another_plant_does_not_agree_with_counts_either(factors):
    name = "an225"
    servo = job_of(name).built_servo
    one, other = engine(name, servo), reference(name, servo, drives_with(**factors))
    assert sizes(one[0] - other[0])[0] > COUNTED[0]


@pytest.mark.parametrize(
    "changes",
    suite_runs(
        [
            {"delay": 1e-4},
            {"acceleration_ff": 0.0},
            {"velocity_ff": 0.0},
            {"ki": 0.0},
            {"output_velocity": -1e-4},
            {"notch": (300.0, 0.05, 0.5)},
        ],
        5,
    ),
    ids=str,
)
def test_another_law_does_not_agree(changes):
    name = "softmc-arc"
    laws = [dataclasses.replace(law_of(stiff(name), axis), **changes) for axis in range(2)]
    assert not within(fine(name), reference(name, stiff(name), laws=laws), EXACT_FINE, EXACT_FINE_TORQUE)


@pytest.mark.parametrize(
    "changes",
    suite_runs([{"delay": 5e-4}, {"output_velocity": (-1e-3, -1e-3)}, {"torque_limit": (0.05, 0.05)}], 1),
    ids=str,
)
def test_delay_velocity_gain_and_torque_limit_act_as_in_the_reference(changes):
    name = "softmc-arc"
    servo = stiff(name, **changes)
    found, expected = engine(name, servo, physics_step=FINE), reference(name, servo)
    rms, largest = sizes(expected[0])  # up to 0.9 mm where the torque is short: to a thousandth of that
    bounds = max(EXACT[0], 1e-3 * rms), max(EXACT[1], 1e-3 * largest)
    assert within(found, expected, bounds, EXACT_TORQUE)
    assert not within(found, reference(name, stiff(name)), bounds, EXACT_TORQUE)


@pytest.mark.parametrize("frequency", [60.0, 290.0, 480.0])
def test_the_notch_is_the_bilinear_transform_prewarped_at_its_centre(frequency):
    period, numerator, denominator = 1e-3, 0.05, 0.6
    b0, b1, b2, a1, a2 = notch_coefficients(frequency, numerator, denominator, period)
    w0 = 2 * np.pi * frequency
    rate = w0 / (2 * np.tan(w0 * period / 2))
    expected = signal.bilinear([1, 2 * numerator * w0, w0**2], [1, 2 * denominator * w0, w0**2], rate)
    assert (b0, b1, b2) == pytest.approx(expected[0], abs=SAME)
    assert (1, a1, a2) == pytest.approx(expected[1], abs=SAME)
    _, response = signal.freqz([b0, b1, b2], [1, a1, a2], [0, w0 * period])
    assert np.abs(response) == pytest.approx([1, numerator / denominator], rel=1e-9)


def test_a_servo_with_a_notch_moves_the_machine_as_the_reference_does():
    name = "softmc-arc"
    without = stiff(name).with_values(notch_frequency=(0.0, 0.0))
    servo = without.with_values(notch_frequency=(150.0, 180.0), notch_width=(0.5, 0.4), notch_depth=(0.2, 0.3))
    found = engine(name, servo, physics_step=5e-5)
    assert within(found, reference(name, servo), EXACT, EXACT_TORQUE)
    assert not within(found, reference(name, without), EXACT, EXACT_TORQUE)
