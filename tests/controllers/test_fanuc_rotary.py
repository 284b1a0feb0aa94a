"""FANUC's rotary axis: it turns with the angle of a coil, and the path slows for its limits."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.fanuc import Arc, Line, Program, Spiral

from support.soaked import examples

PERIOD = 1e-3
OVER = 2e-3  # relative, between the places looked at
CONE = "G02 X0 Y-37.5 Z62.5 I0 J-100 Q-25 C-900 F7200"
START = (0, 100, 0)


def rotary(made, period=PERIOD):
    """Positions of the rotary axis, with some rest before and after."""
    column = made.setpoints(period).position[:, made.axes.index("r")]
    return np.pad(column, 3, mode="edge")


def velocity(made):
    return np.diff(rotary(made)) / PERIOD


def acceleration(made):
    return np.diff(rotary(made), 2) / PERIOD**2


@pytest.mark.parametrize("limit", [80, 110])
def test_the_path_slows_for_the_rotary_axis_velocity_alone(limit):
    free, held = Program(CONE, start=START), Program(CONE, start=START, rotary_velocity=limit)
    assert np.abs(velocity(free)).max() > 1.5 * limit
    assert np.abs(velocity(held)).max() <= limit * (1 + OVER)
    # it is at its limit wherever the feed would have it turn faster: 900 deg over 2.5 turns, one for one
    assert held.duration > free.duration
    feed, angle = 120.0, np.linspace(0, 5 * math.pi, 200001)
    plane = np.hypot(100 - 25 / 2 / math.pi * angle, 25 / 2 / math.pi)  # way in the plane per radian [mm]
    rate = np.minimum(feed / plane, math.radians(limit))
    assert held.duration == pytest.approx(np.trapezoid(1 / rate, angle), rel=1e-4)


def test_the_path_slows_for_the_rotary_axis_acceleration():
    free = Program(CONE, start=START, acceleration=2000)
    held = Program(CONE, start=START, acceleration=2000, rotary_acceleration=100)
    assert np.abs(acceleration(free)).max() > 500
    assert np.abs(acceleration(held)).max() <= 100 * (1 + OVER)
    assert np.abs(acceleration(held)).max() > 90
    assert held.duration > free.duration
    assert rotary(held)[-1] == pytest.approx(-900, abs=1e-9)


def test_it_stops_where_its_rate_along_the_path_jumps_and_only_then():
    text = "G01 X50 F6000\nX100 C90\nX150"
    free = Program(text, acceleration=2000)
    held = Program(text, acceleration=2000, rotary_acceleration=1000)
    assert np.abs(acceleration(free)).max() > 50_000  # 180 deg/s at once
    assert np.abs(acceleration(held)).max() <= 1000 * (1 + OVER)
    steady = Program("G01 X50 C90 F6000\nX100 C180\nX150 C270", acceleration=2000, rotary_acceleration=1000)
    slowest = np.diff(steady.setpoints(PERIOD).position[:, 0])[400:-400].min() / PERIOD
    assert slowest == pytest.approx(100, rel=1e-9)


def test_blending_shares_its_acceleration_too():
    text = "G01 X50 F6000\nX100 C90\nX150\nY40 C0"
    made = Program(text, acceleration=2000, blend_time=0.05, rotary_acceleration=1000)
    assert np.abs(acceleration(made)).max() <= 1000 * (1 + OVER)
    assert np.diff(made.setpoints(PERIOD).position[:, 0])[400:1500].min() / PERIOD > 5  # and does not stop


def test_the_rotary_axis_alone_has_a_trapezoidal_profile():
    made = Program("G01 X1 F6000\nG01 C90 F6000", acceleration=1000, rotary_velocity=60, rotary_acceleration=300)
    line = Program("G01 X1 F6000", acceleration=1000).duration
    assert made.duration - line == pytest.approx(90 / 60 + 60 / 300, rel=1e-9)
    assert np.abs(velocity(made)).max() == pytest.approx(60, rel=1e-9)
    assert np.abs(acceleration(made)).max() <= 300 * (1 + 1e-6)
    assert Program("G01 X1 F6000\nG01 C90 F6000").duration == pytest.approx(0.01 + 90 / 100, rel=1e-9)


@st.composite
def programs(draw):
    """Lines, arcs and cones with turns of the rotary axis, one behind the other."""
    here, angle, blocks = np.zeros(3), 0.0, []
    for _ in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(["line", "arc", "cone"]))
        angle += draw(st.sampled_from([0.0, 45.0, -200.0, 720.0]))
        way = np.array([draw(st.floats(-50, 50)), draw(st.floats(10, 50)), draw(st.sampled_from([0.0, 8.0]))])
        common = {"rotary": angle, "feed": draw(st.floats(1000, 12000))}
        if kind == "cone":
            end = here + way * [0, 1.5, 1]
            blocks.append(Spiral(end=tuple(end), centre=(0.0, float(way[1])), turns=draw(st.integers(1, 3)), **common))
        else:
            end = here + way
            reach = float(np.linalg.norm(way[:2]))
            blocks.append(
                Line(end=tuple(end), **common) if kind == "line" else Arc(end=tuple(end), radius=reach, **common)
            )
        here = end
    return tuple(blocks)


@given(programs(), st.floats(50, 500), st.floats(100, 5000), st.sampled_from([0.0, 0.03]))
@examples(40)
def test_the_rotary_axis_never_passes_its_limits(blocks, fastest, steepest, blend_time):
    made = Program(
        blocks, acceleration=3000, blend_time=blend_time, rotary_velocity=fastest, rotary_acceleration=steepest
    )
    if "r" not in made.axes:
        return
    assert np.abs(velocity(made)).max() <= fastest * (1 + OVER)
    assert np.abs(acceleration(made)).max() <= steepest * (1 + OVER) + 1e-4
    linear = np.pad(made.setpoints(PERIOD).position[:, :2], ((2, 2), (0, 0)), mode="edge")
    assert np.abs(np.diff(linear, 2, axis=0)).max() / PERIOD**2 <= 3000 * (1 + OVER)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rotary_velocity": 0}, "rotary_velocity = 0 deg/s: must be greater than 0 deg/s"),
        ({"rotary_acceleration": -1}, "rotary_acceleration = -1 deg/s²: must be greater than 0 deg/s²"),
        (
            {"rotary_acceleration": 100},
            "rotary_acceleration = 100 deg/s²: must have a finite acceleration, with which the path slows for it",
        ),
    ],
)
def test_a_limit_out_of_its_bounds_is_named(changed, message):
    with pytest.raises(InputError, match=f"^{message}$"):
        Program(CONE, start=START, **changed)
