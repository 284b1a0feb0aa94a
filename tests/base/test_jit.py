"""Compilation is told once, and only where nothing is cached."""

import io

import numba
import pytest
from rich.console import Console

from gantrysim.base import jit
from gantrysim.cli import terminal


def test_compilation_is_told_once():
    told = []
    jit.tell_compiling(lambda: told.append(1))
    add = numba.njit(lambda a, b: a + b)
    assert not told
    assert add(1, 2) == 3
    assert add(1.0, 2.0) == 3.0  # compiled again, for other types
    assert told == [1]


@pytest.mark.parametrize("is_terminal", [True, False])
def test_the_command_tells_it_to_a_terminal_alone(monkeypatch, is_terminal):
    stream = io.StringIO()
    monkeypatch.setattr(terminal, "_messages", Console(file=stream, force_terminal=is_terminal))
    terminal.tell_compiling.__wrapped__()
    numba.njit(lambda a: a * 3)(2)
    assert stream.getvalue().count("compiling for this machine, once") == int(is_terminal)
