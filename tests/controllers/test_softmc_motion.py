"""softMC's speed along the path: profiles, limits, overrides, the orientation axis and the dispenser."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.softmc import Circle, Group, Move, Program

from support.soaked import examples

PERIOD = 1e-3
CRUISE = 1e-6  # of the path speed
PROFILES = ("trapezoid", "sine", "trapezoidal acceleration", "constant", "smooth")


def line(length=100.0, **group):
    """A straight line of so many mm."""
    return Program([Move((length, 0))], Group(**group))


def ways(program, period=PERIOD):
    """The way of every setpoint, each command's from its own geometry: distance, or angle times radius, or degrees."""
    position = program.setpoints(period).position
    counts = [math.ceil(leg.profile.duration / period - 1e-9) for leg in program.legs]
    ends = np.concatenate([[0], np.cumsum(counts)])
    way = np.zeros(len(position))
    for (first, last), leg in zip(pairwise(ends), program.legs, strict=True):
        part = position[first : last + 1]
        if hasattr(leg.path.piece, "angle"):
            place = (part[:, :2] - leg.path.piece.centre[:2]) @ [1, 1j]
            turned = np.abs(np.unwrap(np.angle(place / place[0])))
            steps = np.diff(turned) * math.hypot(leg.path.piece.radius[0], leg.path.piece.rise / leg.path.piece.angle)
        else:
            steps = np.linalg.norm(np.diff(part, axis=0), axis=1)
        way[first + 1 : last + 1] = way[first] + np.cumsum(steps)
    return way


def integrated(acceleration, ramp, along):
    """The way of a ramp up by `acceleration` at 0 to 1 of its time, of cruising and of the same ramp down."""
    n = 20001
    x = np.linspace(0, 1, n)
    a = acceleration(x)
    rise = np.concatenate([[0], np.cumsum(0.5 * (a[1:] + a[:-1]))]) * ramp / (n - 1)
    up = np.concatenate([[0], np.cumsum(0.5 * (rise[1:] + rise[:-1]))]) * ramp / (n - 1)
    down = up[-1] * 2 + rise[-1] * along - up[::-1]
    time = np.concatenate([x * ramp, ramp + along + x * ramp])
    return time, np.concatenate([up, down]), rise[-1]


def trapezoidal(rise, peak):
    return lambda x: peak * np.minimum(np.minimum(x, 1 - x) / max(rise, 1e-12), 1.0)


@pytest.mark.parametrize(
    ("group", "acceleration", "ramp"),
    [
        ({"profile": "trapezoid"}, lambda x: 2000 + 0 * x, 0.1),
        ({"profile": "sine"}, lambda x: 2000 * np.sin(np.pi * x), 0.1 * math.pi / 2),
        # 2000 / 5e4 = 0.04 s up to the acceleration, 0.1 - 0.04 s at it
        ({"profile": "trapezoidal acceleration", "jerk": 5e4}, trapezoidal(0.04 / 0.14, 2000), 0.14),
        ({"profile": "smooth", "smooth": -1, "jerk": 5e4}, trapezoidal(0.04 / 0.14, 2000), 0.14),
        # the acceleration is not reached: sqrt(200 x 1e4) = 1414.2 mm/s², twice 0.14142 s
        ({"profile": "trapezoidal acceleration", "jerk": 1e4}, trapezoidal(0.5, math.sqrt(2e6)), math.sqrt(0.08)),
        ({"profile": "smooth", "smooth": 0}, lambda x: 2000 + 0 * x, 0.1),
        ({"profile": "smooth", "smooth": 25}, trapezoidal(1 / 3, 2000), 0.15),
        ({"profile": "smooth", "smooth": 48}, trapezoidal(1 - 1 / 1.96, 2000), 0.196),
        ({"profile": "smooth", "smooth": 50}, trapezoidal(0.5, 2000), 0.2),
        ({"profile": "smooth", "smooth": 75}, trapezoidal(0.5, 1600), 0.25),
        ({"profile": "smooth", "smooth": 100}, trapezoidal(0.5, 4000 / 3), 0.3),
    ],
)
def test_profiles_are_the_integrals_of_their_accelerations(group, acceleration, ramp):
    program = line(velocity=200, acceleration=2000, **group)
    along = 100 / 200 - ramp
    time, way, speed = integrated(acceleration, ramp, along)
    assert speed == pytest.approx(200, rel=1e-6)
    assert program.duration == pytest.approx(2 * ramp + along)
    setpoints = program.setpoints(PERIOD)
    expected = np.interp(setpoints.time, time, way)
    assert setpoints.position[:, 0] == pytest.approx(expected, abs=2e-5)


def test_constant_velocity_has_no_ramps():
    setpoints = line(velocity=200, profile="constant").setpoints(PERIOD)
    assert np.diff(setpoints.position[:, 0]) == pytest.approx(np.full(500, 0.2))


def test_deceleration_is_the_acceleration_unless_it_is_given():
    assert line(velocity=200, acceleration=2000).duration == pytest.approx(0.6)
    assert line(velocity=200, acceleration=2000, deceleration=1000).duration == pytest.approx(0.65)
    assert line(velocity=200, acceleration=1000, deceleration=2000).duration == pytest.approx(0.65)


def test_a_short_distance_does_not_reach_the_speed():
    program = line(4.0, velocity=200, acceleration=1000)
    assert program.duration == pytest.approx(2 * math.sqrt(4 / 1000))
    assert np.diff(ways(program)).max() / PERIOD < math.sqrt(4 * 1000)


def jerk_bound(group, length):
    """Largest jerk of the ramps: the closed forms of the shapes for the speed that is reached."""
    up, down = group.acceleration, group.deceleration
    stretch = {"sine": math.pi / 2, "smooth": 1 + 2 * group.smooth / 100}.get(group.profile, 1.0)
    speed = min(group.velocity, math.sqrt(2 * length / (stretch * (1 / up + 1 / down))))
    most = max(up, down)
    if group.profile == "sine":
        return 2 * most**2 / speed
    if group.profile == "smooth" and group.smooth > 0:
        rise = (stretch - 1) if stretch <= 2 else 0.25 * stretch**2
        return most**2 / (rise * speed)
    by_jerk = group.profile == "trapezoidal acceleration" or (group.profile == "smooth" and group.smooth < 0)
    return group.jerk if by_jerk else math.inf


place = st.tuples(st.floats(-100, 100), st.floats(-100, 100))


@st.composite
def programs(draw):
    """Moves and circles of any profile, none shorter than a millimetre."""
    group = Group(
        velocity=draw(st.floats(10, 500)),
        acceleration=draw(st.floats(500, 20000)),
        deceleration=draw(st.floats(500, 20000)),
        jerk=draw(st.floats(1e4, 1e6)),
        profile=draw(st.sampled_from(PROFILES)),
        smooth=draw(st.sampled_from([-1, 0, 1, 25, 50, 51, 80, 100])),
    )
    commands, here = [], np.zeros(2)
    for _ in range(draw(st.integers(1, 4))):
        if draw(st.booleans()):
            target = np.add(here, np.multiply(draw(st.floats(1, 100)), _direction(draw)))
            commands.append(Move(tuple(target)))
            here = target
        else:
            centre = np.add(here, np.multiply(draw(st.floats(5, 60)), _direction(draw)))
            angle = draw(st.floats(20, 800)) * draw(st.sampled_from([-1, 1]))
            commands.append(Circle(angle, tuple(centre)))
            here = Program(commands).legs[-1].path.end[:2]
    return Program(commands, group)


def _direction(draw):
    angle = draw(st.floats(-math.pi, math.pi))
    return math.cos(angle), math.sin(angle)


@given(programs())
@examples(100)
def test_velocity_acceleration_and_jerk_stay_within_their_limits(program):
    group, way = program.group, ways(program)
    rounding = 4e-13 * (1 + way[-1])
    speed, acceleration, jerk = (np.abs(np.diff(way, k)) / PERIOD**k for k in (1, 2, 3))
    assert np.all(speed <= group.velocity * (1 + 1e-9) + rounding / PERIOD)
    if group.profile != "constant":
        most = max(group.acceleration, group.deceleration)
        assert np.all(acceleration <= most * (1 + 1e-9) + 4 * rounding / PERIOD**2)
        bound = max(jerk_bound(group, leg.profile.length) for leg in program.legs)
        assert np.all(jerk <= bound * (1 + 1e-6) + 8 * rounding / PERIOD**3)


@given(programs())
@examples(60)
def test_the_cruise_speed_is_the_commanded_one(program):
    way = np.diff(ways(program)) / PERIOD
    first = 0
    for leg in program.legs:
        count = math.ceil(leg.profile.duration / PERIOD - 1e-9)
        speed = leg.profile.velocity(np.arange(count + 1) * PERIOD)
        cruising = (speed[1:] == speed[:-1]) & (speed[1:] == program.group.velocity)
        assert way[first : first + count][cruising] == pytest.approx(program.group.velocity, rel=CRUISE)
        first += count


def test_the_spiral_of_half_circles_cruises_at_its_speed():
    text = "\n".join(f"Circle Angle=180 CircleCenter={{{0 if k % 2 else 12.5},0,{5 * k}}}" for k in range(1, 9))
    program = Program(text, Group(velocity=500, acceleration=30000), start=(25, 0, 0))
    speed = np.diff(ways(program)) / PERIOD
    cruising = np.abs(speed - 500) < 500 * CRUISE
    assert cruising.mean() > 0.9
    assert speed.max() < 500 * (1 + CRUISE)


def test_vmax_caps_the_speed_silently():
    def fastest(**group):
        return np.diff(ways(line(velocity=300, acceleration=10000, **group))).max() / PERIOD

    assert fastest() == pytest.approx(300)
    assert fastest(vmax=120) == pytest.approx(120)
    assert fastest(vmax=500) == pytest.approx(300)
    capped = Program("Move {100, 0} VCruise=900", Group(vmax=120, acceleration=10000))
    assert np.diff(ways(capped)).max() / PERIOD == pytest.approx(120)


@pytest.mark.parametrize(
    "override",
    [
        {"velocity": 40},
        {"acceleration": 500},
        {"deceleration": 500},
        {"profile": "sine"},
        {"profile": "smooth", "smooth": 80},
        {"profile": "trapezoidal acceleration", "jerk": 1e4},
        {"profile": "constant"},
    ],
)
def test_overrides_last_for_one_command(override):
    first, last = Move((50, 0)), Move((150, 0))
    program = Program([first, Move((100, 0), **override), last])
    plain, own = line(50.0).duration, line(50.0, **override).duration
    assert own != pytest.approx(plain, rel=1e-3)
    assert [leg.profile.duration for leg in program.legs] == pytest.approx([plain, own, plain])


def test_smooth_needs_its_profile_which_the_group_may_have():
    program = Program("Move {50, 0} Smooth=100", Group(profile="smooth"))
    assert program.duration == pytest.approx(line(50.0, profile="smooth", smooth=100).duration)


def test_every_command_starts_at_the_tick_at_which_the_one_before_has_ended():
    program = Program([Move((10, 0)), Move((10, 20)), Circle(90, (0, 20))])
    setpoints = program.setpoints(PERIOD)
    counts = [math.ceil(leg.profile.duration / PERIOD) for leg in program.legs]
    corners = np.concatenate([[0], np.cumsum(counts)])
    assert setpoints.position[corners] == pytest.approx(np.array([[0, 0], [10, 0], [10, 20], [0, 30]]), abs=1e-9)
    assert len(setpoints.position) == corners[-1] + 1
    assert program.duration <= setpoints.duration < program.duration + 3 * PERIOD
    assert setpoints.requested is program.requested


def test_orientation_turns_in_proportion_to_the_path_length():
    program = Program([Circle(270, (0, 50, 20, 135)), Move((0, 0, 0, 45))], start=(0, 0, 0, 0))
    setpoints = program.setpoints(PERIOD)
    n = math.ceil(program.legs[0].profile.duration / PERIOD)
    x, y, z, r = setpoints.position.T
    turned = np.degrees(np.unwrap(np.arctan2(y[: n + 1] - 50, x[: n + 1]))) + 90
    assert r[: n + 1] == pytest.approx(turned / 2, abs=1e-9)
    assert z[: n + 1] == pytest.approx(turned * 20 / 270, abs=1e-9)
    share = np.linalg.norm(setpoints.position[n:, :3] - setpoints.position[n, :3], axis=1)
    assert r[n:] == pytest.approx(135 - 90 * share / share[-1], abs=1e-9)
    assert setpoints.axes == ("x", "y", "z", "r")


@pytest.mark.parametrize("profile", PROFILES)
def test_the_path_slows_where_the_orientation_cannot_follow(profile):
    group = Group(velocity=200, acceleration=5000, jerk=1e5, profile=profile, smooth=40, vrot=90, arot=900)
    slow = Program([Move((10, 0, 0, 90))], group, (0, 0, 0, 0)).setpoints(PERIOD).position
    free = Program([Move((10, 0, 0, 0.1))], group, (0, 0, 0, 0)).setpoints(PERIOD).position
    assert len(slow) > 3 * len(free)
    rates = [np.abs(np.diff(slow[:, 3], k)).max() / PERIOD**k for k in (1, 2, 3)]
    assert rates[0] == pytest.approx(90, rel=1e-3)
    if profile != "constant":
        assert rates[1] <= 900 * (1 + 1e-6)
    if profile == "trapezoidal acceleration":
        assert rates[2] <= 1e5 * 900 / 5000 * (1 + 1e-6)


def test_the_orientation_alone_turns_in_place():
    program = Program([Move((10, 0, 0, 0)), Move((10, 0, 0, -180)), Move((10, 0, 0, -180))], start=(0, 0, 0, 0))
    setpoints = program.setpoints(PERIOD)
    n = math.ceil(program.legs[0].profile.duration / PERIOD)
    assert program.legs[1].profile.duration == pytest.approx(180 / 360 + 360 / 3600)
    assert np.ptp(setpoints.position[n:, :3], axis=0) == pytest.approx(np.zeros(3))
    assert setpoints.position[-1, 3] == -180
    assert np.abs(np.diff(setpoints.position[n:, 3])).max() / PERIOD == pytest.approx(360)
    assert len(program.requested.pieces) == 1


def test_glue_is_laid_throughout_unless_a_command_switches_it_off():
    everywhere = Program([Move((10, 0)), Move((10, 10)), Move((0, 10))])
    assert everywhere.setpoints(PERIOD).dispense.all()
    program = Program("Move {10, 0} Dispense=0\nMove {10, 10}\nMove {0, 10} Dispense=0")
    setpoints = program.setpoints(PERIOD)
    position = setpoints.position
    np.testing.assert_array_equal(setpoints.dispense, (position[:, 0] == 10) & (position[:, 1] < 10))
