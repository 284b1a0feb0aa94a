"""Help texts with their units, `gantrysim info NAME`, and what an unknown key is answered with."""

import re

import pytest
import typer.main
from typer.core import TyperGroup

from gantrysim import InputError, Job
from gantrysim.cli.main import app
from gantrysim.job.key_list import sections
from gantrysim.job.loading import builtin_jobs
from gantrysim.job.programs import PROGRAMS
from gantrysim.machine.design.library import encoder_names, motor_names


def commands(command, path=()):
    yield path, command
    if isinstance(command, TyperGroup):
        for name, below in command.commands.items():
            yield from commands(below, (*path, name))


COMMANDS = dict(commands(typer.main.get_command(app)))


def joined(text):
    """The text without the breaks and frames that the terminal's width adds."""
    return re.sub(r"[\s│]+", "", text)


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_help_shows_every_unit_in_brackets(path, gantrysim_command):
    status, printed, _ = gantrysim_command(*path, "--help")
    assert status == 0
    assert "\\[" not in printed
    texts = [getattr(described, "help", None) or "" for described in (COMMANDS[path], *COMMANDS[path].params)]
    for text in texts:
        for unit in re.findall(r"\[[^\]]*\]", text):
            assert joined(unit) in joined(printed), text
        # rich takes a bracket before a letter for markup unless a backslash stands before it
        assert not re.search(r"(?<!\\)\[[a-zA-Zµ/]", text), text


def test_some_help_has_units():
    """The test above would also pass without any."""
    texts = [str(getattr(parameter, "help", "")) for command in COMMANDS.values() for parameter in command.params]
    assert sum("\\[mm" in text for text in texts) >= 4


def test_an_unknown_key_has_the_three_nearest_and_where_all_are(tmp_path):
    with pytest.raises(InputError) as caught:
        Job.load("an225", ["dispenser.closng=1"])
    text = str(caught.value)
    assert text.startswith("unknown key 'dispenser.closng': did you mean dispenser.closing, ")
    assert text.endswith("? all keys: gantrysim info keys")
    assert len(text.split("did you mean ")[1].split("?")[0].replace(" or ", ", ").split(", ")) == 3
    file = tmp_path / "mine.toml"
    file.write_text('name = "a"\n[program]\ncontroller = "softmc.Program"\n[servo]\ndampng = 1\n')
    with pytest.raises(InputError, match=r"unknown key servo.dampng: did you mean damping.*\? all keys: "):
        Job.load(file)
    with pytest.raises(InputError, match=r"^unknown key 'qqqqqq': all keys: gantrysim info keys"):
        Job.load("an225", ["qqqqqq=1"])


@pytest.fixture
def wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")


NAMES = {
    "xyz": ("peak", "verdict"),
    "an225": ('controller = "trio.MoveSpiral"', "integral_time = 0.03"),
    "slicer.Program": ("program.corner_tolerance", "an assumption [mm]", "program.text"),
    "servo.damping": ("servo.damping", "damping ratio zeta of the loop"),
    "closing": ("dispenser.closing", "time constant of falling flow or pressure [s]"),
    "speed": ('controller = "trio.MoveSpiral"', 'controller = "cad.Drawing"', "[mm/s]"),
}


@pytest.mark.parametrize("name", NAMES)
def test_info_shows_one_thing(name, gantrysim_command, wide):
    status, printed, _ = gantrysim_command("info", name)
    assert status == 0
    for text in NAMES[name]:
        assert text in printed
    others = {"xyzr", "fanuc-conical", "simulation.settle"}
    assert not any(other in printed for other in others)


def test_the_default_gains_are_those_of_a_job(gantrysim_command, wide):
    status, printed, _ = gantrysim_command("info", "gains")
    assert status == 0
    assert "and an integral time of 0.03 s" in printed
    assert "ki N·m/(u·s)" in printed


def test_info_keys_lists_every_key(gantrysim_command, wide):
    status, printed, _ = gantrysim_command("info", "keys")
    assert status == 0
    for keys in sections().values():
        for key in keys:
            assert key.name in printed


def test_an_unknown_name_has_the_nearest(gantrysim_command):
    status, _, errors = gantrysim_command("info", "an224")
    assert status == 2
    assert errors.startswith("error: unknown name 'an224': did you mean an225")
    assert "gantrysim info keys" in errors
    assert gantrysim_command("info", "xy", "--model", "xyz")[0] == 2


def test_names_are_of_one_kind_each():
    keys = {key.name for table in sections().values() for key in table}
    assert not keys & {*builtin_jobs(), *PROGRAMS}


def test_info_lists_the_motors_and_encoders_that_a_table_may_name(gantrysim_command):
    status, printed, _ = gantrysim_command("info", "motors")
    assert status == 0
    text = joined(printed)
    assert all(name in text for name in (*motor_names(), *encoder_names()))
    # the catalogue's values of one motor: 24 V, 0.177 N·m, 30 A, 142 g·cm²
    row = next(line for line in printed.splitlines() if "maxon-re40-24 " in line)
    assert [float(number) for number in re.findall(r"\d+\.?\d*", row.split("brushed")[1])] == [24, 0.177, 30, 0.142]
