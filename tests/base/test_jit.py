"""Compilation is told once for each subject, and only where nothing is cached."""

import io
import re
import types
from pathlib import Path

import numba
import pytest
from rich.console import Console

import gantrysim
from gantrysim.base import jit, progress
from gantrysim.cli import terminal


def test_compilation_is_told_once_for_each_subject():
    told = []
    progress.tell_compiling(told.append)
    add = numba.njit(lambda a, b: a + b)
    assert not told
    assert add(1, 2) == 3
    assert add(1.0, 2.0) == 3.0  # compiled again, for other types
    numba.njit(types.FunctionType((lambda a: a).__code__, {"__name__": "gantrysim.bead.laying"}))(1)
    assert told == ["your functions", "the bead"]


def test_every_room_with_compiled_functions_has_a_subject():
    package = Path(gantrysim.__file__).parent
    rooms = {
        file.relative_to(package).parts[0]
        for file in package.rglob("*.py")
        if re.search(r"^@(\w+_)?jit$", file.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert rooms
    assert rooms <= jit._SUBJECTS.keys() | {"base"}


@pytest.mark.parametrize("is_terminal", [True, False])
def test_the_command_tells_it_to_a_terminal_alone(monkeypatch, is_terminal):
    stream = io.StringIO()
    monkeypatch.setattr(terminal, "_messages", Console(file=stream, force_terminal=is_terminal))
    terminal.tell_compiling.__wrapped__()
    numba.njit(lambda a: a * 3)(2)
    assert stream.getvalue().count("compiling your functions, once for this machine") == int(is_terminal)


class _Collector:
    """Python's garbage collector: objects that are young, old, or frozen."""

    def __init__(self, frozen: int) -> None:
        self.young = 3
        self.old = 0
        self.frozen = frozen
        self.enabled = True

    def isenabled(self):
        return self.enabled

    def disable(self):
        self.enabled = False

    def enable(self):
        self.enabled = True

    def get_freeze_count(self):
        return self.frozen

    def freeze(self):
        self.frozen += self.young + self.old
        self.young = self.old = 0

    def unfreeze(self):
        self.old += self.frozen
        self.frozen = 0


@pytest.mark.parametrize("frozen", [0, 5])
def test_what_a_compilation_made_is_old_and_what_was_frozen_stays_so(monkeypatch, frozen):
    collector = _Collector(frozen)
    monkeypatch.setattr(jit, "gc", collector)
    monkeypatch.setattr(jit, "_freezes", jit._freezes.__wrapped__)
    pause = jit._WithoutCollection()
    pause.on_start(None)
    pause.on_start(None)  # what it calls is compiled within
    pause.on_end(None)
    assert not collector.enabled
    pause.on_end(None)
    assert collector.enabled
    assert collector.young == 0
    assert collector.frozen >= frozen
    assert (collector.old > 0) == (frozen == 0)
