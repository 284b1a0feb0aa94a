"""Speeds along merged moves of Trio BASIC: corners, small circles and SP moves, against closed forms of the path."""

import math

import numpy as np
import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import Basic, InterpreterTime

DT = 0.001
ACCEL = 1000.0
NO_TIME = InterpreterTime(0, 0, 0, 0)
EXACT = 1e-6  # of distances; a stop at a corner is met to 1e-12 of the way, and so to 1e-8 s [mm]


def basic(text, **changed):
    values = {"text": text, "interpreter_time": NO_TIME, "initial_acceleration": ACCEL, "buffers": 8}
    return Basic(**{**values, **changed})


def along(position):
    """Distance along a path of straight lines, from positions at every tick that include no corner between ticks."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))])


class Phases:
    """Phases of constant acceleration, one after the other: the closed form of distance and duration."""

    def __init__(self):
        self.parts = []
        self.v = 0.0

    def to_speed(self, v, rate=ACCEL):
        self.parts.append((abs(v - self.v) / rate, math.copysign(rate, v - self.v), self.v))
        self.v = v
        return self

    def stretch(self, length, v, end, rate=ACCEL):
        """A move of a length: to its speed, along, and to the speed at its end."""
        ramps = (abs(v**2 - self.v**2) + abs(v**2 - end**2)) / (2 * rate)
        self.to_speed(v, rate)
        self.parts.append(((length - ramps) / v, 0.0, v))
        return self.to_speed(end, rate)

    @property
    def duration(self):
        return sum(part[0] for part in self.parts)

    def distance(self, times):
        total = np.zeros(len(times))
        begin = 0.0
        for duration, rate, v in self.parts:
            t = np.clip(times - begin, 0.0, duration)
            total += v * t + 0.5 * rate * t**2
            begin += duration
        return total


def corner(degrees, rules="CORNER_MODE=2: DECEL_ANGLE=25*PI/180: STOP_ANGLE=90*PI/180"):
    turn = math.radians(degrees)
    second = f"MOVE({50 * math.cos(turn):.17g},{50 * math.sin(turn):.17g})"
    return f"BASE(0,1): MERGE=ON: SPEED=100: {rules}\nMOVE(50,0): {second}: WAIT IDLE"


@pytest.mark.parametrize(
    ("degrees", "share"), [(20, 1.0), (25, 1.0), (45, 45 / 65), (57.5, 0.5), (89, 1 / 65), (90, 0.0), (180, 0.0)]
)
def test_the_speed_at_a_corner_falls_between_decel_angle_and_stop_angle(degrees, share):
    program = basic(corner(degrees))
    law = Phases().stretch(50, 100, 100 * share).stretch(50, 100, 0)
    position = program.setpoints(DT).position
    times = np.arange(len(position)) * DT
    s = law.distance(times)
    turn = math.radians(degrees)
    first = np.minimum(s, 50)
    second = s - first
    expected = np.column_stack([first + second * math.cos(turn), second * math.sin(turn)])
    assert position == pytest.approx(expected, abs=EXACT)
    assert law.duration - DT < program.duration < law.duration + 2 * DT
    assert program.requested.length == pytest.approx(100)


def test_without_corner_mode_merged_moves_turn_at_full_speed():
    free = basic(corner(90, rules="DECEL_ANGLE=0.1: STOP_ANGLE=0.2"))
    assert free.duration == pytest.approx(Phases().stretch(100, 100, 0).duration, abs=2 * DT)
    stopped = basic(corner(90).replace("MERGE=ON", "MERGE=OFF"))
    assert stopped.duration == pytest.approx(2 * Phases().stretch(50, 100, 0).duration, abs=3 * DT)


@pytest.mark.parametrize(("radius", "share"), [(8, 1.0), (6, 1.0), (3, 0.5), (1.5, 0.25)])
def test_a_circle_below_full_sp_radius_is_run_in_proportion_to_its_radius(radius, share):
    text = "BASE(0,1): MERGE=ON: SPEED=40: CORNER_MODE=8: FULL_SP_RADIUS=6\n"
    text += f"MOVE(20,0): MOVECIRC({radius},{radius},0,{radius},0): MOVE(0,20): WAIT IDLE"
    program = basic(text)
    arc = 0.5 * math.pi * radius
    law = Phases().stretch(20, 40, 40 * share).stretch(arc, 40 * share, 40 * share).stretch(20, 40, 0)
    position = program.setpoints(DT).position
    s = law.distance(np.arange(len(position)) * DT)
    assert position[s <= 20, 0] == pytest.approx(s[s <= 20], abs=EXACT)
    assert position[s >= 20 + arc, 1] == pytest.approx(s[s >= 20 + arc] - 20 - arc + radius, abs=EXACT)
    inside = (s > 20) & (s < 20 + arc)
    angle = (s[inside] - 20) / radius
    assert position[inside] == pytest.approx(
        np.column_stack([20 + radius * np.sin(angle), radius * (1 - np.cos(angle))]), abs=EXACT
    )
    assert program.duration == pytest.approx(law.duration, abs=2 * DT)


@pytest.mark.parametrize(
    ("first", "second", "joint"),
    [
        ("FORCE_SPEED=80: ENDMOVE_SPEED=30", "FORCE_SPEED=30", 30),
        ("FORCE_SPEED=80: ENDMOVE_SPEED=30", "FORCE_SPEED=60: STARTMOVE_SPEED=20", 20),
        ("FORCE_SPEED=80: ENDMOVE_SPEED=1000", "FORCE_SPEED=80: STARTMOVE_SPEED=45", 45),
        ("FORCE_SPEED=80: ENDMOVE_SPEED=0", "FORCE_SPEED=50", 0),
    ],
)
def test_sp_moves_have_speeds_of_their_own_that_are_buffered_with_them(first, second, joint):
    text = f"MERGE=ON: SPEED=10\n{first}\nMOVESP(30)\n{second}\nMOVEABSSP(60)\nFORCE_SPEED=1\nWAIT IDLE"
    program = basic(text)
    speed = float(second.split(":")[0].split("=")[1])
    law = Phases().stretch(30, 80, joint).stretch(30, speed, 0)
    position = program.setpoints(DT).position[:, 0]
    assert position == pytest.approx(law.distance(np.arange(len(position)) * DT), abs=EXACT)
    assert program.duration == pytest.approx(law.duration, abs=2 * DT)


def test_a_lower_force_speed_acts_in_its_own_move_alone():
    """Only ENDMOVE_SPEED, STARTMOVE_SPEED, corners and circles make the axis brake before a joint."""
    program = basic("MERGE=ON: FORCE_SPEED=80: MOVESP(30): FORCE_SPEED=40: MOVESP(30): WAIT IDLE")
    position = program.setpoints(DT).position
    law = Phases().stretch(30, 80, 80).stretch(30, 40, 0)
    assert position[:, 0] == pytest.approx(law.distance(np.arange(len(position)) * DT), abs=EXACT)


def test_sp_moves_without_a_speed_of_their_own_run_at_speed_and_name_their_type():
    program = basic("SPEED=70: PRINT FORCE_SPEED[0];ENDMOVE_SPEED[0]: MOVESP(40): PRINT MTYPE[0]: WAIT IDLE")
    assert program.duration == pytest.approx(Phases().stretch(40, 70, 0).duration, abs=2 * DT)
    assert [line.text for line in program.printed] == ["7070", "6"]
    kinds = basic(
        "BASE(0,1,2): SPEED=500: MOVEABSSP(1,1): PRINT MTYPE[0]: WAIT IDLE\n"
        "MOVECIRCSP(0,0,2,0,1): PRINT MTYPE[0]: WAIT IDLE\nMHELICALSP(0,0,2,0,1,3): PRINT MTYPE[0]: WAIT IDLE"
    )
    assert [line.text for line in kinds.printed] == ["7", "8", "9"]
    assert kinds.setpoints(DT).position[-1] == pytest.approx([1, 1, 3], abs=EXACT)


def test_without_a_limit_of_accel_the_speed_steps_at_the_corner():
    text = corner(57.5).replace("SPEED=100", "SPEED=100: ACCEL=500")
    position = basic(text, initial_acceleration=math.inf).setpoints(DT).position
    s = along(position)
    law = Phases()
    for length in (50.0, 50.0):
        law.parts.append((length / 100, 0.0, 100.0))
    # with ACCEL = 500 and no limit of DECEL: up to 100, down to 50 at once, up again, and a stop at once
    law.parts = [(0.2, 500.0, 0.0), (0.4, 0.0, 100.0), (0.1, 500.0, 50.0), (42.5 / 100, 0.0, 100.0)]
    expected = law.distance(np.arange(len(position)) * DT)
    assert np.abs(s - expected).max() < 0.1 * (1 - math.cos(math.radians(57.5) / 2)) + EXACT  # the tick of the corner
    assert s[-1] == pytest.approx(100, abs=0.1)


def test_periods_run_at_once_and_one_by_one_are_the_same_to_the_last_bit():
    """A process that polls makes the motion run tick by tick."""
    square = "BASE(0,1): MERGE=ON: SPEED=100: CORNER_MODE=10: DECEL_ANGLE=0.3: STOP_ANGLE=2: FULL_SP_RADIUS=9\n"
    square += "MOVE(30,0): MOVECIRC(6,6,0,6,0): MOVE(0,20): MOVE(-20,3): MOVESP(1,-9): "
    positions = [basic(square + wait).setpoints(DT).position for wait in ("WAIT IDLE", "WAIT UNTIL IDLE")]
    assert len(positions[0]) > 500
    assert np.array_equal(positions[0], positions[1])


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("x=1\nCORNER_MODE=4", r"line 2: CORNER_MODE = 4 of axis 0: must be a sum of 2 \(DECEL_ANGLE and"),
        ("FORCE_SPEED=-1", r"line 1: FORCE_SPEED = -1 of axis 0: must be at least 0$"),
        ("STOP_ANGLE AXIS(2)=-1", r"line 1: STOP_ANGLE = -1 of axis 2: must be at least 0$"),
        ("LIMIT_BUFFERED=0", r"line 1: LIMIT_BUFFERED = 0: must be a whole number from 1 to 64$"),
        ("MOVECIRCSP(1,0,3,0)", r"line 1: MOVECIRCSP with 4 values: must have 5$"),
    ],
)
def test_values_that_are_refused_name_their_line(text, error):
    with pytest.raises(InputError, match=f"^{error}"):
        basic(text).setpoints(DT)


def test_limit_buffered_lets_more_moves_merge():
    text = "LIMIT_BUFFERED={}: MERGE=ON: SPEED=100\nMOVE(2): MOVE(2): MOVE(2): MOVE(2): MOVE(2): WAIT IDLE"
    durations = [basic(text.format(count), buffers=1).duration for count in (1, 8)]
    assert durations[1] == pytest.approx(2 * math.sqrt(10 / ACCEL), abs=2 * DT)
    assert durations[0] > durations[1] + 5 * DT
