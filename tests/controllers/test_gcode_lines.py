"""Lines of G-code: the short way for lines of nothing but words reads what the general ways read."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.gcode.lines import LINE_LENGTH, compact, plain_line, plain_words, read_firmware

from support.soaked import examples

NUMBERS = st.from_regex(r"[-+]?([0-9]{1,3}(\.[0-9]{0,4})?|\.[0-9]{1,3})", fullmatch=True)
WORDS = st.tuples(st.sampled_from("GXYZEFIJMNOT"), NUMBERS, st.sampled_from(["", " ", "\t", "  "])).map("".join)
LINES = st.lists(WORDS, min_size=1, max_size=7).map("".join)
# with a character that may change all of it
SPOILED = st.tuples(LINES, st.sampled_from(list(";()*/%$ \x1c\u00a0\u0661.-+#[]eXg")), LINES).map("".join)


@given(line=LINES | SPOILED)
@example(line="X1 0")
@example(line="X1;Y2")
@example(line="X1Y")
@example(line="X1 " * LINE_LENGTH)
@examples(500)
def test_the_short_way_reads_what_the_general_ways_read(line):
    words = plain_line(line)
    if words is None:
        return
    assert plain_words(compact(line)) == words
    assert plain_words(read_firmware(line)) == words
    assert not {"M", "O"} & {letter for letter, _ in words}  # which may order lines


def test_the_lines_of_long_programs_take_it():
    for line in ("G1 X1.5 Y-2 E0.03", "G0 F9000 X10.123 Y.5", "X1Y2Z-3.", "N10 G01 X+1", "G1 Z0.2 F600 "):
        assert plain_line(line), line
    for line in ("M104 S200", "O100", "G1 X[1+2]", "G1 X#1", "/G0 X1", "%", "", "G1 X1 ; to the left", "g1 x1"):
        assert plain_line(line) is None, line


@pytest.mark.parametrize("read", [compact, read_firmware])
def test_a_long_line_is_left_to_the_general_ways_which_refuse_it(read):
    line = "X1" * LINE_LENGTH
    assert plain_line(line) is None
    with pytest.raises(InputError, match=f"must be at most {LINE_LENGTH}"):
        read(line)


@pytest.mark.parametrize(
    ("line", "read"),
    [
        ("M117 Printing X5 G1!", "M117"),
        ("N12 M117 it's 5% (of) X5", "N12M117"),
        ("G28 X Y", "G28"),
        ("G1 X5 Y-2.5*71", "G1X5Y-2.5"),
        ("g0 x1 ; away", "G0X1"),
        ("M118 a (b", "M118"),
    ],
)
def test_a_printer_s_line_is_its_words_without_messages_checksums_and_bare_letters(line, read):
    assert read_firmware(line) == read
