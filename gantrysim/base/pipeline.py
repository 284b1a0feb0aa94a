"""A shorter way through numba's compiler for the functions of this package.

Numba compiles every function by itself: it optimises its code and makes machine code of it, although a helper is called
by other compiled functions alone, into which it is linked and optimised anew. Here a helper stays as LLVM code, what is
called from outside is optimised once and as a whole, and passes for what these functions do not contain are left out.
Floating-point numbers are the same: LLVM may not reorder their operations at any level.

This relies on parts of numba that are not public, so it is used for those versions alone with which it is tested.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import llvmlite.binding
import numba
from numba import _dynfunc
from numba.core.compiler import Compiler, CompilerBase, DefaultPassBuilder, Flags, _LowerResult
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.errors import new_error_context
from numba.core.ir_utils import build_definitions
from numba.core.target_extension import CPU, jit_registry
from numba.core.typed_passes import AnnotateTypes, InlineOverloads, NativeLowering, NopythonRewrites, PreLowerStripPhis
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FindLiterallyCalls,
    InlineClosureLikes,
    InlineInlinables,
    IRProcessing,
    LiteralPropagationSubPipelinePass,
    LiteralUnroll,
    MakeFunctionToJitFunction,
    RewriteDynamicRaises,
    WithLifting,
)

from gantrysim.base.contexts import Target, remembering
from gantrysim.base.libraries import PartLibrary, WholeLibrary

TESTED = ("0.68.",)

# closures, comprehensions, `with`, arguments that may be None, literals, exceptions, whole-array expressions
_LEFT_OUT = {
    WithLifting,
    InlineClosureLikes,
    DeadBranchPrune,
    RewriteDynamicRaises,
    MakeFunctionToJitFunction,
    InlineInlinables,
    FindLiterallyCalls,
    LiteralUnroll,
    LiteralPropagationSubPipelinePass,
    InlineOverloads,
    NopythonRewrites,
    IRProcessing,
    AnnotateTypes,
}
_LOWERING_ALONE = ("no_cpython_wrapper", "no_cfunc_wrapper", "no_compile")


class _Passes(PassManager):  # type: ignore[misc]
    """The shorter list of passes, without events and without an analysis of variables' lifetimes after each."""

    _ENFORCING = False

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:  # noqa: N802 - numba's name
        pss.analysis = self._analysis
        with new_error_context("Pass {name}", name=pss.name()):
            pss.run_pass(internal_state)


@contextmanager
def _unobserved() -> Iterator[None]:
    """Suppress, in the block, the two events of every call of LLVM: they take longer than most of the calls."""
    lock = llvmlite.binding.ffi.lib._lock
    with lock._lock:
        observers = lock._cblist
        lock._cblist = []
    try:
        yield
    finally:
        with lock._lock:
            lock._cblist = observers


@contextmanager
def _short_overloads() -> Iterator[None]:
    """Compile numba's own functions that are written in Python, such as max, as helpers in the block."""
    # dict's own method: the registry refuses to set a key again
    decorator = jit_registry[CPU]
    dict.__setitem__(jit_registry, CPU, partial(numba.jit, pipeline_class=PartCompiler))
    try:
        yield
    finally:
        dict.__setitem__(jit_registry, CPU, decorator)


class _QuickFlags(Flags):  # type: ignore[misc]
    """Numba's flags, compared without a list of all their values: numba looks them up at every operation."""

    __slots__ = ()
    _hash = hash(Flags())  # numba's covers the names alone

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Flags):
            return NotImplemented
        return bool(self._values == other._values or _changed(self) == _changed(other))


def _changed(flags: Flags) -> dict[str, Any]:
    """Return the flags that differ from their defaults."""
    return {name: value for name, value in flags._values.items() if value != flags.options[name].default}


@register_pass(mutates_CFG=False, analysis_only=False)
class _StripPhis(PreLowerStripPhis):  # type: ignore[misc]
    """Numba's pass without its analysis of variables' lifetimes, which the next pass repeats."""

    _name = "short_strip_phis"

    def run_pass(self, state: Any) -> bool:
        state.func_ir = self._strip_phi_nodes(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):  # type: ignore[misc]
    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        _check_returned(state)
        state.library = _library(PartLibrary, state)
        for name in _LOWERING_ALONE:
            setattr(state.flags, name, True)
        super().run_pass(state)
        result = state["cr"]
        description = result.fndesc
        # as numba's own context does, with no address: this function is not to be called from Python
        entry = _dynfunc.make_function(
            description.lookup_module(), description.qualname, "", 0, result.env, (state.library,)
        )
        state.targetctx.insert_user_function(entry, description, [state.library])
        state.reload_init.extend(state.library._reload_init)
        state["cr"] = _LowerResult(description, result.call_helper, cfunc=entry, env=result.env)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class _WholeLowering(NativeLowering):  # type: ignore[misc]
    _name = "whole_lowering"

    def run_pass(self, state: Any) -> bool:
        _check_returned(state)
        state.library = _library(WholeLibrary, state)
        for name, value in state.asked.items():
            setattr(state.flags, name, value)
        return bool(super().run_pass(state))


def _check_returned(state: Any) -> None:
    """Refuse an array returned by a function that counts no references: its caller would give it back once too often.

    Raises:
        TypeError: it returns one.
    """
    returned = state.return_type
    if not state.flags.nrt and state.targetctx.data_model_manager[returned].contains_nrt_meminfo():
        name = state.func_id.func_qualname
        raise TypeError(f"{name} returns {returned}: a function compiled without references to arrays must return none")


def _library(kind: type, state: Any) -> Any:
    library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
    library.enable_object_caching()
    state.status.fail_reason = None  # of the passes that were tried before
    return library


class _ShortCompiler(CompilerBase):  # type: ignore[misc]
    """Numba's compiler with fewer passes, and with all where these do not compile a function."""

    lowering: type

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        state = self.state
        # All functions are typed with equal flags: numba compiles its own, such as max, anew for every set of them.
        flags = _QuickFlags(state.flags)
        state.asked = {name: getattr(flags, name) for name in _LOWERING_ALONE if flags.is_set(name)}
        for name in state.asked:
            flags.discard(name)
        state.flags = flags
        state.typingctx = remembering(state.typingctx)
        state.targetctx.__class__ = Target
        state.targetctx.typing_context = state.typingctx

    def _compile_core(self) -> Any:
        with _unobserved(), _short_overloads():
            return super()._compile_core()

    def define_pipelines(self) -> list[Any]:
        return [self._passes(_LEFT_OUT), self._passes(set())]

    def _passes(self, left_out: set[type]) -> Any:
        manager = _Passes("short") if left_out else PassManager("whole")
        changed = {NativeLowering: self.lowering}
        if left_out:
            changed[PreLowerStripPhis] = _StripPhis
        for step, description in DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            if step not in left_out:
                manager.add_pass(changed.get(step, step), description)
        manager.finalize()
        return manager


class PartCompiler(_ShortCompiler):
    """Compiler of a helper that compiled functions alone call."""

    lowering = _PartLowering


class WholeCompiler(_ShortCompiler):
    """Compiler of a function that is called from Python or by its address."""

    lowering = _WholeLowering


def is_tested(version: str = numba.__version__) -> bool:
    """Return whether the parts of numba on which this relies are as they were tested."""
    return version.startswith(TESTED)


PART: type = PartCompiler if is_tested() else Compiler
WHOLE: type = WholeCompiler if is_tested() else Compiler
