"""FANUC's program text: files of blocks, and every alarm with its words."""

import math
import pickle

import numpy as np
import pytest

from gantrysim.controllers.fanuc import Alarm, Program

FILE = """%
O1234 (PART 7; two spirals)
N10 G17 G21 G90 G40 G94 G64 S800
(start above the part)

N20 g00x0y100
N30 G02 X0 Y-30 I0 J-100 Q-20 F3000 ; N40 G04 P500
/N50 G01 X500 Y500
N60G01X10.Y-30.
N70 G03 X20 Y-20 R10
N80 G61 G01 Y0 G54
N90 G91 X-5 F1500
N100 G90 G18 G00 Z5
N110 G19
N120 G17 G02 X15 Y0 I10 J0
N130 M30
%
"""


def test_a_file_of_mixed_blocks_runs():
    program = Program(FILE, block_skip=True, acceleration=2000)
    position = program.setpoints(0.002).position
    assert program.axes == ("x", "y", "z")
    assert position[0] == pytest.approx([0, 0, 0], abs=1e-12)
    assert position[-1] == pytest.approx([15, 0, 5], abs=1e-9)
    assert np.ptp(position[:, 0]) < 200


def test_block_skip_is_a_switch():
    assert Program(FILE, block_skip=True).requested.length < Program(FILE, block_skip=False).requested.length


def test_layout_has_no_effect():
    spread = Program("N1 G17 G02 X0 Y-30 (in) I0 J-100 Q-20 F300", start=(0, 100, 0))
    dense = Program("n1g17g02x0y-30i0j-100q-20f300;", start=(0, 100, 0))
    assert dense.requested.parameters() == spread.requested.parameters()


@pytest.mark.parametrize("end", ["M30", "M02", "M2"])
def test_blocks_after_the_end_do_not_move(end):
    program = Program(f"G01 X5 F60\n{end}\nX50")
    assert program.requested.length == pytest.approx(5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("X123456789", "003 TOO MANY DIGITS in block 1 (line 1): X123456789: must have 8 digits at most"),
        (
            "N7 5 X3",
            "004 ADDRESS NOT FOUND in block N7 (line 1): '5 X3' has no address: must begin with a letter",
        ),
        ("X", "005 NO DATA AFTER ADDRESS in block 1 (line 1): address X has no number"),
        (
            "X--1",
            "006 ILLEGAL USE OF NEGATIVE SIGN in block 1 (line 1): X--: must be one sign at most, before the number",
        ),
        (
            "X1.2.3",
            "007 ILLEGAL USE OF DECIMAL POINT in block 1 (line 1): X1.2.: must have one decimal point at most",
        ),
        ("G01 X5 F60 Q3", "009 ILLEGAL ADDRESS INPUT in block 1 (line 1): address Q is not used in G01"),
        ("X5 X6", "009 ILLEGAL ADDRESS INPUT in block 1 (line 1): address X is given twice in the block"),
        (
            "\nN3 E5",
            "009 ILLEGAL ADDRESS INPUT in block N3 (line 2): address 'E': must be one of A, B, C, D, F, G, "
            "H, I, J, K, L, M, N, O, P, Q, R, S, T, X, Y, Z",
        ),
        (
            "G05 X1",
            "010 IMPROPER G-CODE in block 1 (line 1): G5: must be one of G00 to G04, G05.1, G08, G10, G17 to G21, "
            "G28, G30, G40 to G44, G49, G50.1, G51.1, G52 to G59, G61, G64, G68, G69, G80, G90 to G92, G94",
        ),
        (
            "G01 X10",
            "011 NO FEEDRATE COMMANDED in block 1 (line 1): a motion at feed must have an F, in its block or before",
        ),
        ("G01 X10 F0", "011 NO FEEDRATE COMMANDED in block 1 (line 1): F = 0: must be greater than 0"),
        (
            "G02 X10 Y0 I3 F10",
            "020 OVER TOLERANCE OF RADIUS in block 1 (line 1): radius = 3 mm at the start, 7 mm at the end: difference "
            "4 mm must be at most radius_tolerance, 0.01 mm",
        ),
        (
            "G02 X10 R3 F100",
            "020 OVER TOLERANCE OF RADIUS in block 1 (line 1): R = 3 mm: must be at least half the chord, 5 mm",
        ),
        (
            "G02 X10.0202 R5 F100",
            "020 OVER TOLERANCE OF RADIUS in block 1 (line 1): R = 5 mm: must be at least half the chord, 5.0101 mm",
        ),
        (
            "G02 X0 Y0 I5 K2 F10",
            "021 ILLEGAL PLANE AXIS COMMANDED in block 1 (line 1): address K in G17: the centre must be given by I "
            "and J",
        ),
        (
            "G02 X10 F10",
            "022 NO CIRCLE RADIUS in block 1 (line 1): arc without a centre and without a radius: must have I, J, K of "
            "its plane, or R",
        ),
        (
            "G41 D1 G02 X10 I5 F10",
            "034 NO CIRC ALLOWED IN ST-UP/EXT BLK in block 1 (line 1): cutter compensation begins or ends in an arc: "
            "must be in a straight move",
        ),
        (
            "G02 X0 Y10 I0 J5 K2 Q-1 F100",
            "5122 ILLEGAL COMMAND IN SPIRAL in block 1 (line 1): height per turn K without a height: must come with an "
            "end Z",
        ),
        (
            "G02 X0 Y0 I5 L0 F100",
            "5122 ILLEGAL COMMAND IN SPIRAL in block 1 (line 1): L = 0: must be a whole number of at least 1",
        ),
        (
            "G02 X5 I5 R5 L1 F100",
            "5122 ILLEGAL COMMAND IN SPIRAL in block 1 (line 1): R in a spiral: the centre must be given by I, J, K of "
            "its plane",
        ),
        (
            "G41 D1 G01 Y10 F100\nN20 G02 X10 Y10 I10 Q-10",
            "5124 CAN NOT COMMAND SPIRAL in block N20 (line 2): end at the centre under cutter compensation: "
            "must be away from it",
        ),
    ],
)
def test_every_alarm_states_its_block_and_cause(text, message):
    with pytest.raises(Alarm) as raised:
        Program(text, offsets={"1": 1.0})
    assert str(raised.value) == f"alarm {message}"


def test_an_alarm_knows_its_number_title_block_and_line():
    with pytest.raises(Alarm) as raised:
        Program("%\nO1\nN10 G02 X0 Y-31 I0 J-100 Q-20 F300", start=(0, 100, 0))
    alarm = raised.value
    assert (alarm.number, alarm.title) == (5123, "OVER TOLERANCE OF END POINT")
    assert (alarm.block, alarm.line) == ("N10", 3)


def test_modal_codes_last_until_they_are_changed():
    program = Program("G01 X10 F600\nY10\nG02 X20 I5\nG01 X30")
    assert len(program.legs) == 4
    assert {leg.feed for leg in program.legs} == {10.0}


def test_message_form_of_a_numbered_block():
    with pytest.raises(Alarm, match=r"in block N10 \(line 1\)"):
        Program("N10 G05")


def test_a_sign_after_the_number_is_an_alarm():
    with pytest.raises(Alarm, match="alarm 006"):
        Program("X5-")


@pytest.mark.parametrize("text", ["?", "X1#2"])
def test_an_unknown_character_is_an_alarm(text):
    with pytest.raises(Alarm, match="alarm 009"):
        Program(text)


def test_text_after_the_end_is_not_read():
    Program("G01 X5 F60 M30\nX#")


@pytest.mark.parametrize("before", ["", "G04 P100\n"])
def test_rounding_of_incremental_coordinates_causes_no_motion(before):
    program = Program(f"G91 F600\nG01 X0.1\nX0.2\nX-0.3\n{before}G90 X0\nY10", acceleration=1000)
    assert sum(leg.piece is not None for leg in program.legs) == 4
    assert program.setpoints(1e-3).position[-1] == pytest.approx([0, 10], abs=1e-9)


def test_word_and_name_of_the_rotary_axis_can_be_chosen():
    assert Program("G01 X5 A90 F60", rotary_word="A", rotary_axis="th").axes == ("x", "y", "th")
    with pytest.raises(ValueError, match=r"alarm 009 .* address C is not used in G01"):
        Program("G01 X5 C90 F60", rotary_word="A")
    with pytest.raises(ValueError, match="rotary_word = 'X': must be one of A, B, C"):
        Program("G01 X5 F60", rotary_word="X")
    with pytest.raises(ValueError, match="rotary_axis = 'x': must not be one of x, y, z"):
        Program("G01 X5 C90 F60", rotary_axis="x")


def test_an_alarm_can_be_pickled():
    with pytest.raises(Alarm) as raised:
        Program("N10 G05")
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)


def turned(text):
    """Positions of the rotary axis, from its program."""
    program = Program(text, acceleration=2000, rotary_velocity=1e4, rotary_acceleration=1e6)
    return program.setpoints(0.001).position[:, program.axes.index("r")]


@pytest.mark.parametrize(
    ("text", "end"),
    [
        ("G90 G01 X1 F6000\nC90\nC90\nC30", 30),
        ("G91 G01 X1 F6000\nC90\nC90\nC30", 210),
        ("G90 G01 X1 C90 F6000\nG91 C-20\nG90 C45", 45),
        ("G91 G01 X1 F6000\nC-20\nX1 C-20", -40),
    ],
)
def test_a_rotary_word_is_absolute_or_incremental_as_all_others(text, end):
    assert turned(text)[-1] == pytest.approx(end, abs=1e-9)


@pytest.mark.parametrize(("unit", "millimetres"), [("G21", 1.0), ("G20", 25.4)])
def test_the_feed_is_in_the_unit_of_the_lengths(unit, millimetres):
    program = Program(f"{unit} G01 X1 F60")
    assert program.requested.length == pytest.approx(millimetres)
    steps = np.diff(program.setpoints(0.001).position[:, 0])
    assert steps.max() / 0.001 == pytest.approx(millimetres, rel=1e-6)


@pytest.mark.parametrize(("end", "reached"), [(19.9, 9.9), (20.1, 10.1)])
def test_an_arc_that_ends_within_or_beyond_its_circle_is_refused(end, reached):
    with pytest.raises(Alarm, match=rf"radius = 10 mm at the start, {reached:g} mm at the end: difference 0\.1 mm"):
        Program(f"G17 G02 X{end} Y0 I10 J0 F600").requested.length  # noqa: B018


def test_a_half_circle_by_a_rounded_radius_is_one():
    """The chord of 10.001 mm is longer than twice R, within the tolerance of the radius."""
    made = Program("G02 X10.001 Y0 R5 F600")
    assert made.requested.length == pytest.approx(0.5 * math.pi * 10.001)
    assert made.requested.position(0.5 * made.requested.length)[0, :2] == pytest.approx([5.0005, 5.0005])


@pytest.mark.parametrize("words", ["G17 G02 X0 Y0 I5 J0 K0.000", "G17 G02 X0 Y0 Z2 I5 J0 K0"])
def test_a_third_centre_word_of_0_has_no_effect(words):
    made = Program(f"{words} F600")
    plain = Program(f"{words.partition(' K')[0]} F600")
    assert made.requested.length == plain.requested.length
    assert made.notes == (
        "1 arcs with a third centre word of 0, as K0 in G17: without an effect on the path.",
        *plain.notes,
    )


def test_a_dwell_without_a_time_is_an_exact_stop():
    common = {"acceleration": 1000.0, "blend_time": 0.05}
    passing, stopping, longer = (
        Program(f"G01 X10 F3000\n{dwell}G01 X20", **common) for dwell in ("", "G04\n", "G04 P500\n")
    )
    assert stopping.duration > passing.duration + 0.05 - 1e-9
    assert longer.duration == pytest.approx(stopping.duration + 0.5, abs=0.06)
