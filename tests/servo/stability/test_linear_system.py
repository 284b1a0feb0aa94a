"""Transfer functions of small systems against closed forms and against an inverse of their matrices."""

import numpy as np
import pytest

from gantrysim.servo.stability.linear_system import Compensator, transfer

Z = np.exp(1j * np.geomspace(1e-4, np.pi, 40))


def test_integrators_and_a_delay_in_closed_form():
    """A torque that takes effect half a period late moves a mass: T^2/8 (1 + 6/z + 1/z^2) / (1 - 1/z)^2 / z."""
    period = 1e-3
    late = 0.5 * period
    # position and speed; the demand before acts for the first half, the present one for the second
    motion = np.array([[1.0, period], [0.0, 1.0]])
    before = np.array([[0.5 * late**2 + late * late], [late]])
    present = np.array([[0.5 * late**2], [late]])
    expected = period**2 / 8 * (1 + 6 / Z + 1 / Z**2) / (Z * (1 - 1 / Z) ** 2)
    found = transfer(Z, motion, (before, present), np.array([[1.0, 0.0]]))
    assert found[:, 0, 0] == pytest.approx(expected, rel=1e-9)


def test_a_pid_law_in_closed_form():
    kp = 3.0
    ki = 40.0
    kd = 0.02
    period = 1e-3
    expected = kp + ki * period / (1 - 1 / Z) + kd / period * (1 - 1 / Z)
    assert Compensator.pid(kp, ki, kd, period).response(Z) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("states", "inputs", "outputs"), [(1, 1, 1), (5, 1, 1), (7, 3, 2)])
def test_systems_of_any_size_against_the_inverse_of_their_matrices(states, inputs, outputs):
    """Among the points one at which the first pivot is zero."""
    rng = np.random.default_rng(5)
    motion = rng.normal(size=(states, states))
    late, prompt = rng.normal(size=(2, states, inputs))
    positions = rng.normal(size=(outputs, states))
    z = np.append(Z, motion[0, 0]) if states > 1 else Z
    found = transfer(z, motion, (late, prompt), positions)
    for value, point in zip(found, z, strict=True):
        expected = positions @ np.linalg.inv(point * np.eye(states) - motion) @ (prompt + late / point)
        assert value == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_pole_has_no_value():
    one = np.ones((1, 1))
    with pytest.raises(ZeroDivisionError):
        transfer(np.ones(1, complex), one, (one, one), one)


@pytest.mark.parametrize("states", [1, 2, 4, 7])
def test_a_law_with_a_triangle_of_states(states):
    rng = np.random.default_rng(states)
    law = Compensator(rng.normal(size=(states, states)), *rng.normal(size=(2, states)), float(rng.normal()))
    motion, enter, leave = law.triangle
    assert not np.tril(motion, -1).any()
    expected = [law.C @ np.linalg.solve(z * np.eye(states) - law.A, law.B) + law.D for z in Z]
    found = [leave @ np.linalg.solve((z - 1) * np.eye(states) - motion, enter) + law.D for z in Z]
    assert found == pytest.approx(expected, rel=1e-9)
