"""The Move Spiral in space, by MHELICAL in both modes, in closed form and pass by pass."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import MoveSpiral

from support.soaked import examples, suite_runs

POSITION = 1e-8  # [mm]
PLANE_SPEED = 1e-6  # relative, of the speed in the plane
FIGURES = 5e-4  # what the note's figures of speed leave open, and a small T [mm/s]


def note(**changed):
    """The example of the note: D = 120 mm, 4 turns, thickness 10 mm, V = 100 mm/s, and a height of 40 mm."""
    return MoveSpiral(**{"diameter": 120, "turns": 4, "thickness": 10, "speed": 100, "height": 40, **changed})


def share(spiral):
    """Of SPEED that belongs to the circle in mode 0, the cosine of the virtual helix' angle of climb."""
    return math.cos(math.atan2(spiral.height, math.pi * spiral.diameter * spiral.turns))


def pass_by_pass(spiral):
    """Complex places, heights and times after every pass, from the three virtual axes' own movements."""
    radius, sense = spiral.diameter / 2, -1 if spiral.clockwise else 1
    circle = spiral.speed * (share(spiral) if spiral.mhelical_mode == 0 else 1.0)
    climb = spiral.height / spiral.turns / (2 * math.pi)  # a turn of the virtual circle climbs height / turns
    phi, place, z, time, x, passes = 0.0, complex(*spiral.start), 0.0, 0.0, 1.0, 0
    found = [(place, z, time)]
    while phi < 2 * math.pi * spiral.turns * (1 - 1e-12):
        passes += 1
        x = 1 - passes * spiral.change
        lasting = spiral.loop_period * x + spiral.interpreter_time
        rest = (2 * math.pi * spiral.turns - phi) * radius * x / circle
        lasting = min(lasting, rest)
        turned = circle / x / radius * lasting
        place += x * sense * radius * (cmath.exp(1j * sense * (phi + turned)) - cmath.exp(1j * sense * phi))
        phi, z, time = phi + turned, z + climb * turned, time + lasting
        found.append((place, z, time))
    return [np.array(values) for values in zip(*found, strict=True)]


@st.composite
def jobs(draw):
    diameter = draw(st.floats(20, 300))
    turns = draw(st.integers(1, 6))
    speed = draw(st.floats(1, 500))
    return {
        "diameter": diameter,
        "turns": turns,
        "thickness": diameter * (1 - draw(st.floats(0.3, 0.95))) / (2 * turns),
        "speed": speed,
        "loop_period": math.pi * diameter * turns / speed / draw(st.floats(12, 300)),
        "interpreter_time": draw(st.sampled_from([0.0, 1e-3])),
        "start": draw(st.tuples(st.floats(-50, 50), st.floats(-50, 50))),
        "clockwise": draw(st.booleans()),
        "height": diameter * turns * draw(st.floats(0.05, 1)) * draw(st.sampled_from([-1, 1])),
        "mhelical_mode": draw(st.sampled_from([0, 1])),
    }


def speeds(setpoints):
    """Plane speed, z speed and speed in space, by differences."""
    step = np.diff(setpoints.position, axis=0)[:-1] / setpoints.period
    plane = np.hypot(step[:, 0], step[:, 1])
    return plane, step[:, 2], np.hypot(plane, step[:, 2])


@given(jobs())
@examples(60)
def test_the_generated_path_is_that_of_three_virtual_axes(job):
    spiral = MoveSpiral(**job)
    place, z, time = pass_by_pass(spiral)
    ends = np.concatenate([[0], spiral.generated.ends])
    assert len(ends) == len(place)
    points = spiral.generated.position(ends)
    assert points[:, :2] @ [1, 1j] == pytest.approx(place, abs=POSITION)
    assert points[:, 2] == pytest.approx(z, abs=POSITION)
    assert points[-1, 2] == pytest.approx(job["height"], abs=POSITION)
    assert spiral.duration == pytest.approx(time[-1], rel=1e-10)
    assert spiral.axes == ("x", "y", "z")


@given(jobs(), st.floats(50, 300))
@examples(60)
def test_setpoints_pass_the_joints_in_time_at_constant_speed_in_between(job, ticks):
    spiral = MoveSpiral(**job)
    place, z, time = pass_by_pass(spiral)
    setpoints = spiral.setpoints(time[-1] / ticks)
    t = setpoints.time[:-1]
    # the third axis runs evenly between the passes
    assert setpoints.position[:-1, 2] == pytest.approx(np.interp(t, time, z), abs=POSITION)
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(place) - 2)
    part = (t - time[k]) / (time[k + 1] - time[k])
    # the plane's axes run along an arc of the radius x R
    x = 1 - (k + 1) * spiral.change
    sense = -1 if job["clockwise"] else 1
    phi = 2 * math.pi * job["turns"] * z / job["height"]
    turned = part * (phi[k + 1] - phi[k])
    begin = np.exp(1j * sense * phi[k])
    expected = place[k] + x * sense * spiral.radius * (np.exp(1j * sense * (phi[k] + turned)) - begin)
    assert setpoints.position[:-1, :2] @ [1, 1j] == pytest.approx(expected, abs=POSITION)
    assert setpoints.requested is spiral.requested


@pytest.mark.parametrize("loop_period", suite_runs([0, 1e-3], 0))
def test_the_notes_speeds_in_mode_1(loop_period):
    """z: (h/n) / (2 pi) V / (R x), from 2.653 to 7.958; in space 100.04 to 100.32; in the plane V."""
    plane, z, space = speeds(note(loop_period=loop_period).setpoints(2e-4))
    assert plane == pytest.approx(np.full(plane.size, 100.0), rel=PLANE_SPEED)  # chords of 0.02 mm
    assert z[0] == pytest.approx(2.653, abs=FIGURES)
    assert z[-1] == pytest.approx(7.958, abs=2 * FIGURES)
    assert np.all(np.diff(z) > -1e-6)
    assert space[0] == pytest.approx(100.04, abs=0.006)
    assert space[-1] == pytest.approx(100.32, abs=0.006)


def test_the_closed_form_of_the_continuous_limit_in_mode_1():
    """rho = R - a phi with phi the tangent's angle, s = R phi - a phi^2 / 2 = V t, and z = h phi / (2 pi n)."""
    spiral = note(loop_period=0)
    setpoints = spiral.setpoints(1e-3)
    a, t = 10 / (2 * math.pi), setpoints.time[:-1]
    phi = (60 - np.sqrt(60**2 - 2 * a * 100 * t)) / a
    assert setpoints.position[:-1, 2] == pytest.approx(40 * phi / (8 * math.pi), abs=POSITION)
    rho = 60 - a * phi
    x, y = 60 - a * np.sin(phi) - rho * np.cos(phi), a - a * np.cos(phi) + rho * np.sin(phi)
    assert setpoints.position[:-1, :2] == pytest.approx(np.stack([x, y], axis=1), abs=POSITION)
    assert spiral.duration == pytest.approx(10.0531, abs=5e-5)  # that of the plane
    assert setpoints.position[-1] == pytest.approx([40, 0, 40], abs=POSITION)


def test_plane_speed_in_mode_1_is_v_at_every_tick_to_a_millionth():
    spiral = note(servo_period=1e-3)
    setpoints = spiral.setpoints(1e-3)
    plane = speeds(setpoints)[0]
    at = np.searchsorted(spiral.passes.time, setpoints.time[:-2] + 5e-4) - 1
    radius = 60 * spiral.ratios[at]
    assert plane == pytest.approx(2 * radius * np.sin(0.05 / radius) / 1e-3, rel=PLANE_SPEED)


@pytest.mark.parametrize("height", suite_runs([40, 400, -1500], 1))
def test_mode_0_slows_the_circle_by_the_cosine_of_the_climb(height):
    """SPEED V / x is the speed in space of the virtual helix of climb tan(beta) = h / (pi D n).

    So its circle runs at V cos(beta) / x: the real plane speed is V cos(beta), and z's V sin(beta) / x.
    """
    spiral = note(height=height, mhelical_mode=0, loop_period=0.01, thickness=6)
    beta = math.atan2(height, math.pi * 480)
    setpoints = spiral.setpoints(1e-3)
    plane, z, _ = speeds(setpoints)
    inside = slice(0, -20)
    assert plane[inside] == pytest.approx(np.full(plane[inside].size, 100 * math.cos(beta)), rel=2e-5)
    assert z[0] == pytest.approx(100 * math.sin(beta), rel=1e-3)
    assert z[-1] == pytest.approx(100 * math.sin(beta) / spiral.ratios[-1], rel=1e-3)
    # mode 1 has the same z at the same angle, at the circle's own speed
    plane, z, _ = speeds(note(height=height, thickness=6, loop_period=0.01).setpoints(1e-3))
    assert plane == pytest.approx(np.full(plane.size, 100.0), rel=2e-5)
    assert z[0] == pytest.approx(100 * math.tan(beta), rel=1e-3)


@pytest.mark.parametrize("height", [40, pytest.param(400, marks=pytest.mark.soak), 1500])
def test_mode_0_has_its_turns_too_far_apart(height):
    """dx/dt = -change / (T x) goes on in time while dphi/dt = V cos(beta) / (x R): the pitch is thickness / cos(beta).

    So x ends at 1 - (1 - inner/outer) / cos(beta), after the time (R 2 pi n / (V cos(beta))) (1 + x_end) / 2, and
    the curve is the involute of that pitch.
    """
    beta = math.atan2(height, math.pi * 480)
    spiral = note(height=height, mhelical_mode=0, loop_period=1e-4, thickness=6)
    x_end = 1 - (48 / 120) / math.cos(beta)
    step = spiral.change
    assert spiral.ratios[-1] == pytest.approx(x_end, abs=2 * step)
    time = 60 * 8 * math.pi / (100 * math.cos(beta)) * 0.5 * (1 + x_end)
    assert spiral.duration == pytest.approx(time, abs=2e-4)
    a = 6 / math.cos(beta) / (2 * math.pi)
    path = spiral.generated
    phi = -(path.heading(path.ends) - 0.5 * math.pi)
    rho = 60 - a * phi
    x, y = 60 - a * np.sin(phi) - rho * np.cos(phi), a - a * np.cos(phi) + rho * np.sin(phi)
    error = path.position(path.ends)[:, :2] - np.stack([x, y], axis=1)
    # half a step of the radius per radian, over a turn or so
    assert np.abs(error).max() <= 2 * math.pi * 60 * step
    planned = note(thickness=6, loop_period=1e-4).generated
    apart = path.position(path.length)[0, 0] - planned.position(planned.length)[0, 0]
    assert apart == pytest.approx(24 * (1 / math.cos(beta) - 1), abs=1e-3)


def test_modes_agree_without_a_height_and_differ_with_one():
    flat = [note(height=0, mhelical_mode=mode) for mode in (0, 1)]
    assert np.array_equal(flat[0].setpoints(1e-3).position, flat[1].setpoints(1e-3).position)
    assert flat[0].axes == ("x", "y")
    high = [note(mhelical_mode=mode).duration for mode in (0, 1)]
    assert high[0] != high[1]


def test_accel_belongs_to_the_motion_in_space_in_mode_0():
    slow = note(height=1500, mhelical_mode=0, thickness=4, acceleration=500, deceleration=250)
    beta = math.atan2(1500, math.pi * 480)
    law = slow.passes.profile
    assert law.velocity(0.01) == pytest.approx(500 * math.cos(beta) * 0.01, rel=1e-9)
    assert law.velocity(law.duration - 0.01) == pytest.approx(250 * math.cos(beta) * 0.01, rel=1e-6)
    # the virtual helix, in space
    z = np.diff(slow.setpoints(1e-3).position[:, 2]) / 1e-3
    assert z[4] / math.sin(beta) == pytest.approx(500 * 0.0045, rel=1e-6)
    in_plane = note(height=1500, thickness=4, acceleration=500).passes.profile
    assert in_plane.velocity(0.01) == pytest.approx(5.0, rel=1e-9)


def test_the_third_axis_is_not_scaled_by_the_ratio():
    """x falls to a third, and yet every circle climbs as much."""
    path = note().generated
    turns = (0.5 * math.pi - path.heading(path.ends)) / (2 * math.pi)
    assert path.position(path.ends)[:, 2] == pytest.approx(10 * turns, abs=POSITION)


@pytest.mark.parametrize("clockwise", [True, False])
def test_a_negative_height_goes_down(clockwise):
    up, down = (note(height=height, clockwise=clockwise).setpoints(0.01).position for height in (40, -40))
    assert np.abs(up * [1, 1, -1] - down).max() < POSITION


def test_the_requested_path_climbs_evenly_with_the_angle():
    path = note().requested
    s = np.linspace(0, path.length, 2001)
    assert path.position(s)[:, 2] == pytest.approx(40 * path.phi(s) / (8 * math.pi), abs=POSITION)
    # its tangent is that of its position, by central differences
    h = 1e-4
    slope = (path.position(s[1:-1] + h) - path.position(s[1:-1] - h)) / (2 * h)
    assert slope == pytest.approx(path.tangent(s[1:-1]), abs=1e-7)


@pytest.mark.parametrize("mode", [0, 1])
def test_a_published_path_in_space_climbs_over_four_circles(mode):
    spiral = note(turns=2, thickness=10, as_published=True, mhelical_mode=mode)
    path = spiral.generated
    assert path.position(path.length)[0, 2] == pytest.approx(80)  # 40 mm in two turns, and four are run
    assert spiral.notes[-1] == "listing: MHELIX is not a command of the controller; MHELICAL is used instead"


def test_negative_ratios_still_climb():
    spiral = note(turns=2, thickness=29, interpreter_time=0.01, as_published=True, servo_period=1e-3, acceleration=2000)
    assert spiral.ratios[-1] < -0.01
    setpoints = spiral.setpoints(1e-3)
    # 40 mm in two turns; the virtual angle from the virtual axis' own way
    way = spiral.passes.profile.position(setpoints.time)
    assert setpoints.position[:, 2] == pytest.approx(20 * way / (math.pi * 120), abs=1e-7)
    step = np.diff(setpoints.position[:, :2] @ [1, 1j])
    x = np.repeat(
        spiral.passes.connected, np.diff(np.append(np.round(spiral.passes.time / 1e-3), len(step))).astype(int)
    )
    turned = np.diff(np.exp(-1j * way / 60))
    assert step == pytest.approx(-60 * x * turned, abs=1e-7)


def test_an_unknown_mode_is_refused():
    with pytest.raises(InputError) as error:
        note(mhelical_mode=3)
    assert str(error.value) == "mhelical_mode = 3: must be 0 (SPEED in space) or 1 (of the circle)"
