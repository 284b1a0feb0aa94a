"""The cost of gains beyond the tuner's limit of |S|, against the loop's response on a dense grid, and its extremes."""

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Machine
from gantrysim.env.sensitivity import SensitivityTable
from gantrysim.servo.servo import Servo

from support.costs import expected_cost
from support.episodes import BANDIT, SHORT, TUNING
from support.soaked import examples

RANGE = 4.0


def relay(tick, _state, torque):
    """A law that is not linear."""
    torque[:] = 0.02 * np.sign(tick.error)


@pytest.fixture(scope="module")
def machine():
    return Machine("xy")


@pytest.fixture(scope="module")
def servo(machine):
    return Servo.derive(machine.axes, integral_time=0.03)


@pytest.fixture(scope="module")
def table(machine, servo):
    return SensitivityTable(machine, servo, RANGE)


@given(kp=st.integers(-16, 16), kd=st.integers(-16, 16), off=st.floats(-0.03, 0.03), feed=st.floats(-1, 1))
@examples(25)
def test_the_cost_is_that_of_the_loops_on_a_dense_grid(machine, servo, table, kp, kd, off, feed):
    action = np.array([[kp / 16 + off], [kd / 16 - off], [feed], [-feed]])
    exact = expected_cost(machine, servo, RANGE ** (kp / 16), RANGE ** (kd / 16))
    assert table.cost(action[None]) == pytest.approx(exact, abs=1e-3)


def test_each_axis_counts_with_its_own_gains(machine, servo, table):
    actions = np.zeros((3, 4, 2))
    actions[[1, 2], 0, [0, 1]] = 1.0  # kp of x, kp of y
    cost = table.cost(actions)
    assert cost[0] == pytest.approx(0.0, abs=1e-6)  # derived gains keep the limit
    for axis in (0, 1):
        kp = np.where(np.arange(2) == axis, RANGE, 1.0)
        assert cost[1 + axis] == pytest.approx(expected_cost(machine, servo, kp, np.ones(2)), abs=1e-3)
        assert cost[1 + axis] > 0.1


def test_gains_common_to_all_axes_cost_what_they_cost_axis_by_axis_however_often_they_are_asked_for(machine, servo):
    table = SensitivityTable(machine, servo, RANGE)
    kp, kd = np.meshgrid([-1.0, 0.25, 1.0], [-1.0, 0.0, 0.25, 1.0])
    actions = np.stack([kp, kd, 0 * kp, 0 * kp], axis=-1).reshape(-1, 4, 1)
    swapped = actions[:, [1, 0, 2, 3]]
    beyond = np.concatenate([actions, 1.25 * actions])
    assert len(set(table.cost(actions))) > 3
    for asked in (actions, swapped, actions[::-1], swapped[:4], beyond):
        assert np.array_equal(table.cost(asked), table.cost(np.repeat(asked, 2, axis=2)))


@pytest.mark.parametrize("name", [TUNING, BANDIT])
def test_an_environment_tells_the_cost_of_its_gains_also_where_it_faults(name):
    env = gymnasium.make(name, **SHORT)
    costs = []
    for action in ([0, 0, 0, 0], [1, -1, 0, 0], [-1, -1, 1, 1]):
        env.reset(seed=1)
        *_, info = env.step(np.array(action, np.float32))
        costs.append(info["cost"])
        assert np.isfinite(info["cost"])
        if info["fault"] is not None:
            assert info["cost"] == 1.0
    assert costs[:2] == [pytest.approx(0.0, abs=1e-6), 1.0]


def test_a_loop_that_cannot_be_linearised_costs_nothing():
    env = gymnasium.make(TUNING, **SHORT, servo={"law": f"{__name__}:relay"})
    env.reset(seed=1)
    assert env.step(np.zeros(4, np.float32))[4]["cost"] == 0.0
