"""FANUC's spiral and conical interpolation: where a program runs, against closed forms and integrals."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.fanuc import Alarm, Arc, Line, Program, Rapid, Spiral
from gantrysim.job.job import Job

from support.soaked import examples

TABLE = 5e-4  # of the oracle table's lengths [mm]
POSITION = 1e-8  # [mm]
SIMPSON = 1e-9  # relative, of a length integrated over 2000 intervals a turn
TURNS = 1e-12
START = (0, 100, 0)
TOP = "N10 G17 G02 {} I0 J-100 F300"


def block(words, **parameters):
    return Program(TOP.format(words), start=START, **parameters)


def only(program):
    (piece,) = program.requested.pieces
    return piece


def end_of(program):
    return program.requested.position(program.requested.length)[0]


def integrated(radius, turns, rise=0.0):
    """Length of a spiral by Simpson's rule over its angle."""
    n = 2 * math.ceil(1000 * turns)
    phi = np.linspace(0, 2 * math.pi * turns, n + 1)
    growth = (radius[1] - radius[0]) / phi[-1]
    f = np.sqrt((radius[0] + growth * phi) ** 2 + growth**2 + (rise / phi[-1]) ** 2)
    return phi[1] / 3 * (f[0] + f[-1] + 4 * f[1::2].sum() + 2 * f[2:-1:2].sum())


@pytest.mark.validates(
    "spirals, cones and arcs of FANUC: end points, lengths, turns",
    "table of the specification",
    "its last digit",
)
@pytest.mark.parametrize(
    ("words", "turns", "radius", "flat", "space"),
    [
        ("X0 Y-30 Q-20", 3.5, 30, 1431.339, 1431.339),
        ("X0 Y-30 L4", 3.5, 30, 1431.339, 1431.339),
        ("X0 Y-50 L4", 3.5, 50, 1650.124, 1650.124),
        ("X0 Y-50 Q-14.2857", 3.5, 50, 1650.124, 1650.124),
        ("X0 Y-37.5 Z62.5 Q-25", 2.5, 37.5, 1081.871, 1083.816),
        ("X0 Y-37.5 Z62.5 K25", 2.5, 37.5, 1081.871, 1083.816),
        ("X0 Y-37.5 Z62.5 L3", 2.5, 37.5, 1081.871, 1083.816),
    ],
)
def test_the_oracle_table(words, turns, radius, flat, space):
    program = block(words)
    piece = only(program)
    assert -piece.angle / (2 * math.pi) == pytest.approx(turns, abs=TURNS)
    assert piece.radius == pytest.approx((100, radius), abs=POSITION)
    assert integrated((100, radius), turns) == pytest.approx(flat, abs=TABLE)
    assert program.requested.length == pytest.approx(space, abs=TABLE)
    assert program.requested.length == pytest.approx(integrated((100, radius), turns, piece.rise), rel=SIMPSON)


def test_quarter_points():
    expected = [(95, 0), (0, -90), (-85, 0), (0, 80), (75, 0), (0, -70), (-65, 0)]
    expected += [(0, 60), (55, 0), (0, -50), (-45, 0), (0, 40), (35, 0), (0, -30)]
    path = block("X0 Y-30 Q-20").requested
    lengths = [integrated((100, 100 - 5 * k), k / 4) for k in range(1, 15)]
    assert path.position(lengths)[:, :2] == pytest.approx(np.array(expected), abs=1e-5)


def test_an225_as_one_block():
    program = Program("G02 X40 Y0 I60 J0 Q-10 F6000")
    assert program.requested.length == pytest.approx(1006.183, abs=TABLE)
    assert -only(program).angle / (2 * math.pi) == pytest.approx(4, abs=TURNS)
    assert end_of(program) == pytest.approx([40, 0, 0], abs=POSITION)


def test_end_point_beyond_its_tolerance_is_an_alarm_and_within_it_is_spread_over_the_angle():
    message = (
        "alarm 5123 OVER TOLERANCE OF END POINT in block N10 (line 1): radius at the end = 30 mm by Q, 31 mm by the "
        "end point: difference 1 mm must be at most end_point_tolerance, 0.999 mm"
    )
    with pytest.raises(Alarm) as raised:
        block("X0 Y-31 Q-20", end_point_tolerance=0.999)
    assert str(raised.value) == message
    piece = only(block("X0 Y-31 Q-20", end_point_tolerance=1.0))
    assert piece.radius == pytest.approx((100, 31), abs=POSITION)
    assert -piece.angle / (2 * math.pi) == pytest.approx(3.5, abs=TURNS)


def test_height_beyond_its_tolerance_is_an_alarm():
    with pytest.raises(Alarm, match=r"height at the end = 62\.5 mm by K, 60 mm by the end point: difference 2\.5 mm"):
        block("X0 Y-37.5 Z60 K25")
    assert only(block("X0 Y-37.5 Z60 K25", end_point_tolerance=2.5)).rise == pytest.approx(60, abs=POSITION)


@pytest.mark.parametrize(
    ("words", "turns"),
    [
        ("X0 Y-30 Q-20 L9", 3.5),  # Q before L
        ("X0 Y-37.5 Z62.5 Q-25 L7", 2.5),
        ("X0 Y-37.5 Z62.5 K25 L7", 2.5),  # the height per turn before L
        ("X0 Y-37.5 Z62.5 L7", 6.5),
    ],
)
def test_the_first_in_rank_of_contradicting_words_applies(words, turns):
    assert -only(block(words)).angle / (2 * math.pi) == pytest.approx(turns, abs=TURNS)


def test_q_and_height_per_turn_that_disagree_are_over_the_tolerance():
    with pytest.raises(Alarm, match=r"height at the end = 37\.5 mm by K, 62\.5 mm by the end point"):
        block("X0 Y-37.5 Z62.5 Q-25 K15")


@given(st.floats(5, 200), st.floats(5, 200), st.integers(0, 6), st.floats(0.01, 1), st.booleans(), st.floats(-3.1, 3.1))
@examples(80)
def test_q_finds_the_turns_it_was_made_of(first, last, whole, part, clockwise, begin):
    """The end of a spiral of so many turns, whole ones included, as an operator would compute it."""
    part = 1.0 if part > 0.99 else part
    turns = whole + part
    change = (last - first) / turns
    sense = -1 if clockwise else 1
    start = cmath.rect(first, begin)
    end = cmath.rect(last, begin + sense * 2 * math.pi * part)
    blocks = [
        Spiral(
            end=(end.real, end.imag), centre=(-start.real, -start.imag), clockwise=clockwise, change=change, feed=600
        )
    ]
    if abs(change) < 0.05:
        return  # the radius hardly says how often it went round
    program = Program(tuple(blocks), start=(start.real, start.imag, 0))
    assert abs(only(program).angle) == pytest.approx(2 * math.pi * turns, abs=1e-8)
    assert program.requested.length == pytest.approx(integrated((first, last), turns), rel=1e-7)
    assert end_of(program) == pytest.approx([end.real, end.imag, 0], abs=1e-7)


ROUNDED = [(40 + off, across) for off in (-4e-4, 4e-4) for across in (-4e-4, 0.0, 4e-4)]


@pytest.mark.parametrize("end", ROUNDED)
def test_an_end_point_rounded_to_microns_does_not_lose_or_gain_a_turn(end):
    program = Program(f"G02 X{end[0]:.4f} Y{end[1]:.4f} I60 J0 Q-10 F600")
    assert -only(program).angle / (2 * math.pi) == pytest.approx(4, abs=1e-4)


@pytest.mark.parametrize("clockwise", [True, False])
def test_arcs_by_radius_are_at_most_half_a_circle_or_more(clockwise):
    for radius in (10, -10):
        piece = only(Program((Arc(end=(10, 10), radius=radius, clockwise=clockwise, feed=100),)))
        swept = 0.5 * math.pi if radius > 0 else 1.5 * math.pi
        assert piece.angle == pytest.approx((-1 if clockwise else 1) * swept)
        assert piece.radius == pytest.approx((10, 10))


def test_an_arc_that_ends_where_it_starts_is_a_full_circle():
    program = Program("G03 X0 Y0 I-5 F100")
    assert program.requested.length == pytest.approx(10 * math.pi)
    assert program.requested.position(2.5 * math.pi)[0] == pytest.approx([-5, 5, 0], abs=POSITION)


PLANES = {"G17": (0, 1, 2), "G18": (2, 0, 1), "G19": (1, 2, 0)}


@pytest.mark.parametrize("code", ["G18", "G19"])
@pytest.mark.parametrize("words", [(0, -37.5, 62.5, "Q-25"), (0, -37.5, 62.5, "L3"), (0, -30, None, "Q-20")])
def test_the_other_planes_are_the_first_with_axes_permuted(code, words):
    first, second, across = PLANES[code]
    x, y, z, rest = words

    def text(i, j, k):
        ends, centres = "XYZ", "IJK"
        height = "" if z is None else f"{ends[k]}{z}"
        return f"{ends[i]}{x} {ends[j]}{y} {height} {centres[i]}0 {centres[j]}-100 {rest} F600"

    flat = Program(f"G17 G02 {text(0, 1, 2)}", start=START)
    start = [0.0, 0.0, 0.0]
    start[second] = 100.0
    tilted = Program(f"{code} G02 {text(first, second, across)}", start=tuple(start))
    assert tilted.axes == ("x", "y", "z")
    s = np.linspace(0, flat.requested.length, 200)
    assert tilted.requested.position(s)[:, [first, second, across]] == pytest.approx(
        flat.requested.position(s), abs=POSITION
    )
    assert tilted.duration == pytest.approx(flat.duration)


def test_text_and_values_are_the_same():
    text = Program(
        "G17 G00 X0 Y100\nG02 X0 Y-37.5 Z62.5 I0 J-100 Q-25 C90 F300\nG03 X10 Y-27.5 I0 J10\nG01 X0 Y0 F600\n"
    )
    values = Program(
        (
            Rapid(end=(0, 100)),
            Spiral(end=(0, -37.5, 62.5), centre=(0, -100), change=-25, rotary=90, feed=300),
            Arc(end=(10, -27.5), centre=(0, 10), clockwise=False),
            Line(end=(0, 0), feed=600),
        )
    )
    assert text.axes == values.axes == ("x", "y", "z", "r")
    assert text.requested.parameters() == values.requested.parameters()
    assert np.array_equal(text.setpoints(0.1).position, values.setpoints(0.1).position)


ABSOLUTE = "G90 G01 X10 Y5 F600\nG02 X20 Y5 I5\nG03 X20 Y65 I0 J-20 Q10\nG00 X0 Y0 Z3"
INCREMENTAL = "G91 G01 X10 Y5 F600\nG02 X10 I5\nG03 Y60 I0 J-20 Q10\nG00 X-20 Y-65 Z3"


def test_absolute_and_incremental_are_the_same():
    a, b = (Program(text, end_point_tolerance=20) for text in (ABSOLUTE, INCREMENTAL))
    s = np.linspace(0, a.requested.length, 500)
    assert a.requested.length == pytest.approx(b.requested.length)
    assert a.requested.position(s) == pytest.approx(b.requested.position(s), abs=POSITION)


def test_inches_are_millimetres():
    inch = Program("G20 G02 X0 Y-1 I0 J-4 Q-1 F10", start=(0, 4 * 25.4, 0), end_point_tolerance=100)
    metric = Program("G02 X0 Y-25.4 I0 J-101.6 Q-25.4 F254", start=(0, 101.6, 0), end_point_tolerance=100)
    assert inch.requested.length == pytest.approx(metric.requested.length)
    assert inch.duration == pytest.approx(metric.duration)


def turned(turn, shift, **parameters):
    """Setpoints of a spiral, a line and an arc, all turned and shifted."""

    def pair(z):
        return z.real, z.imag

    start, first, second, third = (pair(z * turn + shift) for z in (100j, -30j, 40 + 10j, 60 + 10j))
    blocks = (
        Spiral(end=first, centre=pair(-100j * turn), change=-20, feed=6000),
        Line(end=second),
        Arc(end=third, centre=pair(10 * turn)),
    )
    return Program(blocks, start=(*start, 0), **parameters).setpoints(0.01).position @ [1, 1j]


@given(st.floats(-math.pi, math.pi), st.complex_numbers(max_magnitude=100))
@examples(30)
def test_turned_and_shifted_programs_give_turned_and_shifted_setpoints(angle, shift):
    turn = cmath.rect(1, angle)
    assert turned(turn, shift) == pytest.approx(turned(1, 0) * turn + shift, abs=1e-6)


@given(st.complex_numbers(max_magnitude=100))
@examples(30)
def test_shifted_programs_of_limited_acceleration_give_shifted_setpoints(shift):
    assert turned(1, shift, acceleration=1000) == pytest.approx(turned(1, 0, acceleration=1000) + shift, abs=1e-4)


def test_a_job_of_fanuc_keeps_its_program_through_toml(tmp_path):
    path = tmp_path / "spiral.toml"
    path.write_text(
        'name = "spiral"\nmachine = "xy"\n[program]\ncontroller = "fanuc.Program"\n'
        'start = [0.0, 100.0, 0.0]\nprogram = """\n%\nO1\nN10 G02 X0 Y-30 I0 J-100 Q-20 F9000\n%\n"""\n'
    )
    job = Job.load(str(path))
    path.write_text(job.toml())
    again = Job.load(str(path))
    assert again.program == job.program
    assert again.controller.requested.length == pytest.approx(1431.339, abs=TABLE)


def test_objects_that_are_not_blocks_are_refused():
    with pytest.raises(ValueError, match="must be a Rapid, Line, Arc, Spiral or Dwell"):
        Program(("G01 X5",))


def test_an_alarm_quotes_no_more_than_a_line():
    with pytest.raises(Alarm) as refused:
        Program("G90 G01 X10 F1000\n10.0," + "É" * 5000)
    assert len(str(refused.value)) < 300


def test_blocks_are_those_that_were_given_whatever_becomes_of_their_list():
    given = [Line(end=(0, 50, 0), feed=600.0), Line(end=(30, 50, 0), feed=600.0)]
    program = Program(given, start=START)
    once = Program(iter(given), start=START)
    given.clear()
    assert program.program == once.program
    assert len(program.program) == 2
    assert program.requested.length == once.requested.length == pytest.approx(80)
