"""Derived gains and the law itself."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Servo
from gantrysim.servo.derivation import natural_frequency
from gantrysim.servo.gains import GAIN_NAMES, Gains
from gantrysim.servo.laws.pid import torque_demand as law


@dataclass(frozen=True)
class Plant:
    name: str = "x"
    inertia: float = 2e-5
    viscous: float = 3e-5
    lag: float = 3e-4
    peak_torque: float = 0.9
    resolution: float = 1e-3
    motion: None = None
    chain: None = None
    coupled: None = None
    mode: str = "torque"


def margin(frequency, damping, lag):
    """Phase margin of (2 zeta w s + w^2) / s^2 e^(-s lag) by looking for the crossover on a fine grid [deg]."""
    w0 = 2 * math.pi * frequency
    w = w0 * np.logspace(-1, 1.5, 400_001)
    loop = (2 * damping * w0 * 1j * w + w0**2) / (1j * w) ** 2
    crossover = int(np.argmin(np.abs(np.abs(loop) - 1)))
    return 180 + math.degrees(np.angle(loop[crossover])) - math.degrees(w[crossover] * lag)


@given(st.floats(0.5, 3.0), st.floats(1e-4, 0.1))
def test_natural_frequency_keeps_its_share_of_the_phase_margin(damping, lag):
    frequency = natural_frequency(lag, damping, 0.6)
    assert margin(frequency, damping, lag) == pytest.approx(0.6 * margin(frequency, damping, 0.0), abs=0.01)


def test_the_default_leaves_fifty_degrees_to_a_loop_of_critical_damping():
    assert margin(natural_frequency(1e-3, 1.0), 1.0, 1e-3) == pytest.approx(50.9, abs=0.1)


def test_delay_and_lag_and_period_all_slow_the_loop_down():
    base = Servo.derive([Plant()], 1e-3).gains[0].kp
    assert Servo.derive([Plant()], 1e-3, delay=5e-4).gains[0].kp == pytest.approx(base * (1.3 / 1.8) ** 2)
    assert Servo.derive([Plant(lag=8e-4)], 1e-3).gains[0].kp == pytest.approx(base * (1.3 / 1.8) ** 2)


@given(st.floats(1.0, 100.0), st.floats(0.1, 3.0), st.floats(1e-6, 1e-2))
def test_gains_place_the_poles_of_the_continuous_loop(frequency, damping, inertia):
    servo = Servo.derive([Plant(inertia=inertia)], 1e-3, frequency=frequency, damping=damping)
    # J s^2 + kd s + kp, with the torque that the axis' own mass needs
    poles = np.roots([inertia, servo.gains[0].kd, servo.gains[0].kp])
    w = 2 * math.pi * frequency
    assert np.abs(poles.prod()) ** 0.5 == pytest.approx(w)
    assert -poles.sum().real / (2 * w) == pytest.approx(damping)


def test_all_axes_get_one_frequency_and_their_own_inertia():
    servo = Servo.derive([Plant(lag=1e-4), Plant("y", inertia=5e-5, lag=9e-4)])
    assert servo.gains[1].kp / servo.gains[0].kp == pytest.approx(2.5)
    assert servo.gains[1].kd / servo.gains[0].kd == pytest.approx(2.5)
    assert servo.gains[0].kp / 2e-5 == pytest.approx((2 * math.pi * natural_frequency(9e-4 + 1e-3, 1.0)) ** 2)


def test_feed_forward_is_the_inverse_of_the_axis_and_the_rest_comes_from_it():
    servo = Servo.derive([Plant()], feedforward=0.5, integral_time=0.1)
    assert servo.per_axis("velocity_ff") == (pytest.approx(1.5e-5),)
    assert servo.per_axis("acceleration_ff") == (pytest.approx(1e-5),)
    assert servo.gains[0].ki == pytest.approx(servo.gains[0].kp / 0.1)
    assert servo.per_axis("torque_limit") == (0.9,)
    assert servo.per_axis("resolution") == (1e-3,)
    assert servo.per_axis("output_velocity") == (0.0,)


def test_given_gains_are_kept():
    servo = Servo.derive([Plant(), Plant("y")], kp=[1.0, 2.0], kd=0.25)
    assert servo.per_axis("kp") == (1.0, 2.0)
    assert servo.per_axis("kd") == (0.25, 0.25)


def test_slower_servos_get_slower_loops():
    kp = [Servo.derive([Plant()], period).gains[0].kp for period in (2.5e-4, 1e-3, 8e-3)]
    assert kp[0] > kp[1] > kp[2]


floats = st.floats(-1e3, 1e3)


six = st.lists(floats, min_size=6, max_size=6)


@given(six, st.builds(Gains, *(floats for _ in GAIN_NAMES)), six, floats)
def test_law_is_linear_in_the_measured_quantities(measured, gains, other, factor):
    total = law(*[a + factor * b for a, b in zip(measured, other, strict=True)], gains)
    parts = law(*measured, gains) + factor * law(*other, gains)
    assert total == pytest.approx(parts, rel=1e-9, abs=1e-3)


def test_each_term_of_the_law_has_its_own_gain():
    units = np.eye(6)
    for i in range(6):
        for j in range(6):
            assert law(*units[i], Gains(*units[j])) == (1.0 if i == j else 0.0)


BAD = {
    "period": ({"period": 0.0}, "servo period = 0 s: must be greater than 0 s"),
    "damping": ({"damping": -1.0}, "damping = -1: must be 0.001 to 1000"),
    "frequency": ({"frequency": math.nan}, "frequency = nan Hz: must be finite"),
    "integral": ({"integral_time": 0.0}, "integral_time = 0 s: must be greater than 0 s; inf"),
    "integral of a large whole number": ({"integral_time": 10**400}, "integral_time: must be finite"),
    "width without a loop": ({"velocity_bandwidth": "wide"}, "velocity_bandwidth = 'wide': must be a number"),
    "delay": ({"delay": 2e-3}, "servo delay = 0.002 s: must be at most the period, 0.001 s"),
    "feedback delay": ({"feedback_delay": 1.5}, "feedback_delay = 1.5: must be a whole number"),
    "long feedback delay": ({"feedback_delay": 10**6}, "feedback_delay = 1e[+]06: must be 0 to "),
    "per axis": ({"kp": [1.0, 2.0, 3.0]}, "kp has 3 values: must be one or 1, one per axis"),
    "gain": ({"kd": math.inf}, "kd = inf: must be finite"),
    "torque": ({"torque_limit": 0.0}, "torque_limit = 0 N·m: must be greater than 0 N·m"),
    "encoder": ({"resolution": -1e-3}, "encoder resolution = -0.001 mm: must be at least 0 mm"),
    # a current loop faster than the physics, and a seed that a table's number does not hold exactly
    "current loop": ({"current_bandwidth": 1.01e5}, "current_bandwidth = 101000 Hz: must be 0 to 100000 Hz"),
    "seed": ({"encoder_seed": 2**54}, r"encoder_seed = 1\.80144e\+16: must be at most 9\.0072e\+15"),
    "no mode": ({"mode": "fast"}, "servo mode = 'fast': must be one of 'torque', 'velocity', 'position', 'stepper'"),
    "no feedback": ({"feedback": "both"}, "servo feedback = 'both': must be one of 'motor', 'load', 'none'"),
    "following": ({"following_error_limit": -1.0}, "following_error_limit = -1: must be greater than 0"),
}


@pytest.mark.parametrize(("change", "text"), BAD.values(), ids=BAD.keys())
def test_bad_servos_are_refused(change, text):
    with pytest.raises(InputError, match=text):
        Servo.derive([Plant()], **{"period": 1e-3, **change})


@pytest.mark.parametrize(
    "name", ["period", "delay", "feedback delay", "long feedback delay", "gain", "torque", "encoder"]
)
def test_a_servo_that_is_changed_is_checked_again(name):
    change, text = BAD[name]
    with pytest.raises(InputError, match=text):
        Servo.derive([Plant()], 1e-3).with_values(**change)


def test_values_are_converted_and_lists_are_checked_as_tuples_are():
    servo = Servo.derive([Plant()], kp=np.int64(2), resolution=np.float32(0.5))
    assert servo.per_axis("kp") == (2.0,)
    assert isinstance(servo.gains[0].kp, float)
    widest = servo.with_values(current_bandwidth=1e5, encoder_seed=2**53)
    assert (widest.per_axis("current_bandwidth"), widest.encoder_seed) == ((1e5,), 2**53)
    with pytest.raises(InputError, match="kd = nan: must be finite"):
        servo.with_values(kd=[math.nan])
    with pytest.raises(InputError, match="ki has 2 values: must be one or 1, one per axis"):
        servo.with_values(ki=[0.0, 0.0])
    with pytest.raises(InputError, match="at least one axis"):
        Servo.derive([])


def test_a_gain_that_does_not_exist_is_a_type_error():
    with pytest.raises(TypeError, match=r"^Servo.derive: unknown keyword 'kq': did you mean k[pid]"):
        Servo.derive([Plant()], kq=1.0)
    with pytest.raises(TypeError, match=r"^Servo.with_values: unknown keyword 'kq': did you mean k[pid]"):
        Servo.derive([Plant()]).with_values(kq=1.0)
