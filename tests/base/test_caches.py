"""The cache of compiled functions: dropped with what is compiled into them, and with nothing else."""

from __future__ import annotations

import enum
import importlib.util
import sys

import pytest
from numba.core import config

from gantrysim.base import jit, pipeline

pytestmark = pytest.mark.skipif(not pipeline.is_tested(), reason="other versions of numba keep their own cache")

HELPERS = """
from gantrysim.base.jit import inner_jit

FACTOR = 2.0

@inner_jit
def scaled(value):
    return FACTOR * value
"""

KERNELS = """
import numba

from gantrysim.base.jit import jit
from {helpers} import scaled

@jit
def function(value):
    '''Return it, scaled.'''
    return scaled(value) + 1.0

@numba.njit(cache=True)
def numbas(value):
    return scaled(value) + 1.0
"""


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Returns a function that writes files of a module and its helpers, and imports them as a new process would."""
    monkeypatch.setattr(config, "CACHE_DIR", "")
    helpers = f"helpers_of_{tmp_path.name}"

    def load(name):
        spec = importlib.util.spec_from_file_location(name, tmp_path / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, name, module)
        spec.loader.exec_module(module)
        return module

    def write(helper_text=HELPERS, kernel_text=KERNELS):
        kernels = f"kernels_of_{tmp_path.name}"
        (tmp_path / f"{helpers}.py").write_text(helper_text)
        (tmp_path / f"{kernels}.py").write_text(kernel_text.format(helpers=helpers))
        monkeypatch.setattr("sys.dont_write_bytecode", True)  # files are as old as one another
        load(helpers)
        return load(kernels)

    return write


def is_loaded(function):
    """Whether a function that has been called came from a cache."""
    return sum(function.stats.cache_hits.values()) == 1


def test_a_changed_helper_is_compiled_anew_where_numba_itself_keeps_the_old_one(written):
    module = written()
    assert (module.function(3.0), module.numbas(3.0)) == (7.0, 7.0)
    assert not is_loaded(module.function)
    module = written()
    assert (module.function(3.0), module.numbas(3.0)) == (7.0, 7.0)
    assert is_loaded(module.function)
    module = written(HELPERS.replace("2.0", "5.0"))
    assert module.numbas(3.0) == 7.0
    assert module.function(3.0) == 16.0
    assert not is_loaded(module.function)
    module = written(HELPERS.replace("FACTOR * value", "FACTOR / value"))
    assert module.function(4.0) == 1.5


def test_an_edit_of_anything_else_keeps_what_is_compiled(written):
    module = written()
    assert module.function(3.0) == 7.0
    other = "\n# a comment\nOTHER = 3.0\n" + KERNELS.replace("Return it", "Return a value")
    module = written("# longer\n" + HELPERS + "\nUNUSED = 4.0\n", other)
    assert module.function(3.0) == 7.0
    assert is_loaded(module.function)
    module = written(kernel_text=KERNELS.replace("+ 1.0", "+ 2.0"))
    assert module.function(3.0) == 8.0
    assert not is_loaded(module.function)


def test_what_an_older_text_was_compiled_to_is_overwritten(written, tmp_path):
    for factor in ("2.0", "3.0", "4.0"):
        module = written(HELPERS.replace("2.0", factor))
        assert module.function(1.0) == float(factor) + 1.0
        files = sorted(file.suffix for file in tmp_path.glob("__pycache__/*function*"))
        assert files == [".nbc", ".nbi"]


def test_functions_with_other_values_in_their_closures_do_not_share_code(written):
    text = KERNELS + "\ndef adding(term):\n    @jit\n    def add(value):\n        return value + term\n    return add\n"
    for _ in range(2):
        module = written(kernel_text=text)
        functions = [module.adding(term) for term in (1.0, 10.0)]
        assert [function(2.0) for function in functions] == [3.0, 12.0]
    assert all(map(is_loaded, functions))


def test_an_index_that_names_the_code_of_another_key_is_not_believed(written, tmp_path):
    """As two processes that save at the same time may leave it; numba itself runs the other's code."""
    text = KERNELS + "\ndef adding(term):\n    @jit\n    def add(value):\n        return value + term\n    return add\n"
    module = written(kernel_text=text)
    functions = [module.adding(term) for term in (1.0, 10.0)]
    assert [function(2.0) for function in functions] == [3.0, 12.0]
    first, second = sorted(tmp_path.glob("__pycache__/*add.*.nbc"))
    first.write_bytes(second.read_bytes())
    module = written(kernel_text=text)
    functions = [module.adding(term) for term in (1.0, 10.0)]
    assert [function(2.0) for function in functions] == [3.0, 12.0]
    assert list(map(is_loaded, functions)) == [False, True]


def test_the_cache_is_where_numba_is_told_to_keep_it(written, tmp_path, monkeypatch):
    module = written()
    folder = tmp_path / "elsewhere"
    monkeypatch.setattr(config, "CACHE_DIR", str(folder))
    assert module.function(3.0) == 7.0
    assert sorted(file.suffix for file in folder.rglob("*.nb*")) == [".nbc", ".nbi"]
    assert not list(tmp_path.glob("__pycache__/*.nb*"))


class Kind(enum.Enum):
    """What numba knows and a key does not cover."""

    FIRST = 1
    SECOND = 2


def test_a_function_without_a_key_is_compiled_in_every_process():
    compiled = jit.jit(lambda: Kind.SECOND.value)
    assert compiled() == 2
    assert compiled._cache.cache_path is None
    assert jit.jit(lambda: 2)._cache.cache_path is not None


LOADED = """
import sys
import numba, numpy as np
from gantrysim.plots.style import _mark, thinned

x = np.arange(9000.0)
thinned(x, -x, 10)
print(sum(_mark.stats.cache_hits.values()), "numba.np.arraymath" in sys.modules)
print(numba.njit(lambda a: np.sort(a)[:2].sum())(-x))
"""


@pytest.mark.soak
def test_code_is_loaded_without_numba_s_declarations_and_compiled_with_them(fresh, tmp_path):
    for _ in range(2):
        done = fresh.run(LOADED, tmp_path)
        assert (done.status, done.error) == (0, "")
    assert done.output == "1 False\n-17997.0\n"
