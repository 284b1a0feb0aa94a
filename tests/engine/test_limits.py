"""Setpoints and settings that a machine cannot follow are refused before anything moves."""

import dataclasses
import math

import numpy as np
import pytest

from gantrysim import Dispenser, InputError, Servo, simulate

from support.runs import PERIOD, plain, ramp, turn, turned, turntable

BAD = {
    "unknown axis": (
        lambda m: {"setpoints": dataclasses.replace(ramp(50.0), axes=("x", "w"))},
        "moves axis 'w'.*has x, y; run it on a machine with w, or leave w out",
    ),
    "travel": (
        lambda m: {"setpoints": ramp(50.0, 240.0)},
        r"x = 170 mm at t = .*travel -150 to 150 mm of machine rigid",
    ),
    "speed": (lambda m: {"setpoints": ramp(1500.0)}, r"speed of x = 1500 mm/s.*at most 1000 mm/s"),
    "period": (
        lambda m: {"servo": Servo.derive(m.axes, 5e-4)},
        r"period = 0.001 s: must be the servo period, 0.0005 s",
    ),
    "axes": (lambda m: {"servo": Servo.derive(m.axes[:1], PERIOD)}, "servo has 1 axes: machine rigid has 2"),
    "physics step": (lambda m: {"physics_step": 0.0}, "physics_step = 0 s: must be at least"),
    "start lead": (
        lambda m: {"dispenser": Dispenser(flow=1.0, start_lead=0.02)},
        "start_lead = 0.02 s: must be at most 0 s, the time before the first dispensing",
    ),
    "delay": (
        lambda m: {"servo": Servo.derive(m.axes, PERIOD, delay=3e-4)},
        "servo delay = 0.0003 s: must be a multiple",
    ),
}


@pytest.mark.parametrize(("change", "text"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_refused_before_anything_moves(rigid, change, text):
    machine = rigid()
    arguments = {"servo": Servo.derive(machine.axes, PERIOD), "setpoints": ramp(50.0), **change(machine)}
    with pytest.raises(InputError, match=text):
        simulate(machine, **arguments)


def test_speed_limit_is_the_declared_one_or_the_bus_voltage(rigid):
    assert rigid().axes[0].speed_limit == pytest.approx(1000.0)
    slow = rigid(voltage=12.0).axes[0]
    assert slow.speed_limit == pytest.approx(slow.no_load_speed) == pytest.approx(12 / 0.03 * 10 / (2 * math.pi))


def test_speed_limit_is_met_exactly(rigid):
    machine = rigid()
    servo = plain(machine)
    for speed, refused in ((999.9, False), (1000.2, True)):
        setpoints = ramp(speed)
        if refused:
            with pytest.raises(InputError, match="speed of x"):
                simulate(machine, servo, setpoints)
        else:
            simulate(machine, servo, setpoints)


def test_physics_steps_are_at_most_what_the_machine_is_made_for(rigid):
    machine = rigid()
    with pytest.raises(InputError, match=r"physics_step = 0.001 s: must be at most 0.0005 s, the timestep of machine"):
        simulate(machine, plain(machine), ramp(50.0), physics_step=1e-3)
    default = simulate(machine, plain(machine), ramp(50.0))
    same = simulate(machine, plain(machine), ramp(50.0), physics_step=5e-4)
    np.testing.assert_array_equal(default.nozzle, same.nozzle)


def test_limits_of_a_rotary_axis_are_in_degrees(tmp_path):
    machine = turntable(tmp_path)
    bound = "must lie in the travel -400 to 400 deg of machine turntable; it leaves it at t = 4.001 s"
    with pytest.raises(InputError, match=rf"th = 420 deg at t = 4.2 s: {bound}$"):
        turn(machine, 100.0, ticks=4201)
    with pytest.raises(
        InputError,
        match=r"speed of th = 361 deg/s at t = .* must be at most 360 deg/s, the limit of machine turntable$",
    ):
        turn(machine, 361.0)
    run = simulate(machine, Servo.derive(machine.axes, PERIOD), turned(359.0))
    assert run.fault is None


def test_an_encoder_of_a_rotary_axis_counts_degrees(tmp_path):
    run = turn(turntable(tmp_path), 90.0)
    counts = run.encoder[:, 0] * 1e3  # a thousandth of a degree each: 36 turns of 10 000 counts in 360 deg
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert run.encoder[-1, 0] == pytest.approx(90.0, abs=0.1)
    # the nozzle at (200, 0) in the frame of a work that turns with the table
    a = np.radians(run.encoder[:, 0])
    expected = 200 * np.stack([np.cos(a), -np.sin(a), 0 * a], axis=1)
    np.testing.assert_allclose(run.nozzle, expected, atol=2 * 200 * math.radians(1e-3))
    np.testing.assert_allclose(run.commanded_tip[:, 0], 200 * np.cos(np.radians(run.commanded[:, 0])), atol=1e-9)
