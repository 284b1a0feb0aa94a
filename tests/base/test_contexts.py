"""What numba's contexts remember while this package compiles is what numba itself would find again."""

import operator

import llvmlite.binding
import numba
import pytest
from llvmlite import ir
from numba.core import errors, types
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack
from numba.core.typing.npydecl import Numpy_rules_ufunc

from gantrysim.base import contexts, pipeline
from gantrysim.base.jit import jit


@pytest.fixture
def typing():
    cpu_target.typing_context.refresh()
    return contexts.remembering(cpu_target.typing_context)


PAIRS = [
    (types.float64, types.float64),
    (types.int64, types.float64),
    (types.int64, types.int64),
    (types.boolean, types.int32),
    (types.float64[:, ::1], types.float64[::1]),
    (types.literal(2), types.float64),
]


@pytest.mark.parametrize("call", [operator.add, operator.pow, operator.truediv, operator.lt, max])
@pytest.mark.parametrize("arguments", PAIRS)
def test_types_of_results_are_numbas(typing, call, arguments):
    if call is max and any(isinstance(argument, types.Array) for argument in arguments):
        pytest.skip("max takes numbers")
    expected = cpu_target.typing_context.resolve_function_type(call, arguments, {})
    for _ in range(2):
        assert typing.resolve_function_type(call, arguments, {}) == expected


def test_a_type_is_resolved_once_for_equal_flags(typing, monkeypatch):
    tried = []
    generic = Numpy_rules_ufunc.generic
    monkeypatch.setattr(Numpy_rules_ufunc, "generic", lambda *call: tried.append(call) or generic(*call))
    counts = []
    flags = pipeline._QuickFlags()
    for release_gil in (False, False, True, True):
        flags.release_gil = release_gil
        tried.clear()
        with ConfigStack().enter(flags.copy()):
            typing.resolve_function_type(operator.sub, (types.float32, types.int16), {})
        counts.append(len(tried))
    assert counts[0] > 0
    assert counts == [counts[0], 0, counts[0], 0]


def test_what_numba_learns_later_is_known(typing):
    def norm(number):
        raise NotImplementedError

    def learn(kind, result):
        numba.extending.overload(norm)(lambda number: (lambda number: result) if isinstance(number, kind) else None)
        cpu_target.typing_context.refresh()

    learn(types.Integer, 2.0)
    assert typing.resolve_function_type(norm, (types.int64,), {}).return_type == types.float64
    with pytest.raises(errors.TypingError):
        typing.resolve_function_type(norm, (types.float64,), {})
    learn(types.Float, 3)
    learned = typing.resolve_function_type(norm, (types.float64,), {})
    assert types.unliteral(learned.return_type) == types.intp


def test_a_call_that_is_refused_is_refused_again_in_numbas_words(typing):
    with pytest.raises(errors.TypingError) as expected:
        cpu_target.typing_context.resolve_value_type(operator.add).get_call_type(
            cpu_target.typing_context, (types.float64, types.none), {}
        )
    for _ in range(2):
        with pytest.raises(errors.TypingError) as refused:
            typing.resolve_value_type(operator.add).get_call_type(typing, (types.float64, types.none), {})
        assert str(refused.value).split() == str(expected.value).split()


def test_sizes_are_llvms():
    target = cpu_target.target_context.subtarget()
    target.__class__ = contexts.Target
    pair = ir.LiteralStructType([ir.IntType(8), ir.DoubleType()])
    for kind in (ir.DoubleType(), pair, ir.ArrayType(ir.IntType(16), 7)):
        expected = cpu_target.target_context.get_abi_sizeof(kind)
        assert [target.get_abi_sizeof(kind), target.get_abi_sizeof(kind)] == [expected, expected]


def test_calls_of_llvm_are_observed_again_after_a_compilation():
    lock = llvmlite.binding.ffi.lib._lock
    observers = lock._cblist
    assert observers  # numba's clock
    during = []

    def refused():
        return len(3.5)

    monitored = pipeline._Passes.run

    def run(self, state):
        during.append(list(lock._cblist))
        return monitored(self, state)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline._Passes, "run", run)
        with pytest.raises(errors.TypingError):
            jit(refused)()
    assert during == [[]]
    assert lock._cblist is observers
