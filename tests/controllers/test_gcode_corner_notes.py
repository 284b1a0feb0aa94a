"""The note on corners that nearly stop a program advises what makes it faster."""

import re

import pytest

from gantrysim.controllers.gcode import linuxcnc, slicer

# a zigzag of four right angles, and back the way that it came
ZIGZAG = "G1 X10\nG1 X10 Y10\nG1 X20 Y10\nG1 X20 Y20\nG1 X20 Y10\n"


def sliced(head, tolerance=0.05):
    return slicer.Program(text=f"M83\nG0 F3000 X0\n{head}\n{ZIGZAG}", corner_tolerance=tolerance)


def corner_note(program):
    return next(note for note in program.notes if "between moves at feed" in note)


KLIPPER = "SET_VELOCITY_LIMIT SQUARE_CORNER_VELOCITY="


@pytest.mark.parametrize(
    ("tight", "wide"),
    [("M205 J0.001", "M205 J0.1"), ("M205 X1 Y1", "M205 X20 Y20"), (f"{KLIPPER}1", f"{KLIPPER}20")],
)
def test_where_the_program_sets_the_speed_of_corners_the_advice_is_about_that(tight, wide):
    note = corner_note(sliced(tight))
    assert "The program itself limits 3 of them, by M205 or SQUARE_CORNER_VELOCITY: a larger value there" in note
    assert "corner_tolerance" not in note
    assert sliced(wide).duration < sliced(tight).duration
    assert sliced(tight, tolerance=0.5).duration == sliced(tight).duration


def test_a_wider_rounding_is_not_advised_for_a_reversal():
    note = corner_note(sliced(""))
    assert note.endswith("It turns back or joins an arc, which no rounding passes faster.")
    assert "larger corner_tolerance" not in note


def test_rounding_is_advised_where_it_makes_the_program_faster():
    exact = linuxcnc.Program(text=f"G21 G90 G61 F3000\n{ZIGZAG}M2\n")
    note = corner_note(exact)
    blending = linuxcnc.Program(text=f"G21 G90 G64 P0.05 F3000\n{ZIGZAG}M2\n")
    assert re.search(r"G64 P0.05 rounds corners.*1 of them turns back", note)
    assert blending.duration < exact.duration
