"""Encoders with errors, on the load and late, and the current loop, against closed forms and growth of a kick."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from gantrysim import Machine, Servo, simulate, simulate_batch
from gantrysim.base.errors import InputError
from gantrysim.engine.drives import drive_entries
from gantrysim.faults import BusSag, OpenWinding
from gantrysim.job.causes import CAUSES, Setup
from gantrysim.job.job import Job
from gantrysim.machine.ideal import without_winding
from gantrysim.machine.perturbation import Perturbation
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.stability.margins import Plant, margins_of
from gantrysim.study.loop.sampling import circle_response

from support.runs import plain, ramp, turntable
from support.soaked import suite_runs

NEAR = 0.03  # distance from the gain margin at which a kick grows or decays, relative
EXPONENTIAL = 1e-9  # of a step of the current, relative
SAME = 1e-9  # of two runs that differ by rounding [mm]
FINE = 12.5e-6  # physics step where margins are held against motion [s]
KICK = 1e-6  # [mm]
WATCHED = 800  # ticks

TICKS = 4000
RMS = 2e-3  # [mm]
CASES = {
    "load": {"feedback": "load"},
    "late": {"feedback_delay": 2},
    "current loop": {"current_bandwidth": 150.0},
    "all": {"feedback": "load", "feedback_delay": 1, "current_bandwidth": 200.0, "delay": 5e-4},
}


@pytest.fixture(scope="module")
def xy():
    return Machine("xy")


def still(machine, ticks=TICKS, period=1e-3):
    position, off = np.zeros((ticks, len(machine.axes))), np.zeros(ticks, bool)
    return Setpoints(period, machine.axis_names, position, off, ramp(50.0).requested)


@cache
def noise(seed=0, **given):
    machine = Machine("xy")
    run = simulate(machine, plain(machine, encoder_noise=RMS, encoder_seed=seed, **given), still(machine))
    return run.encoder - run.motor


@pytest.mark.validates(
    "encoder noise: variance and fourth moment",
    "white normal noise",
    "5 standard deviations of the estimate",
)
def test_noise_has_its_rms_and_is_normal():
    """Five standard deviations of the estimates: of the variance 2/n, of the fourth moment 96/n."""
    scaled = noise() / RMS
    np.testing.assert_allclose(scaled.mean(axis=0), 0, atol=5 / TICKS**0.5)
    np.testing.assert_allclose((scaled**2).mean(axis=0), 1, atol=5 * (2 / TICKS) ** 0.5)
    np.testing.assert_allclose((scaled**4).mean(axis=0), 3, atol=5 * (96 / TICKS) ** 0.5)


def test_noise_is_white_and_that_of_each_axis_its_own():
    scaled = noise() / RMS
    power = np.abs(np.fft.rfft(scaled, axis=0)[1:-1]) ** 2 / TICKS
    for part in np.array_split(power, 4):  # the spectrum is flat: each quarter has its share
        np.testing.assert_allclose(part.mean(axis=0), 1, atol=5 / len(part) ** 0.5)
    for lag in range(1, 20):
        assert np.abs((scaled[lag:] * scaled[:-lag]).mean(axis=0)).max() < 5 / TICKS**0.5
    assert abs((scaled[:, 0] * scaled[:, 1]).mean()) < 5 / TICKS**0.5


def test_noise_depends_on_the_seed_alone():
    np.testing.assert_allclose(noise(), noise(kd=0.0), atol=1e-14)
    assert np.abs(np.corrcoef(noise()[:, 0], noise(seed=1)[:, 0])[0, 1]) < 5 / TICKS**0.5


def test_a_batch_has_the_noise_of_runs_alone(xy):
    servos = [plain(xy, encoder_noise=RMS, encoder_seed=seed, feedback_delay=seed) for seed in (1, 2)]
    setpoints = ramp(50.0, 5.0)
    for servo, run in zip(servos, simulate_batch([xy] * 2, servos, [setpoints] * 2), strict=True):
        np.testing.assert_array_equal(run.encoder, simulate(xy, servo, setpoints).encoder)


@pytest.mark.validates(
    "interpolation error of an encoder",
    "its sines",
    "1e-12 mm",
)
def test_interpolation_error_has_its_amplitudes_and_periods(xy):
    once, twice, period, speed = 3e-3, 1e-3, 0.5, 50.0
    servo = plain(xy, interpolation_error=once, interpolation_error_twice=twice, signal_period=period)
    run = simulate(xy, servo, ramp(speed))
    error = (run.encoder - run.motor)[-2000:, 0]
    theta = np.arange(error.size) * 1e-3 * 2 * np.pi * speed / period  # of a constant speed
    spectrum = np.abs(np.fft.rfft(error)) * 2 / error.size
    assert [spectrum[round(k * theta[-1] / 2 / np.pi)] for k in (1, 2)] == pytest.approx([once, twice], rel=0.02)
    x = 2 * np.pi * run.motor / period
    np.testing.assert_allclose(run.encoder - run.motor, once * np.sin(x) + twice * np.sin(2 * x), atol=1e-12)


@pytest.mark.parametrize("delay", [1, 3, 16])
def test_feedback_comes_late_by_its_periods(xy, delay):
    run = simulate(xy, plain(xy, frequency=3.0, feedback_delay=delay), ramp(50.0, 20.0))
    np.testing.assert_array_equal(run.encoder[delay:], run.motor[:-delay])
    np.testing.assert_array_equal(run.encoder[:delay], np.tile(run.motor[0], (delay, 1)))


@pytest.mark.parametrize("feedback", ["motor", "load"])
def test_feedback_from_the_load_takes_the_steady_structural_error_away(feedback):
    """A constant force F on the load bends its spring by F / k: a motor's encoder does not see it."""
    pull, machine = 3.0, Machine("xy")  # [m/s²]

    def tilt(spec):
        spec.option.gravity = [pull, 0, 0]
        for body in spec.bodies:
            body.gravcomp = 0

    tilted = machine.edited(tilt).perturbed(Perturbation(friction=1e-15))
    model = tilted.physics
    carriage, flex = model.body("carriage").id, model.joint("x_flex").id
    bend = 1e3 * model.body_subtreemass[carriage] * pull / model.jnt_stiffness[flex]
    run = simulate(tilted, plain(tilted, integral_time=0.05, feedback=feedback), still(tilted, 2000))
    off = run.nozzle[-1, 0] - tilted.tip([0.0, 0.0])[0]
    assert bend > 2e-4
    assert off == pytest.approx(bend if feedback == "motor" else 0.0, abs=0.01 * bend)
    assert run.motor[-1, 0] == pytest.approx(0.0 if feedback == "motor" else -bend, abs=0.01 * bend)


def kicked(machine, servo, axis, factor):
    """Whether a kick of an axis grows when its gains are scaled."""
    gains = {name: list(servo.per_axis(name)) for name in ("kp", "ki", "kd")}
    for values in gains.values():
        values[axis] *= factor
    position = np.zeros((WATCHED, len(machine.axes)))
    position[1:, axis] = KICK
    setpoints = dataclasses.replace(still(machine, WATCHED), position=position)
    run = simulate(machine, servo.with_values(**gains), setpoints, physics_step=FINE)
    error = np.abs(run.commanded - run.motor)[:, axis]
    return run.fault is not None or error[-50:].max() > error[400:450].max()


@pytest.mark.parametrize("axis", suite_runs([0, 1], 1))
@pytest.mark.parametrize("case", CASES)
def test_margins_know_the_drive(case, axis):
    machine = Machine("xy").perturbed(Perturbation(friction=1e-15))
    servo = plain(machine, feedforward=0.0, **CASES[case])
    gain = margins_of(machine, servo)[axis].gain
    ordinary = margins_of(machine, servo.with_values(feedback="motor", feedback_delay=0, current_bandwidth=0.0))
    assert abs(gain / ordinary[axis].gain - 1) > 3 * NEAR
    assert not kicked(machine, servo, axis, gain * (1 - NEAR))
    assert kicked(machine, servo, axis, gain * (1 + NEAR))


def test_a_late_feedback_turns_the_loop(xy):
    frequency, late = np.array([3.0, 40.0, 200.0, 499.0]), 3
    loops = [Plant.of(xy, 1e-3).loop(plain(xy, feedback_delay=n, frequency=20.0), frequency) for n in (0, late)]
    turn = np.exp(-2j * np.pi * frequency * 1e-3 * late)
    np.testing.assert_allclose(loops[1], loops[0] * turn[:, None], rtol=1e-9)


@pytest.mark.parametrize("name", ["xyzr", "stage"])
@pytest.mark.parametrize("case", CASES)
def test_derived_gains_keep_their_margins_with_every_drive(name, case):
    machine = Machine(name)
    for margins in margins_of(machine, Servo.derive(machine.axes, **CASES[case])):
        assert margins.gain >= 2 * (1 - 1e-9)
        assert margins.sensitivity <= 2 * (1 + 1e-9)


@pytest.mark.parametrize("given", [{}, {"feedback_delay": 2}, {"current_bandwidth": 150.0}])
def test_the_error_on_a_circle_is_that_of_the_closed_form(given):
    """To the second order in the frequency over that of the machine's mode, and half a step of the servo."""
    machine, ticks, cycles = Machine("xy").perturbed(Perturbation(friction=1e-15)), 2000, 6
    servo = plain(machine, frequency=12.0, **given)
    time = np.arange(ticks) * 1e-3
    rate = 2 * np.pi * cycles / 1.0
    position = np.zeros((ticks, 2))
    position[:, 0] = 2.0 * (1 - np.cos(rate * time))
    run = simulate(machine, servo, dataclasses.replace(still(machine, ticks), position=position))
    turned = np.exp(-1j * rate * time[1000:])
    found = ((run.commanded - run.motor)[1000:, 0] @ turned) / (run.commanded[1000:, 0] @ turned)
    assert abs(found / circle_response(servo, 0, machine.axes[0], rate) - 1) < 0.03


def stepped(machine, torque, bandwidth, period=2.5e-4, ticks=20):
    servo = plain(machine, period, current_bandwidth=bandwidth)
    return simulate(machine, servo, still(machine, ticks, period), law=lambda tick: [torque, 0.0])


@pytest.mark.validates(
    "step of a current loop",
    "exponential",
    "1e-9 relative",
)
@pytest.mark.parametrize("bandwidth", [100.0, 400.0, 1500.0])
def test_torque_follows_a_step_of_its_demand_with_the_bandwidth(xy, bandwidth):
    run = stepped(xy, 0.05, bandwidth)
    time = np.arange(20) * 2.5e-4
    expected = 0.05 * -np.expm1(-2 * np.pi * bandwidth * time)
    np.testing.assert_allclose(run.current[:, 0] * xy.axes[0].motor_constant, expected, rtol=EXPONENTIAL, atol=1e-15)


def test_the_bus_voltage_limits_how_fast_a_current_rises(xy):
    axis, period = xy.axes[0], 5e-5
    run = stepped(xy, 0.9, 5000.0, period)
    steepest = axis.bus_voltage / axis.resistance * -np.expm1(-period / axis.lag)
    assert run.current[1, 0] == pytest.approx(steepest, rel=EXPONENTIAL)
    assert steepest < 0.9 / axis.motor_constant * -np.expm1(-2 * np.pi * 5000.0 * period)


def test_electrical_faults_act_on_a_current_loop(xy):
    """An open winding has no current; a sagged bus has that share of the voltage for the first rise."""
    axis, period = xy.axes[0], 5e-5
    servo, setpoints = plain(xy, period, current_bandwidth=5000.0), still(xy, 40, period)
    share, opens = 0.5, 20 * period
    faults = BusSag(time=0.0, share=share), OpenWinding(time=opens, axis="x")
    run = simulate(xy, servo, setpoints, law=lambda tick: [0.9, 0.0], faults=faults)
    steepest = share * axis.bus_voltage / axis.resistance * -np.expm1(-period / axis.lag)
    assert run.current[1, 0] == pytest.approx(steepest, rel=EXPONENTIAL)
    assert np.abs(run.voltage[:20]).max() == pytest.approx(share * axis.bus_voltage)
    assert (run.current[1:20, 0] > 0).all()
    np.testing.assert_array_equal(run.current[20:, 0], 0)


def test_a_current_loop_as_fast_as_the_winding_is_none(xy):
    width = 1 / (2 * np.pi * xy.axes[0].lag)
    servo, setpoints = plain(xy, frequency=15.0), ramp(80.0, 30.0)
    run = simulate(xy, servo.with_values(current_bandwidth=(width, 0.0)), setpoints)
    np.testing.assert_allclose(run.motor, simulate(xy, servo, setpoints).motor, atol=SAME)


def test_the_recorded_voltage_is_that_of_the_current(xy):
    """L di/dt = V - R i - K w over one physics step, with V and w at its beginning."""
    period = 5e-5
    run = stepped(xy, 0.9, 3000.0, period)
    axis = xy.axes[0]
    speed = np.diff(run.motor[:, 0]) / period / axis.scale  # a step moves at the speed of its end
    fallen = np.exp(-period / axis.lag)
    mean = (run.current[1:, 0] - run.current[:-1, 0] * fallen) / (1 - fallen) * axis.resistance
    np.testing.assert_allclose(run.voltage[1:-1, 0], mean[1:] + axis.motor_constant * speed[:-1], rtol=1e-9)
    assert run.voltage[0, 0] == axis.bus_voltage


def test_a_motor_without_inductance_has_no_current_loop(xy, tmp_path):
    for machine in (turntable(tmp_path), without_winding(xy)):
        with pytest.raises(InputError, match="axis 1 = 100 Hz: its motor has no inductance"):
            plain(machine, current_bandwidth=100.0)
        servo = plain(machine).with_values(current_bandwidth=(0.0, 100.0))
        with pytest.raises(InputError, match=r"axis [xy] = 100 Hz: its motor has no inductance"):
            simulate(machine, servo, still(machine, 10))


@pytest.mark.parametrize("cause", ["sampling", "counts", "winding", "compliance"])
def test_a_cause_is_switched_off_with_every_drive(xy, cause):
    servo = plain(xy, encoder_noise=1e-4, **CASES["all"])
    (chosen,) = (one for one in CAUSES if one.name == cause)
    without = chosen.without(Setup(xy, servo, ramp(50.0, 2.0)))
    assert without.run().fault is None
    off = {"sampling": (0, "feedback_delay"), "counts": ((0.0, 0.0), "encoder_noise")}
    off |= {"winding": ((0.0, 0.0), "current_bandwidth"), "compliance": (("motor", "motor"), "feedback")}
    value, name = off[cause]
    assert without.servo.values()[name] == value


def test_a_drive_that_does_nothing_leaves_every_bit(xy):
    servo, setpoints = Servo.derive(xy.axes), ramp(80.0, 10.0)
    neutral = Servo.derive(xy.axes, interpolation_error=1e-300, signal_period=1.0)
    assert drive_entries(xy, neutral, 2.5e-4) is not None
    run, same = simulate(xy, servo, setpoints), simulate(xy, neutral, setpoints)
    for name in ("encoder", "motor", "demand", "torque", "current", "voltage", "nozzle"):
        np.testing.assert_array_equal(getattr(same, name), getattr(run, name))


def test_plain_drives_have_no_entries_and_a_job_can_name_them(xy):
    assert drive_entries(xy, plain(xy), 2.5e-4) is None
    job = Job.load("trio-basic", ['servo.feedback=["load", "motor"]', "servo.encoder_noise=1e-4"])
    assert job.built_servo.per_axis("feedback") == ("load", "motor")
    assert job.built_servo.per_axis("encoder_noise") == (1e-4, 1e-4)
    assert all(margins.stable for margins in job.margins)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"feedback": "nozzle"}, "feedback = 'nozzle': must be one of 'motor', 'load'"),
        ({"feedback": ["load"]}, "feedback has 1 values: must be one or 2"),
        ({"feedback_delay": 17}, "feedback_delay = 17: must be 0 to 16"),
        ({"feedback_delay": 0.5}, "feedback_delay = 0.5: must be a whole number"),
        ({"encoder_noise": -1.0}, "encoder_noise = -1: must be 0"),
        ({"current_bandwidth": -5.0}, "current_bandwidth = -5 Hz: must be 0 to 100000 Hz"),
        ({"interpolation_error": 1e-3}, "signal_period = 0 mm: must be greater than 0 mm"),
    ],
)
def test_a_drive_that_cannot_be_is_refused(xy, given, text):
    with pytest.raises(InputError) as refused:
        plain(xy, **given)
    assert text in str(refused.value)


def test_feedback_from_a_load_that_there_is_not_is_refused(tmp_path):
    machine = turntable(tmp_path)
    with pytest.raises(InputError, match=r"axis 1 = .load.: the machine has no single spring"):
        plain(machine, feedback="load")
    servo = plain(machine).with_values(feedback=("motor", "load"))
    with pytest.raises(InputError, match="axis x = 'load': machine turntable has no single spring"):
        simulate(machine, servo, still(machine, 10))
