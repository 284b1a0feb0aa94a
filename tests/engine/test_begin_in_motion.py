"""Runs that begin in motion, or off their first setpoint."""

import numpy as np
import pytest

from gantrysim import Machine, Servo, simulate
from gantrysim.engine.simulation import Start
from gantrysim.machine.ideal import frictionless_machine
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.setpoints import Setpoints

MACHINE = Machine("xy")
SERVO = Servo.derive(MACHINE.axes)
NO_PATH = Chain([Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))])


def test_the_axes_start_where_and_as_fast_as_they_are_told():
    """With a servo that does nothing, an axis without friction goes on at its first velocity."""
    machine = frictionless_machine(MACHINE)
    idle = SERVO.with_values(kp=0.0, ki=0.0, kd=0.0, velocity_ff=0.0, acceleration_ff=0.0, notch_frequency=0.0)
    idle = idle.with_values(following_error_limit=1e3)
    resting = Setpoints(1e-3, ("x", "y"), np.zeros((201, 2)), np.zeros(201, bool), NO_PATH)
    start = Start(np.array([-7.0, 3.0]), np.array([40.0, -25.0]), np.zeros(2), np.zeros(2))
    run = simulate(machine, idle, resting, start=start)
    expected = start.position + run.time[:, None] * start.velocity
    # the motors' back-EMF is compensated, the load swings on its spring
    assert np.abs(run.motor - expected).max() < 0.05


def test_a_command_that_moves_at_the_first_row_has_no_jump_of_velocity():
    """Feed-forward alone on exact gains: torque of the first tick is that of the velocity, none of an acceleration."""
    servo = SERVO.with_values(kp=0.0, ki=0.0, kd=0.0, notch_frequency=0.0, following_error_limit=1e3)
    time = 1e-3 * np.arange(50)
    command = np.stack([40.0 * time, -25.0 * time], axis=1)
    setpoints = Setpoints(1e-3, ("x", "y"), command, np.zeros(50, bool), NO_PATH)
    speed = np.array([40.0, -25.0])
    run = simulate(MACHINE, servo, setpoints, start=Start(np.zeros(2), speed, speed, np.zeros(2)))
    expected = speed * np.array(servo.per_axis("velocity_ff"))
    np.testing.assert_allclose(run.demand, np.tile(expected, (50, 1)), rtol=1e-6)


@pytest.mark.parametrize("friction", [True, False])
def test_an_axis_that_begins_in_steady_motion_goes_on_steadily(friction):
    """With the torque of its friction, the error of a velocity's feed-forward stays: no bristle jolts it."""
    machine = MACHINE if friction else frictionless_machine(MACHINE)
    speed = np.array([60.0, -40.0])
    time = 1e-3 * np.arange(300)
    setpoints = Setpoints(1e-3, ("x", "y"), time[:, None] * speed, np.zeros(300, bool), NO_PATH)
    # once more, from where the first run has settled
    first = simulate(machine, SERVO, setpoints)
    settled = 200
    start = Start(first.motor[settled], speed, speed, first.demand[settled])
    again = simulate(machine, SERVO, setpoints.part(slice(settled, None)), start=start)
    assert np.abs(again.motor - first.motor[settled:]).max() < 1e-3


def test_the_compiled_loop_leaves_such_a_run_to_mujoco():
    setpoints = Setpoints(1e-3, ("x", "y"), np.zeros((50, 2)), np.zeros(50, bool), NO_PATH)
    start = Start(np.array([0.5, 0.0]), np.array([10.0, 0.0]), np.zeros(2), np.zeros(2))
    loop, mujoco = (simulate(MACHINE, SERVO, setpoints, start=start, engine=engine) for engine in ("loop", "mujoco"))
    np.testing.assert_array_equal(loop.motor, mujoco.motor)
    assert loop.motor[0, 0] == pytest.approx(0.5)
    # against a servo that pulls it back
    assert loop.motor[1, 0] > 0.503
