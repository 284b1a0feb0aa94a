"""The edge of the margin: against a grid of shapes, and margins computed by themselves."""

import numpy as np
import pytest

from gantrysim import Machine, Servo
from gantrysim.servo.stability.margins import margins_of
from gantrysim.study.tuning.search import MarginEdge
from gantrysim.study.tuning.space import SearchSpace
from gantrysim.study.tuning.stability import Fastest, Stability

PERIOD = 1e-3
XY = Machine("xy")
DERIVED = Servo.derive(XY.axes, PERIOD)
OF_GRID = 0.99  # least ratio of the gain to the best of a grid


@pytest.fixture(scope="module")
def stability():
    return Stability([XY], PERIOD, 0.0, 2.0)


def edge(stability, law="pid", per_axis=False):
    return MarginEdge(SearchSpace(law, XY.axes, DERIVED, DERIVED, per_axis), stability)


def gain(servo, names):
    return float(np.prod([servo.per_axis(name)[0] for name in names]))


@pytest.mark.parametrize(("law", "names"), [("pid", ("kp", "ki")), ("pd", ("kp",))])
def test_the_stiffest_shape_has_the_gain_of_the_best_of_a_grid_and_keeps_the_margin(stability, law, names):
    searched = edge(stability, law)
    space = searched.space
    shape = searched.stiffest()
    servo = space.servo(searched.fastest(shape).frequencies, shape)
    assert max(margins.sensitivity for margins in margins_of(XY, servo)) <= 2.0 * (1 + 1e-3)
    known = len(searched._shapes)
    assert 5 < known < 80
    np.testing.assert_array_equal(shape[-2:], [1.0, 1.0])
    best = 0.0
    for n in np.linspace(-0.6, -1.0, 5) if law == "pid" else [None]:
        for zeta in np.linspace(-0.15, 0.1, 6):
            trial = np.array([zeta, 1.0, 1.0] if n is None else [zeta, n, 1.0, 1.0])
            fastest = searched.fastest(trial)
            if fastest.excess <= 0:
                best = max(best, gain(space.servo(fastest.frequencies, trial), names))
    assert gain(servo, names) >= OF_GRID * best
    assert gain(servo, names) > 1.05 * gain(
        space.servo(searched.fastest(space.natural).frequencies, space.natural), names
    )


@pytest.mark.soak
def test_the_stiffest_shape_is_the_same_for_all_axes(stability):
    shared = edge(stability).stiffest()
    separate = edge(stability, per_axis=True).stiffest()
    np.testing.assert_array_equal(separate[::2], separate[1::2])
    np.testing.assert_allclose(separate[::2], shared, atol=0.1)  # the gain is flat there


def test_a_narrow_band_of_frequencies_is_found_from_a_shape_beside_it(stability):
    searched = edge(stability)
    tip = np.array([0.018, -0.885, 1.0, 1.0])
    natural = searched.space.natural
    assert stability.fastest(searched.space, tip, Fastest(np.zeros(1))).excess > 0  # from afar it is missed
    for share in np.linspace(0.0, 1.0, 21):
        fastest = searched.fastest(natural + share * (tip - natural))
    assert fastest.excess <= 0
    servo = searched.space.servo(fastest.frequencies, tip)
    assert max(margins.sensitivity for margins in margins_of(XY, servo)) <= 2.0 * (1 + 1e-3)


def test_feed_forwards_cost_no_margins(stability, monkeypatch):
    searched = edge(stability)
    first = searched.fastest(np.array([0.0, -0.3, 1.0, 1.0]))

    def computed(*arguments):
        raise AssertionError

    monkeypatch.setattr(stability, "fastest", computed)
    assert searched.fastest(np.array([0.0, -0.3, 0.0, 2.0])) is first
