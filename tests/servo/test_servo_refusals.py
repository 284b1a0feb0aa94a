"""Settings of a servo that contradict each other are refused with their value and what would do."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gantrysim import InputError, Servo
from gantrysim.servo import notch
from gantrysim.servo.drive_settings import DriveSettings
from gantrysim.servo.gains import Gains
from gantrysim.servo.notch import Notch
from gantrysim.servo.request import check_drive_period
from gantrysim.servo.stability.margins import Plant
from gantrysim.servo.stability.motion import Drives, Motion

PERIOD = 1e-3
PLAIN = Gains(kp=2.0, kd=0.02)
OF_VELOCITY = Gains(kp=20.0)


def servo(gains=PLAIN, axes=1, limits=None, **values):
    drive = DriveSettings(**{name: values.pop(name) for name in list(values) if name in DriveSettings._fields})
    limits = (5.0,) * axes if limits is None else limits
    given = {"period": PERIOD, "gains": (gains,) * axes, "drives": (drive,) * axes, "following_error_limit": limits}
    return Servo(**(given | values))


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"interpolation_error": 2e-4}, "signal_period = 0 mm: must be greater than 0 mm where there is"),
        ({"interpolation_error_twice": 3e-4}, "interpolation error, which is 0.0003 mm"),
        ({"feedback": "none"}, "servo feedback = 'none': a drive in mode 'torque' needs it"),
        ({"mode": "stepper", "feedback": "none"}, "kp = 2 in mode 'stepper': must be 0, nothing is fed back"),
        ({"velocity_gain": 0.5}, "velocity_gain = 0.5 N·m·s/mm in mode 'torque': must be 0, only for mode 'velocity'"),
        ({"mode": "velocity"}, "velocity_gain = 0 N·m·s/mm in mode 'velocity': must be greater than 0"),
        ({"limits": (5.0, 5.0)}, "following_error_limit has 2 values: must be 1, one per axis"),
        ({"drives": (DriveSettings(),) * 3}, "drives has 3 values: must be 1, one per axis"),
        ({"notches": (Notch(),) * 2}, "notches has 2 values: must be 1, one per axis"),
        ({"axes": 0}, "gains has 0 values: must be one per axis, at least one"),
    ],
)
def test_values_that_contradict_each_other_are_refused(values, sentence):
    with pytest.raises(InputError) as caught:
        servo(**values)
    assert sentence in str(caught.value)


def test_what_goes_together_is_taken():
    assert servo(interpolation_error=2e-4, signal_period=0.02).per_axis("signal_period") == (0.02,)
    assert servo(axes=2, notches=(Notch(),) * 2).axes == 2
    assert servo(gains=OF_VELOCITY, mode="velocity", velocity_gain=0.5).modes == ("velocity",)


@pytest.mark.parametrize(("ratio", "whole"), [(4.0, True), (1.0, True), (3.7, False), (0.5, False)])
def test_loops_of_drives_run_a_whole_number_of_times_in_a_period(ratio, whole):
    period = PERIOD / ratio
    check_drive_period(period, PERIOD, ["torque"])
    if whole:
        check_drive_period(period, PERIOD, ["torque", "velocity"])
        return
    with pytest.raises(InputError, match=f"drive_period = {period:g} s: must be a whole fraction of .*, 0.001 s"):
        check_drive_period(period, PERIOD, ["torque", "velocity"])


def test_a_value_that_no_axis_has_is_refused_with_the_nearest_one():
    with pytest.raises(InputError, match=r"kpp: .*value of the servo.*kp|value of the servo 'kpp'.*kp"):
        servo().per_axis("kpp")


@pytest.mark.parametrize(("frequency", "width", "depth"), [(80.0, 0.5, 0.1), (200.0, 1.2, 0.0)])
def test_the_delay_of_a_notch_is_the_slope_of_its_phase_at_zero(frequency, width, depth):
    """(s² + 2 d b w s + w²) / (s² + 2 b w s + w²), at a thousandth of its frequency."""
    w0 = 2 * math.pi * frequency
    s = 1e-3 * w0 * 1j
    answer = (s**2 + 2 * depth * width * w0 * s + w0**2) / (s**2 + 2 * width * w0 * s + w0**2)
    slope = -math.atan2(answer.imag, answer.real) / abs(s)
    assert notch.lag(frequency, width, depth) == pytest.approx(slope, rel=1e-4)
    assert notch.lag(notch.NONE, width, depth) == 0


def test_plain_drives_have_no_loop_noise_or_delay():
    assert servo().plain
    assert not servo(feedback_delay=1).plain
    assert not servo(encoder_noise=1e-3).plain
    assert not servo(current_bandwidth=500.0).plain


# two masses that nothing joins, or the torque of each of which moves the other
APART = Motion(
    A=np.kron(np.eye(2), [[0.0, 1.0], [0.0, 0.0]]),
    B=np.kron(np.eye(2), [[0.0], [1.0]]),
    C=np.kron(np.eye(2), [1.0, 0.0]),
    L=None,
)
JOINED = replace(APART, B=np.array([[0.0, 0.0], [1.0, 0.2], [0.0, 0.0], [0.2, 1.0]]))


@pytest.mark.parametrize(
    ("motion", "drives", "sentence"),
    [
        (APART, Drives(bandwidth=(0.0, 300.0)), "current_bandwidth of axis 2 = 300 Hz: its motor has no inductance"),
        (APART, Drives(load=(True, False)), "servo feedback of axis 1 = 'load': the machine has no single spring"),
        (
            JOINED,
            Drives(mode=("torque", "velocity")),
            "axes 1, 2 move each other: must have one mode, not 'torque' and",
        ),
    ],
)
def test_a_drive_needs_what_its_loop_stands_on(motion, drives, sentence):
    with pytest.raises(InputError) as caught:
        Plant(motion, PERIOD, drives=drives)
    assert sentence in str(caught.value)


def test_axes_that_do_not_move_each_other_have_modes_of_their_own():
    modes = Drives(mode=("torque", "stepper"))
    assert Plant(APART, PERIOD, drives=modes).groups == ((0,),)
    assert Plant(JOINED, PERIOD).groups == ((0, 1),)
