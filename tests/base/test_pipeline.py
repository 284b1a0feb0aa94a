"""The shorter way through numba's compiler gives the numbers of numba's own, and steps aside for untested versions."""

import math
import subprocess
import sys

import llvmlite.binding
import numba
import numpy as np
import pytest
from numba.core.caching import NullCache
from numba.core.compiler import Flags
from numba.core.target_extension import CPU, jit_registry

from gantrysim.base import libraries, pipeline
from gantrysim.base.jit import inner_jit, jit, plain_inner_jit, plain_jit

ROWS = np.random.default_rng(3).normal(size=(50, 3))


@inner_jit
def _length(row):
    return math.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2])


@inner_jit
def _mean(rows, weight):
    total = 0.0
    for k in range(rows.shape[0]):
        total += weight * _length(rows[k]) / (k + 1)
    return total


def weighted(rows, weight):
    highest = -np.inf
    for k in range(rows.shape[0]):
        highest = max(highest, abs(rows[k, 0]) ** 1.5)
    return _mean(rows, weight) - highest


def test_numbers_are_those_of_numbas_own_compiler():
    own = numba.njit(error_model="numpy")(weighted)
    assert jit(weighted)(ROWS, 0.3) == own(ROWS, 0.3)


def test_a_helper_has_no_code_of_its_own():
    jit(weighted)(ROWS, 0.3)
    (helper,) = _length.overloads.values()
    assert isinstance(helper.library, libraries.PartLibrary)
    assert helper.library.get_pointer_to_function(helper.fndesc.llvm_func_name) == 0


def test_numbas_own_functions_are_helpers_too(monkeypatch):
    def highest(numbers):
        return max(numbers)

    numbers = tuple(np.arange(7, dtype=np.float32))  # so many are compared nowhere else
    names = []
    finalize = libraries.PartLibrary.finalize
    monkeypatch.setattr(libraries.PartLibrary, "finalize", lambda part: names.append(part.name) or finalize(part))
    compiled = jit(highest)
    compiled._cache = NullCache()  # from which nothing is compiled
    assert compiled(numbers) == 6
    assert any("ol_max" in name for name in names)
    names.clear()
    assert numba.njit(highest)(numbers) == 6
    assert not names
    assert jit_registry[CPU] is numba.jit


def test_a_function_of_a_users_may_call_a_helper():
    assert numba.njit(lambda rows: _mean(rows, 2.0))(ROWS) == jit(lambda rows: _mean(rows, 2.0))(ROWS)


def test_a_helper_of_two_helpers_is_linked_once(monkeypatch):
    @inner_jit
    def square(row):
        return row[0] * row[0]

    @inner_jit
    def first(rows):
        return square(rows[0])

    @inner_jit
    def last(rows):
        return square(rows[-1])

    linked = []
    link_in = llvmlite.binding.ModuleRef.link_in

    def counted(module, other, preserve=False):
        if preserve:  # code that is linked elsewhere too
            linked.append(other.name.rpartition(".")[2])
        link_in(module, other, preserve)

    monkeypatch.setattr(llvmlite.binding.ModuleRef, "link_in", counted)
    compiled = jit(lambda rows: first(rows) + last(rows))
    compiled._cache = NullCache()  # from which nothing is compiled
    assert compiled(ROWS) == ROWS[0, 0] * ROWS[0, 0] + ROWS[-1, 0] * ROWS[-1, 0]
    assert {"square", "first", "last"} <= set(linked)
    assert len(linked) == len(set(linked))


def _attributes(compiled):
    """Return the attributes of a compiled function's wrapper, and of the function itself."""
    compiled._cache = NullCache()  # code from a cache cannot be looked at
    compiled(ROWS)
    (result,) = compiled.overloads.values()
    description = result.fndesc
    functions = [
        result.library.get_function(name)
        for name in (description.llvm_cpython_wrapper_name, description.llvm_func_name)
    ]
    return [b" ".join(function.attributes) for function in functions]


@pytest.mark.parametrize("decorator", [jit, plain_jit])
def test_the_wrapper_alone_is_not_optimised(decorator):
    wrapper, function = _attributes(decorator(lambda rows: rows[0, 0] * rows[1, 1]))
    assert b"optnone" in wrapper
    assert b"optnone" not in function


def test_errors_pass_the_wrapper():
    def positive(rows):
        if rows[0, 0] < 0.0:
            raise ValueError("must be positive")
        return rows

    compiled = jit(positive)
    assert compiled(np.abs(ROWS)).tolist() == np.abs(ROWS).tolist()
    with pytest.raises(ValueError, match="must be positive"):
        compiled(-np.abs(ROWS))


def test_what_the_short_way_does_not_compile_takes_all_passes():
    def scaled(values, factor):
        if factor is None:
            return len([value for value in values])  # noqa: C416
        return factor * values[0]

    compiled = jit(scaled)
    assert compiled(np.arange(3.0), None) == 3
    assert compiled(np.arange(1.0, 3.0), 4.0) == 4.0


@plain_inner_jit
def _first(row):
    return row[0] + row[1]


def sums(rows, into):
    for k in range(rows.shape[0]):
        row = rows[k]
        into[k] = _first(row) + row[2]


def test_a_plain_function_counts_no_references():
    into = np.empty(len(ROWS))
    compiled = plain_jit(sums)
    compiled._cache = NullCache()  # code from a cache cannot be looked at
    compiled(ROWS, into)
    assert into.tolist() == [row[0] + row[1] + row[2] for row in ROWS.tolist()]
    (code,) = compiled.inspect_llvm().values()
    same = numba.njit(lambda rows: rows)
    same(ROWS)
    (counting,) = same.inspect_llvm().values()
    assert "call void @NRT_incref" in counting  # which is how references are counted
    assert "call void @NRT_incref" not in code


def test_a_plain_function_that_returns_an_array_is_refused():
    @plain_inner_jit
    def tail(rows):
        return rows[1:], 1.0

    def last(rows):
        return tail(rows)[0][-1, 0]

    with pytest.raises(TypeError, match=r"tail returns .*array.* must return none"):
        jit(last)(ROWS)
    with pytest.raises(TypeError, match="must return none"):
        plain_jit(lambda rows: (rows, 1.0))(ROWS)


def test_flags_compare_as_numbas_own():
    one = pipeline._QuickFlags()
    other = pipeline._QuickFlags()
    assert one == other == Flags()
    assert hash(one) == hash(Flags())
    other.release_gil = True
    assert one != other
    one.release_gil = True
    assert one == other
    assert hash(one) == hash(other)
    one.nrt = False  # as is the default
    assert one == other


def test_versions_that_are_tested():
    assert pipeline.is_tested("0.68.1")
    assert not pipeline.is_tested("0.67.0")
    assert not pipeline.is_tested("0.69.0rc1")
    assert pipeline.is_tested() == (pipeline.PART is pipeline.PartCompiler)


def test_an_untested_version_of_numba_compiles_as_it_does():
    code = (
        "import numba; numba.__version__ = '0.69.0'\n"
        "from gantrysim.base import pipeline, jit\n"
        "print(pipeline.PART.__name__, pipeline.WHOLE.__name__)\n"
        "double = jit.inner_jit(lambda a: 2.0 * a)\n"
        "print(jit.jit(lambda a: double(a) + 1.0)(3.0))\n"
        "from gantrysim.plots.style import _mark\n"
        "print(type(_mark._cache).__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "Compiler Compiler\n7.0\nFunctionCache\n"
