"""Torques that are sent with the setpoints, beside the equation of motion of a rigid machine."""

import numpy as np
import pytest

from gantrysim import Servo
from gantrysim.servo.inverse import Inverse

PERIOD = 1e-3


def rest_to_rest(distance, duration):
    """A polynomial without jerk at its ends, (ticks, 4): position and its three derivatives."""
    time = np.arange(round(duration / PERIOD) + 1) * PERIOD
    shape = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20]) * distance
    moved = np.stack([shape.deriv(k)(time / duration) / duration**k for k in range(4)], axis=1)
    before = np.zeros((200, 4))
    after = np.zeros((200, 4))
    after[:, 0] = distance
    return np.concatenate([before, moved, after])


@pytest.mark.parametrize("bandwidth", [(100.0, 400.0), (400.0, 100.0)])
def test_preview_is_the_torque_of_the_motion_through_the_current_loop_of_each_axis(rigid, bandwidth):
    """Behind a lag of 1 / (2 pi f) the torque is J a + d v early by the lag; a slow motion passes Q whole."""
    machine = rigid()
    servo = Servo.derive(
        machine.axes,
        PERIOD,
        law=["pd", "preview"],
        feedforward=0.0,
        delay=0.0,
        current_bandwidth=bandwidth,
        preview_bandwidth=200.0,
        notch_frequency=0.0,
    )
    motions = [rest_to_rest(30.0, 0.5), rest_to_rest(-12.0, 0.5)]
    torque = Inverse(servo).preview(np.stack([motion[:, 0] for motion in motions], axis=1))
    # inertia and damping at the motor: mass over gear squared, and the motor's own
    gear = 200 * np.pi  # [rad/m]
    for axis, mass in enumerate((1.0, 4.0)):
        scale = 1e-3 * gear  # rad per mm
        inertia = (mass / gear**2 + 1.5e-5) * scale
        damping = 12.0 / gear**2 * scale
        _, speed, acceleration, jerk = motions[axis].T
        lag = 1 / (2 * np.pi * bandwidth[axis])
        expected = inertia * acceleration + damping * speed + lag * (inertia * jerk + damping * acceleration)
        np.testing.assert_allclose(torque[:, axis], expected, atol=0.01 * np.abs(expected).max())
