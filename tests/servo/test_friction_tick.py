"""A tick of friction compensation, interpreted: the equation of LuGre's friction for each axis by itself."""

import math
from types import SimpleNamespace

import pytest

from gantrysim.servo.laws.friction import tick

PERIOD = 2e-3


def law(torque, static=0.0, speed=0.0, stiffness=0.0, now=0.0):
    return SimpleNamespace(
        friction_torque=torque,
        friction_static=static,
        friction_speed=speed,
        friction_stiffness=stiffness,
        friction_now=now,
    )


def ticked(laws, velocities):
    row = SimpleNamespace(
        axes=len(laws),
        period=PERIOD,
        demand_velocity=list(velocities),
        compensation=[math.nan] * len(laws),
        feedforward=[1.0] * len(laws),
    )
    tick(row, laws)
    return row


def test_the_torque_nears_its_level_with_the_travel_of_the_tick():
    """From -0.03 N·m towards G at 4 mm/s: G = 0.05 + 0.02 e^-(4/8)², over a travel of 8 µm."""
    level = 0.05 + 0.02 * math.exp(-0.25)
    expected = level + (-0.03 - level) * math.exp(-20.0 * 4.0 * PERIOD / level)
    laws = [law(0.05, 0.07, 8.0, 20.0, -0.03), law(0.02, now=0.1), law(0.0, now=0.004)]
    row = ticked(laws, (4.0, -3.0, 5.0))
    # the second has no bristles, the third no friction, and stays
    assert row.compensation == [pytest.approx(expected), -0.02, 0.004]
    assert row.feedforward == [pytest.approx(1 + expected), pytest.approx(0.98), pytest.approx(1.004)]
    assert [one.friction_now for one in laws] == row.compensation


def test_at_rest_the_bristles_stay_bent():
    row = ticked([law(0.05, 0.07, 8.0, 20.0, -0.03)], (0.0,))
    assert (row.compensation, row.feedforward) == ([-0.03], [pytest.approx(0.97)])


def test_a_reversal_is_half_done_after_the_travel_of_its_stiffness():
    """Without Stribeck's part, F = G (1 - 2 e^(-k x / G)) after a reversal: zero at x = G ln 2 / k, in 50 ticks."""
    velocity = 0.05 * math.log(2) / 20.0 / (50 * PERIOD)
    one = law(0.05, 0.05, 0.0, 20.0, -0.05)
    for _ in range(50):
        ticked([one], (velocity,))
    assert one.friction_now == pytest.approx(0.0, abs=1e-12)


def test_friction_falls_with_the_speed_until_its_exponential_is_zero():
    """G = 1e308 e^-(27)² N·m at 27 times the Stribeck speed; at 28 times e^-(28)² is 0, and nothing changes."""
    row = ticked([law(1e-320, 1e308, 1.0), law(1e-320, 1e308, 1.0, now=0.25)], (27.0, -28.0))
    assert row.compensation == [pytest.approx(1e308 * math.exp(-729.0), rel=1e-12), pytest.approx(0.0, abs=1e-300)]
