"""Runs step a model without the stops of the axes until one is reached, and move as with the stops throughout."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gantrysim import Machine, Servo
from gantrysim.base.errors import GantryError
from gantrysim.engine.advance import Stepper
from gantrysim.engine.places import MuJoCoPlaces
from gantrysim.engine.simulation import Simulation
from gantrysim.machine.row import IN_MODEL, MISSED, NOT_IN_MODEL
from gantrysim.machine.travel import has_no_constraints_but_stops
from gantrysim.record.setpoints import Setpoints

from support.own_laws import lagged_pid
from support.runs import PERIOD, ramp

RECORDED = ("encoder", "motor", "nozzle", "demand", "current", "voltage")
SERVOS = {
    "plain": {},
    "laws with a state": {"law": ["pid", "friction", "observer"]},
    "drives with a state": {"feedback_delay": 1},
}


def beside_the_stop(machine, **servo):
    """A move at 80 mm/s to 0.002 mm before the end of x's travel, under a servo that overshoots."""
    end = machine.axes[0].travel[1] - 0.002
    x = np.minimum(end - 16.0 + 0.08 * np.arange(300), end)
    position = np.stack([x, np.zeros(300)], axis=1)
    derived = Servo.derive(machine.axes, PERIOD, **servo)
    soft = derived.with_values(kd=tuple(0.5 * gain for gain in derived.per_axis("kd")))
    return soft, Setpoints(PERIOD, ("x", "y"), position, np.zeros(300, bool), ramp(50.0).requested)


def with_stops(simulation):
    """The same simulation on the model with its stops from the first step on."""
    other = Simulation.of(simulation.machine, simulation.servo, simulation.setpoints)
    return replace(other, stops=True)


def stepped(simulation, chunk=None):
    stepper = Stepper(simulation)
    while not stepper.run.done:
        stepper.advance(chunk)
    return stepper


def assert_equal(record, other):
    assert str(record.fault) == str(other.fault)
    for name in RECORDED:
        np.testing.assert_array_equal(getattr(record, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("servo", SERVOS.values(), ids=SERVOS)
def test_a_run_that_reaches_a_stop_equals_one_with_the_stops_throughout(xy, servo):
    simulation = Simulation.of(xy, *beside_the_stop(xy, **servo))
    assert not simulation.stops
    free = stepped(simulation, chunk=97)
    full = stepped(with_stops(simulation), chunk=97)
    assert free.run.record().motor[:, 0].max() > xy.axes[0].travel[1], "x is to reach its stop"
    assert free.run.row["stops"] == IN_MODEL
    assert_equal(free.run.record(), full.run.record())
    np.testing.assert_array_equal(free.data.qpos, full.data.qpos)


def test_without_the_stops_the_same_run_would_be_another(xy):
    """Or else this file would compare nothing."""
    simulation = Simulation.of(xy, *beside_the_stop(xy))
    wrong = Stepper(simulation)
    wrong.run.row["stop_high"][:2] = np.inf  # nobody looks
    wrong.advance()
    assert wrong.run.row["stops"] == NOT_IN_MODEL
    assert not np.array_equal(wrong.run.record().motor, stepped(simulation).run.record().motor)


def test_places_of_a_batch_that_reach_a_stop_are_stepped_again_alone(xy):
    servo, setpoints = beside_the_stop(xy)
    away = replace(setpoints, position=setpoints.position - np.array([30.0, 0.0]))
    simulations = [Simulation.of(xy, servo, each) for each in (away, setpoints, away)]
    batch = MuJoCoPlaces(xy, 3)
    batch.load(dict(enumerate(simulations)))
    for _ in range(13):
        batch.advance(steps=100)  # the short way, without a look at each run
    assert batch.field("stops").tolist() == [NOT_IN_MODEL, IN_MODEL, NOT_IN_MODEL]
    for place, each in enumerate((away, setpoints, away)):
        full = stepped(with_stops(Simulation.of(xy, servo, each)))
        assert_equal(batch.runs[place].record(), full.run.record())
    batch.load({1: Simulation.of(xy, servo, away)})  # another run at this place is without stops again
    batch.advance([1])
    assert_equal(batch.runs[1].record(), batch.runs[0].record())


def test_a_saved_moment_beside_a_stop_goes_on_with_it(xy):
    servo, setpoints = beside_the_stop(xy)
    batch = MuJoCoPlaces(xy, 2)
    batch.load({0: Simulation.of(xy, servo, setpoints)})
    while batch.field("stops")[0] == NOT_IN_MODEL:
        batch.advance([0], steps=20)
    moment = batch.moment(0)
    batch.advance([0])
    batch.resume(1, Simulation.of(xy, servo, setpoints), moment)
    batch.advance([1])
    assert_equal(batch.runs[1].record(), batch.runs[0].record())


@pytest.mark.parametrize("name", [*SERVOS, "a user's law with a state"])
def test_a_saved_moment_goes_on_with_the_state_of_drives_and_laws(xy, name):
    """In motion, where errors of the last ticks, an integral and a lag are what the next torque depends on."""
    derived = Servo.derive(xy.axes, PERIOD, **SERVOS.get(name, {"law": "pd", "notch_frequency": 0.0}))
    servo = derived if name in SERVOS else derived.with_values(law=(lagged_pid,))
    batch = MuJoCoPlaces(xy, 2)
    batch.load({0: Simulation.of(xy, servo, ramp(50.0))})
    batch.advance([0], steps=150)
    moment = batch.moment(0)
    batch.advance([0])
    batch.resume(1, Simulation.of(xy, servo, ramp(50.0)), moment)
    batch.advance([1])
    assert_equal(batch.runs[1].record(), batch.runs[0].record())


def test_a_run_that_was_left_beyond_a_missed_stop_does_not_go_on(xy):
    stepper = Stepper(Simulation.of(xy, *beside_the_stop(xy)))
    stepper.run.row["stops"] = MISSED
    with pytest.raises(GantryError, match="rewound from a stop: start it again"):
        stepper.advance(10)


def test_a_law_in_plain_python_has_the_stops_from_its_first_step(xy):
    stepper = Stepper(Simulation.of(xy, *beside_the_stop(xy)))
    stepper.advance(10, law=lambda tick: 0.0 * tick.error)
    assert stepper.run.row["stops"] == IN_MODEL


@pytest.mark.parametrize("name", ["xy", "xyz", "xyzr", "stage", "delta"])
def test_only_stops_of_axes_may_be_left_out(name):
    model = Machine(name).physics
    assert has_no_constraints_but_stops(model) == (name != "delta")  # whose arms are tied to its platform


@pytest.mark.parametrize(
    "change",
    [
        lambda spec: setattr(spec.joint("x_flex"), "range", [-1e-3, 1e-3]),
        lambda spec: setattr(spec.joint("y"), "frictionloss", 1.0),
        lambda spec: spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1="x_flex"),
    ],
    ids=["limit of a spring", "dry friction", "equality"],
)
def test_other_constraints_keep_the_stops_in_the_model(xy, change):
    machine = xy.edited(change)
    servo, setpoints = beside_the_stop(machine)
    assert Simulation.of(machine, servo, setpoints).stops
