"""Gain margins against the motion of the simulated machines: growth of a kick, a sweep of sines, and two masses.

The first two run the engine in fine steps, without encoder counts and dry friction, which limit the growth. All axes
keep the gains derived for them; those of one axis are scaled as its gain margin scales them.
"""

import dataclasses
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from gantrysim import Machine, Servo, simulate
from gantrysim.machine.perturbation import Perturbation
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.stability.margins import margins_of

from .compare import law_of
from .law import notch_coefficients
from .mjcf import read_drives
from support.soaked import suite_runs

AXES = {"xy": "xy", "xyz": "xyz", "xyzr": "xyzr", "stage": ("th", "x", "y")}
CASES = [(machine, axis) for machine, axes in AXES.items() for axis in range(len(axes))]
NAMES = [f"{machine}-{AXES[machine][axis]}" for machine, axis in CASES]

MARGIN = 0.03  # of the reported gain margins, relative
METHODS = 0.01  # between growth and sweep, relative
PERIOD = 1e-3  # [s]
FINE = 12.5e-6  # physics step [s]

KICK = 1e-6  # step of the setpoint [mm or deg]
WATCHED = 500  # ticks
WINDOW = 10  # ticks over which the amplitude is taken
ROUNDING = 1e-16  # amplitude below which rounding shows [mm or deg]
TOLERANCE = 2e-3  # of the factor at which a kick keeps its size

SWEPT = 1000  # ticks of the sweep's period: sines 1 Hz apart
SETTLED = 1000  # ticks before it is measured
LOWEST = 10  # sine [Hz]
REDUCED = 0.5  # factor on the gains during the sweep, so that the loop is stable


@cache
def machine_of(name):
    return Machine(name).perturbed(Perturbation(friction=1e-15))


@cache
def servo_of(name):
    return Servo.derive(machine_of(name).axes, PERIOD, feedforward=0.0, resolution=0.0)


def scaled(servo, axis, factor):
    """The servo with the gains of one axis times a factor."""
    gains = {name: list(servo.per_axis(name)) for name in ("kp", "ki", "kd", "output_velocity")}
    for values in gains.values():
        values[axis] *= factor
    return servo.with_values(**gains)


def moved(name, servo, axis, position):
    """The run of a machine whose axis is commanded to positions, the others to zero."""
    machine = machine_of(name)
    off, unused = np.zeros(len(position), bool), ArcChain((0.0, 0.0), 0.0, [0.0], [1.0])
    setpoints = Setpoints(PERIOD, (machine.axis_names[axis],), position[:, None], off, unused)
    return simulate(machine, servo, setpoints, physics_step=FINE)


def growth(name, servo, axis, factor):
    """Rate at which the following error after a kick grows, negative where it decays [1/s]."""
    servo = scaled(servo, axis, factor)
    run = moved(name, servo, axis, np.where(np.arange(WATCHED) < 1, 0.0, KICK))
    error = (run.commanded - run.motor)[:, axis]
    clamped = np.abs(run.demand) >= servo.per_axis("torque_limit")
    error = error[: np.argmax(clamped.any(axis=1)) if clamped.any() else None]
    amplitude = np.sqrt(np.mean(error[: error.size // WINDOW * WINDOW].reshape(-1, WINDOW) ** 2, axis=1))
    amplitude = amplitude[: np.argmax(amplitude < ROUNDING) if (amplitude < ROUNDING).any() else None]
    late = np.log(amplitude[amplitude.size // 2 :])
    return np.polyfit(np.arange(late.size) * WINDOW * PERIOD, late, 1)[0]


@cache
def edge_by_growth(name, servo, axis):
    """Factor on the gains of an axis at which a kick neither grows nor decays."""
    low = high = 1.0
    while growth(name, servo, axis, low) > 0:
        low, high = low / 1.2, low
    while growth(name, servo, axis, high) < 0:
        low, high = high, high * 1.2
    return brentq(lambda factor: growth(name, servo, axis, factor), low, high, rtol=TOLERANCE)


def loop_by_sweep(name, servo, axis):
    """The open loop of an axis at its own gains, all others closed, from the lowest to the Nyquist frequency."""
    bins = np.arange(LOWEST, SWEPT // 2 + 1)
    phase = np.random.default_rng(7).uniform(0, 2 * np.pi, bins.size)
    phase[-1] = 0.0  # of the alternation at the Nyquist frequency
    ticks = np.arange(SETTLED + SWEPT)
    position = KICK * np.cos(2 * np.pi * np.outer(ticks, bins) / SWEPT + phase).sum(axis=1)
    servo = scaled(servo, axis, REDUCED)
    run = moved(name, servo, axis, position - position[0])
    assert run.fault is None
    assert (np.abs(run.demand) < servo.per_axis("torque_limit")).all()
    answer, error = (np.fft.rfft(values[SETTLED:, axis])[bins] for values in (run.motor, run.commanded - run.motor))
    return answer / error / REDUCED


@cache
def edge_by_sweep(name, servo, axis):
    """Smallest factor on the gains at which the loop passes through -1."""
    loop = loop_by_sweep(name, servo, axis)
    k = np.flatnonzero(np.diff(loop.imag >= 0))
    share = loop.imag[k] / (loop.imag[k] - loop.imag[k + 1])
    crossed = np.append(loop.real[k] + share * (loop.real[k + 1] - loop.real[k]), loop.real[-1])
    return (-1 / crossed[crossed < 0]).min()


def edge_of_two_masses(drive, servo, axis):
    """Factor at which the largest pole of an axis, two masses and a winding sampled exactly, passes the unit circle."""
    motor, load = drive.nut + drive.rotor * drive.gear**2, drive.load
    drag, k, c = drive.damping + drive.rotor_damping * drive.gear**2, drive.stiffness, drive.flex_damping
    lag = drive.inductance / drive.resistance
    rates = np.zeros((6, 6))  # of x, x', y, y', K i and the torque demand
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :5] = np.array([-k, -drag - c, k, c, drive.gear]) / motor
    rates[3, :4] = np.array([k, c, -k, -c]) / load
    rates[4, 4:] = -1 / lag, 1 / lag
    after = expm(rates * servo.period)
    kp, kd = 1e3 * servo.gains[axis].kp, 1e3 * servo.gains[axis].kd / servo.period

    law = law_of(servo, axis)
    b0, b1, b2, a1, a2 = notch_coefficients(*law.notch, servo.period)

    def radius(factor):
        closed = np.zeros((8, 8))  # after the five: x one tick before, and the notch's states
        asked = factor * np.array([-kp - kd, 0, 0, 0, 0, kd, 0, 0])
        demand = b0 * asked + np.eye(8)[6]
        closed[:5, :5], closed[5, 0] = after[:5, :5], 1.0
        closed[:5] += np.outer(after[:5, 5], demand)
        closed[6] = b1 * asked - a1 * demand + np.eye(8)[7]
        closed[7] = b2 * asked - a2 * demand
        return np.abs(np.linalg.eigvals(closed)).max()

    factors = np.arange(0.05, 20.0, 0.01)
    k = np.argmax([radius(factor) > 1 for factor in factors])
    return brentq(lambda factor: radius(factor) - 1, factors[k - 1], factors[k])


def reported(name, servo, axis):
    return margins_of(machine_of(name), servo)[axis].gain


@pytest.mark.validates(
    "gain margin of every axis of every machine",
    "growth of a kick",
    "3 %",
)
@pytest.mark.parametrize(("name", "axis"), suite_runs(CASES, 0), ids=NAMES)
def test_a_kick_keeps_its_size_at_the_gain_margin(name, axis):
    servo = servo_of(name)
    assert edge_by_growth(name, servo, axis) == pytest.approx(reported(name, servo, axis), rel=MARGIN)


@pytest.mark.parametrize(("name", "axis"), suite_runs(CASES, 0), ids=NAMES)
def test_the_loop_measured_with_sines_passes_minus_one_at_the_gain_margin(name, axis):
    servo = servo_of(name)
    assert edge_by_sweep(name, servo, axis) == pytest.approx(reported(name, servo, axis), rel=MARGIN)


@pytest.mark.parametrize(("name", "axis"), suite_runs(CASES, 0), ids=NAMES)
def test_growth_and_sines_find_the_same_edge(name, axis):
    servo = servo_of(name)
    assert edge_by_growth(name, servo, axis) == pytest.approx(edge_by_sweep(name, servo, axis), rel=METHODS)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_delay_moves_the_measured_edge_with_the_reported_one(axis):
    prompt = servo_of("xy")
    late = dataclasses.replace(prompt, delay=2.5e-4)
    measured = edge_by_sweep("xy", late, axis)
    assert measured == pytest.approx(reported("xy", late, axis), rel=MARGIN)
    assert measured != pytest.approx(reported("xy", prompt, axis), rel=MARGIN)


@pytest.mark.parametrize(("name", "axis"), suite_runs(CASES[:5], 0), ids=NAMES[:5])
def test_the_measured_edge_is_that_of_two_masses(name, axis):
    servo = servo_of(name)
    assert not any(servo.per_axis("ki"))
    drive = read_drives(Path(str(files("gantrysim.models") / f"{name}.xml")))[axis]
    assert edge_by_sweep(name, servo, axis) == pytest.approx(edge_of_two_masses(drive, servo, axis), rel=METHODS)
