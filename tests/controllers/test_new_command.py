"""A command of a BASIC is one function: added in a copy of the package, it is read, run, and known to messages."""

from __future__ import annotations

import re
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

import gantrysim
from gantrysim.controllers.softmc.basic.program import BLOCKS, COMMANDS
from gantrysim.controllers.trio.basic import commands
from gantrysim.controllers.trio.basic.text import STATEMENTS

PACKAGE = Path(gantrysim.__file__).parent
CORE = PACKAGE / "controllers" / "basic"

# a command of either BASIC: to move by the same distance on the first two axes
TRIO = '''

@command(1, 1, MOTION)
def cmd_diagonal(process: Process, values: Values, line: int) -> None:
    """DIAGONAL(distance): move by the same distance on two axes."""
    order(process, Move(MOVE, line, process.axes(2), Straight((values[0], values[0]))))
'''
SOFTMC = '''

@command("_DIAGONAL sum")
def cmd_diagonal(tree: Node) -> Action:
    """DIAGONAL distance: move by the same distance on two axes."""
    distance = expression(child(tree, 0))

    def act(scope: RoutineFrame) -> None:
        execution = scope.execution
        length = number("distance", distance(scope))
        execution.move(execution.elements.only_group(None), {"abs": 0.0}, Move((length, length)), False)

    return act
'''

ASKED = """
import sys
from pathlib import Path

import gantrysim

assert Path(gantrysim.__file__).parent == Path(sys.argv[2])
from gantrysim.base.errors import InputError
from gantrysim.controllers.softmc import Basic as McBasic
from gantrysim.controllers.trio import Basic as TrioBasic

def ends(program):
    return [round(float(x), 9) for x in program.setpoints(0.001).position[-1]]

def refusal(basic, text):
    try:
        basic(text)
    except InputError as error:
        return str(error)

if sys.argv[1] == "trio":
    assert ends(TrioBasic("FOR k = 1 TO 2: DIAGONAL(2 + k): NEXT k: MOVE(1)")) == [8.0, 7.0]
    assert refusal(TrioBasic, "DIAGONAL(1, 2)") == "line 1: DIAGONAL with 2 values: must have 1"
    assert refusal(TrioBasic, "DIAGONL(1)") == "line 1: unknown word 'DIAGONL': did you mean DIAGONAL?"
    word = "is a word of the language that cannot be assigned"
    assert refusal(TrioBasic, "DIAGONAL = 1") == f"line 1: DIAGONAL = ...: {word}"
else:
    text = "dim k as long\\nmove {1, 0}\\nfor k = 1 to 2\\ndiagonal 2 + k\\nnext\\n"
    assert ends(McBasic(text)) == [8.0, 7.0]
    assert refusal(McBasic, "diagonal\\n").startswith('line 1 "diagonal": the end of the line does not fit there')
    assert ", detach, diagonal, dim, " in refusal(McBasic, "horizontal 1\\n")
"""


def _copied_if_there(source, target):
    """Copy a file, but for one that goes meanwhile: other tests write compiled code beside it under passing names."""
    with suppress(FileNotFoundError):
        shutil.copy2(source, target)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("dialect", "file", "function"),
    [
        ("trio", "controllers/trio/basic/commands.py", TRIO),
        ("softmc", "controllers/softmc/basic/commands.py", SOFTMC),
    ],
)
def test_a_command_is_added_by_one_function_in_one_file(fresh, tmp_path, dialect, file, function):
    package = tmp_path / "gantrysim"
    shutil.copytree(PACKAGE, package, copy_function=_copied_if_there)
    module = package / file
    module.write_text(module.read_text(encoding="utf-8") + function, encoding="utf-8")
    done = fresh.run(ASKED, tmp_path, dialect, package)
    assert (done.status, done.error) == (0, "")


def test_every_command_is_the_function_of_its_name():
    for name, command in commands.COMMANDS.items():
        assert command.act.__name__ == f"cmd_{name.lower()}"
        assert command.act.__doc__.startswith(name)
    for table in (STATEMENTS, COMMANDS, BLOCKS):
        for name, handler in table.handlers.items():
            assert handler.__name__ == f"cmd_{name}"


def test_the_core_has_no_word_of_a_vendor():
    words = re.compile(r"trio|softmc|servotronix|mc-?basic|motion coordinator", re.IGNORECASE)
    files = list(CORE.glob("*.py"))
    assert CORE / "code.py" in files
    assert [file.name for file in files if words.search(file.read_text(encoding="utf-8"))] == []
