"""Damaged programs of every dialect: nothing but InputError comes out."""

import random

import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.fanuc import Program as Fanuc
from gantrysim.controllers.gcode.linuxcnc import Program as LinuxCNC
from gantrysim.controllers.gcode.slicer import Program as Slicer

SEEDS = [
    "G21 G90 G64 P0.05 Q0.01\nG0 X1 Y2\nG1 X5 F600\nG2 X9 Y6 I2 J2 P2\nG4 P0.1\nG61 G3 X1 Y1 R9\nM2",
    "#1=3 #<a>=[#1*2+SIN[30]]\no1 while [#1 gt 0]\nG91 G1 X1 F[60+#1]\n#1=[#1-1]\no1 endwhile\nG90",
    "o<s> sub\no1 if [#1 eq 2]\nG0 X#1\no1 else\nG0 Y[ATAN[1]/[#2]]\no1 endif\no<s> endsub [5]\n"
    "o<s> call [2] [3]\nG0 Z#<_value>",
    "G10 L2 P2 X1 R45\nG55 G0 X1\nG92 X3\nG5 I1 J1 P2 Q2 X9 Y9 F60\nG28 X1\no2 repeat [2]\nG53 G0 X1\no2 endrepeat",
    "M82\nG92 E0\nG0 X1 Y1 F6000\nG1 X2 E1\nG1 E0\nG2 X5 Y1 I1.5 E2\nM83\nG91\nG1 X1 E.5",
    "O1\n#1=1\nWHILE[#1LE3]DO1\nG01 X#1 F600\n#1=#1+1\nEND1\nM98 P2 L2\nIF[#1EQ4]GOTO9\n"
    "N9 G65 P2 A1\nM30\nO2\nG91 Y1\nM99",
    "G17 G02 X0 Y-30 I0 J-100 Q-20 F300\nG41 D1 G01 X9\nG40 X0\nG04 P100\nG05.1 Q1\nG28 X0\nG10 L2 P1 X1",
]
PIECES = [*"GXYZFIJKRPQE#<>[]()%/;.-+=0123456789 \n", "o1 ", "call", "while", "endsub", "**", "MOD", "WHILE"]
PIECES += ["GOTO", "9e9", "\x00", "é"]


def damaged(rng):
    """One of the programs with some of its characters deleted, doubled, replaced or moved."""
    text = list(rng.choice(SEEDS))
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(text) + 1)
        match rng.randrange(4):
            case 0:
                del text[at : at + rng.randint(1, 4)]
            case 1:
                text[at:at] = rng.choice(PIECES)
            case 2:
                text[at : at + 1] = rng.choice(PIECES)
            case _:
                other = rng.choice(SEEDS)
                begin = rng.randrange(len(other))
                text[at:at] = other[begin : begin + rng.randint(1, 30)]
    return "".join(text)


def survives(text, plan):
    """How many dialects read a text; any other error than InputError is the test's."""
    read = 0
    for make in (
        lambda: LinuxCNC(text=text, max_steps=300, skip_axes="ABCUVW"),
        lambda: Slicer(text=text, max_steps=300),
        lambda: Fanuc(text, max_steps=300, offsets={"1": 0.5}),
    ):
        try:
            controller = make()
            if plan:
                assert controller.duration > 0
            elif not isinstance(controller, Fanuc):
                assert controller.program.moves.ndim == 2
            read += 1
        except InputError:
            continue
    return read


@pytest.mark.parametrize("seed", range(3))
def test_damaged_programs_run_or_are_refused(seed):
    rng = random.Random(seed)
    for k in range(300):
        survives(damaged(rng), plan=k % 4 == 0)


@pytest.mark.soak
def test_many_damaged_programs_run_or_are_refused(record_property):
    rng = random.Random(99)
    read = sum(survives(damaged(rng), plan=k % 10 == 0) for k in range(100_000))
    record_property("attack", "G-code of LinuxCNC, slicers and FANUC: random changes to programs")
    record_property("tries", 300_000)
    record_property("refused", 300_000 - read)
