"""What E feeds: distances, retraction, flow factor; pressure advance against the firmware's formulas."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import quad

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.slicer import Program
from gantrysim.glue.dispenser.command import Material

from support.soaked import examples

SIDE = 40.0  # of the square [mm]
FEED = 50.0  # [mm/s]
ACCELERATION = 1500.0  # [mm/s²]
CORNER = 5.0  # speed at a right angle [mm/s]
RATE = 0.05  # filament per path
MARLIN_CORNER = f"M205 X{CORNER:g} Y{CORNER:g}"
KLIPPER_CORNER = f"SET_VELOCITY_LIMIT SQUARE_CORNER_VELOCITY={CORNER:g}"
SQUARE = f"""M83
M204 S{ACCELERATION:g}
G1 X{SIDE} E{RATE * SIDE} F{60 * FEED:g}
G1 Y{SIDE} E{RATE * SIDE}
G1 X0 E{RATE * SIDE}
G1 Y0 E{RATE * SIDE}
"""


def fed(text, **options):
    """Return what a program feeds, move by move [mm]."""
    moves = Program(text=text, **options).program.moves
    return [round(flow, 9) for flow in moves[:, 13]]


class Square:
    """The square's filament over time, from rest to rest and with the corner's speed in between: trapezoids."""

    def __init__(self):
        self.knots = [(0.0, 0.0, 0.0, 0.0)]  # time, position, speed, acceleration from there on
        for begin, end in ((0.0, CORNER), (CORNER, CORNER), (CORNER, CORNER), (CORNER, 0.0)):
            rising = (FEED**2 - begin**2) / (2 * ACCELERATION)
            falling = (FEED**2 - end**2) / (2 * ACCELERATION)
            self.add((FEED - begin) / ACCELERATION, begin, ACCELERATION)
            self.add((SIDE - rising - falling) / FEED, FEED, 0.0)
            self.add((FEED - end) / ACCELERATION, FEED, -ACCELERATION)
        self.duration = self.knots[-1][0]

    def add(self, duration, speed, acceleration):
        time, place, *_ = self.knots.pop()
        self.knots.append((time, place, RATE * speed, RATE * acceleration))
        length = speed * duration + 0.5 * acceleration * duration**2
        self.knots.append((time + duration, place + RATE * length, 0.0, 0.0))

    def at(self, t):
        """Position and velocity at a time."""
        if t <= 0:
            return 0.0, 0.0
        time, place, speed, change = next(knot for knot in reversed(self.knots) if knot[0] <= t)
        elapsed = t - time
        return place + elapsed * (speed + 0.5 * change * elapsed), speed + change * elapsed

    def smoothed(self, value, t, smooth_time):
        """Klipper's average of a function of time with the weight T/2 - |t - x|, by adaptive quadrature."""
        half = 0.5 * smooth_time
        inner = sorted({t, *(knot[0] for knot in self.knots if abs(knot[0] - t) < half)})
        edges = [t - half, *inner, t + half]
        parts = [
            quad(lambda x: value(x) * (half - abs(t - x)), a, b, epsabs=1e-13)[0] for a, b in itertools.pairwise(edges)
        ]
        return sum(parts) / half**2


def test_marlin_s_linear_advance_adds_k_times_the_speed_of_the_filament():
    square = Square()
    points = Program(text=f"{MARLIN_CORNER}\nM900 K0.08\n{SQUARE}").setpoints(1e-3)
    time = points.time[:-1]
    expected = [place + 0.08 * speed for place, speed in map(square.at, time)]
    assert points.extruder is not None
    # where the acceleration jumps the speed is the same on both sides, but for the begin
    np.testing.assert_allclose(points.extruder[:-1], expected, rtol=0, atol=1e-6)
    assert points.extrusion[-1] == pytest.approx(4 * SIDE * RATE, abs=1e-9)


@pytest.mark.parametrize("smooth_time", [0.02, 0.04])
def test_klipper_s_pressure_advance_is_averaged(smooth_time):
    square = Square()
    text = f"{KLIPPER_CORNER}\nSET_PRESSURE_ADVANCE ADVANCE=0.08 SMOOTH_TIME={smooth_time}\n{SQUARE}"
    points = Program(text=text).setpoints(1e-3)

    def advanced(x):
        place, speed = square.at(x)
        return place + 0.08 * speed

    chosen = [*range(0, len(points.time), 37), *range(780, 860), len(points.time) - 1]
    expected = [square.smoothed(advanced, points.time[k], smooth_time) for k in chosen]
    assert points.extruder is not None
    np.testing.assert_allclose(points.extruder[chosen], expected, rtol=0, atol=1e-6)
    # the average ends after the motion
    assert points.extruder[-1] == pytest.approx(4 * SIDE * RATE, abs=1e-9)


@pytest.mark.parametrize(
    ("law", "shape"), [("tanh", np.tanh), ("reciprocal", lambda ratio: 1 - 1 / (1 + ratio))], ids=["tanh", "reciprocal"]
)
def test_the_non_linear_laws_act_on_the_averaged_speed(law, shape):
    square = Square()
    text = f"{KLIPPER_CORNER}\nSET_PRESSURE_ADVANCE ADVANCE=0.02 OFFSET=0.1 VELOCITY=1.5 SMOOTH_TIME=0.02\n{SQUARE}"
    points = Program(text=text, advance_law=law).setpoints(1e-3)
    chosen = [*range(5, len(points.time), 41)]
    expected = []
    for k in chosen:
        place = square.smoothed(lambda x: square.at(x)[0], points.time[k], 0.02)
        speed = square.smoothed(lambda x: square.at(x)[1], points.time[k], 0.02)
        expected.append(place + 0.02 * speed + 0.1 * shape(speed / 1.5))
    assert points.extruder is not None
    np.testing.assert_allclose(points.extruder[chosen], expected, rtol=0, atol=1e-6)


def test_reprapfirmware_s_pressure_advance_is_marlin_s():
    marlin, reprap = (
        Program(text=f"{MARLIN_CORNER}\n{word}\n{SQUARE}").setpoints(1e-3).extruder
        for word in ("M900 K0.05", "M572 D0 S0.05")
    )
    np.testing.assert_array_equal(marlin, reprap)


def test_only_moves_along_the_work_are_advanced():
    text = "M900 K0.1\nM83\nG1 X10 E1 F600\nG1 E-2 F1800\nG0 X20 F6000\nG1 E2 F1800\nG1 Z5 E1 F600"
    points = Program(text=text).setpoints(1e-3)
    ahead = points.extruder - points.extrusion
    x = points.position[:, 0]
    assert ahead[(x > 1) & (x < 9)] == pytest.approx(0.1 * 1.0)  # 1 mm/s of filament
    assert not ahead[x > 10.01].any()


def test_an_advance_holds_from_its_line_on():
    text = "M83\nG1 X10 E1 F600\nM900 K0.1\nG1 X20 E1\nM900 K0\nG1 X30 E1"
    points = Program(text=text).setpoints(1e-3)
    ahead = points.extruder - points.extrusion
    x = points.position[:, 0]
    assert not ahead[(x < 9.9) | (x > 20.1)].any()
    assert ahead[(x > 11) & (x < 19)] == pytest.approx(0.1)


def test_without_an_advance_the_motor_is_sent_to_e():
    points = Program(text=SQUARE).setpoints(1e-3)
    assert points.extruder is None
    assert Program(text="G1 X10 F600").setpoints(1e-3).extrusion is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G1 X1 E1 F60\nG1 X2 E3", [1, 2]),
        ("M82\nG1 X1 E1 F60\nG1 X2 E3\nG1 X3 E4", [1, 2, 1]),
        ("M83\nG1 X1 E1 F60\nG1 X2 E3", [1, 3]),
        ("G1 X1 E1 F60\nG92 E0\nG1 X2 E3", [1, 3]),
        ("M221 S50\nM83\nG1 X1 E1 F60\nG1 E-2\nM221 S100\nG1 X2 E1", [0.5, -1, 1]),
        ("G20\nM83\nG1 X1 E1 F60", [25.4]),
        # E of 2.405 mm³ is 1 mm of filament of 1.75 mm
        (f"M200 D1.75\nM83\nG1 X1 E{math.pi * 1.75**2 / 4} F60\nM200 D0\nG1 X2 E1", [1, 1]),
        # words of axes that stand where they are: E alone moves, and takes its time
        ("M83\nG1 X1 F60\nG1 X1 E1\nG1 X2 E1", [0, 1, 1]),
        # no feed was given for the retraction
        ("M83\nG1 E-1\nG1 X1 E1 F60", [-1, 1]),
    ],
)
def test_words_feed_what_firmware_feeds(text, expected):
    assert fed(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("firmware", "expected"), [("marlin", [1, 1]), ("klipper", [1, 2]), ("reprapfirmware", [1, 2])]
)
def test_g90_makes_e_absolute_in_marlin_alone(firmware, expected):
    assert fed("M83\nG1 X1 E1 F60\nG90\nG1 X2 E2", firmware=firmware) == expected


@pytest.mark.parametrize(
    ("firmware", "expected"), [("marlin", [1, 2]), ("klipper", [1, 2]), ("reprapfirmware", [1, 1])]
)
def test_g91_makes_e_relative_in_marlin_and_klipper(firmware, expected):
    assert fed("M82\nG1 X1 E1 F60\nG91\nG1 X2 E2", firmware=firmware) == expected


@pytest.mark.parametrize(
    ("comment", "expected"),
    [
        ("; gcode_flavor = klipper", [1, 2]),
        (";FLAVOR:Marlin", [1, 1]),
        ("; gcode_flavor = marlin2", [1, 1]),
        ("; gcode_flavor = reprapfirmware", [1, 2]),
        ("EXCLUDE_OBJECT_START NAME=a", [1, 2]),
        ("M572 D0 S0", [1, 2]),
        ("", [1, 1]),
    ],
)
def test_the_firmware_is_read_off_the_program(comment, expected):
    assert fed(f"{comment}\nM83\nG1 X1 E1 F60\nG90\nG1 X2 E2") == expected


def test_firmware_retracts_and_recovers_once():
    text = "M207 S2 F1800\nM208 S0.5 F600\nM83\nG1 X1 E1 F60\nG10\nG10\nG0 X5\nG11\nG11\nG1 X6 E1"
    program = Program(text=text)
    assert fed(text) == [1, -2, 0, 2.5, 1]
    dwells = program.program.moves[[1, 3], 8]
    assert dwells == pytest.approx([2 / 30, 2.5 / 10])


@pytest.mark.parametrize(
    ("settings", "dwells"),
    [
        ("M207 S2", [2 / 10, 2 / 10]),
        ("M207 S2 F1800", [2 / 30, 2 / 10]),
        ("M207 S2\nM208 F1200", [2 / 10, 2 / 20]),
        ("SET_RETRACTION RETRACT_LENGTH=2", [2 / 10, 2 / 10]),
    ],
)
def test_retraction_without_a_speed_has_that_of_the_feed_and_nothing_extra(settings, dwells):
    text = f"{settings}\nM83\nG1 X1 E1 F600\nG10\nG0 X5\nG11"
    assert fed(text) == [1, -2, 0, 2]
    assert Program(text=text).program.moves[[1, 3], 8] == pytest.approx(dwells)


def test_klipper_s_retraction_has_names():
    text = "SET_RETRACTION RETRACT_LENGTH=1.5 UNRETRACT_EXTRA_LENGTH=0.1\nM83\nG1 X1 E1 F60\nG10\nG0 X5\nG11"
    assert fed(text) == pytest.approx([1, -1.5, 0, 1.6])


@pytest.mark.parametrize(("retract", "recover"), [("G10", "G11"), ("G22", "G23")])
def test_a_retraction_of_unknown_length_is_said_and_takes_no_time(retract, recover):
    program = Program(text=f"M83\nG1 X1 E1 F60\n{retract}\nG0 X5\n{recover}")
    assert fed(program.text) == [1, 0]
    for name in (retract, recover):
        assert f"{name}, whose length the program does not state (1)" in program.notes[0]


def test_retraction_beside_dwells_keeps_the_position():
    text = "M83\nG1 X10 E1 F600\nG4 P100\nG1 E-0.5 F1800\nG4 P100\nG0 X20\nG1 E0.5\nG1 X30 E1"
    points = Program(text=text).setpoints(1e-3)
    x = points.position[:, 0]
    assert points.extrusion[(x > 10.1) & (x < 19.9)] == pytest.approx(0.5)
    assert points.extrusion[-1] == pytest.approx(2.0)
    assert points.extrusion.max() == pytest.approx(2.0)


def test_holds_and_parts_keep_what_is_fed():
    points = Program(text=f"M900 K0.05\n{SQUARE}").setpoints(1e-3)
    held = points.wait(0.1).hold(0.2)
    assert held.extrusion[:101].tolist() == [0.0] * 101
    assert held.extrusion[-200:].tolist() == [points.extrusion[-1]] * 200
    assert len(held.extruder) == len(held.time)
    np.testing.assert_array_equal(points.part(slice(10, 50)).extruder, points.extruder[10:50])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("M900 K-1", "line 1: pressure advance = -1 s: must be at least 0 s"),
        ("SET_PRESSURE_ADVANCE ADVANCE=x", "line 1: ADVANCE = X: must be a number"),
        ("SET_PRESSURE_ADVANCE ADVANCE=0.1 SMOOTH_TIME=1", "line 1: SMOOTH_TIME = 1 s: must be at most 0.2 s"),
        ("M221 S-5", "line 1: M221: S = -5 %: must be at least 0 %"),
    ],
)
def test_bad_values_are_refused(line, message):
    with pytest.raises(InputError, match=message):
        _ = Program(text=f"{line}\nG1 X1 E1 F60").duration


def test_g90_after_m83_is_told_where_it_makes_e_absolute():
    """Once two of three dots of E0.5 vanished without a word."""
    text = "M83\nG90\nG1 X1 E0.5 F60\nG1 X2 E0.5"

    def told(text, **options):
        return [note for note in Program(text=text, **options).notes if note.startswith("G90 after M83")]

    assert told(text) == [
        "G90 after M83 makes E absolute, as in Marlin, and 2 E words follow: M83 after G90, or "
        'program.firmware = "klipper" or "reprapfirmware", keeps E relative.'
    ]
    assert not told(text, firmware="klipper")
    assert not told("G90\nM83\nG1 X1 E0.5 F60")
    assert not told("M83\nG91\nG1 Z1 F60\nG90\nM83\nG1 X2 E0.5")
    assert not told("M83\nG1 X1 E0.5 F60\nG90\nM82\nG1 X2 E0.5")
    assert told("M83\nG91\nG1 Z1 F60\nG90\nG1 X2 E0.5")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("G1 X50 E2.5 F600\nG1 X100 E2.5", "E feeds 5 mm, 0.05 to 0.05 mm per mm of the lines (5 to 95 %)."),
        (
            "G1 X50 E2.5 F600\nG1 X100 E5",
            "E feeds 7.5 mm, 0.05 to 0.1 mm per mm of the lines (5 to 95 %). "
            "The verdict compares all of them with one section, their median.",
        ),
        ("G1 X50 F600\nG1 E0.5\nG1 E-0.5\nG1 X0\nG1 E0.8", "E feeds 0.8 mm, none of it in lines."),
    ],
)
def test_the_amounts_of_e_are_those_of_the_lines(text, told):
    """Once 0.0525 to 0.0975 of two lines with 0.05 and 0.1."""
    assert Program(text=f"M83\n{text}").notes[-1] == told


@examples(25)
@example([(0.0625, 0.03125, 3613.0)], 1e-3, True)
@example([(0.25, 0.0, 1200.0)], 2.5e-4, True)
@given(
    st.lists(st.tuples(st.floats(0.002, 0.3), st.floats(0.0, 0.3), st.floats(1200.0, 12000.0)), min_size=1, max_size=8),
    st.sampled_from([2.5e-4, 1e-3, 1.3e-3]),
    st.booleans(),
)
def test_dots_of_e_have_the_volume_of_their_words_whatever_the_tick_s_phase(dots, period, ends_in_retraction):
    """E's highest place is the sum of the amounts beyond the retractions, and its end the sum of all words."""
    lines = ["M83", "G1 X1 F3000"]
    pulled = 0.0
    for k, (amount, back, feed) in enumerate(dots):
        lines += [f"G0 X{k + 2}", f"G1 E{pulled + amount:.6f} F{feed:.3f}", f"G1 E{-back:.6f} F{feed:.3f}"]
        pulled = back
    if not ends_in_retraction:
        lines.append("G0 X50")
    points = Program(text="\n".join(lines)).setpoints(period)
    total = sum(round(amount, 6) for amount, _, _ in dots)
    laid = Material(points.extrusion).laid()
    np.testing.assert_allclose(laid.sum(), total, atol=1e-5, rtol=0)
    # while the dispenser is on, dot by dot
    on = points.dispense
    begins = np.flatnonzero(on & ~np.append(False, on[:-1]))
    each = np.add.reduceat(laid, begins)
    np.testing.assert_allclose(each, [round(amount, 6) for amount, _, _ in dots], atol=1e-5, rtol=0)
    assert laid[~on].sum() == pytest.approx(0.0, abs=1e-5)
    assert points.extrusion[-1] == pytest.approx(total - dots[-1][1], abs=1e-5)


def test_a_dot_of_e_begins_and_ends_at_ticks():
    """A dot of 0.1 mm at 100 mm/s from 2.6 to 3.6 ms, where E is for no time: from the tick at 3 ms to that at 4 ms."""
    program = Program(text="M83\nG4 P2.6\nG1 E0.1 F6000\nG1 E-0.1\nG1 X10 F3000")
    points = program.setpoints(1e-3)
    assert points.extrusion[:7] == pytest.approx([0, 0, 0, 0, 0.1, 0, 0], abs=1e-9)
    assert np.flatnonzero(points.dispense[:7]).tolist() == [3]
