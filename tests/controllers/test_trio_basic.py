"""Trio BASIC: the language, by what programs print, and its refusals by line."""

import gc
import math
import re
import weakref
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import Basic, InterpreterTime
from gantrysim.controllers.trio.basic.expressions import known_words
from gantrysim.controllers.trio.basic.words import IGNORED_WORDS

from support.soaked import examples

NO_TIME = InterpreterTime(0, 0, 0, 0)


def basic(text, **changed):
    return Basic(**{"text": text, "interpreter_time": NO_TIME, "initial_acceleration": math.inf, **changed})


def printed(text, **changed):
    return [line.text for line in basic(text, **changed).printed]


def test_threads_read_their_own_texts():
    def lines(k):
        return printed("\n" * k + f"x{k}={k}\nPRINT x{k}*2\n" * 50)

    with ThreadPoolExecutor(4) as threads:
        for k, found in enumerate(threads.map(lines, range(40))):
            assert found == [f"{2 * k:.4f}"] * 50


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1+2*3", 7),
        ("(1+2)*3", 9),
        ("2^3^1", 8),
        ("-2^2", -4),
        ("2^-1", 0.5),
        ("7 MOD 3", 1),
        ("-7 MOD 3", -1),
        ("10/4", 2.5),
        ("1=1", -1),
        ("1<>1", 0),
        ("1<2 AND 2<3", -1),
        ("1>2 OR 2>=3", 0),
        ("NOT (1>2)", -1),
        ("6 AND 3", 2),
        ("6 OR 3", 7),
        ("6 XOR 3", 5),
        ("$1F", 31),
        ("1.5e2", 150),
        (".5+2.", 2.5),
        ("PI", math.pi),
        ("TRUE", -1),
        ("ON+OFF", 1),
        ("ABS(-3)", 3),
        ("INT(2.7)", 2),
        ("INT(-2.7)", -2),
        ("FRAC(2.75)", 0.75),
        ("SGN(-9)", -1),
        ("SQR(2)", math.sqrt(2)),
        ("ATAN2(1,-1)", 0.75 * math.pi),
        ("COS(PI/3)", 0.5),
        ("LN(EXP(1.5))", 1.5),
        ("ACOS(SIN(0.3))", math.pi / 2 - 0.3),
        ("aSiN(tan(ATAN(0.2)))", math.asin(0.2)),
        ("IN(3)", 1),
        ("IN(4)=OFF", -1),
        ("VR(9)", 0),
        ("SERVO_PERIOD", 1000),
        ("PROCNUMBER", 1),
        ("PROC_STATUS", 1),
        ("SPEED AXIS(5)", 1),
        ("unset", 0),
    ],
)
def test_expressions(expression, value):
    text = printed(f"PRINT {expression}[15]", inputs=(3,), unassigned_zero=True)
    assert float(text[0]) == pytest.approx(value, abs=1e-14)


def root_free(a, b):
    power = a**b
    if isinstance(power, complex):
        raise ArithmeticError
    return power


# from the loosest rank to the tightest; a prefix stands before an operand of its own rank or a tighter one
LADDER = [
    {
        "OR": lambda a, b: float(int(a) | int(b)),
        "XOR": lambda a, b: float(int(a) ^ int(b)),
    },
    {"AND": lambda a, b: float(int(a) & int(b))},
    {"NOT": lambda a: -int(a) - 1.0},
    {
        "=": lambda a, b: -float(a == b),
        "<>": lambda a, b: -float(a != b),
        "<": lambda a, b: -float(a < b),
        ">": lambda a, b: -float(a > b),
        "<=": lambda a, b: -float(a <= b),
        ">=": lambda a, b: -float(a >= b),
    },
    {"+": lambda a, b: a + b, "-": lambda a, b: a - b},
    {"*": lambda a, b: a * b, "/": lambda a, b: a / b, "MOD": lambda a, b: a - b * int(a / b)},
    {"-": lambda a: -a, "+": lambda a: a},
    {"^": root_free},
]
PREFIXES, POWERS = (2, 6), 7
WRONG = (ArithmeticError, ValueError)


def operand(draw, rank, depth):
    """An expression that binds at least as tightly as a rank of the ladder: its text, and a function for its value."""
    if rank == len(LADDER):
        if depth and draw(st.booleans()):
            text, value = operand(draw, 0, depth - 1)
            return f"({text})", value
        number = draw(st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.0, 7.0]))
        return f"{number:g}", lambda: number
    more = depth and draw(st.integers(0, 2)) == 0
    if rank in PREFIXES:
        if not more:
            return operand(draw, rank + 1, depth)
        sign = draw(st.sampled_from(sorted(LADDER[rank])))
        text, value = operand(draw, rank, depth - 1)
        return f"{sign} {text}", lambda: LADDER[rank][sign](value())
    text, value = operand(draw, rank + 1, depth)
    if more:  # powers from the right, the others from the left
        for _ in range(1 if rank == POWERS else draw(st.integers(1, 2))):
            sign = draw(st.sampled_from(sorted(LADDER[rank])))
            right, second = operand(draw, rank - 1 if rank == POWERS else rank + 1, depth - 1)
            text = f"{text} {sign} {right}"
            value = partial(lambda f, a, b: f(a(), b()), LADDER[rank][sign], value, second)
    return text, value


@given(st.data())
@examples(100)
def test_operators_bind_by_their_rank(data):
    text, value = operand(data.draw, 0, 4)
    try:
        expected = value()
    except WRONG:
        expected = math.nan
    if math.isfinite(expected):
        assert basic(f"VR(0)={text}").trace(1e-3).state.vr.get(0, 0.0) == expected
    else:
        with pytest.raises(InputError):
            basic(f"VR(0)={text}").trace(1e-3)


@pytest.mark.parametrize("x", [-1, 0, 1, 2, 3])
def test_if_in_all_its_forms(x):
    block = f"""
x={x}
IF x<0 THEN ' comment
  PRINT "negative"
ELSEIF x=0 THEN
  PRINT "zero"
ELSEIF x=1 THEN : PRINT "one"
ELSE
  IF x=2 THEN PRINT "two" ELSE PRINT "many": PRINT "more"
ENDIF
"""
    expected = {-1: ["negative"], 0: ["zero"], 1: ["one"], 2: ["two"], 3: ["many", "more"]}
    assert printed(block) == expected[x]
    nested = f'x={x}: IF x>0 THEN IF x>1 THEN PRINT "b" ELSE PRINT "a"\nPRINT "end"'
    assert printed(nested) == {-1: [], 0: [], 1: ["a"], 2: ["b"], 3: ["b"]}[x] + ["end"]


def test_loops():
    assert printed("FOR i=1 TO 3\nPRINT i[0]\nNEXT i") == ["1", "2", "3"]
    assert printed("FOR i=1 TO 0 STEP -0.5\nPRINT i[1]\nNEXT") == ["1.0", "0.5", "0.0"]
    assert printed("FOR i=2 TO 1\nPRINT i\nNEXT i\nPRINT i[0]") == ["2"]
    with pytest.raises(InputError, match="STEP 0: must not be 0"):
        printed("FOR i=2 TO 1 STEP 0\nPRINT i\nNEXT i")
    assert printed("x=0\nWHILE x<2\nx=x+1\nPRINT x[0]\nWEND") == ["1", "2"]
    assert printed("x=5\nREPEAT\nx=x+1\nPRINT x[0]\nUNTIL x>2") == ["6"]
    text = "FOR i=1 TO 2: FOR j=1 TO 2: PRINT i[0];j[0]: NEXT j: NEXT i"
    assert printed(text) == ["11", "12", "21", "22"]


def test_jumps_and_subroutines():
    program = """
n=0
again: n=n+1
GOSUB show
IF n<3 THEN GOTO again
ON 2 GOTO wrong, right
wrong: PRINT "wrong"
right: PRINT "right"
ON 1 GOSUB show, wrong
ON 7 GOSUB wrong
STOP
PRINT "never"
show:
  PRINT #5, "n=",n[3,0];CHR(33)
RETURN
"""
    assert printed(program) == ["n=        1!", "n=        2!", "n=        3!", "right", "n=        3!"]
    assert {line.channel for line in basic(program).printed} == {5, None}


def test_memory_is_global_and_variables_belong_to_a_process():
    program = """
x=7: VR(1)=1
TABLE(10, 1.5, 2.5)
RUN "second"
WAIT UNTIL VR(1)=2
PRINT x[0];" ";TABLE(11)[1]
'$PROGRAM second
x=8
VR(1)=2
"""
    assert printed(program) == ["7 2.5"]
    assert printed("TABLE(511998, 1, 2): PRINT TABLE(511999)[0]") == ["2"]


def test_lines_continue_and_words_have_no_case():
    assert printed("x = 1 + _\n  2\nprint X[0]\nrem PRINT\nPrint remaining[0]", unassigned_zero=True) == ["3", "0"]


def test_processes_stop_one_another():
    program = """
RUN "ticker", 3
WA(10)
STOP "ticker"
PRINT VR(0)[0]
RUN "ticker"
WA(5)
HALT
'$PROGRAM ticker
WHILE TRUE
  VR(0)=VR(0)+1
  WA(2)
WEND
"""
    made = basic(program)
    assert [line.text for line in made.printed] == ["5"]  # at 0, 2, 4, 6, 8 ms; the main program is first at 10
    assert made.duration == pytest.approx(0.015)


def test_ticks_count_down_by_the_servo_period():
    program = "TICKS=100\nWAIT UNTIL TICKS<=0\nMOVE(1)\nWAIT IDLE"
    made = basic(program, initial_speed=1e3, servo_period=0.002)
    moving = np.flatnonzero(np.diff(made.setpoints(0.002).position[:, 0]))
    assert moving[0] == 100


@pytest.mark.parametrize(
    ("wait", "resolution", "ticks"),
    [(10, 0.001, 10), (10.9, 0.001, 10), (10.5, 0, 11), (-5, 0.001, 0), (0.4, 0.001, 0)],
)
def test_wa_truncates_and_a_negative_time_does_not_wait(wait, resolution, ticks):
    made = basic(f"WA({wait})\nMOVE(1)", wait_resolution=resolution, initial_speed=1e3)
    assert np.flatnonzero(np.diff(made.setpoints(0.001).position[:, 0]))[0] == ticks


def test_statements_take_their_time():
    times = {"statement": 0.001, "motion": 0.002, "print": 0.003, "wait": 0.005}
    made = basic(
        "x=1\nPRINT x\nMOVE(1)\nWA(1)\nPRINT x\n", interpreter_time=InterpreterTime(**times), initial_speed=1e6
    )
    assert [round(1e3 * line.time) for line in made.printed] == [1, 12]  # 1; 1 + 3 + 2 + 5 + 1


def test_a_loop_that_only_tests_keeps_its_phase():
    """A statement that is due after 19 ms is executed at 20 ms: that is the pass of 140 us that leaves the loop."""
    program = "WHILE TICKS>-20\nWEND\nPRINT TICKS[0]\nWA(1)\nPRINT TICKS[0]"
    made = basic(program, interpreter_time=InterpreterTime(statement=7e-5, print=0.0, wait=0.0))
    left = math.ceil(19e-3 / 14e-5) * 14e-5 + 7e-5
    assert left + 1e-3 < 21e-3  # while a pass begun at the tick itself would wait beyond
    assert [line.text for line in made.printed] == ["-20", "-21"]
    assert [line.time for line in made.printed] == pytest.approx([0.020, 0.021])


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("x=1+NOT 2", r"line 1: syntax error, '2' unexpected"),
        ("x=-NOT 2", r"line 1: syntax error, '2' unexpected"),
        ("x=1 2", r"line 1: syntax error, '2' unexpected"),
        ("x=*2", r"line 1: syntax error, '\*' unexpected"),
        ("x=2*", r"line 1: syntax error, the line ends too early"),
        ("MOVE(1", r"line 1: syntax error, the line ends too early"),
        ("x=1\nMOVECIRC(0,0,1,0,1,,)", r"line 2: syntax error, ',' unexpected"),
        ("x=1\nMOVECIRC(,)", r"line 2: syntax error, ',' unexpected"),
        ("x=1\n\n  y=?", r"line 3: syntax error, '\?' unexpected"),
        ('PRINT "a', r"line 1: syntax error, '\"' unexpected"),
        ("FROBNICATE(1)", r"line 1: unknown word 'FROBNICATE'"),
        ("x=1\nMOVETO 3,4", r"line 2: unknown word 'MOVETO': did you mean MOVE\?"),
        ("x=1\n'$PROGRAM b\n\nMOVETO 3,4", r"line 4 \(line 2 of B\): unknown word 'MOVETO'"),
        ("MOVE 3,4", r"line 1: syntax error, '3' unexpected"),
        ("\nMHELI(0,0,1,0,1,5)", r"line 2: unknown word 'MHELI': did you mean MHELICAL\?"),
        ("x=SINE(1)", r"line 1: unknown word 'SINE': did you mean SIN\?"),
        ("x=1\nMODBUS(0,0)", r"line 2: MODBUS: a word of the controller that is not emulated"),
        ("x=1\ny=REGIST+x", r"line 2: REGIST: a word of the controller that is not emulated"),
        ("speedd=1\nSPEED=sped", r"line 2: variable sped is assigned nowhere, did you mean speedd\?: it must be"),
        ("x=MOVE", r"line 1: MOVE: is a command, it has no value"),
        ("DPOS", r"line 1: DPOS: is a value, not a command"),
        ("DPOS=3", r"line 1: DPOS = \.\.\.: is a word of the language that cannot be assigned"),
        ("FOR SPEED=1 TO 2\nNEXT", r"line 1: SPEED = \.\.\.: is a word of the language"),
        ("TABLE(1)=3", r"line 1: TABLE: is set by TABLE\(first, value, \.\.\.\), not by ="),
        ("MOVECIRC(1,2,3)", r"line 1: MOVECIRC with 3 values: must have 5"),
        ("MOVE()", r"line 1: MOVE with 0 values: must have 1 to 16"),
        ("x=SIN(1,2)", r"line 1: SIN with 2 values: must have 1"),
        ("x=PI AXIS(2)", r"line 1: PI AXIS\(\): PI does not belong to an axis"),
        ("IF 1 THEN\nx=1", r"line 1: IF without its ENDIF"),
        ("WHILE 1\nENDIF", r"line 2: ENDIF without IF inside the WHILE of line 1"),
        ("NEXT", r"line 1: NEXT without FOR"),
        ("FOR i=1 TO 2\nNEXT j", r"line 2: NEXT j: must be NEXT i, of the FOR of line 1"),
        ("IF 1 THEN\nELSE\nELSE\nENDIF", r"line 3: ELSE after the ELSE of the IF of line 1"),
        ("GOTO nowhere", r"line 1: label NOWHERE: must stand before a colon at the start of a line"),
        ("a: x=1\na: x=2", r"line 2: label A: stands in two places"),
        ("x=1e999", r"line 1: number 1e999: too large"),
        ("x=1e999\ny=?", r"line 1: number 1e999: too large"),
        ("x=?\ny=1e999", r"line 1: syntax error, '\?' unexpected"),
        ("x=1+ _\n 1E999", r"line 2: number 1E999: too large"),
        ("x=" + "(" * 70 + "1" + "+1)" * 70, r"line 1: expression nested more than 60 deep"),
        ("", r"program without a statement"),
        ("'$PROGRAM a\nx=1\n'$PROGRAM a\nx=1", r"two programs have one name"),
    ],
)
def test_a_text_that_is_refused_names_the_line(text, error):
    with pytest.raises(InputError, match=f"^{error}"):
        basic(text)


def test_what_an_225_misprints_runs_with_a_note():
    text = "BASE(0,1,2)\nSPEED=50\nMHELIX(0,0,10,0,1,5{comma})\nWAIT IDLE"
    made = basic(text.format(comma=","))
    right = basic(text.format(comma="").replace("MHELIX", "MHELICAL"))
    assert made.notes[:2] == (
        "line 3: a comma before a closing bracket, as AN-225 prints it, is a syntax error on the controller; it is "
        "ignored",
        "line 3: MHELIX, as AN-225 prints it, is not a command of the controller; MHELICAL is used instead",
    )
    assert made.notes[2:] == right.notes
    np.testing.assert_array_equal(made.setpoints(0.001).position, right.setpoints(0.001).position)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("x=0\ny=1/x", r"line 2: division by zero$"),
        ("x=10^300\ny=x*x", r"line 2: y = inf: must be finite$"),
        ("x=10^400", r"line 1: no number, the operands are out of range$"),
        ("x=-1\ny=SQR(x)", r"line 2: no number"),
        ("x=1\nMOVE(x,10^308*10)", r"line 2: MOVE: value 2 = inf: must be finite$"),
        ("MOVE(1.5*10^308,1.5*10^308)", r"line 1: move of length inf: must be finite$"),
        ("DEFPOS(-10^308)\nMOVE(1)\nMOVEABS(1.5*10^308)", r"line 3: move of length inf: must be finite$"),
        (
            "TABLE(0,0,10^300): CAM(0,1,10^300,10)",
            r"line 1: cam from TABLE\(0\) to TABLE\(1\): its values must be finite$",
        ),
        ("MOVELINK(10^308,10^-5,0,0,1)", r"line 1: 1e\+308 over a link distance of 1e-05: must be a finite rate$"),
        ("x=1\nSPEED=10^308: FORWARD: WA(5)", r"line 2: axis 0 is at [^ ]+: must stay within 1e\+12 units$"),
        ("x=1\nSPEED=10^13: REVERSE: WA(500)", r"line 2: axis 0 is at -[^ ]+: must stay within 1e\+12 units$"),
        ("SPEED AXIS(1)=9: CONNECT(10^250,1)\nFORWARD AXIS(1): WA(9)", r"line 1: axis 0 is at [^ ]+: must stay within"),
        ("MOVECIRC(0,0,10^308,10^308,0)", r"line 1: move of length inf: must be finite$"),
        ("x=(-1)^0.5", r"line 1: root of a negative number$"),
        ("VR(-1)=3", r"line 1: VR\(-1\): must be a whole number from 0 to 65535$"),
        ("x=TABLE(0.5)", r"line 1: TABLE\(0\.5\): must be a whole number"),
        ("BASE(64)", r"line 1: axis 64: must be a whole number from 0 to 63$"),
        ("BASE(1,1)", r"line 1: BASE\(1, 1\): must name an axis once$"),
        ("x=1\nDATUM(3)", r"line 2: DATUM\(3\): homing is not simulated"),
        ("RETURN", r"line 1: RETURN without GOSUB$"),
        ("again: GOSUB again", r"line 1: GOSUB nested more than 256 deep: must return before$"),
        ('x=1\nRUN "other"', r"line 2: RUN 'other': must be one of the programs MAIN$"),
        ("SPEED=-1", r"line 1: SPEED = -1 of axis 0: must be at least 0$"),
        ("ACCEL AXIS(1)=0", r"line 1: ACCEL = 0 of axis 1: must be greater than 0$"),
        ("MOVECIRC(3,0,3,0,1)", r"line 1: circle about \(3, 0\): its end is its centre: must lie on the circle$"),
        (
            "MOVECIRC(1,0,3,0,1)",
            r"line 1: circle about \(3, 0\): its end \(1, 0\) lies in the direction of the start, but 1 off it",
        ),
        ("MOVECIRC(1,0,0,0,1)", r"line 1: circle about \(0, 0\) of radius 0: a radius must be above 0\.001$"),
        ("MOVECIRC(0,0,3,0,2)", r"line 1: direction 2: must be 0 or 1$"),
        ("CONNECT(1,0)", r"line 1: axis 0 would follow itself through axis 0: links must have no circle$"),
        ("CONNECT(1,1)\nBASE(1)\nADDAX(0)", r"line 3: axis 1 would follow itself through axis 0: links must have no"),
        ("CAM(0,1,1,10)", r"line 1: cam: TABLE\(0\) must be set before$"),
        ("CAMBOX(0,0,1,10,2)", r"line 1: cam from TABLE\(0\) to TABLE\(0\): must have 2 to 32000 points$"),
        ("TABLE(511999,1,2)", r"line 1: TABLE\(512000\): must be a whole number from 0 to 511999$"),
        ("CAM(0,1,1,0)", r"line 1: distance = 0: must be greater than 0$"),
        ("MOVELINK(10,0,0,0,1)", r"line 1: link distance = 0: must be greater than 0$"),
        ("MOVELINK(1,10,1,1,2,1)", r"line 1: link options = 1: must be a sum of 2 \(from a position\)"),
        ("MOVELINK(1,10,1,1,2,2)", r"line 1: link position: must be given with link option 2, and with no other$"),
        ("MOVE(1)\nWDOG=OFF\nWA(9)", r"line 1: axis 0 is to move while WDOG = OFF: must be ON$"),
        ("SERVO=OFF\nMOVE(1)", r"line 2: axis 0 is to move while SERVO AXIS\(0\) = OFF: must be ON"),
        ("MOVE(1)\nWAIT IDLE\nUNITS=10", r"line 3: UNITS of axis 0: must be set before it moves$"),
        ("x=1\nWHILE x>0\nx=x+1\nWEND", r"line [234]: more than 2000 statements are executed: must be fewer"),
        (
            "\nFORWARD",
            r"line 2: the program still runs after 2 s: must end before, or raise time_limit, or give stop_after",
        ),
        ("WHILE TRUE\nWEND", r"line [12]: (the program still runs after 2 s|more than 2000 statements)"),
        ("GET", None),
    ],
)
def test_a_program_that_fails_names_the_line(text, error):
    with pytest.raises(InputError) as raised:
        _ = basic(text, statement_limit=2000, time_limit=2.0).setpoints(0.001)
    if error:
        assert raised.match(f"^{error}")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"axis_numbers": (1,)}, r"axis_numbers = \[1\]: must be 2 to 4 different numbers"),
        ({"axis_numbers": (1, 1)}, r"axis_numbers = \[1, 1\]"),
        ({"axis_numbers": (1, 99)}, r"axis_numbers = \[1, 99\]: must be at most 63"),
        ({"start": (1,)}, r"start = \[1\]: must be 2 to 4 numbers"),
        ({"valve": 9999}, r"valve = 9999: must be at most 1023"),
        ({"ratio_bits": 3}, r"ratio_bits = 3: must be 8 to 52, or 0"),
        ({"buffers": 0}, r"buffers = 0"),
        ({"initial_acceleration": 0.0}, r"initial_acceleration = 0"),
        ({"servo_period": 0.0}, r"servo_period = 0 s"),
        ({"time_limit": -1.0}, r"time_limit = -1 s"),
    ],
)
def test_arguments_out_of_bounds_are_refused(changed, error):
    with pytest.raises(InputError, match=f"^{error}"):
        basic("MOVE(1)", **changed)


def test_a_program_that_moves_no_axis_of_the_machine_has_no_requested_path():
    with pytest.raises(InputError, match=r"^program moves none of the machine's axes x, y, z: must move one"):
        _ = basic("BASE(5)\nMOVE(10)", initial_speed=1e3).requested


def test_what_has_no_effect_is_noted():
    notes = basic(
        "P_GAIN=1: D_GAIN AXIS(1)=0.5: FE_LIMIT=3\nSRAMP=20\nMOVE(1): PRINT P_GAIN[1]", initial_speed=1e3
    ).notes
    assert notes == (
        "D_GAIN, P_GAIN: accepted without effect, the servo has gains of its own",
        "FE_LIMIT: accepted without effect, the servo and the machine have limits of their own",
        "SRAMP: accepted without effect, the motion stays that without it",
        "OP(8) is never switched: the dispenser is on while the axes move, but not straight up or down",
        "PRINT at 0.000 s: 1.0",
    )


def test_a_long_log_is_cut():
    made = basic("FOR i=1 TO 30\nPRINT i\nNEXT\nMOVE(1)", initial_speed=1e3)
    assert made.notes[-1] == "PRINT: 10 more lines"
    assert len(made.printed) == 30


def test_the_page_names_every_word():
    page = (Path(__file__).parent.parent.parent / "docs" / "trio-basic.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"[A-Z_]+[A-Z0-9_]*", page))
    without_effect = set(IGNORED_WORDS)
    assert set(known_words()) - without_effect - listed == set()
    assert listed & without_effect  # some of them as examples


def test_memory_that_was_never_set_is_zero():
    made = basic("PRINT TABLE(5);VR(7);IN(3);READ_OP(9)\nTABLE(4,2.5): VR(7)=3\nPRINT TABLE(4);TABLE(5);VR(7)")
    assert [line.text for line in made.printed] == ["0.00000.00000.00000.0000", "2.50000.00003.0000"]


def test_known_words_come_in_one_order():
    """So a message names the same word of two that are as near, in every process."""
    found = known_words()
    assert isinstance(found, list)
    assert found == sorted(set(found))
    assert {"MOVE", "CONNECT", "WAIT", "TABLE"} <= set(found)


def test_a_program_that_has_run_is_freed_with_the_last_that_holds_it():
    program = basic(
        'RUN "OTHER",3\nFOR i=1 TO 3\nIF i=2 THEN\nGOSUB more\nENDIF\nNEXT i\nSTOP\n'
        "more:\nWHILE x<3: x=x+1: WEND\nMOVE(x)\nRETURN\n'$PROGRAM other\nWAIT UNTIL PROC_STATUS PROC(0)=0\n"
    )
    state = weakref.ref(program.trace(0.001).state)
    gc.disable()  # which would free a cycle too
    try:
        del program
        assert state() is None
    finally:
        gc.enable()


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 OR 2 AND 0", 1),
        ("0 AND 2 OR 1", 1),
        ("1 OR 3 XOR 2", 1),
        ("3 XOR 2 OR 2", 3),
        ("7 XOR 2 AND 1", 7),
        ("1 OR 2 = 2", -1),
        ("4 AND 2 + 2", 4),
    ],
)
def test_logical_operators_bind_less_than_all_others_and_and_more_than_or(expression, value):
    """OR and XOR are of one rank, from the left: (1 OR 3) XOR 2 = 1; TRUE is -1."""
    assert printed(f"PRINT {expression}[0]") == [str(value)]


@pytest.mark.parametrize("kept", [30, 45, 100])
def test_lines_beyond_the_log_are_counted(monkeypatch, kept):
    """All lines that are not shown, whether the log keeps them or not."""
    monkeypatch.setattr("gantrysim.controllers.trio.basic.process.MOST_PRINTED", kept)
    program = basic("FOR i=1 TO 60\nPRINT i[0]\nNEXT i")
    assert len(program.printed) == min(kept, 60)
    shown = sum(note.startswith("PRINT at ") for note in program.notes)
    assert f"PRINT: {60 - shown} more lines" in program.notes


def test_more_moves_than_can_be_held_are_refused(monkeypatch):
    monkeypatch.setattr("gantrysim.controllers.trio.basic.buffers.MOST_MOVES", 4)
    text = "BASE(0,1)\nFOR i=1 TO {count}\nMOVECIRC(10,10,0,10,0)\nNEXT i\nWAIT IDLE"
    assert printed(text.format(count=4)) == []
    with pytest.raises(InputError, match="line 3: more than 4 moves are run: must be fewer"):
        printed(text.format(count=5))
