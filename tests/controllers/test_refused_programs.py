"""Programs that a controller would not run: the line, what is wrong with it, and what it must be."""

import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers import softmc, trio
from gantrysim.controllers.fanuc import Alarm
from gantrysim.controllers.fanuc import Program as FanucProgram
from gantrysim.controllers.gcode.linuxcnc import Program

MC_BASIC = {
    "common shared g as group axnm=a1": "line 1: group g of 1 axes: must be 2 to 4",
    "? g1.nosuch": "line 1: unknown property 'nosuch': must be declared by DIM, or be a property",
    "dim a[2] as long\n? (a + 1)[1]": "line 2: an index in [ ]: must follow the name of an array",
    "sub s\nend sub\n? s()": "line 3: s is a sub: must be called by CALL",
    "sub s\nend sub\nsub S\nend sub": "line 3: S is declared twice",
    "dim a[2][3] as long\na[1] = 3": "line 2: a has more dimensions than 1",
    "dim a[2] as long\na[1][1] = 3": "line 2: a has 1 dimensions: 2 are used",
    "dim a[2] as long\n? a[1][1][2]": "line 2: a has 1 dimensions: 3 are used",
    "dim a[2] as long\na[3] = 3": "line 2: index of a = 3: must be 1 to 2",
    "dim a[2] as long\n? a[0]": "line 2: index of a = 0: must be 1 to 2",
    "for i = 1 to 3\nnext j": "line 1: next j: must be next i",
    "record f.rec 100 gap=1 recdata=pcmd{5}": "line 1: pcmd{5}: must be 1 to 4",
    "record f.rec 100 gap=1 recdata=pcmd{0}": "line 1: pcmd{0}: must be 1 to 4",
    "function f(a as long) as long\nf = a\nend function\n? f(1, 2)": "line 4: f of 2 arguments: must have 1",
}


@pytest.mark.parametrize(("text", "message"), MC_BASIC.items())
def test_mc_basic(text, message):
    with pytest.raises(InputError) as refused:
        softmc.Basic(f"{text}\nmove {{0, 0}}\nmove {{10, 0}}\n")
    assert str(refused.value) == message


TRIO_BASIC = {
    "MOVE(10,0)\nRAPIDSTOP(3)": "line 2: mode 3: must be 0 (executing move), 1 (buffered moves) or 2 (both)",
    "MOVE(10,0)\nCANCEL(0.5)": "line 2: mode 0.5: must be 0 (executing move), 1 (buffered moves) or 2 (both)",
    "DIM a AS FLOAT(2,2,2,2)": "line 1: DIM a: 4 sizes, must be 1 to 3",
    "DIM a AS FLOAT(2) = 3": "line 1: DIM a = ...: an array has no value, its elements are 0",
    'RUN "b",33\n\'$PROGRAM b\nx=1': "line 1: RUN on process 33: must be a free one of 0 to 32",
    'RUN "b",1\nRUN "b",1\n\'$PROGRAM b\nWA(100)': "line 1: RUN on process 1: must be a free one of 0 to 32",
    'RUN "c"\n\'$PROGRAM b\nx=1': "line 1: RUN 'c': must be one of the programs MAIN, B",
    f"x=${'F' * 300}": "line 1: number too large",
    "PRINT 2[8,16]": "line 1: digits(16): must be a whole number from 0 to 15",
    "PRINT 2[64,2]": "line 1: width(64): must be a whole number from 0 to 63",
    "PRINT CHR(256)": "line 1: CHR(256): must be a whole number from 0 to 255",
}


@pytest.mark.parametrize(("text", "message"), TRIO_BASIC.items())
def test_trio_basic(text, message):
    with pytest.raises(InputError) as refused:
        trio.Basic(text).setpoints(1e-3)
    assert str(refused.value) == message


def test_the_widest_number_of_trio_basic_has_63_characters_and_15_digits():
    (text,) = (line.text for line in trio.Basic("PRINT 2[63,15]").printed)
    assert text == "2.000000000000000".rjust(63)


LINUXCNC = {
    "G10 L3 P1 X0": "line 1: G10 L3: must be L1, L2, L10, L11 or L20",
    "G10 L20 P1 X0 R10": "line 1: G10 L20 with R: must not have it",
    "G10 L2 P10 X0": "line 1: G10 P10: must be a coordinate system, 0 to 9",
    "G10 L2 P1.5 X0": "line 1: G10 P1.5: must be a coordinate system, 0 to 9",
    "G53 G2 X1 I1 F60": "line 1: G53: must be with G0 or G1",
    "G1 X1 F60 J3": "line 1: J3: is not used in this block",
    "G1 X1 F60 (a (b) c)": "line 1: comment: must begin with ( and end with ), without another inside",
    "G1 X10000001 F60": "line 1: end at [10000001.0, 0.0, 0.0] mm: must be within 1e+07 mm",
    "G1 X0 Y-10000001 F60": "line 1: end at [0.0, -10000001.0, 0.0] mm: must be within 1e+07 mm",
    "G1 Z-10000001 F60": "line 1: end at [0.0, 0.0, -10000001.0] mm: must be within 1e+07 mm",
    "G2 X0 Y20000002 I0 J10000001 F60": "line 1: arc to [0.0, 20000002.0, 0.0] mm: must be within 1e+07 mm",
    "M72": "line 1: M72: must follow M70 or M73 in the same subroutine",
    "M70\no1 sub\nM72\no1 endsub\no1 call": "line 3: M72: must follow M70 or M73 in the same subroutine",
    "G95 G1 X1 F1": "line 1: G95: feed per revolution must have a spindle speed S",
    "G1 X[1/0] F60": "line 1: 1 / 0: the divisor must not be 0",
    "G1 X[1 MOD 0] F60": "line 1: 1 MOD 0: the divisor must not be 0",
    "#1=EXP[999]": "line 1: EXP[999]: has no finite value",
    f"#1={'9' * 400}": f"line 1: {'9' * 20}...: must be finite",
}


@pytest.mark.parametrize(("text", "message"), LINUXCNC.items())
def test_linuxcnc(text, message):
    with pytest.raises(InputError) as refused:
        Program(text=f"{text}\nG1 X1 F60").setpoints(1e-3)
    assert str(refused.value) == message


FANUC = {
    "G53 G02 X1 I1 F60": "alarm 010 IMPROPER G-CODE in block 1 (line 1): G53 must be with G00 or G01",
    "G91 G53 X1": "alarm 010 IMPROPER G-CODE in block 1 (line 1): G53 in G91: must be in G90, as the controller "
    "ignores it in G91",
    "#1 3": "alarm 114 FORMAT ERROR IN MACRO in block 1 (line 1): '': an assignment must have = after the variable",
    "#1=[1/0]": "alarm 114 FORMAT ERROR IN MACRO in block 1 (line 1): 1 / 0: the divisor must not be 0",
}


@pytest.mark.parametrize(("text", "message"), FANUC.items())
def test_fanuc(text, message):
    with pytest.raises(Alarm) as refused:
        FanucProgram(f"{text}\nG01 X1 F60")
    assert str(refused.value) == message
