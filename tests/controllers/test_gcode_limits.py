"""Limits that a program of printers' firmware sets: durations against closed forms and a junction-deviation planner."""

import math

import numpy as np
import pytest

from gantrysim.controllers.gcode.linuxcnc import Program as LinuxCNC
from gantrysim.controllers.gcode.slicer import Program

FEED = 50.0  # [mm/s]
SQUARE = f"G1 X60 E1 F{60 * FEED:g}\nG1 Y60 E2\n"


def line_time(length, first, feed, last, acceleration):
    """From one speed to another by way of the feed."""
    ramps = (2 * feed**2 - first**2 - last**2) / (2 * acceleration)
    assert ramps <= length
    return (2 * feed - first - last) / acceleration + (length - ramps) / feed


@pytest.mark.parametrize(
    ("words", "acceleration", "feed"),
    [
        ("M204 S500", 500, FEED),
        ("M204 P400 T9000", 400, FEED),
        ("M204 T9000", 2000, FEED),
        ("M201 X300 Y300", 300, FEED),
        ("M203 X20 Y20", 2000, 20),
        ("SET_VELOCITY_LIMIT ACCEL=700 VELOCITY=30", 700, 30),
    ],
)
def test_acceleration_and_speed_are_those_of_the_program(words, acceleration, feed):
    # without a jump at the corner, which is as good as exact
    text = f"{words}\nM205 X0.01 Y0.01\n{SQUARE}"
    expected = 2 * line_time(60, 0, feed, 0, acceleration)
    assert Program(text=text, acceleration=2000).duration == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    "words", ["M205 X8 Y9", "SET_VELOCITY_LIMIT SQUARE_CORNER_VELOCITY=8", "M205 J{deviation:.9f}"]
)
def test_a_right_angle_is_passed_at_the_corner_speed(words):
    # an arc of the radius v^2 / a is (sqrt 2 - 1) r away from a right angle
    deviation = 8**2 * (math.sqrt(2) - 1) / 2000
    program = Program(text=words.format(deviation=deviation) + "\n" + SQUARE, acceleration=2000)
    expected = 2 * line_time(60, 0, FEED, 8, 2000)
    assert program.duration == pytest.approx(expected, rel=1e-6)
    assert program.duration < 2 * line_time(60, 0, FEED, 0.01, 2000)


def junction_planned(points, feed, acceleration, corner_speed):
    """Duration by junction deviations, as firmware plans: v^2 = a d s / (1 - s) with s the sine of half the angle."""
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    unit = steps / lengths[:, None]
    deviation = corner_speed**2 * (math.sqrt(2) - 1) / acceleration
    top = np.zeros(len(points))
    for k in range(1, len(points) - 1):
        half = 0.5 * math.acos(np.clip(-(unit[k - 1] @ unit[k]), -1, 1))  # of the angle between the lines
        reach = 0.5 * min(lengths[k - 1], lengths[k]) * math.tan(half)
        radius = min(deviation * math.sin(half) / (1 - math.sin(half)), reach)
        top[k] = min(feed**2, acceleration * radius)
    for order in (range(len(lengths) - 1, -1, -1), range(len(lengths))):
        for k in order:
            near, far = (k, k + 1) if order.step < 0 else (k + 1, k)
            top[near] = min(top[near], top[far] + 2 * acceleration * lengths[k])
    peak = np.minimum(feed**2, 0.5 * (top[1:] + top[:-1]) + acceleration * lengths)
    v, first, last = np.sqrt(peak), np.sqrt(top[:-1]), np.sqrt(top[1:])
    cruise = lengths - (2 * peak - top[1:] - top[:-1]) / (2 * acceleration)
    return float(((2 * v - first - last) / acceleration + cruise / v).sum())


@pytest.mark.validates(
    "time of random G-code paths",
    "a planner by junction deviation",
    "1e-4 relative",
)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_paths_take_the_time_of_a_planner_by_junction_deviation(seed):
    random = np.random.default_rng(seed)
    turns = np.cumsum(random.normal(0, 0.7, 400))
    lengths = random.uniform(0.5, 8, 400)
    points = np.vstack([[0, 0], np.cumsum(lengths[:, None] * np.column_stack([np.cos(turns), np.sin(turns)]), axis=0)])
    lines = [f"G1 X{x:.6f} Y{y:.6f} E1 F3600" for x, y in points[1:]]
    limits = "SET_VELOCITY_LIMIT ACCEL=3000 SQUARE_CORNER_VELOCITY=5"
    program = Program(text="\n".join([limits, "M83", *lines]))
    assert program.duration == pytest.approx(junction_planned(points, 60.0, 3000.0, 5.0), rel=1e-4)


def test_a_cap_of_the_speed_is_noted_with_its_cost():
    text = "G21 G90 G61\nG1 X100 F6000\nG1 X0\n"
    program = LinuxCNC(text=text, axis_speeds=(40.0, 40.0, 10.0), acceleration=4000)
    cost = 2 * (line_time(100, 0, 40, 0, 4000) - line_time(100, 0, 100, 0, 4000))
    assert program.needed_speeds["x"] == pytest.approx(40)
    note = program.notes[0]
    assert note.startswith("Feeds above the machine's speed (x 40, y 40, z 10 mm/s) are run at it")
    assert f"{cost:.3g} s longer" in note
    assert not any("machine's speed" in text for text in LinuxCNC(text=text, axis_speeds=(200.0, 200.0, 10.0)).notes)
