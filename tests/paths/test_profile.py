"""Speed profiles in closed form: constant, and from rest to rest."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad

from gantrysim.base.errors import InputError
from gantrysim.paths.profile import Constant, Jerk, PointToPoint, Profile, Ramp, Sine

from support.soaked import examples

ROUNDING = 1e-12  # relative
INTEGRAL = 1e-9  # of the length
SLOPE = 1e-9  # by which a difference of speeds may pass the limit, relative

lengths = st.floats(-3, 3).map(lambda x: 10**x)  # [mm]
speeds = st.floats(-1, 3).map(lambda x: 10**x)  # [mm/s]
accelerations = st.floats(0, 4.5).map(lambda x: 10**x)  # [mm/s²]
shapes = st.one_of(
    st.builds(Ramp, st.floats(0, 0.5)),
    st.builds(Ramp, st.sampled_from([0.0, 0.25, 0.5]), st.floats(0.2, 1)),
    st.just(Sine()),
    st.builds(Jerk, st.floats(0, 7).map(lambda x: 10**x)),
)
moves = st.builds(PointToPoint, lengths, speeds, accelerations, st.one_of(st.none(), accelerations), shape=shapes)


def kinks(profile):
    """Times at which the acceleration or the jerk may jump [s]."""
    down = profile.acceleration if profile.deceleration is None else profile.deceleration
    up, slow = profile.shape.time(profile.peak, profile.acceleration), profile.shape.time(profile.peak, down)
    shares = np.array([0, 0.5, 1])
    if isinstance(profile.shape, Ramp):
        shares = np.array([0, profile.shape.rise, 0.5, 1 - profile.shape.rise, 1])
    if isinstance(profile.shape, Jerk):
        rises = [
            min(a, math.sqrt(profile.peak * profile.shape.jerk)) / profile.shape.jerk
            for a in (profile.acceleration, down)
        ]
        return np.unique(
            [0, rises[0], up - rises[0], up, *(profile.duration - np.array([slow, slow - rises[1], rises[1], 0]))]
        )
    return np.unique([*(up * shares), *(profile.duration - slow * shares)])


@given(moves, st.floats(0, 1))
@examples(200)
def test_distance_is_the_integral_of_the_speed(profile, share):
    t = share * profile.duration
    node, weight = np.polynomial.legendre.leggauss(20)
    edges = np.unique([*kinks(profile).clip(0, t), t])
    way = sum(
        0.5 * (high - low) * weight @ profile.velocity(0.5 * (high + low) + 0.5 * (high - low) * node)
        for low, high in pairwise(edges)
    )
    assert profile.position(t) == pytest.approx(way, abs=INTEGRAL * profile.length)


@given(moves)
@examples(200)
def test_runs_from_rest_to_rest_over_its_length_within_the_limits_monotonically(profile):
    down = profile.acceleration if profile.deceleration is None else profile.deceleration
    t = np.union1d(np.linspace(0, profile.duration, 2001), kinks(profile).clip(0, profile.duration))
    s, v = profile.position(t), profile.velocity(t)
    assert s[0] == 0
    assert v[0] == 0
    assert s[-1] == pytest.approx(profile.length, rel=4e-16)
    assert v[-1] == pytest.approx(0, abs=ROUNDING * profile.peak)
    assert np.diff(s).min() >= -1e-15 * profile.length
    assert v.min() >= 0
    assert v.max() <= profile.peak * (1 + ROUNDING)
    assert v.max() == pytest.approx(profile.peak, rel=1e-6)
    assert profile.peak <= profile.speed
    step = np.diff(t)
    wide = step > 1e-6 * profile.duration
    slope = np.diff(v)[wide] / step[wide]
    assert slope.max() <= profile.acceleration * (1 + SLOPE)
    assert slope.min() >= -down * (1 + SLOPE)


@given(moves)
@examples(100)
def test_position_is_constant_before_the_start_and_after_the_end(profile):
    T = profile.duration  # noqa: N806
    outside = np.array([-1.0, -1e-9 * T, T * (1 + 1e-9), T + 1.0])
    assert profile.position(outside) == pytest.approx(np.array([0, 0, 1, 1]) * profile.length, rel=4e-16)
    assert profile.velocity(outside).tolist() == [0, 0, 0, 0]


@given(lengths, speeds, accelerations, accelerations, st.floats(0, 0.5))
@examples(100)
def test_times_of_moves_that_reach_their_speed_in_closed_form(length, speed, up, down, rise):
    """L/V + V/2A + V/2D for a trapezoid; its last two times pi/2 for half sines, 1/(1 - r) for ramps of the rise r."""

    def time(factor):
        return length / speed + 0.5 * factor * (speed / up + speed / down)

    for shape, factor in ((Ramp(), 1), (Sine(), 0.5 * math.pi), (Ramp(rise), 1 / (1 - rise))):
        profile = PointToPoint(length, speed, up, down, shape)
        reached = 0.5 * factor * speed**2 * (1 / up + 1 / down) <= length
        if reached:
            assert profile.duration == pytest.approx(time(factor), rel=ROUNDING)
            assert profile.peak == speed
        else:  # V^2 factor (1/A + 1/D) / 2 = L
            peak = math.sqrt(2 * length / factor / (1 / up + 1 / down))
            assert profile.peak == pytest.approx(peak, rel=ROUNDING)
            assert profile.duration == pytest.approx(2 * length / peak, rel=ROUNDING)
    assert PointToPoint(length, speed, up, up).duration == PointToPoint(length, speed, up).duration


@given(lengths, speeds, accelerations, st.floats(0, 7).map(lambda x: 10**x))
@examples(200)
def test_times_of_jerk_limited_moves_in_closed_form(length, speed, acceleration, jerk):
    def ramp(v):
        return v / acceleration + acceleration / jerk if v * jerk >= acceleration**2 else 2 * math.sqrt(v / jerk)

    profile = PointToPoint(length, speed, acceleration, shape=Jerk(jerk))
    if speed * ramp(speed) <= length:
        peak = speed
    else:
        # V (V/A + A/J) = L where A is reached, 2 V sqrt(V/J) = L where it is not
        a, j = acceleration, jerk
        peak = 0.5 * a * (-a / j + math.sqrt((a / j) ** 2 + 4 * length / a))
        if peak * j < a**2:
            peak = (0.5 * length) ** (2 / 3) * j ** (1 / 3)
    assert profile.peak == pytest.approx(peak, rel=1e-9)
    assert profile.duration == pytest.approx(length / peak + ramp(peak), rel=1e-9)


@given(moves.filter(lambda profile: isinstance(profile.shape, Jerk)))
@examples(100)
def test_jerk_and_acceleration_are_bounded_and_one_of_them_is_reached(profile):
    jerk = profile.shape.jerk
    up = profile.shape.time(profile.peak, profile.acceleration)
    t = np.linspace(0, up, 401)
    h = t[1]
    acceleration = np.diff(profile.velocity(t)) / h
    rounding = 1e-13 * profile.peak / h
    assume(rounding / h < 1e-3 * jerk)
    assert np.abs(np.diff(acceleration)).max() / h <= jerk * (1 + 1e-6) + rounding / h
    reached = min(profile.acceleration, math.sqrt(profile.peak * jerk))
    assert acceleration.max() == pytest.approx(reached, rel=0.01)
    assert acceleration[0] == pytest.approx(0.5 * jerk * h, rel=1e-2, abs=rounding) or reached / jerk < 2 * h


@given(st.floats(0.01, 0.5), speeds, accelerations)
@examples(100)
def test_acceleration_of_a_ramp_is_a_trapezoid_whose_sides_take_their_share(rise, speed, acceleration):
    shape = Ramp(rise)
    time = shape.time(speed, acceleration)
    x = np.linspace(0, 1, 2001)
    v = speed * shape.velocity(x, speed, acceleration)
    middle = 0.5 * (x[1:] + x[:-1])
    expected = acceleration * np.minimum(1, np.minimum(middle, 1 - middle) / rise)
    # a difference over 1/2000 of the ramp cuts a corner of the trapezoid by an eighth of the side's step
    assert np.diff(v) / (time / 2000) == pytest.approx(expected, abs=acceleration / 8 / 2000 / rise * 1.01)
    assert shape.velocity(np.array([0, 0.5, 1]), speed, acceleration) == pytest.approx([0, 0.5, 1], abs=1e-15)
    assert shape.distance(np.array([0, 1.0]), speed, acceleration) == pytest.approx([0, 0.5], abs=1e-15)


def test_a_share_of_the_acceleration_stretches_the_ramp():
    full, half = Ramp(0.25), Ramp(0.25, 0.5)
    assert half.time(40, 1000) == pytest.approx(2 * full.time(40, 1000), rel=ROUNDING)
    assert full.time(40, 1000) == pytest.approx(40 / 1000 / 0.75, rel=ROUNDING)


def test_acceleration_of_the_sine_is_a_half_sine():
    profile = PointToPoint(100, 50, 400, shape=Sine())
    up = 0.5 * math.pi * 50 / 400
    t = np.linspace(0, up, 1001)
    middle = 0.5 * (t[1:] + t[:-1])
    slope = np.diff(profile.velocity(t)) / t[1]
    assert slope == pytest.approx(400 * np.sin(math.pi * middle / up), abs=400 * 1e-5)


def test_each_limit_bites():
    def with_(length=100.0, speed=50.0, acceleration=400.0, deceleration=None, shape=None):
        return PointToPoint(length, speed, acceleration, deceleration, shape or Ramp())

    duration = with_().duration
    assert duration == pytest.approx(100 / 50 + 50 / 400, rel=ROUNDING)
    assert with_(speed=60).duration < duration < with_(speed=40).duration
    assert with_(acceleration=800).duration < duration < with_(acceleration=200).duration
    assert with_(deceleration=800).duration < duration < with_(deceleration=200).duration
    assert with_(shape=Jerk(4000)).duration == pytest.approx(duration + 400 / 4000, rel=ROUNDING)
    assert with_(shape=Jerk(1e12)).duration == pytest.approx(duration, rel=1e-8)
    # the deceleration is that of the end alone
    hard = with_(deceleration=1600)
    assert np.diff(hard.velocity([0, 0.01]))[0] == pytest.approx(4, rel=ROUNDING)
    assert np.diff(hard.velocity([hard.duration - 0.01, hard.duration]))[0] == pytest.approx(-16, rel=1e-10)


def test_a_long_jerk_limited_move_by_hand():
    """V = 40, A = 200, J = 1000: 0.2 s to A, nothing at it, so 0.4 s up over 8 mm, as much down, the rest at V."""
    profile = PointToPoint(100, 40, 200, shape=Jerk(1000))
    assert profile.duration == pytest.approx(0.4 + 84 / 40 + 0.4, rel=ROUNDING)
    assert profile.position([0.2, 0.4, 2.5, 2.7, 2.9]) == pytest.approx(
        [1000 * 0.2**3 / 6, 8, 92, 100 - 1000 * 0.2**3 / 6, 100], rel=ROUNDING
    )
    assert profile.velocity([0.1, 0.2, 0.4, 1.0, 2.7]) == pytest.approx([5, 20, 40, 40, 20], rel=ROUNDING)


@given(st.floats(1e-9, 1e-3), shapes)
@examples(50)
def test_the_shortest_moves_have_a_time_and_reach_their_end(length, shape):
    profile = PointToPoint(length, 100, 1000, shape=shape)
    assert 0 < profile.duration < math.inf
    assert profile.position(0.5 * profile.duration) == pytest.approx(0.5 * length, rel=1e-9)
    assert profile.position(profile.duration) == pytest.approx(length, rel=4e-16)


@pytest.mark.parametrize("profile", [Constant(0, 5), PointToPoint(0, 5, 100), PointToPoint(0, 5, 100, shape=Jerk(9))])
def test_zero_distance_takes_no_time(profile):
    assert profile.duration == 0
    assert profile.position([-1, 0, 1]).tolist() == [0, 0, 0]


@pytest.mark.parametrize("shape", [Ramp(), Ramp(0.5), Sine(), Jerk(1e5)])
@pytest.mark.parametrize("speed", [1e30, 1e100, 1e308])
def test_a_speed_far_above_the_reachable_one_has_no_effect(speed, shape):
    plain, fast = (PointToPoint(10.0, v, 3000.0, shape=shape) for v in (1e5, speed))
    assert fast.duration == pytest.approx(plain.duration, rel=1e-9)
    assert fast.position(0.5 * fast.duration) == pytest.approx(5.0)


def test_constant_speed():
    profile = Constant(10, 4)
    assert profile.duration == 2.5
    assert profile.position([-1, 0, 1, 2.5, 3]).tolist() == [0, 0, 4, 10, 10]
    assert profile.velocity([-1, 0, 1, 2.5, 3]).tolist() == [0, 4, 4, 4, 0]
    assert quad(profile.velocity, 0, 2.5)[0] == pytest.approx(10, rel=ROUNDING)


@pytest.mark.parametrize("profile", [Constant(10, 4), PointToPoint(10, 4, 30)])
def test_a_number_is_not_a_profile(profile):
    assert isinstance(profile, Profile)
    assert not isinstance(4.0, Profile)


@pytest.mark.parametrize(
    ("build", "text"),
    [
        (lambda: Constant(-1, 5), r"^length = -1 mm: must be at least 0 mm$"),
        (lambda: Constant(1, 0), r"^speed = 0 mm/s: must be greater than 0 mm/s$"),
        (lambda: PointToPoint(math.nan, 5, 5), r"^length = nan mm: must be finite$"),
        (lambda: PointToPoint(1, -5, 5), r"^speed = -5 mm/s: must be greater than 0 mm/s$"),
        (lambda: PointToPoint(1, 5, 0), r"^acceleration = 0 mm/s²: must be greater than 0 mm/s²$"),
        (lambda: PointToPoint(1, 5, 5, -1), r"^deceleration = -1 mm/s²: must be greater than 0 mm/s²$"),
        (lambda: PointToPoint(1, 5, math.inf), r"^acceleration = inf mm/s²: must be finite$"),
        (lambda: Jerk(0), r"^jerk = 0 mm/s³: must be greater than 0 mm/s³$"),
        (lambda: Ramp(0.6), r"^rise = 0\.6: must be at most 0\.5$"),
        (lambda: Ramp(-0.1), r"^rise = -0\.1: must be at least 0$"),
        (lambda: Ramp(0.1, 0), r"^peak = 0: must be greater than 0$"),
    ],
)
def test_limits_out_of_bounds_are_named(build, text):
    with pytest.raises(InputError, match=text):
        build()
