"""What a program asks for in vain is said in the notes: G41 without an offset, G64 where the motion stops."""

import pytest

from gantrysim.controllers.fanuc import Program
from gantrysim.controllers.valve import Dispense

MOVES = "G01 X10 F600\nX20\nX20 Y50\nX80\n"
SMOOTH = {"acceleration": 2000.0, "blend_time": 0.05}


def notes(text, **arguments):
    return Program(text, **arguments).notes


@pytest.mark.parametrize("side", ["G41", "G42", "G41 D0", "G42 D00"])
def test_compensation_without_an_offset(side):
    program = Program(f"{side}\n{MOVES}G40 Y0", offsets={"1": 3.0})
    assert program.notes == (
        "4 motions in G41 or G42 have no D or an offset of 0: they follow the programmed path (offsets).",
    )
    plain = Program(f"{MOVES}G40 Y0")
    assert program.requested.length == plain.requested.length


def test_compensation_with_an_offset_is_no_matter_for_a_note():
    text = f"G41 D1\n{MOVES}G40 Y0"
    assert notes(text, offsets={"1": 3.0}) == ()
    assert notes(text, offsets={"1": 0.0})[0].startswith("4 motions in G41 or G42 have no D or an offset of 0")
    assert notes(f"G40\n{MOVES}") == ()


def test_an_offset_given_later_counts_from_there():
    text = "G41\nG01 X10 F600\nX20 D1\nX30\nG40 X40"
    assert notes(text, offsets={"1": 3.0}) == (
        "1 motions in G41 or G42 have no D or an offset of 0: they follow the programmed path (offsets).",
    )


def test_g64_that_stops_at_corners_without_a_blend_time():
    text = f"G64\n{MOVES}"
    stopping = Program(text, acceleration=2000.0)
    assert stopping.notes == (
        "2 stops at corners in G64, as blend_time is 0; blend_time = 0.05 passes without a stop.",
    )
    assert notes(text, **SMOOTH) == ()
    assert notes(text) == ()  # without a limit of the acceleration nothing stops
    assert notes(f"{MOVES}", acceleration=2000.0) == ()
    assert notes(f"G64\nG61\n{MOVES}", acceleration=2000.0) == ()
    # and it does stop: longer by what the ramps at the two corners take, v / a for each
    faster = Program(text)
    assert stopping.duration - faster.duration == pytest.approx(3 * 10 / 2000, rel=2e-3)


def test_g64_that_stops_at_every_piece_while_the_look_ahead_is_off():
    text = f"G64\nG05.1 Q1\nG01 X-10 F600\nG05.1 Q0\n{MOVES}"
    assert notes(text, **SMOOTH) == (
        "4 motions in G64 stop at their end, as G05.1 Q1 or G08 P1, which the program uses, is off.",
    )
    assert notes(text.replace("G05.1 Q0\n", ""), **SMOOTH) == ()
    assert notes(text.replace("G05.1 Q0", "G61"), **SMOOTH) == ()
    stops = Program(text, **SMOOTH).duration
    assert stops - Program(text.replace("G05.1 Q0\n", ""), **SMOOTH).duration > 3 * 0.05


PART = """O0001
G21 G90 G17 G40 G80
T1 M06
G54 G43 H1 Z10. M08
S3000 M03
G00 X0 Y0
G01 X30. F600
M00
M05
M09
G49 G00 X0
M30"""


def test_words_without_an_effect_are_counted():
    """Every word of the text that neither moves an axis nor switches the valve, which is M08's, counted by hand."""
    _, of_words = notes(PART)
    assert of_words == ("Words without an effect on the path: G43 (1), H (1), M0 (1), M3 (1), M5 (1), M6 (1), T (1).")
    by_spindle = notes(PART, dispense=Dispense(on=("M03",), off=("M05",)))
    assert by_spindle == (
        "Words without an effect on the path: G43 (1), H (1), M0 (1), M6 (1), M8 (1), M9 (1), T (1).",
    )


def test_words_that_do_what_they_say_are_not_counted():
    assert notes("O1\nG90 G49 G80 G94\nM98 P2\nM30\nO2\nG01 X5 F60\nG28 X0\nM99") == ()


@pytest.mark.parametrize("block", ["G28 X0 T2", "G04 X0.5 T2", "G92 X0 T2"])
def test_a_tool_may_be_named_beside_any_action(block):
    """T selects a tool in the magazine while the axes do something else."""
    assert notes(f"G01 X5 F60\n{block}") == ("Words without an effect on the path: T (1).",)
