"""What numba knows while it compiles: types of results, and LLVM code of operations, without looking for them again.

Numba types a function at least twice and once more where it makes its code. Every time it tries for a sum of two
numbers all that NumPy's `add` accepts, and it asks of every array that is looked at whether it wraps another.
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
    """A function of numba's, such as an operator, that remembers the types of its results."""

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
    """Numba's typing context with functions that remember."""

    def _lookup_global(self, gv: Any) -> Any:
        known = super()._lookup_global(gv)
        return _remembering(known) if type(known) is Function else known


@cache
def remembering(context: Any) -> Any:
    """Return a typing context that remembers, with all that is declared, now and later, in numba's own."""
    typing = object.__new__(_Typing)
    typing.__dict__ = context.__dict__
    return typing


class Target(CPUContext):  # type: ignore[misc]
    """Numba's context of the processor, which does not look for the same things again."""

    _sizes: ClassVar[dict[str, int]] = {}

    def get_function(self, fn: Any, sig: Any, _firstcall: bool = True) -> Any:
        """Return what makes the code of a function. No array here wraps another, which numba asks at every use."""
        return super().get_function(fn, sig, _firstcall=_firstcall and fn != "__array__")

    def get_abi_sizeof(self, ty: Any) -> int:
        """Return a type's size in bytes, for which LLVM parses a module."""
        name = str(ty)
        if name not in self._sizes:
            self._sizes[name] = super().get_abi_sizeof(ty)
        return self._sizes[name]
