"""The stream that a motion controller hands to its servo."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.profile import Constant, Jerk, PointToPoint, Sine
from gantrysim.paths.spirals import Involute
from gantrysim.record.setpoints import Setpoints, ticks

from support.soaked import examples

POSITION = 1e-9  # [mm]
FORGIVEN = 1e-9  # rounding that `ticks` forgives, of a period

LINE = ArcChain([0, 0], math.atan2(3, 4), 0, 10)


def made(**changed):
    values = {"period": 0.001, "axes": ("x", "y"), "position": np.zeros((3, 2)), "dispense": [True] * 3}
    return Setpoints(**{**values, "requested": LINE, **changed})


def test_time_and_duration_count_periods():
    setpoints = made(period=0.25)
    assert setpoints.time.tolist() == [0, 0.25, 0.5]
    assert setpoints.duration == 0.5


def test_arrays_are_read_only_copies():
    position = np.zeros((3, 2))
    setpoints = made(position=position)
    position[0, 0] = 7
    assert setpoints.position[0, 0] == 0
    for array in (setpoints.position, setpoints.dispense):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_arrays_that_nobody_writes_to_are_not_copied():
    own = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]])
    own.setflags(write=False)
    assert np.shares_memory(made(position=own).position, own)
    seen = np.arange(6.0).reshape(3, 2)
    view = seen[:]
    view.setflags(write=False)
    setpoints = made(position=view)
    seen[0, 0] = 7
    assert setpoints.position[0, 0] == 0


def test_setpoints_along_a_line_are_equally_spaced_and_end_at_its_end():
    setpoints = Setpoints.along(LINE, 4, 0.6)  # 2.4 mm each, the last 0.4 mm
    expected = np.array([0, 2.4, 4.8, 7.2, 9.6, 10])[:, None] * [0.8, 0.6]
    assert setpoints.position == pytest.approx(expected, abs=POSITION)
    assert setpoints.dispense.all()
    assert setpoints.axes == ("x", "y")
    assert setpoints.requested is LINE
    assert setpoints.duration == pytest.approx(3.0, abs=1e-12)


def test_a_whole_number_of_steps_has_no_short_step():
    setpoints = Setpoints.along(LINE, 10, 0.1)  # 10 steps of 1 mm, though 10 * 0.1 is rounded
    assert len(setpoints.position) == 11
    assert np.linalg.norm(np.diff(setpoints.position, axis=0), axis=1) == pytest.approx(np.ones(10), abs=POSITION)


def test_the_last_setpoint_is_the_end_though_the_last_period_is_forgiven_its_rounding():
    setpoints = Setpoints.along(LINE, 10, 0.1 * (1 - 1e-11))  # ten periods fall 1e-10 mm short
    assert len(setpoints.position) == 11
    assert setpoints.position[-1] @ [0.8, 0.6] == pytest.approx(10, abs=1e-14)


@given(st.floats(10, 500), st.floats(2.5e-4, 8e-3), st.floats(5, 40))
@examples(50)
def test_setpoints_along_a_circle_are_chords_of_equal_length_but_for_the_last(speed, period, radius):
    path = ArcChain([1, 2], 0.4, 1 / radius, 2 * radius)
    setpoints = Setpoints.along(path, speed, period)
    chords = np.linalg.norm(np.diff(setpoints.position, axis=0), axis=1)
    chord = 2 * radius * math.sin(speed * period / (2 * radius))
    assert chords[:-1] == pytest.approx(np.full(len(chords) - 1, chord), abs=POSITION)
    assert 0 < chords[-1] <= chord + POSITION
    assert setpoints.position[0] == pytest.approx(path.position(0)[0, :2], abs=POSITION)
    assert setpoints.position[-1] == pytest.approx(path.position(path.length)[0, :2], abs=speed * period * FORGIVEN * 2)
    # the time is that of the path, rounded up to a period
    late = setpoints.duration - path.length / speed
    assert -period * FORGIVEN * 2 <= late < period


def test_axes_take_the_columns_of_the_path_and_a_requested_path_is_kept():
    asked = Involute(60, 10, 4)
    setpoints = Setpoints.along(ArcChain([0, 0, 5], 0, 0, 1), 1, 0.5, requested=asked, axes=("x", "y", "z"))
    assert setpoints.position.tolist() == [[0, 0, 5], [0.5, 0, 5], [1, 0, 5]]
    assert setpoints.requested is asked


def test_hold_repeats_the_last_position_without_glue():
    setpoints = Setpoints.along(LINE, 10, 0.1)
    held = setpoints.hold(0.25)
    assert len(held.position) == 11 + 3
    assert np.array_equal(held.position[:11], setpoints.position)
    assert np.all(held.position[11:] == setpoints.position[-1])
    assert held.dispense.tolist() == [True] * 11 + [False] * 3
    assert held.requested is LINE
    assert held.period == 0.1


def test_a_hold_of_zero_has_no_effect():
    setpoints = Setpoints.along(LINE, 10, 0.1)
    assert setpoints.hold(0) is setpoints


@pytest.mark.parametrize(
    ("duration", "period", "count"),
    [(1, 0.1, 10), (1.05, 0.1, 11), (0.07, 0.01, 7), (0.3, 0.1, 3), (0, 0.1, 0), (1e-4, 0.1, 1)],
)
def test_ticks_cover_the_duration_and_forgive_rounding(duration, period, count):
    assert ticks(duration, period) == count


@pytest.mark.parametrize("name", ["speed", "period"])
@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "must be greater than 0"), (-2, "= -2 .*must be greater than 0"), (math.nan, "= nan .*must be finite")],
)
def test_speed_and_period_out_of_bounds_are_named(name, value, text):
    with pytest.raises(InputError, match=rf"^{name} .*{text}"):
        Setpoints.along(LINE, **{"speed": 10, "period": 0.1, name: value})


def test_negative_hold_is_named():
    with pytest.raises(InputError, match=r"^hold = -0\.1 s: must be at least 0 s$"):
        made().hold(-0.1)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"period": 0}, r"period = 0 s: must be greater than 0 s"),
        ({"period": math.inf}, r"period = inf s: must be finite"),
        ({"position": np.zeros(3)}, r"setpoints of shape \(3,\): must be \(n, 2\) with n at least 2"),
        ({"position": np.zeros((3, 3))}, r"setpoints of shape \(3, 3\): must be \(n, 2\)"),
        ({"position": np.zeros((1, 2)), "dispense": [True]}, r"shape \(1, 2\): .* n at least 2"),
        ({"dispense": [True] * 2}, r"dispenser command of shape \(2,\): must be \(3,\)"),
        ({"dispense": np.ones((3, 2), bool)}, r"dispenser command of shape \(3, 2\): must be \(3,\)"),
        ({"position": [[0, 0], [1, math.nan], [0, 0]]}, r"setpoint 1 = \[1\.0, nan\]: must be finite"),
        ({"position": [[0, 0], [1, 0], [math.inf, 0]]}, r"setpoint 2 = \[inf, 0\.0\]: must be finite"),
    ],
)
def test_setpoints_out_of_bounds_are_named(changed, text):
    with pytest.raises(InputError, match=text):
        made(**changed)


def test_setpoints_along_a_profile_are_its_distances_at_every_period():
    profile = PointToPoint(10, 5, 40)  # 0.125 s up over 0.3125 mm, 1.875 s along, as much down: 2.125 s
    setpoints = Setpoints.along(LINE, profile, 0.1)
    assert len(setpoints.position) == 1 + 22
    t = setpoints.time
    t[-1] = profile.duration
    ramps = np.where(t < 0.125, 20 * t**2, np.where(t > 2, 10 - 20 * (2.125 - t) ** 2, 0.3125 + 5 * (t - 0.125)))
    assert setpoints.position == pytest.approx(ramps[:, None] * [0.8, 0.6], abs=POSITION)
    assert setpoints.position[-1] == pytest.approx([8, 6], abs=1e-14)
    assert setpoints.dispense.all()


@pytest.mark.parametrize(
    "profile", [PointToPoint(10, 30, 200, shape=Sine()), PointToPoint(10, 30, 200, 900, Jerk(5e3))]
)
def test_setpoints_of_a_profile_keep_its_speed_and_acceleration(profile):
    period = 1e-3
    s = Setpoints.along(LINE, profile, period).position @ [0.8, 0.6]
    assert np.diff(s).max() / period <= profile.speed * (1 + 1e-9)
    inner = np.diff(s[:-1], 2) / period**2  # the last setpoint is at the end, a part of a period early
    assert inner.max() <= profile.acceleration * (1 + 1e-9)
    assert inner.min() >= -(profile.deceleration or profile.acceleration) * (1 + 1e-9)


def test_a_constant_profile_is_the_constant_speed():
    by_profile, by_speed = Setpoints.along(LINE, Constant(10, 4), 0.6), Setpoints.along(LINE, 4, 0.6)
    assert np.array_equal(by_profile.position, by_speed.position)


def test_coordinates_map_arc_lengths_to_axes():
    asked = []

    def coordinates(s):
        asked.append(s)
        return np.stack([np.degrees(s / 5), 40 - s, s**2], axis=1)

    setpoints = Setpoints.along(LINE, 4, 0.6, axes=("th", "x", "y"), coordinates=coordinates)
    s = np.array([0, 2.4, 4.8, 7.2, 9.6, 10])
    assert asked[0] == pytest.approx(s, abs=POSITION)
    assert setpoints.position == pytest.approx(np.stack([np.degrees(s / 5), 40 - s, s**2], axis=1), abs=1e-7)
    assert setpoints.axes == ("th", "x", "y")
    assert setpoints.requested is LINE
    with pytest.raises(InputError, match=r"setpoints of shape \(6, 3\): must be \(n, 2\)"):
        Setpoints.along(LINE, 4, 0.6, coordinates=coordinates)


def test_a_profile_of_another_length_than_the_path_is_refused():
    with pytest.raises(InputError, match=rf"^profile of 30 mm: must be as long as the path, {LINE.length:g} mm$"):
        Setpoints.along(LINE, Constant(30.0, 10.0), 0.1)
