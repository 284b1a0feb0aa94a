"""A user's own law in plain Python."""

import mujoco
import numpy as np
import pytest

from gantrysim import GantryError, InputError, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.servo.laws.user import Tick

from support.runs import PERIOD, plain, ramp


def pd_in_python(servo):
    before = {}

    def law(tick: Tick):
        error = np.subtract(tick.commanded, tick.measured)
        change = (error - before.get("error", error)) / servo.period
        before["error"] = error
        return (
            np.array(servo.per_axis("kp")) * error
            + np.array(servo.per_axis("ki")) * 0.0
            + np.array(servo.per_axis("kd")) * change
            + np.array(servo.per_axis("velocity_ff")) * tick.demand_velocity
            + np.array(servo.per_axis("acceleration_ff")) * tick.demand_acceleration
            + np.array(servo.per_axis("output_velocity")) * tick.measured_velocity
        )

    return law


def test_a_law_in_plain_python_runs_through_the_same_tick(xy):
    servo = Servo.derive(xy.axes, notch_frequency=0.0)
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(PERIOD)
    compiled = simulate(xy, servo, setpoints)
    plain_law = simulate(xy, servo, setpoints, law=pd_in_python(servo))
    np.testing.assert_allclose(plain_law.demand, compiled.demand, rtol=0, atol=1e-11)
    np.testing.assert_allclose(plain_law.encoder, compiled.encoder, rtol=0, atol=1e-9)


def test_an_exception_in_a_plain_law_reaches_the_caller(xy):
    setpoints = MoveSpiral(60, 1, 10, 100).setpoints(PERIOD)

    def broken(tick):
        raise ZeroDivisionError("gain of nothing")

    with pytest.raises(ZeroDivisionError, match="gain of nothing"):
        simulate(xy, Servo.derive(xy.axes), setpoints, law=broken)
    with pytest.raises(InputError, match="must be 2 finite torques"):
        simulate(xy, Servo.derive(xy.axes), setpoints, law=lambda tick: [0.0])


def test_nested_runs_in_a_law_are_refused_and_a_law_may_step_other_models(rigid):
    machine = rigid()
    servo = plain(machine)
    other = machine.stepping(5e-4)
    state = mujoco.MjData(other)

    def nested(tick):
        simulate(machine, servo, ramp(50.0))

    with pytest.raises(GantryError, match="cannot run a simulation: it is inside one"):
        simulate(machine, servo, ramp(50.0), law=nested)
    with pytest.raises(GantryError, match="cannot run inside another simulation"):
        simulate(
            machine, servo, ramp(50.0), progress=lambda _: simulate(machine, servo, ramp(50.0), law=lambda t: [0, 0])
        )

    def stepping(tick):
        mujoco.mj_step(other, state)
        return 0.0 * tick.error

    alone = simulate(machine, servo, ramp(5.0, 1.0), law=lambda tick: 0.0 * tick.error)
    beside = simulate(machine, servo, ramp(5.0, 1.0), law=stepping)
    np.testing.assert_array_equal(alone.nozzle, beside.nozzle)


def test_an_interrupt_in_a_law_reaches_the_caller(rigid):
    machine = rigid()

    def interrupted(tick):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(machine, plain(machine), ramp(50.0), law=interrupted)
