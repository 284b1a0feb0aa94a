"""A program read from another start takes over what an earlier reading made of it, and nothing that the start changes.

The oracle is reading the whole text from the other start.
"""

from dataclasses import fields, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode import checkpoints
from gantrysim.controllers.gcode.linuxcnc import Program as LinuxCNC
from gantrysim.controllers.gcode.slicer import Program as Slicer
from gantrysim.controllers.gcode.word_blocks import Interpreter

# lines that take the place of the nozzle, keep it, compute with it, store it, or forget it
LINUXCNC_LINES = """
G90 | G91 | G0 X1 Y2 | G0 X3 | G0 Z4 | G1 X5 Y6 Z1 F600 | G1 Z2 F300 | G1 X-3 F500 | G93 F60 | G94 F600
G92 Z1 | G92 X2 Y1 Z0 | G92.1 | G92.2 | G92.3 | G52 Z1 | G10 L20 P1 Z0 | G10 L2 P1 X1 Z1 R30 | G10 L2 P2 Z3 | G54 | G55
G28 | G28 Z3 | G28.1 | G30 X1 | G30.1 | G53 G0 Z2 | G43.1 Z5 | G49 | T1 M6 | G7 | G8 | G20 | G21 | @5 ^30
#1=#5422 | #1=#<_z> | #2=#5163 | #3=#5183 | #1=[#1+1] | G1 Z[#1] F600 | G0 X[#2] | G0 Y#3
#<_w>=#<_abs_x>/G0 X[#<_w>*2]
G2 X4 Y4 R40 | G3 I3 J0 | G3 X1 Y2 R9 Z1 | G17 | G18 | G19 | G2 X1 Z1 R60 | G90.1 | G91.1 | G5 I1 J1 P2 Q2 X9 Y9
G5.2 X5 Y5 P1 L3/X5 Y9 P2/X9 Y1 P1/G5.3 | G5.1 I1 J2 X3 Y3 | G61 | G64 P0.1 Q0.05 | G64
G81 Z-1 R2 | G82 X3 Z-1 R2 P0.1 | G98 | G99 | G80 | G4 P0.1 | G83 X1 Z-2 R1 Q0.7
G41.1 D1 | G42.1 D0.5 | G40 | G1 X30 Y0 | G1 X30 Y30 | G1 X0 Y30 | G1 X0 Y0 | G1 Z-1
M70/G91/X1/M72 | M73 | M3 S100 | M2 | o1 call [3] | o1 call [#5422] |
o2 if [#5422 gt 3]/G0 X8/o2 endif | o3 repeat [2]/G91/G0 Y1/o3 endrepeat/G90
M98 P4 L2
"""
LINUXCNC_FRAME = ("o1 sub\nG1 Z[#1] F300\nG91\nX1\nG90\no1 endsub\nG64 P0.2\nF500\n", "\nM2\nO4\nG91 G1 X1\nG90\nM99\n")
SLICER_LINES = """
M82 | M83 | G92 E0 | G92 Z1 E2 | G0 X1 Y1 F6000 | G1 X2 E1 | G1 E0 | G90/G1 X2 Y1/G2 X5 Y1 I1.5 E2 | G91 | G90
G1 X1 E.5 | G1 Z0.2 |G1 X9 Y8 Z1 E3 F1800 | G28 | G30 | G28.1 | G30 Z1 | M204 S500 | M204 P400 T900 | M203 X100
SET_VELOCITY_LIMIT ACCEL=900
G1 F1200 | G4 S1 | M106 S5 | G5.1 I1 J1 X3 Y3 | G1 E-1 F2400 | M205 J0.02 | G20 | G21 | ; a remark | G3 I4 J0 E9
"""
STARTS = [(0.0, 0.0, 0.0), (0.0, 0.0, 7.5), (0.0, 0.0, -0.0), (1.25, -2.0, 0.1), (0.0, 3.0, 0.0)]


def programs(lines):
    """Any lines out of a table; / in it parts lines that follow one another."""
    pieces = [line.strip().replace("/", "\n") for row in lines.split("\n") for line in row.split("|") if line.strip()]
    return st.lists(st.sampled_from(pieces), min_size=1, max_size=40).map("\n".join)


def read(program):
    """The moves of a program to the last bit and all that was noted, or its refusal."""
    try:
        interpreted = program.program
    except InputError as error:
        return str(error)
    notes = {field.name: getattr(interpreted, field.name) for field in fields(interpreted)}
    del notes["moves"], notes["checkpoints"]
    return interpreted.moves.tobytes(), repr(notes)


def read_from(program, start):
    """What a program reads from another start when it shares the text with one that was read."""
    other = replace(program, start=start)
    other.sharing_text_of(program)
    return read(other)


def compared(program, start, interval, patch):
    """Compare a shared reading with one of the whole; return whether the program is read at all."""
    patch.setattr(checkpoints, "_INTERVAL", interval)
    patch.setattr(checkpoints, "_BYTES_PER_LINE", 1_000_000)
    whole = read(replace(program, start=start))
    if isinstance(read(program), str):
        return False
    assert read_from(program, start) == whole
    return True


@given(text=programs(LINUXCNC_LINES), start=st.sampled_from(STARTS[1:]), interval=st.integers(1, 5))
@settings(max_examples=400, deadline=None)
def test_sharing_a_program_of_linuxcnc_is_reading_it_again(text, start, interval):
    begin, end = LINUXCNC_FRAME
    with pytest.MonkeyPatch.context() as patch:
        compared(LinuxCNC(text=begin + text + end, max_steps=2000), start, interval, patch)


@given(text=programs(SLICER_LINES), start=st.sampled_from(STARTS[1:]), interval=st.integers(1, 5))
@settings(max_examples=200, deadline=None)
def test_sharing_a_program_of_a_slicer_is_reading_it_again(text, start, interval):
    with pytest.MonkeyPatch.context() as patch:
        compared(Slicer(text=text), start, interval, patch)


class Count:
    """Lines that are interpreted while it is in force."""

    def __init__(self, monkeypatch):
        run = Interpreter.run
        self.lines = 0

        def counted(interpreter, line):
            self.lines += 1
            return run(interpreter, line)

        monkeypatch.setattr(Interpreter, "run", counted)


HEAD = "G21\nG0 X1 Y1\nG1 Z1 F600\n"
BODY = "".join(f"G1 X{k % 50} Y{k % 7}\n" for k in range(6000))
INTERVAL = checkpoints._INTERVAL
SQUARES = "Y60\nX0\nY0\nX60\n" * (INTERVAL // 4)


@pytest.mark.parametrize(
    ("text", "most"),
    [
        (HEAD + BODY, INTERVAL),
        (HEAD + BODY + "M2\n", INTERVAL),
        (HEAD + BODY + "G28\nM2\n", 2 * INTERVAL),  # the end, where the start is used, is read again
        (HEAD + BODY + "G28\n" + HEAD + BODY + "M2\n", 3 * INTERVAL),  # and once more until the axes have moved
        (HEAD + "G41.1 D0.1\nX60\n" + SQUARES + "G40\nX0 Y0\n" + BODY, 2 * INTERVAL + 7),  # all of the squares
        ("G91 F600\n" + BODY, None),  # all of it lies where the start says
        ("G0 X1 Y1 F600\n" + BODY, None),  # z is that of the start
        ("#1=#5422\n" + HEAD + BODY, None),  # a parameter keeps it
    ],
    ids=["plain", "M2", "G28-last", "G28-between", "compensation", "relative", "no-z", "parameter"],
)
def test_a_program_that_forgets_its_start_is_read_once(text, most, monkeypatch):
    program = LinuxCNC(text=text)
    lines = len(text.splitlines())
    start = (0.0, 0.0, 3.0)
    whole = read(replace(program, start=start))
    assert not isinstance(whole, str)
    assert read(program) != whole
    count = Count(monkeypatch)
    assert read_from(program, start) == whole
    if most is None:
        assert count.lines >= lines - 1  # an assignment is none of the words' lines
    else:
        assert 0 < count.lines <= most
