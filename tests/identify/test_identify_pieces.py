"""Parts of a log: of a motion whose speed, place, direction and torque are known in closed form."""

import numpy as np
import pytest

from gantrysim.identify.pieces import partitions

PERIOD = 1e-3  # [s]


@pytest.fixture(scope="module")
def parts():
    """Parts of two periods of a sine of 50 mm at 1 Hz, with a torque in phase with the speed; ends are at rest."""
    time = np.arange(2000) * PERIOD
    position = 50 * np.sin(2 * np.pi * time)
    torque = 0.3 * np.cos(2 * np.pi * time)
    used = (time > 0.1) & (time < 1.9)
    return time, position, torque, used, partitions(position, torque, used, PERIOD)


@pytest.mark.parametrize(
    ("quantity", "count"), [("time", 3), ("direction", 2), ("speed", 3), ("position", 4), ("torque", 3)]
)
def test_every_sample_in_motion_is_in_one_part(parts, quantity, count):
    *_, used, masks = parts
    assert len(masks[quantity]) == count
    assert np.sum(masks[quantity], axis=0).tolist() == used.astype(int).tolist()


@pytest.mark.parametrize(
    ("quantity", "value"),
    [
        ("time", lambda time, position, torque: time),
        ("speed", lambda time, position, torque: np.abs(np.cos(2 * np.pi * time))),
        ("torque", lambda time, position, torque: np.abs(torque)),
    ],
)
def test_parts_in_rising_order_have_as_many_samples_each(parts, quantity, value):
    time, position, torque, used, masks = parts
    values = value(time, position, torque)
    count = np.array([mask.sum() for mask in masks[quantity]])
    assert np.abs(count - used.sum() / 3).max() <= 4
    # filtered near its turns
    for low, high in zip(masks[quantity], masks[quantity][1:], strict=False):
        assert np.quantile(values[low], 0.98) <= np.quantile(values[high], 0.02) + 0.01


def test_parts_by_position_are_as_wide(parts):
    _, position, _, _, masks = parts
    for k, mask in enumerate(masks["position"]):
        low, high = position[mask].min(), position[mask].max()
        assert -50 + 25 * k - 0.5 <= low < high <= -25 + 25 * k + 0.5
    assert set(masks) == {"time", "direction", "speed", "position", "torque"}


def test_directions_are_told_by_the_sign_of_the_speed(parts):
    time, _, _, _, masks = parts
    back, forwards = masks["direction"]
    speed = np.cos(2 * np.pi * time)
    assert (speed[back] < 0.02).all()
    assert (speed[forwards] > -0.02).all()
