"""LLVM code of compiled functions: that of helpers waits until it is linked, what is called from outside is optimised.

For the versions of numba for which `gantrysim.base.pipeline` is used.
"""

from __future__ import annotations

from typing import Any

from llvmlite.binding import Linkage
from numba.core.codegen import JITCodeLibrary


class PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """LLVM code of a helper, which is optimised where it is linked into its callers."""

    _shared_module: Any

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Leave the code as it is: it is verified with its callers, and linked with what it calls there."""
        for library in self._linking_libraries:
            self._reload_init.update(library._reload_init)
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.external:
                function.linkage = "linkonce_odr"  # several callers may bring it along
        self._finalize_dynamic_globals()
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return the code with all that it calls, which numba's own libraries link."""
        if self._shared_module is None:
            self._shared_module = self._final_module.clone()
            _link_all(self._shared_module, self)
        return self._shared_module


def _link_all(module: Any, library: Any) -> None:
    """Link into a module all that a library calls: the code of each helper once, whichever of the others call it."""
    pending = [*library._linking_libraries]
    linked = {library}
    while pending:
        called = pending.pop()
        if called in linked:
            continue
        linked.add(called)
        if isinstance(called, PartLibrary):
            module.link_in(called._final_module, preserve=True)
            pending.extend(called._linking_libraries)
        else:
            module.link_in(called._get_module_for_linking(), preserve=True)


class WholeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of a function with all that it calls, optimised once."""

    _linking_libraries: list[Any]
    _wrapper: Any = None

    def add_llvm_module(self, ll_module: Any) -> None:
        """Add a module, but for that of the wrapper, through which Python calls the function: it is not optimised."""
        if ll_module.name == "wrapper":
            ll_module.data_layout = self._codegen._data_layout
            for function in ll_module.functions:
                if not function.is_declaration:
                    function.add_function_attribute("noinline")
                    function.add_function_attribute("optnone")
            self._wrapper = ll_module
        else:
            super().add_llvm_module(ll_module)

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Link all that the function calls, then optimise it and make its machine code."""
        for library in self._linking_libraries:
            self._reload_init.update(library._reload_init)
        _link_all(self._final_module, self)
        self._linking_libraries = []
        super().finalize()

    def _optimize_final_module(self) -> None:
        # numba's first pass inlines, so that counted references to arrays can be omitted: most functions count none
        if any(function.name == "NRT_incref" for function in self._final_module.functions):
            super()._optimize_final_module()
        else:
            passes, builder = self._codegen._module_pass_manager()
            passes.run(self._final_module, builder)
        if self._wrapper is not None:
            self._final_module.link_in(self._wrapper)
