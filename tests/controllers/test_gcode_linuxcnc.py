"""LinuxCNC's dialect: programs of every word, with end points from their arithmetic."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode import gcode_program
from gantrysim.controllers.gcode.interpret import interpret
from gantrysim.controllers.gcode.lines import GRAMMAR
from gantrysim.controllers.gcode.linuxcnc import Program
from gantrysim.controllers.gcode.move_table import ANGLE, DWELL, END, FEED, KIND, SOURCE
from gantrysim.controllers.macro.scanner import Scanner
from gantrysim.controllers.valve import Dispense

LARGE = "9" * 200  # its square is infinite


def moves(text, **settings):
    return Program(text=text, **settings).program.moves


def ends(text, **settings):
    """End points of the moves, without what waits for them."""
    table = moves(text, **settings)
    return np.round(table[table[:, KIND] != DWELL, END : END + 3], 9).tolist()


SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")


@pytest.mark.parametrize(("number", "code"), list(enumerate(SYSTEMS, start=1)))
def test_every_code_of_a_coordinate_system_means_its_number(number, code):
    zeros = "\n".join(f"G10 L2 P{k} X{10 * k} Y{-k}" for k in range(1, 10))
    text = f"{zeros}\n{code}\nG0 X1\nG54\n{code}\nG0 X#5220 Y#[5202+20*#5220]"
    assert ends(text) == [[10 * number + 1, 0, 0], [11 * number, -2 * number, 0]]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G0 X1 Y2 Z3", [(1, 2, 3)]),
        ("%\nG0 X1\n%\nX2", [(1, 0, 0)]),
        ("n10 g 0 x 1 . 5 (a comment) y-2 ; the rest", [(1.5, -2, 0)]),
        ("/G0 X5\nG0 X1", [(5, 0, 0), (1, 0, 0)]),
        ("G20 G0 X1\nG21 X1", [(25.4, 0, 0), (1, 0, 0)]),
        ("G91 G0 X1\nX1\nG90 X1", [(1, 0, 0), (2, 0, 0), (1, 0, 0)]),
        ("G7 G0 X10\nG8 X10", [(5, 0, 0), (10, 0, 0)]),
        ("G0 @10 ^90", [(0, 10, 0)]),
        ("G0 X3 Y4\n@10", [(3, 4, 0), (6, 8, 0)]),
        ("#1=2 #<a>=3\nG0 X#1 Y#<a> Z[#1+#<a>*2]", [(2, 3, 8)]),
        ("#1=1\n#1=5 G0 X#1\nX#1", [(1, 0, 0), (5, 0, 0)]),  # a line's parameters are set after its values are taken
        ("#1=2 #2=7\nG0 X##1", [(7, 0, 0)]),
        ("#<n>=1\nG0 X EXISTS[#<n>] Y EXISTS[#<m>]", [(1, 0, 0)]),
        ("G0 X EXISTS[#<_hal[pin]>] Y1", [(0, 1, 0)]),
        ("G0 X EXISTS[#1] Y EXISTS[#5602] Z1", [(1, 1, 1)]),
        ("G0 X EXISTS[#0] Y EXISTS[#5603] Z1", [(0, 0, 1)]),
        ("G0 X[atan[1]/[1]] Y[2**3] Z[7 mod 4]", [(45, 8, 3)]),
        ("G0 X[fix[-1.5]] Y[fup[1.2]] Z[round[2.5]]", [(-2, 2, 3)]),
        ("G0 X[1 lt 2] Y[[1 gt 2] or [2 eq 2]] Z[1 xor 1]", [(1, 1, 0)]),
        ("G10 L2 P2 X10 Y20\nG55 G0 X1 Y1\nG54 X0", [(11, 21, 0), (0, 21, 0)]),
        ("G10 L2 P1 R90\nG0 X1", [(0, 1, 0)]),
        ("G0 X5\nG10 L20 P1 X1\nG0 X2", [(5, 0, 0), (6, 0, 0)]),
        ("G59.3 G10 L2 P0 X7\nG0 X1\nG0 X[#5381+#5220]", [(8, 0, 0), (23, 0, 0)]),
        # parameters that show the frames, in the unit of the program
        ("G10 L2 P2 X10 Y20 R30\nG0 X#5241 Y#5242 Z#5250", [(10, 20, 30)]),
        ("G91\nG0 X#<_incremental> Y#<_absolute>", [(1, 0, 0)]),
        ("G90\nG0 X#<_incremental> Y#<_absolute>", [(0, 1, 0)]),
        ("G20\nG0 X#<_imperial> Y#<_metric>", [(25.4, 0, 0)]),
        ("G21\nG0 X#<_imperial> Y#<_metric>", [(0, 1, 0)]),
        ("G8\nG0 X#<_lathe_radius_mode> Y#<_lathe_diameter_mode>", [(1, 0, 0)]),
        ("G55\nG0 X#<_coord_system>\nG59.2\nX#<_coord_system>", [(550, 0, 0), (592, 0, 0)]),
        ("G0 X3 Y4\nG92 X1\nG0 X#5211 Y#5421", [(3, 4, 0), (4, 4, 0)]),
        ("G10 L2 P1 X5\nG0 X1 Y2\nG53 G0 X#<_x> Y#<_abs_x>", [(6, 2, 0), (1, 6, 0)]),
        ("G20\nG0 X1\nX[#5420*2]", [(25.4, 0, 0), (50.8, 0, 0)]),
        ("G52 X4\nG0 X1\nG52 X0\nX1", [(5, 0, 0), (1, 0, 0)]),
        ("G10 L2 P1 X9\nG53 G0 X1\nX1", [(1, 0, 0), (10, 0, 0)]),
        ("G10 L1 P3 Z50\nG43 H3 G0 Z1\nG53 Z60\nG49", [(0, 0, 1), (0, 0, 10)]),
        ("G0 X5 Z8\nG28", [(5, 0, 8), (0, 0, 8)]),
        ("G0 X5 Z-8\nG30 Z-2", [(5, 0, -8), (5, 0, -2), (5, 0, 0)]),
        ("G0 X5 Y5\nG28.1\nX9\nG28 X8\nG0 X0", [(5, 5, 0), (9, 5, 0), (8, 5, 0), (5, 5, 0), (0, 5, 0)]),
        ("G0 X5\nG30", [(5, 0, 0), (0, 0, 0)]),
        # a call sets all thirty local parameters: those without an argument to 0; the caller's own come back
        ("#2=7 #30=9\no1 sub\nG0 X#1 Y#2 Z#30\no1 endsub\no1 call [5]\nG0 X#1 Y#2 Z#30", [(5, 0, 0), (0, 7, 9)]),
        ("#31=4\no1 sub\n#31=[#31+#1]\no1 endsub\no1 call [5]\nG0 X#31 Y#1", [(9, 0, 0)]),
        ("o1 repeat [3]\nG91 G0 X1\no1 endrepeat", [(1, 0, 0), (2, 0, 0), (3, 0, 0)]),
        ("#1=0\no1 while [#1 lt 2]\n#1=[#1+1]\nG0 X#1\no1 endwhile", [(1, 0, 0), (2, 0, 0)]),
        ("#1=0\no1 do\n#1=[#1+1]\nG0 X#1\no1 while [#1 lt 2]", [(1, 0, 0), (2, 0, 0)]),
        ("#1=5\no1 if [#1 eq 4]\nG0 X1\no1 elseif [#1 eq 5]\nG0 X2\no1 else\nG0 X3\no1 endif", [(2, 0, 0)]),
        ("o1 if [0]\nG0 X1\no1 else\nG0 X3\no1 endif", [(3, 0, 0)]),
        ("o1 while [1]\nG91 G0 X1\no2 if [#5420 ge 2]\no1 break\no2 endif\no1 endwhile", [(1, 0, 0), (2, 0, 0)]),
        ("o1 do\nG91 G0 X1\no2 if [#5420 ge 2]\no1 break\no2 endif\no1 while [1]", [(1, 0, 0), (2, 0, 0)]),
        ("#1=0\no1 while [#1 lt 2]\n#1=[#1+1]\no1 continue\nG0 X1\no1 endwhile\nG0 X2", [(2, 0, 0)]),
        ("#1=0\no1 do\n#1=[#1+1]\no1 continue\nG0 X1\no1 while [#1 lt 2]\nG0 X2", [(2, 0, 0)]),
        ("o<s> sub\nG0 X#1 Y#2\no<s> endsub [#1*2]\no<s> call [3] [4]\nX#<_value>", [(3, 4, 0), (6, 4, 0)]),
        ("#1=7\no1 sub\n#1=9\no1 endsub\no1 call\nG0 X#1", [(7, 0, 0)]),  # the first thirty are local
        ("o1 sub\no2 if [#1 gt 2]\no1 return [5]\no2 endif\no1 endsub\no1 call [3]\nG0 X#<_value>", [(5, 0, 0)]),
        ("M98 P5 L2\nM2\nO5\nG91 G0 X1\nM99", [(1, 0, 0), (2, 0, 0)]),
        ("M70 G20\nM72 G0 X1", [(1, 0, 0)]),
        ("o1 sub\nM73 G91\nG0 X1\no1 endsub\no1 call\no1 call\nG0 X3", [(1, 0, 0), (2, 0, 0), (3, 0, 0)]),
        ("G0 X1\nM2\nX5", [(1, 0, 0)]),
        ("G0 X1\n\nG0 X#<_line>\nY#<_line>", [(1, 0, 0), (3, 0, 0), (3, 4, 0)]),
        ("#1=#<_line>\no1 if [#<_line> eq 2]\nG0 X#1 Y#<_line>\no1 endif", [(1, 3, 0)]),
    ],
)
def test_moves_end_where_the_arithmetic_says(text, expected):
    assert ends(text) == [list(map(float, end)) for end in expected]


def test_suspended_shifts_come_back():
    assert ends("G0 X5\nG92 X1\nG0 X2\nG92.2\nG0 X2\nG92.3\nG0 X2\nG92.1\nG0 X2") == [
        [x, 0, 0] for x in (5.0, 6.0, 2.0, 6.0, 2.0)
    ]


@pytest.mark.parametrize(
    ("text", "angle", "length"),
    [
        ("G2 X10 Y10 I10 J0", -math.pi / 2, 5 * math.pi),
        ("G3 X10 Y10 I10 J0", 1.5 * math.pi, 15 * math.pi),
        ("G2 X10 Y10 R10", -math.pi / 2, 5 * math.pi),
        ("G2 X10 Y10 R-10", -1.5 * math.pi, 15 * math.pi),
        ("G3 I10", 2 * math.pi, 20 * math.pi),
        ("G3 I10 P3 Z30", 6 * math.pi, math.hypot(60 * math.pi, 30)),
        ("G90.1 G2 X10 Y10 I10 J0", -math.pi / 2, 5 * math.pi),
        ("G18 G2 X10 Z10 I10 K0", -1.5 * math.pi, 15 * math.pi),
        ("G19 G3 Y10 Z10 J10 K0", 1.5 * math.pi, 15 * math.pi),
        ("G10 L2 P1 R30\nG2 X10 Y10 I10 J0", -math.pi / 2, 5 * math.pi),
    ],
)
def test_arcs_sweep_the_angle_of_their_words(text, angle, length):
    program = Program(text="F600\n" + text)
    assert program.program.moves[0, ANGLE] == pytest.approx(angle)
    assert program.requested.length == pytest.approx(length)
    np.testing.assert_allclose(
        program.requested.position(program.requested.length)[0], program.program.moves[0, END : END + 3], atol=1e-9
    )


@pytest.mark.parametrize(
    ("text", "feed"),
    [("F600 G1 X10", 10), ("G20 F60 G1 X1", 25.4), ("G93 F6 G1 X10", 1), ("S20 M3\nG95 F0.5 G1 X10", 1 / 6)],
)
def test_feeds_are_in_their_units(text, feed):
    assert moves(text)[0, FEED] == pytest.approx(feed)


@pytest.mark.parametrize("start", [(0.0, 0.0), (200.0, -70.0)])
def test_an_inverse_time_feed_is_the_time_of_an_arc_wherever_it_lies(start):
    """A quarter of a circle, and a helix of two turns and a quarter, in a tenth of a minute each."""
    x, y = start
    arcs = f"G3 X{x - 30} Y{y + 30} I-30 F10\nG3 X{x - 60} Y{y} Z8 J-30 P3 F10"
    lengths = (15 * math.pi, math.hypot(2 * 60 * math.pi + 15 * math.pi, 8))
    feeds = moves(f"G0 X{x} Y{y}\nG93\n{arcs}")[-2:, FEED]
    assert feeds == pytest.approx([length / 6.0 for length in lengths])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G1 X1", "line 1: .*must have an F"),
        ("G0 X1\nG87 Z-1 R1 F1", "line 2: G87: milling cycle is not simulated"),
        ("F1 G81 X1 Z-1", "line 1: G81 without R: must have Z, R"),
        ("F1 G81 X1 Z2 R1", "line 1: G81: R at Z = 1 mm must not be below the depth, 2 mm"),
        ("F1 G83 X1 Z-1 R1 Q0", "line 1: Q = 0 mm: must be above 0"),
        ("F1 G81 X1 Z-1 R1\nG80\nX2", "line 3: axis words while no motion is in force"),
        ("G38.2 X1 F1", "line 1: G38.2: probing"),
        ("G33 Z1 K1", "line 1: G33: motion synchronised"),
        ("G76", "line 1: G76: milling cycle"),
        ("G47", "line 1: G47: is not a word of LinuxCNC"),
        ("M450", "line 1: M450: is not a word"),
        ("G0 X1 A0\nG91 A0 X1\nG90 A1", "line 3: A1 moves an axis that a program of LinuxCNC cannot have here"),
        ("#1=#<_hal[pin]>", r"line 1: #<_hal\[pin\]> is a value of the machine: must be given in parameters"),
        ("G0 A1", "line 1: A1 moves an axis .*: must be x, y or z; skip_axes"),
        ("G0 X1 X2", "line 1: X is given twice"),
        ("G0 X1 K", "line 1: K.*must be followed by a number"),
        ("G0 X[1+", "line 1: "),
        ("G0 X[1/0]", "line 1: .*divisor"),
        ("G0 X[sqrt[-1]]", "line 1: SQRT"),
        (f"G0 X[{LARGE}*{LARGE} mod 2]", "line 1: inf MOD 2: has no finite value"),
        (f"o[{LARGE}*{LARGE}-{LARGE}*{LARGE}] call", "line 1: O word: label = nan: must be a number"),
        (
            f"o1 repeat [{LARGE}*{LARGE}-{LARGE}*{LARGE}]\no1 endrepeat",
            "line 1: O word: repeat = nan: must be a number",
        ),
        ("G0 X#<none>", "line 1: unknown parameter '#<none>'"),
        ("G0 X1 (open", "line 1: comment"),
        ("F1 G2 X10", "line 1: arc without I, J and R"),
        ("F1 G2 X10 I1", "line 1: radius = 1 mm at the start, 9 mm at the end"),
        ("F1 G2 X10 R1", "line 1: R = 1 mm: must be at least half the chord, 5 mm"),
        ("F1 G2 X10 I5 K1", "line 1: K in G17"),
        ("F1 G2 X10 I10", "line 1: the end of the arc is its centre, by I, J: radius = 10 mm at the start, 0 mm at"),
        ("F1 G18 G3 Z10 K10", "line 1: the end of the arc is its centre, by K, I: radius = 10 mm at the start"),
        ("F1 G2 X10 I0 J0", "line 1: the start of the arc is its centre, by I, J: radius = 0 mm must be greater than"),
        ("o1 call", "line 1: unknown subprogram '1'"),
        ("o1 while [1]\no1 endwhile", "lines have run"),
        ("o1 sub\no1 call\no1 endsub\no1 call", "deeper than 10"),
        ("o1 if [1]\no1 elseif [2]", "line 2: O word 1: must be followed by endif"),
        ("G4", "line 1: G4: must have P"),
        ("M72", "line 1: M72"),
        ("G0 X" + "[" * 100 + "1" + "]" * 100, "nested deeper than 60"),
        ("G0 X[" + "1+" * 300 + "1]", "more than 200 operators"),
        ("G0 X1" + " " * 2000, "line of 2005 characters"),
        ("G0 X99999999", "must be within 1e"),
        ("G0", "moves none of x, y, z"),
    ],
)
def test_what_is_refused_names_the_line_and_the_word(text, message):
    with pytest.raises(InputError, match=message):
        _ = Program(text=text, max_steps=1000).duration


def test_a_refused_program_runs_once_however_many_ask(monkeypatch):
    runs = []

    def counted(*given):
        runs.append(given)
        return interpret(*given)

    monkeypatch.setattr(gcode_program, "interpret", counted)
    program = Program(text="G1 X1 F60\nG1 X2 R5 Q1 L2 T1.5")
    for name in ("program", "duration", "plan"):
        with pytest.raises(InputError, match="line 2"):
            getattr(program, name)
    assert len(runs) == 1


def test_a_third_centre_word_of_0_has_no_effect():
    text = "F600 {plane} G2 {words} {third}0.000"
    for plane, words, third in (("G17", "X10 I5", "K"), ("G18", "Z10 K5", "J"), ("G19", "Y10 J5", "I")):
        made = Program(text=text.format(plane=plane, words=words, third=third))
        assert made.requested.length == pytest.approx(5 * math.pi)
        assert made.notes == (
            f"Words without an effect on the path: {third}0 of arcs in {plane}, which LinuxCNC itself refuses (1).",
        )


@pytest.mark.parametrize(
    ("radius", "off", "refused"),
    [(10, 0.0049, False), (10, 0.0101, True), (4, 0.0051, True), (20, 0.0101, False), (20, 0.021, True)],
)
def test_arcs_that_grbl_refuses_are_noted(radius, off, refused):
    """From (R, 0) about 0 to (0, R + off): more than 0.005 mm and a thousandth of R."""
    text = f"F600 G0 X{radius}\nG1 Y1\nY0\nG3 X0 Y{radius + off} I-{radius} J0"
    made = Program(text=text)
    noted = [note for note in made.notes if "grbl" in note]
    assert len(noted) == refused
    if refused:
        assert f"1 arc ends off its circle, by {off:.3g} mm in line 4" in noted[0]
    assert not any("grbl" in note for note in Program(text="G64\n" + text).notes)


def test_what_has_no_effect_is_counted():
    program = Program(text="T1 M6\nM3 S100\nM8\nG0 X1 A5\nM64 P0\nM0\nM9\nM5", skip_axes="A")
    assert program.program.ignored == {
        "T": 1,
        "M6": 1,
        "M3": 1,
        "axis A": 1,
        "M64": 1,
        "M0": 1,
        "M5": 1,
    }
    assert "M64 (1)" in program.notes[0]
    assert "M8 opens the valve and M9 closes it" in program.notes[1]


def test_a_feed_of_the_machine_is_assumed_with_a_note_unless_it_is_given():
    text = "F#<_hal[plasmac.cut-feed-rate]>\nG1 X10"
    assumed = Program(text=text)
    assert assumed.program.moves[0, FEED] == 25
    assert "#<_hal[plasmac.cut-feed-rate]> is a feed of the machine that was not given: 1500 mm/min" in assumed.notes[0]
    given = Program(text=text, parameters={"_hal[plasmac.cut-feed-rate]": 600.0})
    assert given.program.moves[0, FEED] == 10
    assert not any("feed of the machine" in note for note in given.notes)
    assert Program(text="G20\n" + text).program.moves[0, FEED] == 25


def test_a_file_of_subroutines_alone_is_told_from_a_program():
    with pytest.raises(InputError, match=r"moves none of x, y, z; its subroutines \(touch\) run where another program"):
        _ = Program(text="o<touch> sub\nG0 X1\no<touch> endsub\nM2").plan


HIGH = "G0 X1 Y2 Z3 F60\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # the two examples of LinuxCNC's manual
        ("G90 G81 G98 X4 Y5 Z1.5 R2.8", ["4 5 3", "4 5 2.8", "4 5 1.5 F", "4 5 3"]),
        (
            "G91 G81 G98 X4 Y5 Z-0.6 R1.8 L3",
            ["1 2 4.8"]
            + [
                f"{text}"
                for k in (1, 2, 3)
                for text in (
                    f"{1 + 4 * k} {2 + 5 * k} 4.8",
                    f"{1 + 4 * k} {2 + 5 * k} 4.2 F",
                    f"{1 + 4 * k} {2 + 5 * k} 4.8",
                )
            ],
        ),
        # R and the depth stay in force; G99 stays at R, and G98 returns to the height before the series
        (
            "G99 G81 X4 Z1 R2\nX5\nG98 X6",
            ["4 2 3", "4 2 2", "4 2 1 F", "4 2 2", "5 2 2", "5 2 1 F", "5 2 2", "6 2 2", "6 2 1 F", "6 2 3"],
        ),
        ("G89 X4 Z1 R2 P0.1", ["4 2 3", "4 2 2", "4 2 1 F", "4 2 3 F"]),
        ("G85 X4 Z1 R2", ["4 2 3", "4 2 2", "4 2 1 F", "4 2 2 F", "4 2 3"]),
        (
            "G83 X1 Z0 R2 Q0.8 D0.5",
            ["1 2 2", "1 2 1.2 F", "1 2 2", "1 2 1.7", "1 2 0.4 F", "1 2 2", "1 2 0.9", "1 2 0 F", "1 2 3"],
        ),
        ("G73 X1 Z0 R2 Q1.5 D0.5", ["1 2 2", "1 2 0.5 F", "1 2 1", "1 2 0 F", "1 2 3"]),
        ("G18 G81 X4 Y1 R1.5 G80", ["4 2 3", "4 1.5 3", "4 1 3 F", "4 2 3"]),
    ],
)
def test_canned_cycles_go_down_at_feed_and_up(text, expected):
    table = moves(HIGH + text.replace(" G80", "\nG80"))[1:]
    length = np.linalg.norm(np.diff(moves(HIGH + text)[:, END : END + 3], axis=0), axis=1)
    rows = [" ".join(f"{v:.6g}" for v in row[END : END + 3]) + (" F" if row[FEED] else "") for row in table[length > 0]]
    assert rows == expected


@pytest.mark.parametrize(("by", "dots"), [("feed", [1, 1]), ("auto", [0, 1]), ("codes", [0, 1])])
def test_a_cycle_with_a_dwell_lays_dots(by, dots):
    """By feed the valve is open in the dwells alone; by codes between the codes."""
    program = Program(text=HIGH + "M5\nG82 X4 Z1 R2 P0.4\nM3\nX5", dispense=Dispense(by=by))
    table = program.program.moves
    dwells = (table[:, KIND] == DWELL) & (table[:, FEED] > 0)
    assert table[dwells, FEED].tolist() == [0.4, 0.4]
    assert program.program.glue[dwells].tolist() == dots
    if by != "codes":
        assert program.program.glue.sum() == sum(dots)
        setpoints = program.setpoints(0.001)
        assert setpoints.dispense.sum() == pytest.approx(400 * sum(dots), abs=4)
        assert np.unique(setpoints.position[setpoints.dispense][:, 0].round(6)).tolist() == [4, 5][2 - sum(dots) :]


def test_subprograms_in_files_of_their_own_are_called_by_name():
    files = {"Dot": "o<dot> sub\nG0 X#1\no<dot> endsub\nM2"}
    table = moves("G0 X1\no<dot> call [7]", subprograms=files)
    assert table[:, END].tolist() == [1, 7]
    assert table[:, SOURCE].tolist() == [1, 2]  # the line of the call
    with pytest.raises(InputError, match=r"line 2 of dot: G87"):
        moves("o<dot> call", subprograms={"dot": "o<dot> sub\nG87\no<dot> endsub"})


def test_parameters_of_the_machine_come_from_the_job():
    assert ends("G0 X#<_hal[gun.feed]>", parameters={"#<_hal[gun.feed]>": 4.0}) == [[4, 0, 0]]


def test_a_quadratic_stays_within_a_micrometre_of_its_closed_form():
    path = Program(text="F600 G5.1 X10 Y0 I5 J10").requested
    points = path.position(np.linspace(0, path.length, 2000))
    t = points[:, 0] / 10
    assert np.abs(points[:, 1] - 20 * t * (1 - t)).max() < 1.1e-3 * math.hypot(1, 2)


def test_a_cubic_runs_along_its_closed_form():
    table = moves("F600 G5 I0 J10 P0 Q10 X10 Y0")
    t = np.arange(1, len(table) + 1) / len(table)
    expected = np.column_stack([10 * (3 * t**2 - 2 * t**3), 30 * t * (1 - t)])
    np.testing.assert_allclose(table[:, END : END + 2], expected, atol=1e-9)
    assert set(table[:, KIND]) == {0.0}


_NUMBERS = st.integers(0, 99).map(str)
_SUMS = st.recursive(
    _NUMBERS,
    lambda inner: st.tuples(inner, st.sampled_from(["+", "-", "*"]), inner).map(lambda t: f"{t[0]}{t[1]}[{t[2]}]"),
    max_leaves=12,
)


@given(_SUMS)
def test_expressions_have_the_value_that_python_gives(text):
    value = Scanner(f"[{text}]", GRAMMAR).value("")
    assert value(None) == pytest.approx(eval(text.replace("[", "(").replace("]", ")")))


@given(st.integers(1, 9), st.integers(0, 3))
def test_recursion_counts_as_it_should(n, extra):
    text = (
        "o<f> sub\no1 if [#1 le 1]\no<f> return [1]\no1 endif\n"
        f"o<f> call [#1-1]\no<f> endsub [#1*#<_value>]\no<f> call [{n}]\nG0 X#<_value> Y{extra}"
    )
    assert ends(text)[0][0] == math.factorial(n)


@given(st.floats(-50, 50), st.floats(-9, 9).filter(lambda b: abs(b) > 0.01))
def test_mod_is_what_remains_above_a_multiple_of_the_divisor(a, b):
    """LinuxCNC's MOD is never negative: a - |b| floor(a / |b|)."""
    (end,) = ends(f"G0 X[[{a:.6f}] MOD [{b:.6f}]] Y1")
    a, b = round(a, 6), abs(round(b, 6))
    remains = a - b * math.floor(a / b)
    assert -1e-9 <= end[0] <= b + 1e-9
    assert min(abs(end[0] - remains), b - abs(end[0] - remains)) < 1e-8  # 0 and b are one where a is a multiple


@pytest.mark.parametrize("end", ["", "M2\n", "M30\n"])
def test_a_program_ends_with_its_own_text_whatever_subprograms_follow(end):
    """Files of subprograms are called, not run into; without a call the main program's last line is the last."""
    others = {"100": "O100\nG0 X9\nM99", "dot": "o<dot> sub\nG0 X8\no<dot> endsub"}
    assert ends(f"G0 X1\nG0 X2\n{end}", subprograms=others) == [[1, 0, 0], [2, 0, 0]]
    assert ends(f"G0 X1\nM98 P100\n{end}", subprograms=others) == [[1, 0, 0], [9, 0, 0]]


@pytest.mark.parametrize("before", ["", "G64\n", "G64 P0\n"])
def test_a_tolerance_of_corners_does_what_p_of_g64_does(before):
    lines = "G1 F1200 X10\nX20 Y0.01\nX30 Y10\nG2 X40 Y20 I10\nG1 Y40\n"
    written = Program(text=f"G64 P0.03\n{lines}")
    given = Program(text=before + lines, corner_tolerance=0.03)
    assert np.array_equal(given.setpoints(1e-3).position, written.setpoints(1e-3).position)
    assert Program(text=before + lines).duration < given.duration
    own = Program(text=f"G64 P0.1\n{lines}")
    assert Program(text=own.text, corner_tolerance=0.03).duration == own.duration


@pytest.mark.parametrize("tolerance", [0.0, -0.1])
def test_a_tolerance_of_corners_is_greater_than_zero(tolerance):
    with pytest.raises(InputError, match=r"corner_tolerance = .*: must be greater than 0"):
        Program(text="G1 F600 X1", corner_tolerance=tolerance)


@pytest.mark.parametrize(("before", "height"), [("", 20.0), ("G28.1\n", 0.0), ("G0 Z20\nG28.1\nG0 Z5\n", 20.0)])
def test_g28_goes_down_only_to_a_stored_height(before, height):
    assert ends(f"{before}G1 F600 X50\nG0 Z20\nG28")[-1] == [0, 0, height]


@pytest.mark.parametrize(
    ("saves", "after"),
    [
        # saved alone, nothing comes back by itself
        ("M70 G91\nG0 X1", (4, 0, 0)),
        ("M73 G91\nG0 X1", (3, 0, 0)),
        # what is invalidated does not come back, and that is no error
        ("M73 G91\nM71\nG0 X1", (4, 0, 0)),
    ],
)
def test_modes_come_back_at_the_end_of_a_subroutine_where_they_are_saved_for_that(saves, after):
    text = f"o1 sub\n{saves}\no1 endsub\no1 call\nG0 X3"
    assert ends(text) == [[1.0, 0.0, 0.0], list(map(float, after))]
