"""What the key of a compiled function covers: all that is compiled into it, and nothing else."""

from __future__ import annotations

import dis
import importlib
import math
import re
import types
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

import gantrysim
from gantrysim.base.fingerprint import _names, code_hash, fingerprint
from gantrysim.base.jit import inner_jit

LIMIT = 2.0


def _with(function, **names):
    """Return a function with other globals, as if its module had been edited."""
    return types.FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__)


def _inner(x):
    return min(x, LIMIT)


def _other_inner(x):
    return max(x, LIMIT)


def _outer(x):
    return _inner(x) + 1.0


def test_a_key_changes_with_constants_and_with_what_is_called_and_with_nothing_else():
    key = fingerprint(_outer)
    assert key == fingerprint(_with(_outer))
    assert key == fingerprint(_with(_outer, unused=3.0))
    assert key != fingerprint(_with(_outer, _inner=_other_inner))
    assert key != fingerprint(_with(_outer, _inner=_with(_inner, LIMIT=3.0)))
    compiled = fingerprint(_with(_outer, _inner=inner_jit(_inner)))
    assert compiled == fingerprint(_with(_outer, _inner=inner_jit(_with(_inner))))
    assert compiled != fingerprint(_with(_outer, _inner=numba.njit(_inner)))  # a division by zero raises there
    assert compiled != fingerprint(_with(_outer, _inner=inner_jit(_with(_inner, LIMIT=3.0))))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("def f(a, b): return a - 2 * b", "def f(b, a): return b - 2 * a"),  # the same instructions, other keywords
        ("def f(a): return a + 1.0", "def f(a): return a + 1"),
        ("def f(a): return sin(a)", "def f(a): return cos(a)"),
        ("from math import sin as g\ndef f(a): return g(a)", "from math import cos as g\ndef f(a): return g(a)"),
        ("from numpy import sin as g\ndef f(a): return g(a)", "from numpy import cos as g\ndef f(a): return g(a)"),
        ("T = int32\ndef f(a): return T(a)", "T = int64\ndef f(a): return T(a)"),
        ("T = array([1.0, 2.0])\ndef f(a): return T[a]", "T = array([1.0, 3.0])\ndef f(a): return T[a]"),
        ("def f(a, b=1.0): return a + b", "def f(a, b=2.0): return a + b"),
        ("def f(a, *, b=1.0): return a + b", "def f(a, *, b=2.0): return a + b"),
        (
            "def make(k): return lambda: k\ng = make(1)\nh = make(2)",
            "def make(k): return lambda: k\ng = make(1)\nh = g",
        ),
    ],
)
def test_what_another_text_compiles_to_has_another_key(before, after):
    keys = []
    for text in (before, after):
        names = {"sin": math.sin, "cos": math.cos, "int32": numba.int32, "int64": numba.int64, "array": np.array}
        exec(text, names)
        keys.append(fingerprint(names["f"] if "f" in names else _with(_pair, g=names["g"], h=names["h"])))
    assert keys[0] != keys[1]


def _pair():
    return g() + h()  # noqa: F821 - given by the test


def test_docstrings_comments_and_lines_do_not_count():
    keys = set()
    for text in ('def f(a):\n    """Short."""\n    return a', '\n# f\ndef f(a):\n    """Long."""\n    return a  # a\n'):
        names = {}
        exec(text, names)
        keys.add((fingerprint(names["f"]), code_hash(names["f"])))
    assert len(keys) == 1


def test_the_globals_of_a_function_are_those_that_python_disassembles():
    """In whichever version of Python, whose instructions change."""
    codes = [
        _outer.__code__,
        dis.get_instructions.__code__,
        test_what_another_text_compiles_to_has_another_key.__code__,
    ]
    for code in codes:
        loaded = {step.argval for step in dis.get_instructions(code) if step.opname == "LOAD_GLOBAL"}
        nested = [constant for constant in code.co_consts if isinstance(constant, types.CodeType)]
        assert _names(code) == loaded.union(*map(_names, nested))
        assert loaded


def test_names_beyond_the_256th_are_found():
    """Their numbers need a second word of the instruction."""
    names = [f"n{k}" for k in range(300)]
    scope = dict.fromkeys(names, 1.0)
    exec(f"def f(): return {' + '.join(names)}", scope)
    assert fingerprint(scope["f"]) != fingerprint(_with(scope["f"], n299=2.0))


def test_a_key_refuses_what_it_does_not_cover():
    class Secret:
        pass

    with pytest.raises(TypeError, match=r"_inner = .*constants"):
        fingerprint(_with(_outer, _inner=Secret()))
    with pytest.raises(TypeError, match=r"_inner = <module 'gantrysim'.*functions by name"):
        fingerprint(_with(_outer, _inner=gantrysim))  # what it calls of a module is not known
    assert fingerprint(_with(_outer, _inner=math)) != fingerprint(_with(_outer, _inner=np))


def test_every_compiled_function_of_the_package_has_a_key():
    """One without would be compiled anew in every process."""
    package = Path(gantrysim.__file__).parent
    marked = re.compile(r"^@((plain|unlocked)_)?jit$", re.MULTILINE)
    keys = []
    for file in package.rglob("*.py"):
        if marked.search(file.read_text(encoding="utf-8")):
            module = importlib.import_module(".".join(file.relative_to(package.parent).with_suffix("").parts))
            functions = [value for value in vars(module).values() if isinstance(value, Dispatcher)]
            keys += [fingerprint(function) for function in functions if not isinstance(function._cache, NullCache)]
    assert len(keys) > 40
