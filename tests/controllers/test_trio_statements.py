"""Trio BASIC as people write it: each statement by what the manual says of it, in programs of the usual kinds."""

import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gantrysim.base.errors import InputError
from gantrysim.cli.main import app
from gantrysim.controllers.trio import Basic, InterpreterTime

NO_TIME = InterpreterTime(0, 0, 0, 0)
DT = 0.001

# what is printed, and where the axes are at the end; each is a kind of program that stands on controllers
PROGRAMS = {
    "names in an include": (
        """
INCLUDE "names"
BASE(x_axis,y_axis): SPEED=feed
MOVE(10,0): WAIT IDLE
PRINT "feed ";VR(speed_vr)[0];" at ",DPOS[1]
'$PROGRAM names
x_axis=0: y_axis=1: speed_vr=12
VR(speed_vr)=80
feed=VR(speed_vr)
""",
        ["feed 80 at      10.0"],
        (10, 0),
    ),
    "constants and globals of all programs": (
        """
CONSTANT "pitch",4
GLOBAL "count",31
count=3
RUN "row",2
WAIT UNTIL PROC_STATUS PROC(2)=0
PRINT count[0];VR(31)[0]
'$PROGRAM row
SPEED=100
FOR i=1 TO count
  MOVE(pitch): WAIT IDLE
NEXT i
count=count+1
""",
        ["44"],
        (12, 0),
    ),
    "typed variables and arrays": (
        """
DIM n AS INTEGER = 7/2
DIM ready, done AS BOOLEAN
DIM px, py AS FLOAT(4)
DIM grid AS INTEGER(2,3)
ready=5
FOR i=0 TO 3
  px(i)=i*2.5: py(i)=px(i)^2/5
NEXT
grid(1,2)=9.9
PRINT n;ready[0];done[0];grid(1,2)[0];grid(0,0)[0];px(3)[2]
BASE(0,1): SPEED=200: MOVEABS(px(3),py(3)): WAIT IDLE
""",
        ["3.0000-10907.50"],
        (7.5, 11.25),
    ),
    "an error is reported and the axes stop": (
        """
ON BASICERROR GOTO failed
FORWARD
WA(100)
VR(1)=1/VR(2)
PRINT "never"
failed:
IF RUN_ERROR<>31 THEN PRINT#5, "error in line ";ERROR_LINE[0]
RAPIDSTOP
WAIT IDLE
STOP
""",
        ["error in line 4"],
        None,
    ),
    "loops with a condition at either end": (
        """
a=0: b=0: c=0: d=9
DO
  a=a+1
LOOP UNTIL a=3
DO WHILE b<2
  b=b+1
LOOP
DO UNTIL c>=4: c=c+1: LOOP
DO
  d=d-1
LOOP WHILE d>5
DO WHILE FALSE
  d=0
LOOP
PRINT a[0],b[0],c[0],d[0]
MOVE(1): WAIT IDLE
""",
        ["3       2       4       5"],
        (1, 0),
    ),
    "bits and hexadecimal numbers": (
        """
VR(4)=$2D
PRINT VR(4).0[0];VR(4).1[0];VR(4).2[0];VR(4).5[0];" $";HEX(VR(4));" ";HEX(-1)
OP(10,13,5): VR(5)=OP AND $FFFF
PRINT VR(5)[0];" ";READ_OP(10,13)[0];OP(11)[0];OP(12)[0];IN(0,3)[0]
MOVE(100): WA(200): CANCEL
WA(20)
PRINT AXISSTATUS.11[0];AXISSTATUS.11 AXIS(1)[0];AXISSTATUS AXIS(0).11[0]
WAIT IDLE: PRINT AXISSTATUS[0]
""",
        ["1011 $2D FFFFFFFF", "5120 5010", "101", "0"],
        None,
    ),
    "waiting for axes by a value": (
        """
PRINT IN[0];OP[0]
loop: n=1
IF n=0 THEN GOTO loop
BASE(0): SPEED=100: MOVE(10)
BASE(1): SPEED=50: MOVE(10)
PRINT IDLE AXIS(0)[0];IDLE[0];LOADED AXIS(1)[0]
WAIT UNTIL IDLE AXIS(0) AND IDLE AXIS(1)
PRINT IDLE AXIS(0)[0];IDLE[0]
""",
        ["00", "00-1", "-1-1"],
        (10, 10),
    ),
    "brackets about what is printed": (
        """
x=2
PRINT("x = ";x[0])
PRINT (x+1)*2
PRINT(#6,"done"): PRINT("(in text)") ' (and more)
PRINT "one ";
PRINT "line"
MOVE(1): WAIT IDLE
""",
        ["x = 2", "6.0000", "done", "(in text)", "one line"],
        (1, 0),
    ),
    "a start-up program with settings of the hardware": (
        """
LIMIT_BUFFERED=16: ADDRESS=1
ETHERCAT($22,0,59): ETHERNET(1,-1,14,0,2,0): TRON
IF VR(59)<>3 AND CONTROL<>400 THEN WA(5000)
BASE(0,1)
FOR a=0 TO LAST_AXIS
  BASE(a)
  P_GAIN=1: I_GAIN=0: OV_GAIN=0: VFF_GAIN=0: DAC_SCALE=1
  UNITS=400: FE_LIMIT=5: FS_LIMIT=200: RS_LIMIT=-200: FAST_JOG=-1
  REP_DIST=100000: STEP_RATIO(1,1): ENCODER_RATIO(1,1)
  DATUM(0): SERVO=ON
NEXT a
WDOG=ON
IF MOTION_ERROR=0 AND SYSTEM_ERROR=0 THEN PRINT "ready"
BASE(0,1): SPEED=100: MOVEABS(3,4): WAIT IDLE
""",
        ["ready"],
        (3, 4),
    ),
    "a rounded rectangle with a speed of its own for the corners": (
        """
BASE(0,1): MERGE=ON: ACCEL=1000: DECEL=1000
FORCE_SPEED=60: ENDMOVE_SPEED=30
MOVESP(20,0)
FORCE_SPEED=30: MOVECIRCSP(5,5,0,5,0)
FORCE_SPEED=60: MOVESP(0,20)
WAIT LOADED
PRINT MTYPE[0];NTYPE[0]
WAIT IDLE
""",
        ["60"],
        (25, 25),
    ),
    "a cycle that counts and an offset of the origin": (
        """
BASE(0): SPEED=100
MOVE(5): WAIT IDLE
OFFPOS=-5: WAIT UNTIL OFFPOS=0
PRINT DPOS[1]
WHILE VR(10)<3
  MOVEABS(10): MOVEABS(0): WAIT IDLE
  VR(10)=VR(10)+1
WEND
""",
        ["0.0"],
        (5, 0),
    ),
    "a state machine that starts and stops programs": (
        """
VR(0)=1
REPEAT
  IF VR(0)=1 THEN
    IF PROC_STATUS PROC(3)=0 THEN RUN "jog",3
    WA(300)
    VR(0)=2
  ELSEIF VR(0)=2 THEN
    STOP "jog"
    CANCEL: WAIT IDLE
    VR(0)=0
  ENDIF
UNTIL VR(0)=0
PRINT PROC_STATUS PROC(3)[0];PROC_STATUS[0]
'$PROGRAM jog
FORWARD
WAIT UNTIL FALSE
""",
        ["01"],
        None,
    ),
}


def basic(text, **changed):
    return Basic(**{"text": text, "interpreter_time": NO_TIME, "initial_speed": 100.0, **changed})


@pytest.mark.parametrize("kind", PROGRAMS)
def test_programs_run_as_people_write_them(kind):
    text, printed, end = PROGRAMS[kind]
    program = basic(text.lstrip("\n"), time_limit=20.0)
    position = program.setpoints(DT).position
    assert [line.text for line in program.printed] == printed
    if end is not None:
        assert position[-1] == pytest.approx(end, abs=1e-9)


@pytest.mark.parametrize(
    "first",
    [
        "MOVEABS(10,20)",
        "MOVESP(3.3,7.7)",
        "CORNER_MODE=2: STOP_ANGLE=1: MERGE=ON: MOVEABS(10,1): MOVEABS(0,7)",
        "MOVELINK(5,4,1,1,2): MOVE(8) AXIS(2)",
        "FORWARD: CANCEL",
    ],
)
def test_an_absolute_move_from_the_buffer_ends_at_its_target(first):
    """It starts where the move before it has ended, not where its axes were a period earlier."""
    text = f"BASE(0,1): SPEED=37: {first}\nMOVEABS(1.25,-2.5): WAIT IDLE"
    assert basic(text, buffers=4).setpoints(DT).position[-1] == pytest.approx([1.25, -2.5], abs=1e-12)


def test_an_error_that_the_program_handles_is_noted_and_a_second_one_ends_it():
    text = "ON BASICERROR GOTO again\nMOVE(1): WAIT IDLE\nagain:\nx=1/VR(1)"
    with pytest.raises(InputError, match=r"^line 4: division by zero$"):
        basic(text).setpoints(DT)
    program = basic("n=0\nON BASICERROR GOTO again\nMOVE(1): WAIT IDLE: y=1/n\nagain:\nn=1")
    program.setpoints(DT)
    assert "line 3: division by zero: the program went on at its ON BASICERROR" in program.notes
    endless = "again:\nON BASICERROR GOTO again\nx=0\nWHILE TRUE\nx=x+1\nWEND"
    with pytest.raises(InputError, match=r"more than 50 statements"):
        basic(endless, statement_limit=50, time_limit=1.0).setpoints(DT)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ('x=1\nINCLUDE "names"', r'line 2: INCLUDE "NAMES": must be one of the programs MAIN, or a file names\.bas'),
        ('INCLUDE "a"\n\'$PROGRAM a\nINCLUDE "a"', r"line 3 \(line 1 of A\): INCLUDE \"A\": .* more than 8 deep$"),
        ("DIM s AS STRING(20)", r"line 1: DIM s AS STRING: is not emulated, must be BOOLEAN, FLOAT, INTEGER$"),
        ('x=1\ns="text"', r"line 2: text in a variable is not emulated: a variable must be a number$"),
        ("DIM a AS FLOAT(3)\na(3)=1", r"line 2: a\(3\): must be a whole number from 0 to 2$"),
        ("DIM a AS FLOAT(3)\nPRINT a(1,1)", r"line 2: a with 2 indices: must have 1$"),
        ("x=0\nIF x THEN\nDIM a AS FLOAT(3)\nENDIF\na(1)=2", r"line 5: a\(\.\.\.\): the DIM of the array must be"),
        ("DIM a AS FLOAT(0)", r"line 1: DIM a: 0 elements, must be 1 to 1000000$"),
        ('CONSTANT "c",4\nc=5', r"line 2: c = \.\.\.: is a CONSTANT, which cannot be assigned$"),
        ('CONSTANT "c",4\nCONSTANT "c",5', r"line 2: CONSTANT c = 5: must be 4, as it is already$"),
        ('CONSTANT "move",4', r"line 1: move = \.\.\.: is a word of the language that cannot be assigned$"),
        ('GLOBAL "g",70000', r"line 1: VR\(70000\): must be a whole number from 0 to 65535$"),
        ("DO\nx=1", r"line 1: DO without its LOOP$"),
        ("LOOP UNTIL TRUE", r"line 1: LOOP without DO$"),
        ("ON BASICERROR GOTO nowhere", r"line 1: label NOWHERE: must stand before a colon"),
        ("x=1\nDATUM(3)", r"line 2: DATUM\(3\): homing is not simulated"),
        ("VR(1).3=1", r"line 1: VR\.3 = \.\.\.: a bit can be read, not set$"),
        ("PRINT VR(1).32", r"line 1: VR\.32: must be a bit from 0 to 31$"),
        ("PRINT SPEED PROC(1)", r"line 1: SPEED PROC\(\): SPEED does not belong to a process$"),
        ("PRINT IN(5,1)", r"line 1: IN\(5,1\): must be 1 to 32 lines, the first one first$"),
        ("OP(8,7,1)", r"line 1: OP\(8,7, \.\.\.\): must be 1 to 32 outputs, the first one first$"),
        ("\nPRINT foo(3)", r"line 2: unknown word 'foo'"),
    ],
)
def test_what_is_refused_is_named_with_its_line(text, error):
    with pytest.raises(InputError, match=f"^{error}"):
        basic(text).setpoints(DT)


def test_a_program_that_never_ends_is_stopped_and_brought_to_rest():
    text = "BASE(0): SPEED=50: ACCEL=1000: DECEL=500\nCONNECT(2,0) AXIS(1)\nFORWARD\nWHILE TRUE\nWA(1)\nWEND"
    program = basic(text, stop_after=1.0)
    position = program.setpoints(DT).position
    # 1 s at 50 mm/s after a ramp of 0.05 s, and 50² / (2 · 500) mm to rest
    assert position[-1] == pytest.approx([50 - 1.25 + 2.5, 2 * 51.25], abs=0.051)
    assert program.duration == pytest.approx(1.1, abs=0.003)
    assert program.notes[0].startswith("stopped at 1 s (stop_after), at line 5: the program had not ended")
    ended = basic("SPEED=50: MOVE(1): WAIT IDLE", stop_after=1.0)
    assert not any("stop_after" in note for note in ended.notes)
    with pytest.raises(InputError, match=r"^stop_after = -1 s: must be at least 0 s$"):
        basic(text, stop_after=-1.0)


def test_programs_are_found_in_files_beside_the_program(tmp_path: Path):
    (tmp_path / "cell.bas").write_text('INCLUDE "names"\nRUN "Row",2\nWHILE TRUE\nWEND\n\' INCLUDE "absent"\n')
    (tmp_path / "NAMES.BAS").write_text("pitch=4\n")
    row = 'INCLUDE "names"\nSPEED=100\nREPEAT\nMOVE(pitch): WAIT IDLE: MOVE(-pitch): WAIT IDLE\nUNTIL FALSE\n'
    (tmp_path / "row.bas").write_text(row)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "cell.bas"), "--stop-after", "2"])
    assert result.exit_code == 0, result.output
    assert "stopped at 2 s (stop_after)" in " ".join(result.output.split())
    (tmp_path / "row.bas").write_text(row.replace("100", "-100"))
    with pytest.raises(InputError, match=r"cell\.bas: line 10 \(line 2 of ROW\): SPEED = -100 of axis 0"):
        CliRunner().invoke(app, ["check", str(tmp_path / "cell.bas")], catch_exceptions=False, standalone_mode=False)


def test_speeds_of_sp_moves_are_changed_with_the_others():
    program = basic("SPEED=50: FORCE_SPEED=40: ENDMOVE_SPEED = 20: STARTMOVE_SPEED AXIS(0)=10\nMOVESP(5)")
    changed = program.with_speeds(lambda speed: 2 * speed)["text"]
    assert changed.startswith("SPEED=100")
    for number in ("80", "40", "20"):
        assert number in changed
    assert math.isfinite(basic(changed).duration)
