"""Faults that end a run, and conditions that are no faults."""

import dataclasses
import math
import re

import mujoco
import numpy as np
import pytest

from gantrysim import Fault, Machine, Servo, metrics, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.native.callback import installed_tick
from gantrysim.engine.simulation import Simulation
from gantrysim.engine.started import Started
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints

from support.runs import PERIOD, STEP, ideal_motors, plain, ramp, turn, turntable


def slowly(tick):
    return [0.05 if tick.measured_velocity[0] < 150 else 0.0, 0.0]


@pytest.mark.parametrize("frequency", [100.0, 140.0, 200.0, 400.0, 1000.0])
def test_unstable_gains_end_in_a_fault_with_time_and_axis(xy, frequency):
    servo = Servo.derive(xy.axes, PERIOD, frequency=frequency)
    run = simulate(xy, servo, MoveSpiral(120, 4, 10, 100).setpoints(PERIOD))
    assert run.fault is not None
    assert run.fault.axis in ("x", "y")
    assert run.time[-1] == pytest.approx(run.fault.time)
    assert run.fault.time < 2.0
    assert f"{run.fault.kind} on axis {run.fault.axis} at t = {run.fault.time:.4f} s" in str(run.fault)


def test_divergence_without_any_limit_is_a_fault_too(rigid):
    machine = rigid(travel=1e6, speed=0.0, voltage=1e9, current=1e9)
    servo = plain(machine, frequency=400.0, following_error_limit=math.inf, torque_limit=math.inf)
    run = simulate(machine, servo, MoveSpiral(120, 4, 10, 100).setpoints(PERIOD))
    assert run.fault is not None
    assert np.abs(run.commanded - run.encoder)[:-1].max() > 10


def test_a_limit_cycle_between_the_torque_limits_is_a_fault_and_a_hard_start_is_none(rigid):
    machine = rigid()
    lazy = {"following_error_limit": 1e3, "resolution": 0.0}
    wild = simulate(machine, Servo.derive(machine.axes, PERIOD, frequency=150.0, **lazy), ramp(100.0))
    assert wild.fault is not None
    assert (wild.fault.kind, wild.fault.axis, wild.fault.value) == ("oscillation", "x", 20)
    assert np.abs(wild.commanded - wild.encoder).max() < 20  # bounded: no other limit would have seen it
    limited = simulate(machine, Servo.derive(machine.axes, PERIOD, torque_limit=0.1, **lazy), ramp(100.0))
    assert limited.fault is None
    assert (np.abs(limited.demand[:, 0]) == 0.1).sum() > 10


def test_slow_swings_between_the_limits_are_no_oscillation(rigid):
    machine = rigid(speed=5.0)
    n = 25 * 300
    x = 5 * np.sign(np.sin(2 * np.pi * np.arange(n) * PERIOD / 0.3))  # jumps to and fro, every 0.15 s
    x = np.clip(np.convolve(x, np.ones(12) / 12, "same"), -5, 5)
    path = ArcChain((0.0, 0.0), 0.0, [0.0], [10.0])
    setpoints = Setpoints(PERIOD, ("x",), x[:, None], np.ones(n, bool), path)
    servo = Servo.derive(machine.axes, PERIOD, torque_limit=0.15, following_error_limit=1e3, resolution=0.0)
    run = simulate(machine, servo, setpoints)
    clamped = np.abs(run.demand[:, 0]) == 0.15
    swings = np.abs(np.diff(np.sign(run.demand[clamped, 0]))).sum() / 2
    assert swings > 20
    assert run.fault is None


@pytest.mark.parametrize(
    ("limits", "kind"),
    [
        ({"following_error_limit": 0.5}, "following error"),
        ({"following_error_limit": 1e6}, "overspeed"),
    ],
)
def test_a_run_away_axis_trips_on_the_first_limit_it_meets(rigid, limits, kind):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, **limits)
    run = simulate(machine, servo, ramp(50.0), law=lambda tick: [0.9, 0.0])
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == (kind, "x")
    reached = run.commanded[-1, 0] - run.encoder[-1, 0] if kind == "following error" else run.fault.value
    assert reached == pytest.approx(run.fault.value)
    assert abs(run.fault.value) > run.fault.limit
    if kind == "overspeed":
        assert run.fault.limit == pytest.approx(1.2 * machine.axes[0].speed_limit)


@pytest.mark.parametrize(
    ("limits", "law", "text"),
    [
        (
            {"following_error_limit": 0.5},
            lambda tick: [0.9, 0.0],
            r"^following error on axis th .*: −\d\.\d+ deg, limit 0.5 deg$",
        ),
        (
            {"following_error_limit": 1e6},
            lambda tick: [0.9, 0.0],
            r"^overspeed on axis th .*: \d+(\.\d)? deg/s, limit 432 deg/s$",
        ),
        ({"following_error_limit": 1e6}, slowly, r"^travel on axis th .*: 400\.\d deg, limit 400.1 deg$"),
        (
            {"following_error_limit": 1e6},
            lambda tick: [0.0, 0.9],
            r"^overspeed on axis x .*: \S+ mm/s, limit \S+ mm/s$",
        ),
    ],
)
def test_a_fault_of_a_rotary_axis_is_in_degrees(tmp_path, limits, law, text):
    machine = turntable(tmp_path)
    machine.physics.jnt_limited[:] = 0  # no hard stop before the limit switch
    run = turn(machine, 0.0, ticks=6000, law=law, **limits)
    assert run.fault is not None
    assert re.match(text, str(run.fault)), str(run.fault)


@pytest.mark.parametrize(("push", "limit"), [(-0.05, -0.5), (0.05, 80.1)])
def test_the_travel_ends_where_it_does_on_either_side(push, limit):
    """Of an axis whose travel is to one side of its zero alone."""
    machine = Machine("xyz")
    machine.physics.jnt_limited[:] = 0  # no hard stop before the limit switch
    axis = machine.axis_names.index("z")
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=1e6)

    def law(tick):
        steady = abs(tick.measured_velocity[axis]) < 100
        return [push if k == axis and steady else 0.0 for k in range(len(machine.axes))]

    run = simulate(machine, servo, ramp(50.0), law=law)
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == ("travel", "z")
    assert run.fault.limit == pytest.approx(limit)
    assert abs(run.fault.value - limit) < 1.0
    assert (run.fault.value > limit) == (push > 0)


def test_leaving_the_travel_is_a_fault(rigid):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=1e6)
    machine.physics.jnt_limited[:] = 0  # no hard stop before the limit switch
    run = simulate(machine, servo, ramp(50.0), law=lambda tick: [0.05 if tick.measured_velocity[0] < 300 else 0.0, 0.0])
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == ("travel", "x")
    assert run.encoder[-1, 0] > 150.1
    assert run.encoder[-2, 0] <= 150.1 + 1e-9


def test_the_same_run_within_its_limits_has_no_fault(rigid):
    machine = rigid()
    run = simulate(machine, Servo.derive(machine.axes, PERIOD, following_error_limit=0.6), ramp(50.0))
    assert run.fault is None
    assert len(run.time) == len(ramp(50.0).position)


def test_a_fault_disables_the_drives_at_once_even_with_a_delay(rigid):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, delay=5e-4, following_error_limit=0.05)
    seen = []
    run = simulate(machine, servo, ramp(400.0), physics_step=STEP, progress=seen.append)
    assert run.fault is not None
    assert seen[-1] < 1.0  # the job has ended there
    row_end = len(run.time) - 1
    assert run.fault.time == pytest.approx(row_end * PERIOD)
    assert np.isfinite(run.nozzle).all()


def test_a_control_that_mujoco_would_zero_is_a_fault(rigid):
    machine = Machine(ideal_motors(rigid(current=0.0).source))  # no limit
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=math.inf)
    run = simulate(machine, servo, ramp(50.0), law=lambda tick: [1e300, 0.0])
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis, run.fault.time) == ("diverged", "x", 0.0)
    wild = servo.with_values(kp=(1e14, 1e14))
    run = simulate(machine, wild, ramp(50.0))
    assert run.fault is not None
    assert run.fault.kind in ("diverged", "overspeed")
    assert run.fault.time < 0.01


def test_a_warning_of_mujoco_is_a_fault_at_the_next_tick(rigid, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    machine = rigid(speed=0.0, travel=1e7)
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=math.inf)
    machine.physics.jnt_limited[:] = 0
    object.__setattr__(
        machine,
        "plain_axes",
        tuple(dataclasses.replace(a, travel=(-math.inf, math.inf)) for a in machine.plain_axes),
    )
    machine.physics.opt.gravity[0] = 1e13  # an acceleration that MuJoCo calls bad
    run = simulate(machine, servo, ramp(50.0))
    assert run.fault is not None
    assert (run.fault.kind, run.fault.axis) == ("diverged", "x")
    assert run.fault.time <= 2 * PERIOD
    assert np.isfinite(run.nozzle).all()
    assert metrics.values(run).contour.max >= 0  # a record that can be looked at
    assert [item.name for item in tmp_path.iterdir()] == ["rigid.xml"]  # and no log file in the working directory


def test_the_torques_are_off_within_the_very_step_of_the_fault(rigid):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, delay=5e-4, following_error_limit=0.6)
    simulation = Simulation.of(machine, servo, ramp(400.0), physics_step=STEP)
    model = simulation.model
    data = mujoco.MjData(model)
    run = Started.of(simulation, data.qpos, data.userdata)
    before = 0.0
    with installed_tick():
        for _ in range(4000):
            mujoco.mj_step(model, data)
            if run.fault:
                break
            before = data.ctrl[0]
    assert run.fault
    assert before != 0.0
    assert not data.ctrl.any()


def test_a_run_that_ends_in_nan_keeps_the_ticks_before(rigid):
    machine = rigid()
    servo = Servo.derive(machine.axes, PERIOD, following_error_limit=math.inf)
    poisoned = machine.stepping(STEP)
    poisoned.body_mass[:] = np.inf  # no acceleration is a number
    poisoned.opt.gravity[0] = 1.0
    run = simulate(machine, servo, ramp(50.0), physics_step=STEP)
    assert run.fault is not None
    assert run.fault.kind == "diverged"
    assert len(run.time) >= 1
    assert np.isfinite(run.nozzle).all()
    assert np.isfinite(metrics.values(run).contour.max)


def test_a_fault_of_an_absurd_torque_is_in_newton_metres():
    assert (
        str(Fault("diverged", "x", 0.002, -5e9, 1e9, "N·m"))
        == "diverged on axis x at t = 0.0020 s: −5e+09 N·m, limit 1e+09 N·m"
    )
