"""Numba's typing and target contexts, with results that are looked up once.

Numba resolves the type of an operation at least twice while it types a function and once more while it writes LLVM
code; for a sum of two numbers it tries all signatures of NumPy's `add` each time. For every array that is used it looks
for a wrapper around it, and for none that exists it goes through all of its registries.
"""

from __future__ import annotations

from functools import cache
from typing import Any, ClassVar

from numba.core.cpu import CPUContext
from numba.core.datamodel import models, register_default
from numba.core.targetconfig import ConfigStack
from numba.core.types import Function
from numba.core.typing import Context


class _Operation(Function):  # type: ignore[misc]
    """Numba's type of a function or an operator, with the types of results that were resolved before."""

    def __init__(self, function: Function) -> None:
        super().__init__(function.templates)
        self.name = function.name  # which numba's messages show
        self._resolved: dict[Any, Any] = {}

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        key = args, tuple(kws.items()), ConfigStack.top_or_none()
        if key not in self._resolved:
            self._resolved[key] = super().get_call_type(context, args, kws)
        return self._resolved[key]


register_default(_Operation)(models.OpaqueModel)  # as numba stores its own functions


@cache
def _remembering(function: Function) -> _Operation:
    return _Operation(function)


class _Typing(Context):  # type: ignore[misc]
    """Numba's typing context with such functions."""

    def _lookup_global(self, gv: Any) -> Any:
        known = super()._lookup_global(gv)
        return _remembering(known) if type(known) is Function else known


@cache
def remembering(context: Any) -> Any:
    """Return a typing context that shares all declarations, present and future, with numba's own."""
    typing = object.__new__(_Typing)
    typing.__dict__ = context.__dict__
    return typing


class Target(CPUContext):  # type: ignore[misc]
    """Numba's target context of the processor, without repeated look-ups."""

    _sizes: ClassVar[dict[str, int]] = {}

    def get_function(self, fn: Any, sig: Any, _firstcall: bool = True) -> Any:
        """Return the function that writes the LLVM code of a call."""
        # No array here wraps another, for which numba would read all registries again at every use of one.
        return super().get_function(fn, sig, _firstcall=_firstcall and fn != "__array__")

    def get_abi_sizeof(self, ty: Any) -> int:
        """Return the size of an LLVM type in bytes; LLVM parses a module to find it."""
        name = str(ty)
        if name not in self._sizes:
            self._sizes[name] = super().get_abi_sizeof(ty)
        return self._sizes[name]
