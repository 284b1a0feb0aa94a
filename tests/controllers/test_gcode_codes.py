"""Codes of G-code: a new one is one function in one file, and the page lists those that there are."""

import json
import re
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.fanuc.codes import g_codes
from gantrysim.controllers.fanuc.sequence import CALLS, ENDS
from gantrysim.controllers.gcode.codes import CODES, Kind
from gantrysim.controllers.gcode.codes.code_table import SLICER, setting
from gantrysim.controllers.gcode.linuxcnc import Program as LinuxCNC
from gantrysim.controllers.valve import CODES as VALVE_CODES

ROOT = Path(__file__).parent.parent.parent
PACKAGE = ROOT / "gantrysim"
PAGE = (ROOT / "docs" / "g-code.md").read_text(encoding="utf-8")

# a code of all dialects, a command of firmware, and a code of FANUC: the same square, from the corner where they begin
SQUARE = '''

@action()
def g13_1(state: ProgramState, block: WordBlock) -> None:
    """Square of the side I at the rapid speed, counter-clockwise from its first corner."""
    x, y, z = state.frames.here
    side = state.frames.axis(0, block.values.pop("I"))
    for end in ([x + side, y, z], [x + side, y + side, z], [x, y + side, z], [x, y, z]):
        state.rapid_to(end)
'''
COMMAND = '''

from gantrysim.controllers.gcode.codes.code_table import command


@command()
def square(state: ProgramState, block: WordBlock) -> None:
    """Square of the side SIDE at the feed."""
    x, y, z = state.frames.here
    side = float(block.arguments.removeprefix("SIDE="))
    for end in ([x + side, y, z], [x + side, y + side, z], [x, y + side, z], [x, y, z]):
        state.line_to(end, state.feed_per_minute)
'''
FANUC = '''

@action
def g13(state: ModalState, words: Words) -> list[Block]:
    """Square of the side I at the rapid speed, counter-clockwise from its first corner."""
    x, y, _ = state.here
    side = words.values.pop("I") * state.unit
    return [Rapid(end=end) for end in ((x + side, y), (x + side, y + side), (x, y + side), (x, y))]
'''

RUN = """
import json, sys
sys.path.insert(0, sys.argv[1])
import gantrysim
from gantrysim.controllers.fanuc import Program as Fanuc
from gantrysim.controllers.gcode.linuxcnc import Program as LinuxCNC
from gantrysim.controllers.valve import CODES as VALVE_CODES
from gantrysim.controllers.gcode.move_table import END
from gantrysim.controllers.gcode.slicer import Program as Slicer

def ends(program):
    return program.program.moves[:, END : END + 2].tolist()

print(json.dumps({
    "package": gantrysim.__file__,
    "linuxcnc": ends(LinuxCNC(text="G0 X1 Y2\\nG91 G13.1 I5\\nG0 X1")),
    "slicer": ends(Slicer(text="G1 F600 X1 Y2\\nsquare side=5\\nG13.1 I5")),
    "fanuc": [leg.piece.end[:2] for leg in Fanuc("G01 X1 Y2 F600\\nG13 I5").legs if leg.piece is not None],
}))
"""


def _copied_if_there(source, target):
    """Copy a file, but for one that goes meanwhile: other tests write compiled code beside it under passing names."""
    with suppress(FileNotFoundError):
        shutil.copy2(source, target)


@pytest.fixture(scope="module")
def shown(fresh, tmp_path_factory):
    """What programs with the new codes do in a copy of the package, in which each is added to one file."""
    folder = tmp_path_factory.mktemp("codes")
    copy = shutil.copytree(PACKAGE, folder / "gantrysim", copy_function=_copied_if_there)
    for file, text in (
        ("gcode/codes/motions.py", SQUARE),
        ("gcode/codes/printing.py", COMMAND),
        ("fanuc/codes.py", FANUC),
    ):
        path = copy / "controllers" / file
        path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")
    done = fresh.run(RUN, folder, folder)
    assert (done.status, done.error) == (0, "")
    answer = json.loads(done.output)
    assert Path(answer.pop("package")).parent == copy
    return answer


CORNERS = [[6, 2], [6, 7], [1, 7], [1, 2]]


def test_a_code_of_all_dialects_is_one_function(shown):
    assert shown["linuxcnc"] == [[1, 2], *CORNERS, [2, 2]]
    assert shown["slicer"][5:] == CORNERS


def test_a_command_of_firmware_is_one_function(shown):
    assert shown["slicer"][:5] == [[1, 2], *CORNERS]


def test_a_code_of_fanuc_is_one_function(shown):
    assert shown["fanuc"] == [[1, 2], *CORNERS]


def test_without_its_function_the_code_is_refused():
    with pytest.raises(InputError, match=r"line 2: G13\.1: is not a word of LinuxCNC"):
        _ = LinuxCNC(text="G0 X1 Y2\nG91 G13.1 I5").program


def test_a_dialect_has_one_function_for_each_code():
    with pytest.raises(AssertionError, match=r"slicer has two functions for G92\.1"):

        @setting("shift", (SLICER,))
        def g92_1(state, block):
            """Once more."""


def test_every_code_says_what_it_means():
    for table in CODES.values():
        for name, code in table.items():
            assert code.name == name
            assert re.fullmatch(r"[A-Z].*[.]", code.meaning), name
            assert (code.kind is Kind.AUXILIARY) == bool(re.fullmatch(r"M[0-9]+", name)), name


def section(title):
    """The text below a title of the page, without programs."""
    text = PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    return re.sub(r"```.*?```", "", text, flags=re.DOTALL)


def codes_of(text):
    """Codes that a text names, and ranges of them, as "G54 to G59.3"."""
    names = re.findall(r"\b[GM][0-9]+(?:\.[0-9])?\b", text)
    ranges = re.findall(r"\b([GM])([0-9]+(?:\.[0-9])?) to \1([0-9]+(?:\.[0-9])?)\b", text)
    return names, [(letter, float(first), float(last)) for letter, first, last in ranges]


def listed(name, names, ranges):
    return name in names or any(
        name[0] == letter and first <= float(name[1:]) <= last for letter, first, last in ranges
    )


FLOW = {"M98", "M99"}  # which change the order of the lines


def test_the_page_lists_the_codes_of_linuxcnc():
    names, ranges = codes_of(section("LinuxCNC"))
    assert set(names) <= {*CODES["LinuxCNC"], *FLOW}
    assert [name for name in CODES["LinuxCNC"] if not listed(name, names, ranges)] == []


def test_codes_that_the_page_lists_for_slicers_are_there():
    """All others are counted, so those with a function and without an effect need not be listed."""
    names, ranges = codes_of(section("Slicers"))
    assert set(names) <= set(CODES["slicer"])
    effective = [name for name, code in CODES["slicer"].items() if code.handler]
    linuxcnc_names, linuxcnc_ranges = codes_of(section("LinuxCNC"))
    both = ([*names, *linuxcnc_names], [*ranges, *linuxcnc_ranges])
    assert [name for name in effective if f"`{name} " not in section("Slicers") and not listed(name, *both)] == []


def test_the_page_lists_the_codes_of_fanuc():
    names, ranges = codes_of(section("FANUC"))
    known = {*g_codes(), *(f"M{code:02}" for code in VALVE_CODES), *CALLS, *ENDS}
    assert set(names) <= known
    assert sorted(name for name in known if not listed(name, names, ranges)) == []
