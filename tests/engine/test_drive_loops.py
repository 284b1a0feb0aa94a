"""Velocity and position loops in the drives: closed forms, margins against growth of a kick, limits."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from gantrysim import Job, Machine, Servo, simulate, simulate_batch
from gantrysim.base.errors import InputError
from gantrysim.engine.advance import Stepper
from gantrysim.engine.simulation import Simulation
from gantrysim.env.episodes import Source
from gantrysim.env.settings import PathSettings
from gantrysim.job.causes import CAUSES, Setup
from gantrysim.machine.perturbation import Perturbation
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo_design import velocity_loop
from gantrysim.servo.stability.linear_system import Compensator
from gantrysim.servo.stability.margins import Plant, UnheldLaws, margins_of, with_velocity_loops
from gantrysim.servo.stability.motion import Drives, LinearSystem
from gantrysim.study.tuning.study import TuningStudy

from support.runs import plain, ramp
from support.soaked import examples, suite_runs
from support.tables import EXAMPLES

NEAR = 0.03  # distance from the gain margin at which a kick grows or decays, relative
FINE = 1.25e-5  # physics step where margins are held against motion [s]
KICK, WATCHED = 1e-6, 800  # [mm], ticks
LOOPS = ("velocity", "position")
CASES = {
    "plain": {},
    "late": {"feedback_delay": 2, "delay": 2.5e-4},
    "off the drive's samples": {"delay": 2e-4},
    "slow drive": {"drive_period": 5e-4},
    "on the load": {"feedback": "load", "current_bandwidth": 600.0},
}


@pytest.fixture(scope="module")
def xy():
    return Machine("xy").perturbed(Perturbation(friction=1e-15))


def still(machine, ticks=WATCHED, period=1e-3):
    position, off = np.zeros((ticks, len(machine.axes))), np.zeros(ticks, bool)
    return Setpoints(period, machine.axis_names, position, off, ramp(50.0).requested)


@pytest.mark.first
@pytest.mark.parametrize("bandwidth", [8.0, 20.0])
def test_a_velocity_loop_answers_a_step_as_its_two_poles_do(xy, bandwidth):
    """v / w = (2 p s + p²) / (s + p)² with p half of K / J: 1 - (1 - p t) exp(-p t), for lags far below 1 / p."""
    servo = plain(xy, mode="velocity", velocity_bandwidth=bandwidth)
    run = simulate(xy, servo, still(xy, 300), law=lambda tick: [20.0, -10.0])
    p, time = math.pi * bandwidth, run.time[:-1] + 5e-4
    expected = 1 - (1 - p * time) * np.exp(-p * time)
    for a, demand in enumerate((20.0, -10.0)):
        np.testing.assert_allclose(np.diff(run.motor[:, a]) / 1e-3 / demand, expected, atol=0.02 * bandwidth / 8)
    assert servo.drives[0].velocity_gain == pytest.approx(2 * p * xy.axes[0].inertia)


@pytest.mark.parametrize("mode", LOOPS)
def test_a_finer_physics_step_leaves_the_drive_s_period(xy, mode):
    """The loops stay those of the drive: halving the physics step changes less each time."""
    servo = plain(xy, mode=mode, integral_time=0.05)
    position = still(xy, 300).position.copy()
    position[:, 0] = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 300))
    setpoints = dataclasses.replace(still(xy, 300), position=position)
    motors = [simulate(xy, servo, setpoints, physics_step=step).motor for step in (1.25e-4, 6.25e-5, 3.125e-5)]
    first, second = np.abs(motors[1] - motors[0]).max(), np.abs(motors[2] - motors[1]).max()
    assert second < 0.7 * first < 2e-3


def kicked(machine, servo, axis, factor):
    """Whether a kick of an axis grows when its gains are scaled."""
    gains = {name: list(servo.per_axis(name)) for name in ("kp", "ki", "kd")}
    for values in gains.values():
        values[axis] *= factor
    position = np.zeros((WATCHED, len(machine.axes)))
    position[1:, axis] = KICK
    setpoints = dataclasses.replace(still(machine), position=position)
    run = simulate(machine, servo.with_values(**gains), setpoints, physics_step=FINE)
    error = np.abs(run.commanded - run.motor)[:, axis]
    return run.fault is not None or error[-50:].max() > error[400:450].max()


@pytest.mark.parametrize("case", suite_runs(list(CASES), 0, 4))
@pytest.mark.parametrize("mode", LOOPS)
def test_margins_know_the_loop_in_the_drive(xy, mode, case):
    servo = plain(xy, feedforward=0.0, mode=mode, **CASES[case])
    axis = 1
    gain = margins_of(xy, servo)[axis].gain
    assert math.isfinite(gain)
    assert not kicked(xy, servo, axis, gain * (1 - NEAR))
    assert kicked(xy, servo, axis, gain * (1 + NEAR))


def test_a_velocity_loop_too_fast_is_unstable_where_the_margins_say_so(xy):
    servo = plain(xy, feedforward=0.0, mode="velocity")

    def faster(factor):
        return servo.with_values(velocity_gain=tuple(factor * gain for gain in servo.per_axis("velocity_gain")))

    factors = np.geomspace(1.5, 8, 120)
    edge = next(factor for factor in factors if not all(one.stable for one in margins_of(xy, faster(factor))))
    which = [one.stable for one in margins_of(xy, faster(edge))].index(False)
    assert not kicked(xy, faster(edge * (1 - NEAR)), which, 1.0)
    assert kicked(xy, faster(edge * (1 + NEAR)), which, 1.0)


@pytest.mark.parametrize("name", ["xyzr", "stage"])
@pytest.mark.parametrize("case", ["plain", "late"])
@pytest.mark.parametrize("mode", LOOPS)
def test_derived_gains_keep_their_margins(name, mode, case):
    """The loops in the servo, around those in the drives, and those in the drives by themselves."""
    machine = Machine(name)
    servo = Servo.derive(machine.axes, mode=mode, integral_time=0.05, **CASES[case])
    for margins in margins_of(machine, servo):
        assert margins.gain >= 2 * (1 - 1e-9)
        assert margins.sensitivity <= 2 * (1 + 1e-6)
    if mode == "velocity":
        found = velocity_loop(machine.axes, Drives(period=servo.drive_period), None)
        t = servo.drive_period
        for axis, gain, time in zip(
            machine.axes, servo.per_axis("velocity_gain"), servo.per_axis("velocity_time"), strict=True
        ):
            assert gain == pytest.approx(4 * math.pi * found.frequency * axis.inertia)
            inner = Compensator.pid(gain / time, 0.0, gain, t)
            margins = Plant(axis.motion, t).margins(UnheldLaws(t, 0.0, (inner,)))[0]
            assert margins.gain >= 2 * (1 - 1e-9)
            assert margins.sensitivity <= 2 * (1 + 1e-9)


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1, 2, 5, 8]),
    st.floats(0, 1),
    st.integers(1, 2),
)
@examples(30)
def test_two_rates_in_one_system_are_the_recurrence_of_both(seed, ratio, share, axes):
    """Every sample of the drives one after the other, by the words of their law, for any motion."""
    random = np.random.default_rng(seed)
    states, t = 2 * axes + 1, 1e-3
    system = LinearSystem(
        tuple(range(axes)),
        random.uniform(-0.4, 0.4, (states, states)),
        np.zeros((states, axes)),
        random.uniform(-1, 1, (states, axes)),
        random.uniform(-1, 1, (axes, states)),
    )
    motors, gain, rate = (
        random.uniform(-1, 1, (axes, states)),
        random.uniform(0, 1e-3, axes),
        random.uniform(0, 9, axes),
    )
    delay = share * ratio * t
    whole = with_velocity_loops(system, motors, gain, rate, (t, ratio * t, delay))
    x, before, total, last = np.zeros(states), np.zeros(axes), np.zeros(axes), np.zeros(axes)
    lifted = np.zeros(states + 2 * axes)
    for demand in random.uniform(-1, 1, (6, axes)):
        np.testing.assert_allclose(whole.H @ lifted, system.H @ x, atol=1e-9)
        lifted = whole.F @ lifted + whole.G0 @ last + whole.G1 @ demand
        for j in range(ratio):
            wanted = demand if j * t >= delay * (1 - 1e-9) else last
            error = wanted - (motors @ x - before) / t
            before, total = motors @ x, total + t * error
            x = system.F @ x + system.G1 @ (gain * (error + rate * total))
        last = demand


def test_the_torque_limit_holds_in_the_drive_and_does_not_wind_up(xy):
    """Out of the limit the loop overshoots no more than without it, by exp(-2) of the step."""
    servo = plain(xy, mode="velocity", velocity_bandwidth=15.0)
    law = lambda tick: [150.0, 0.0]  # noqa: E731
    free, held = (simulate(xy, one, still(xy, 500), law=law) for one in (servo, limited(servo, 0.02)))
    assert np.abs(held.demand[:, 0]).max() == pytest.approx(0.02)
    assert np.abs(free.demand[:, 0]).max() > 0.05
    speed = np.diff(held.motor[:, 0]) / 1e-3
    assert speed.max() < 150 * (1 + math.exp(-2) + 0.02)
    assert speed[-1] == pytest.approx(150, rel=0.01)


def limited(servo, torque):
    return servo.with_values(torque_limit=(torque,) * servo.axes)


def test_a_limit_cycle_in_the_torque_limit_is_a_fault(xy):
    servo = plain(xy, mode="velocity")
    fast = servo.with_values(velocity_gain=tuple(20 * gain for gain in servo.per_axis("velocity_gain")))
    run = simulate(xy, limited(fast, 0.1), ramp(50.0, 20.0))
    assert run.fault is not None
    assert run.fault.kind in ("oscillation", "diverged", "overspeed")


def test_a_position_loop_in_the_drive_follows_a_period_late(xy):
    servo = plain(xy, mode="position", integral_time=0.05)
    run = simulate(xy, servo, ramp(80.0, 60.0))
    late = (run.commanded[:-1] - run.motor[1:])[200:, 0]
    assert np.abs(late).max() < 2e-3 < 0.08 == pytest.approx((run.commanded - run.motor)[400, 0], rel=0.03)


def test_a_batch_is_the_runs_alone(xy):
    servos = [plain(xy, mode=mode, encoder_noise=1e-4, resolution=1e-3) for mode in LOOPS]
    setpoints = ramp(50.0, 5.0)
    runs = simulate_batch([xy] * 2, servos, [setpoints] * 2)
    for servo, run in zip(servos, runs, strict=True):
        np.testing.assert_array_equal(run.motor, simulate(xy, servo, setpoints).motor)
    assert not np.array_equal(runs[0].motor, runs[1].motor)


@pytest.mark.parametrize("mode", LOOPS)
def test_causes_are_switched_off_with_loops_in_the_drives(xy, mode):
    setup = Setup(xy, plain(xy, mode=mode, resolution=1e-3), ramp(50.0, 2.0))
    for cause in CAUSES:
        run = cause.without(setup).run()
        assert run.fault is None
        assert np.abs(run.commanded - run.motor).max() < 0.1


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"mode": "velocity", "drive_period": 3e-4}, "drive_period = 0.0003 s: must be a whole fraction of the servo"),
        ({"mode": "velocity", "drive_period": 2e-3}, "drive_period = 0.002 s: must be a whole fraction of the servo"),
        ({"velocity_bandwidth": 50.0}, "velocity_bandwidth = 50 Hz: no drive is in mode 'velocity'"),
        ({"velocity_gain": 0.01}, "velocity_gain = 0.01 .* in mode 'torque': must be 0, only for mode 'velocity'"),
        ({"mode": "velocity", "velocity_gain": 0.0}, "in mode 'velocity': must be greater than 0"),
        ({"mode": "position", "feedback": "none"}, "feedback = 'none': a drive in mode 'position' needs it"),
    ],
)
def test_loops_that_make_no_sense_are_refused_in_one_line(xy, given, text):
    with pytest.raises(InputError, match=text) as caught:
        plain(xy, **given)
    assert "\n" not in str(caught.value)


def test_axes_of_a_closed_chain_have_one_mode():
    machine = Machine(EXAMPLES / "corexy.toml")
    assert all(one.gain >= 2 for one in margins_of(machine, Servo.derive(machine.axes, mode="velocity")))
    with pytest.raises(InputError, match="coupled by a closed chain, all must have one mode"):
        Servo.derive(machine.axes, mode=["velocity", "torque"])


def test_what_needs_torque_gains_refuses_other_modes(xy):
    job = Job.load("an225", ["servo.mode='velocity'"])
    with pytest.raises(InputError, match="tuning: servo mode"):
        _ = TuningStudy(job).stability
    with pytest.raises(InputError, match="environment: servo mode"):
        Source(PathSettings(job=job))


@pytest.mark.parametrize("speed", [10.0, 150.0, 210.0])
def test_reactance_takes_torque_from_a_stepper_in_a_closed_loop(speed):
    """With the current in the torque's axis: (R i + K w)² + (p w L i)² = V²."""
    machine = Machine(EXAMPLES / "stepper.toml")
    a, axis = machine.axis_names.index("y"), machine.axes[machine.axis_names.index("y")]
    assert axis.mode == "position"
    w, constant = speed / axis.scale, axis.motor_constant

    def over(i):
        return (axis.resistance * i + constant * w) ** 2 + (
            axis.phases.pole_pairs * w * axis.phases.inductance * i
        ) ** 2

    most = axis.peak_torque / constant
    expected = constant * (
        most if over(most) < axis.bus_voltage**2 else brentq(lambda i: over(i) - axis.bus_voltage**2, 0, most)
    )
    heavy = machine.edited(lambda spec: setattr(spec.joint("y"), "armature", 1e7))
    position = np.zeros((60, 3))
    position[:, a] = 4.0 + speed * 1e-3 * np.arange(60)
    off = np.zeros(60, bool)
    setpoints = Setpoints(1e-3, machine.axis_names, position, off, ramp(50.0).requested)
    servo = Servo.derive(machine.axes, following_error_limit=1e3, mode=["stepper", "position", "stepper"])
    stepper = Stepper(Simulation.of(heavy, servo, setpoints))
    stepper.data.qpos[heavy.addresses[a].joint] = 0.0
    stepper.data.qvel[heavy.physics.joint("y").dofadr[0]] = 1e-3 * speed
    stepper.advance()
    run = stepper.run.record()
    assert run.demand[20, a] == pytest.approx(expected, rel=1e-3)
    assert (expected < axis.peak_torque) == (speed > 100)


def test_a_closed_loop_stepper_of_a_table_runs_the_spiral():
    job = Job.load("an225", machine=str(EXAMPLES / "stepper.toml"))
    y = job.built_machine.axis_names.index("y")
    assert job.built_servo.modes == ("stepper", "position", "stepper")
    run = job.run()
    assert run.fault is None
    late = np.abs(run.commanded[:-1] - run.motor[1:])
    assert late[:, y].max() < 0.02
