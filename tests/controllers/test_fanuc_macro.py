"""FANUC's subprograms, macro variables, branches, coordinate systems and overlap of blocks."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.controllers.fanuc import Alarm, Program
from gantrysim.controllers.placement import Placement

LARGE = "9" * 200  # its square is infinite


def ends(text, **settings):
    """End points of the motions in the plane."""
    legs = [leg for leg in Program(text, **settings).legs if leg.piece is not None]
    return [tuple(np.round(leg.piece.end[:2], 9)) for leg in legs]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("#1=2\nG01 X#1 Y[#1*3] F600", [(2, 6)]),
        ("#1=5.\nG01 X-#1 F600", [(-5, 0)]),
        ("G01 X1 Y#2 F600", [(1, 0)]),  # a variable that was never set leaves its word out
        ("#1=1\nWHILE[#1LE3]DO1\nG01 X#1 F600\n#1=#1+1\nEND1", [(1, 0), (2, 0), (3, 0)]),
        # the first two letters of a word stand for it
        ("#1=1\nN5WH[#1LE3]DO1\nG01 X#1 F600\n#1=#1+1\nN6EN1", [(1, 0), (2, 0), (3, 0)]),
        (
            "#1=0\nN10 #1=#1+1\nG01 X#1 F600\nIF[#1LT2]GO10\nIF[[1EQ1]AN[1EQ1]]TH#2=9\nGO20\nX5\nN20 Y#2",
            [(1, 0), (2, 0), (2, 9)],
        ),
        ("#1=SQ[16]\n#2=RO[AB[-2.6]]\nG01 X[#1*CO[60]] Y[SI[30]+#2+FI[1.9]+FU[1.1]] F600", [(2, 6.5)]),
        ("#1=EX[LN[2]]\n#2=AT[1]/[1]\nG01 X#1 Y[[#2+AS[1]+AC[1]+AT[0]]/45] F600", [(2, 3)]),
        ("#1=7 MO 4\nG01 X#1 Y[TA[45]] F600", [(3, 1)]),
        ("#1=0\nN10 #1=#1+1\nG01 X#1 F600\nIF[#1LT2]GOTO10\nY9", [(1, 0), (2, 0), (2, 9)]),
        ("IF[1EQ2]THEN#5=7\nIF[1EQ1]THEN#6=8\nG01 X#6 Y#5 F600", [(8, 0)]),
        ("G01 X1 F600\nGOTO20\nX5\nN20 Y2", [(1, 0), (1, 2)]),
        ("G01 F600\nG91 M98 P7 L3\nM30\nO7\nX1 Y1\nM99", [(1, 1), (2, 2), (3, 3)]),
        ("G91 G01 F600\nM98 P20007\nM30\nO0007\nX1\nM99", [(1, 0), (2, 0)]),
        ("G01 F600\nG65 P7 A3 B4\nX9\nM30\nO7\nX#1 Y#2\nM99", [(3, 4), (9, 4)]),
        ("#1=4\n#100=6\nG01 F600\nG65 P7 X1\nX#1\nM30\nO7\n#1=9\nY#100\nM99", [(0, 6), (4, 6)]),
        ("G01 F600\nM98 P7\nX5\nN9 Y1\nM30\nO7\nX2\nM99 P9", [(2, 0), (2, 1)]),
        # the other words of the block with M99 are run before the return
        ("G01 F600\nM98 P7\nX5\nM30\nO7\nG91 X1\nG90 Y2 M99", [(1, 0), (1, 2), (5, 2)]),
        ("G01 F600\nM98 P7\nX5\nN9 Y1\nM30\nO7\nX2\nY3 M99 P9", [(2, 0), (2, 3), (2, 1)]),
        ("G01 X1 F600\nX#5001 Y[#5001+1]", [(1, 0), (1, 2)]),
        ("#1=FIX[-1.5]\n#2=FUP[-1.5]\nG01 X#1 Y#2 F600", [(-1, -2)]),
        ("G01 X1 F600\nO2\nX5", [(1, 0)]),  # another program follows
        ("G01 X1 F600\nM99\nX5", [(1, 0)]),
        ("#1=2\nG01 X#1 F600 N5\nX[#1+1] N6", [(2, 0), (3, 0)]),  # the number of a block may stand at its end
        # numbers that agree in six digits are those of two blocks
        ("G01 F600\nGOTO1000000\nX9\nN1000000 X1\nGOTO1000001\nX8\nN1000001 X2", [(1, 0), (2, 0)]),
    ],
)
def test_macros_move_as_their_arithmetic_says(text, expected):
    assert ends(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G10 L2 P2 X10 Y20\nG55 G01 X1 Y1 F600\nG54 X0", [(11, 21), (0, 21)]),
        ("G01 X5 F600\nG92 X0\nX1", [(5, 0), (6, 0)]),
        # in a coordinate system of another zero
        ("G10 L2 P2 X10\nG55 G01 X5 F600\nG92 X0\nX1", [(15, 0), (16, 0)]),
        ("G52 X10\nG01 X1 F600\nG52 X0\nX2", [(11, 0), (2, 0)]),
        ("G10 L2 P1 X10\nG01 X1 F600\nG53 X1\nX1", [(11, 0), (1, 0), (11, 0)]),
        ("G10 L2 P2 X10\nG10 L2 P2 X7\nG55 G01 X1 F600", [(8, 0)]),
        ("G91 G10 L2 P2 X10\nG10 L2 P2 X7\nG90 G55 G01 X1 F600", [(18, 0)]),
        *(
            (
                f"G10 L2 P{k} X{10 * k} Y{-k}\nG{53 + k} G01 X1 F600\nG54\nG{53 + k}\nX2 Y0",
                [(10 * k + 1, 0), (10 * k + 2, -k)],
            )
            for k in range(1, 7)
        ),
        ("G01 X5 Y5 F600\nG28 X8\nG01 Y1", [(5, 5), (8, 5), (0, 5), (0, 1)]),
        ("G91 G01 X5 F600\nG28 X0", [(5, 0), (0, 0)]),
        ("G43 H1\nG01 X1 F600\nG49 G80 G40", [(1, 0)]),
    ],
)
def test_coordinate_systems_shift_the_path(text, expected):
    assert ends(text) == expected


def test_a_further_reference_point_is_the_first():
    second = Program(program="G00 X5 Z8\nG91 G30 P2 Z0\nG30 X0")
    assert second.requested.length == Program(program="G00 X5 Z8\nG91 G28 Z0\nG28 X0").requested.length


def test_the_needle_does_not_go_down_to_the_initial_height():
    """The reference point of z is above the work."""
    program = Program(program="G00 X5 Z8\nG91 G28 Z0\nG28 X0\nG90 G00 Z-2\nG28 Z-1")
    ends = [list(leg.piece.end) for leg in program.legs if leg.piece is not None]
    assert ends == [[5, 0, 8], [0, 0, 8], [0, 0, -2], [0, 0, -1], [0, 0, 0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("M98\nG01 X1 F1", r"alarm 076 .*block 1 .*P"),
        ("M98 P5\nG01 X1 F1", r"alarm 078 .*O5: must be one of the text's programs, none"),
        ("G01 X1 F1\nGOTO7", "alarm 078 .*N7"),
        ("O1\nM98 P1", "alarm 077 .*deeper than 10"),
        ("N1 GOTO1", "alarm 114 .*endless loop"),
        ("WHILE[1EQ2]DO1\nG01 X1 F1", "alarm 124 .*END1"),
        ("END1", "alarm 124 .*DO1"),
        ("#1=1/0", "alarm 114 .*divisor"),
        (f"#1=FIX[{LARGE}*{LARGE}]", r"alarm 114 .*FIX\[inf\]: has no finite value"),
        (f"#1=FUP[{LARGE}*{LARGE}-{LARGE}*{LARGE}]", r"alarm 114 .*FUP\[nan\]: has no finite value"),
        (f"M98 P2 L[{LARGE}*{LARGE}-{LARGE}*{LARGE}]\nO2", "alarm 114 .*L = nan: must be finite"),
        (f"G01 F1\nX[{LARGE}*{LARGE}]", "alarm 114 .*block 2 .*X = inf: must be finite"),
        (f"GOTO[-1]\nN{'9' * 21} X1", "alarm 078 .*N-1: must be a block"),  # of too many digits to be read
        ("#1=[1+2", "alarm 114"),
        ("IF[1EQ1]X1", "alarm 114 .*GOTO"),
        ("#0=1", "alarm 114 .*#0"),
        ("G05.1 X1", "alarm 009 .*Q0 or Q1"),
        ("G02 G53 X1 I1 F1", "alarm 010 .*G53"),
        ("G10 L3 P1", "alarm 009 .*L2"),
        ("G81 Z-1 R1 F1", "alarm 010 .*G81"),
    ],
)
def test_what_the_controller_refuses_is_an_alarm(text, message):
    with pytest.raises(Alarm, match=message):
        Program(text, max_steps=2000)


def test_blocks_overlap_only_where_the_look_ahead_is_on():
    corner = "G01 X10 F6000\nY10\n"
    common = {"acceleration": 1000.0, "blend_time": 0.05}
    stopping, overlapping = (Program(f"G08 P{on}\n{corner}", **common) for on in (0, 1))
    assert overlapping.duration == pytest.approx(Program(corner, **common).duration)
    # each of the two motions ends with a hold of the moving average
    assert stopping.duration > overlapping.duration + 2 * common["blend_time"] - 1e-9
    switched = Program(f"G05.1 Q1\n{corner}G05.1 Q0\nX0\n", **common)
    assert [leg.exact_stop for leg in switched.legs] == [False, False, True]


@given(st.floats(-180, 180), st.floats(0.1, 5), st.floats(-50, 50), st.sampled_from(["G17", "G18 K3 Z4", "G19 K3 Z4"]))
def test_a_placed_program_is_the_program_placed(turn, scale, x, plane):
    text = f"{plane[:3]} G01 X3 Y4 Z1 F600\nG02 X8 Y4 Z1 {'I2.5' if plane == 'G17' else 'R4'}"
    if plane != "G17":
        text = f"{plane[:3]} G01 X3 Y4 Z1 F600\nG02 {'X8' if plane[:3] == 'G18' else 'Y8'} R9"
    placement = Placement(x=x, y=2.0, rotate=turn, scale=scale)
    plain, placed = Program(text), Program(text, placement=placement)
    s = np.linspace(0, plain.requested.length, 50)
    assert placed.requested.length == pytest.approx(scale * plain.requested.length)
    np.testing.assert_allclose(
        placed.requested.position(scale * s), placement.point(plain.requested.position(s)), atol=1e-9 * (1 + scale)
    )
    first = placed.setpoints(0.01).position[0]
    np.testing.assert_allclose(first, placement.point((0, 0, 0))[: first.size], atol=1e-9)


def test_a_spiral_of_chords_by_a_macro_ends_where_the_formula_says():
    text = "#1=0\nG01 F6000\nWHILE[#1LE360]DO1\nX[10*COS[#1]] Y[10*SIN[#1]]\n#1=#1+15\nEND1"
    found = ends(text)
    expected = [(10 * math.cos(math.radians(a)), 10 * math.sin(math.radians(a))) for a in range(0, 361, 15)]
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_stops_at_short_motions_are_noted_with_their_remedy():
    rows = "\n".join(f"X{k / 10:.1f} Y{0.1 * (k % 2):.1f}" for k in range(1, 101))
    text = f"G01 F6000\n{rows}\nX500"
    stopping = Program(text, acceleration=1000.0)
    assert stopping.notes[0].startswith(
        "100 stops at corners after motions too short to reach their feed, 0.141 mm long"
    )
    # from rest to 100 mm/s and back takes 10 mm
    (alone,) = Program("G01 F6000\nX3 Y4\nX500", acceleration=1000.0).notes
    assert alone.startswith("1 stop at a corner after motions too short to reach their feed, 5 mm long")
    assert Program("G01 F6000\nX6 Y8.1\nX500", acceleration=1000.0).notes == ()
    assert Program(text, acceleration=1000.0, blend_time=0.05).notes == ()
    assert Program("G01 X500 F6000\nY500", acceleration=1000.0).notes == ()
    assert Program("G61 " + text, acceleration=1000.0).notes == ()
